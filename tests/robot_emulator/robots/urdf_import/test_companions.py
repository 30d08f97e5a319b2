"""What meshes name goes with them into a robot's folder: materials, buffers, textures."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from support.urdfs.vendor_arm import JOINTS, LINKS, PACKAGE, urdf, vendor_folder

from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.folder import write_folder, wrong_meshes
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.robot_emulator.robots.yaml_file import read_files

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
GLTF = {
    "asset": {"version": "2.0"},
    "buffers": [{"uri": "hand%20shape.bin", "byteLength": 4}, {"uri": "data:;base64,AAAA"}],
    "images": [{"uri": "textures/skin.png"}],
}
COLLADA = (
    "<COLLADA><library_images><image><init_from>./paint.jpg</init_from></image></library_images>"
    "<surface><init_from>paint_jpg</init_from></surface></COLLADA>"
)


def drawn(mesh: str) -> str:
    """The visual of a mesh in another folder of the package."""
    name = f"package://{PACKAGE}/{mesh}"
    return f'<visual><geometry><mesh filename="{name}"/></geometry></visual></link>'


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The vendor's package, whose fore link and hand are drawn besides."""
    vendor_folder(tmp_path)
    return tmp_path / PACKAGE


def imported(package: Path, fore: str, hand: str = "") -> tuple[Path, str]:
    """The folder of its robot, and what was said of its import."""
    links, last = LINKS.rsplit("</link>", 1)[0], LINKS.rsplit("</link>", 1)[1]
    before, middle, after = links.rpartition('<link name="hand">')
    text = before.removesuffix("</link>") + drawn(fore) + middle + after
    text += (drawn(hand) if hand else "</link>") + last
    path = package / "urdf" / "arm.urdf"
    path.write_text(urdf(text, JOINTS))
    robot, folder = import_robot(path), package.parent / "made"
    write_folder(robot, folder)
    assert load(folder).n == 3
    return folder, "\n".join(note.line() for note in robot.notes)


def test_an_obj_keeps_its_material_and_this_its_textures(package):
    shown = package / "shown"
    (shown / "textures").mkdir(parents=True)
    (shown / "fore.obj").write_text(f"mtllib fore arm.mtl\n{TRIANGLE}")
    (shown / "fore arm.mtl").write_text(
        "newmtl a\n  map_Kd -s 1 1 1 textures/skin.png\nbump textures/skin.png\nmap_Ks gone.png\n"
    )
    (shown / "textures" / "skin.png").write_bytes(b"skin")
    folder, said = imported(package, "shown/fore.obj")
    for name in ("fore arm.mtl", "textures/skin.png"):
        assert (folder / "meshes" / name).read_bytes() == (shown / name).read_bytes()
    assert "gone.png" in said
    file = folder / "robot.yaml"
    robot = read_files(file)[0]
    kept = {each.file: each.sha256 for mesh in robot.meshes for each in mesh.companions}
    assert kept["textures/skin.png"] == hashlib.sha256(b"skin").hexdigest()
    assert len(kept) == 2
    assert wrong_meshes(file, robot) == []
    (folder / "meshes" / "textures" / "skin.png").write_bytes(b"paint")
    (folder / "meshes" / "fore arm.mtl").unlink()
    assert len(wrong_meshes(file, robot)) == 2


@pytest.mark.parametrize("binary", [False, True])
def test_a_gltf_keeps_its_buffers_and_images(package, binary):
    shown = package / "shown"
    (shown / "textures").mkdir(parents=True)
    text = json.dumps(GLTF).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text)).to_bytes(4, "little")
    data = head + len(text).to_bytes(4, "little") + b"JSON" + text if binary else text
    name = f"fore.{'glb' if binary else 'gltf'}"
    (shown / name).write_bytes(data)
    (shown / "hand shape.bin").write_bytes(b"1234")
    (shown / "textures" / "skin.png").write_bytes(b"skin")
    folder, _ = imported(package, f"shown/{name}")
    assert (folder / "meshes" / "hand shape.bin").read_bytes() == b"1234"
    assert (folder / "meshes" / "textures" / "skin.png").read_bytes() == b"skin"


def test_a_collada_file_keeps_its_images(package):
    shown = package / "shown"
    shown.mkdir()
    (shown / "fore.dae").write_text(COLLADA)
    (shown / "paint.jpg").write_bytes(b"paint")
    folder, _ = imported(package, "shown/fore.dae")
    assert (folder / "meshes" / "paint.jpg").read_bytes() == b"paint"


@pytest.mark.parametrize(
    "name", ["../secret.png", "/etc/hostname", "a/../../secret.png", ".hidden.png", "run.sh"]
)
def test_nothing_from_elsewhere_is_taken_along(package, name):
    shown = package / "shown"
    shown.mkdir()
    (shown / "fore.obj").write_text(f"mtllib fore.mtl\n{TRIANGLE}")
    (shown / "fore.mtl").write_text(f"map_Kd {name}\n")
    for place in (package / "secret.png", shown / ".hidden.png", shown / "run.sh"):
        place.write_bytes(b"secret")
    folder, said = imported(package, "shown/fore.obj")
    assert name in said
    assert {path.read_bytes() for path in folder.rglob("*") if path.is_file()}.isdisjoint(
        {b"secret"}
    )


def test_of_two_files_of_one_name_the_first_is_kept(package):
    for folder in ("one", "two"):
        (package / folder).mkdir()
        (package / folder / "part.obj").write_text(f"mtllib part.mtl\n{TRIANGLE}# {folder}\n")
        (package / folder / "part.mtl").write_text(f"newmtl {folder}\n")
    made, said = imported(package, "one/part.obj", "two/part.obj")
    assert (made / "meshes" / "part.mtl").read_text() == "newmtl one\n"
    assert "part.mtl" in said
