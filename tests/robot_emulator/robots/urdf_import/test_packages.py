"""Where the meshes of a URDF are found: relative, file://, package://, and nowhere."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.urdfs.vendor_arm import PACKAGE, stl, tube, urdf, vendor_folder

from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.robot_emulator.robots.urdf_import.packages import SearchPath, UnresolvedError


@pytest.fixture
def apart(tmp_path, monkeypatch) -> tuple[Path, Path]:
    """The folder of a URDF that is not in its package, and the folder that holds that."""
    for variable in ("HOAP3_PACKAGE_PATH", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    vendor_folder(tmp_path / "share")
    (tmp_path / "mine").mkdir()
    return tmp_path / "mine", tmp_path / "share"


MESH = f"package://{PACKAGE}/meshes/upper.stl"


def test_a_package_is_found_among_the_parents_of_the_file(tmp_path):
    folder = vendor_folder(tmp_path).parent
    assert SearchPath(folder).find(MESH) == tmp_path / PACKAGE / "meshes" / "upper.stl"


def test_a_link_to_the_file_leads_to_the_parents_of_what_it_links_to(tmp_path, apart):
    here = tmp_path / "shortcut"
    here.symlink_to(apart[1] / PACKAGE / "urdf")
    assert SearchPath(here).find(MESH).name == "upper.stl"


def test_a_folder_that_is_named_and_does_not_exist_is_refused(tmp_path):
    file, nowhere = vendor_folder(tmp_path), tmp_path / "nowhere"
    with pytest.raises(ConfigError) as caught:
        import_robot(file, [tmp_path, nowhere])
    assert (caught.value.file, caught.value.value) == ("--package-path", str(nowhere))
    import_robot(file, [tmp_path])


@pytest.mark.parametrize("inside", [".", PACKAGE])
def test_a_package_is_found_in_the_folders_that_are_named(apart, inside):
    folder, share = apart
    assert SearchPath(folder, [share / inside]).find(MESH).is_relative_to(share)


@pytest.mark.parametrize(
    ("variable", "part"),
    [("HOAP3_PACKAGE_PATH", "share"), ("ROS_PACKAGE_PATH", "share"), ("AMENT_PREFIX_PATH", "")],
)
def test_a_package_is_found_by_the_environment(apart, monkeypatch, variable, part):
    folder, share = apart
    monkeypatch.setenv(variable, f"/nowhere:{share.parent / part}")
    assert SearchPath(folder).find(MESH).is_relative_to(share)


def test_a_folder_of_another_name_is_the_package_that_its_package_xml_says(apart):
    folder, share = apart
    (share / PACKAGE).rename(share / "acme-main")
    with pytest.raises(UnresolvedError):
        SearchPath(folder, [share / "acme-main"]).find(MESH)
    text = f"<package><name> {PACKAGE} </name></package>"
    (share / "acme-main" / "package.xml").write_text(text)
    assert SearchPath(folder, [share / "acme-main"]).find(MESH).name == "upper.stl"


@pytest.mark.parametrize("form", ["../meshes/upper.stl", "file://{0}", "file://localhost{0}"])
def test_a_file_is_found_by_its_path(tmp_path, form):
    folder = vendor_folder(tmp_path).parent
    mesh = tmp_path / PACKAGE / "meshes" / "upper.stl"
    assert SearchPath(folder).find(form.format(mesh)) == mesh


@pytest.mark.parametrize(
    "name",
    [
        f"package://{PACKAGE}/../secret.stl",
        f"package://{PACKAGE}/%2e%2e/secret.stl",
        "package://../secret.stl",
        "package://./secret.stl",
        "package:///",
        "package://",
        "package://a\0b/secret.stl",
        "http://example.org/mesh.stl",
        "",
        "\0",
        "file://",
    ],
)
def test_what_leads_elsewhere_or_nowhere_is_refused(tmp_path, name):
    folder = vendor_folder(tmp_path).parent
    (tmp_path / "secret.stl").write_text("")
    with pytest.raises(UnresolvedError):
        SearchPath(folder).find(name)


def test_a_mesh_that_is_nowhere_is_said_and_gives_no_shape(tmp_path):
    path = vendor_folder(tmp_path)
    (tmp_path / PACKAGE / "meshes" / "upper.stl").unlink()
    robot = import_robot(path)
    assert [each.link for each in robot.parts.visuals] == ["base"]
    missing = [note for note in robot.notes if any("upper.stl" in name for name in note.names)]
    assert {note.about for note in missing} == {"left out"}
    assert len(missing) == 2  # the one that is drawn, and the one that collides
    with pytest.raises(DescriptionError, match=r"link 'upper'.*upper\.stl"):
        import_robot(path, strict=True)


def test_a_package_that_is_nowhere_is_said_with_what_to_do(apart):
    folder, share = apart
    path = folder / "arm.urdf"
    path.write_text(urdf())
    robot = import_robot(path)
    texts = [note.text for note in robot.notes if PACKAGE in note.text]
    assert len(texts) == 2
    assert all("--package-path" in text and "HOAP3_PACKAGE_PATH" in text for text in texts)
    assert not any(PACKAGE in note.text for note in import_robot(path, [share]).notes)


WRONG_MESHES = {
    "nan": stl(tube(0.1, 0.2)).replace("vertex", "vertex nan 0 0\nvertex", 1).encode(),
    "nothing": b"",
    "no mesh": b"solid part\nfacet normal",
    "binary": b"\x00\xff" * 500,
    "far": stl(tube(0.1, 0.2) * 1e6).encode(),
}


@pytest.mark.parametrize("case", WRONG_MESHES)
def test_a_mesh_that_cannot_be_used_is_said_and_gives_no_shape(tmp_path, case):
    path = vendor_folder(tmp_path)
    (tmp_path / PACKAGE / "meshes" / "upper.stl").write_bytes(WRONG_MESHES[case])
    robot = import_robot(path)
    assert robot.description.urdf.count("<collision>") == 1  # that of the base
    assert any(
        note.about == "left out" and any("upper.stl" in name for name in note.names)
        for note in robot.notes
    )


def test_a_huge_mesh_is_not_read(tmp_path):
    path = vendor_folder(tmp_path)
    with open(tmp_path / PACKAGE / "meshes" / "upper.stl", "wb") as stream:
        stream.truncate(1 << 32)  # without taking any place on the disk
    notes = [note for note in import_robot(path).notes if "MiB" in note.text]
    assert len(notes) == 2


def test_what_is_no_mesh_by_its_name_is_neither_read_nor_copied(tmp_path):
    mesh = f'"package://{PACKAGE}/meshes/upper.stl"'
    path = vendor_folder(tmp_path, urdf().replace(mesh, '"/etc/passwd"'))
    robot = import_robot(path)
    assert [each.link for each in robot.parts.visuals] == ["base"]


def test_a_mesh_through_a_symbolic_link_is_read(tmp_path):
    path = vendor_folder(tmp_path)
    mesh = tmp_path / PACKAGE / "meshes" / "upper.stl"
    mesh.rename(tmp_path / "elsewhere.stl")
    mesh.symlink_to(tmp_path / "elsewhere.stl")
    assert [each.link for each in import_robot(path).parts.visuals] == ["base", "upper"]


def test_a_fifo_in_place_of_a_mesh_does_not_block(tmp_path):
    import os

    path = vendor_folder(tmp_path)
    mesh = tmp_path / PACKAGE / "meshes" / "upper.stl"
    mesh.unlink()
    os.mkfifo(mesh)
    assert [each.link for each in import_robot(path).parts.visuals] == ["base"]


@pytest.mark.parametrize("form", ["package://{0}", "$(find {0})", "$(find-pkg-share {0})"])
def test_a_package_is_found_from_a_folder_beside_it(tmp_path, monkeypatch, form):
    vendor_folder(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    search = SearchPath(Path("..", PACKAGE, "urdf"))
    mesh = tmp_path / PACKAGE / "meshes" / "upper.stl"
    assert search.find(f"{form.format(PACKAGE)}/meshes/upper.stl") == mesh
    assert SearchPath(tmp_path, [Path("..")]).find(MESH) == mesh
