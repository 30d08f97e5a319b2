"""Where a URDF comes from: a xacro file or `robot_descriptions`, through libraries or without."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from support.urdfs.vendor_arm import PACKAGE, urdf, vendor_folder

from hoap3.protocol.errors import ConfigError, DescriptionError, NotInstalledError, UrdfWarning
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
XACRO = urdf().replace("<robot", f"<robot {XMLNS}", 1).replace(
    "<link", '<xacro:property name="m" value="2"/><link', 1
)  # fmt: skip

STAND_IN = """
from pathlib import Path
class packages:
    looked_in = []
    look_in = looked_in.extend
class XacroDoc:
    @classmethod
    def from_file(cls, path, subargs, resolve_packages):
        document = cls()
        document.text = Path(path).read_text()
        if "raise" in subargs or "fails" in document.text:
            raise ValueError("undefined\\nsubstitution")
        document.name = subargs.get("name", "from_xacro")
        return document
    def to_urdf_string(self):
        head = '<xacro:property name="m" value="2"/>'
        return self.text.replace(head, "").replace("acme_arm", self.name)
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """Write a stand-in for an optional library, and import none of it from elsewhere."""

    def write(name: str, text: str) -> None:
        path = tmp_path / "library" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    for name in [each for each in sys.modules if each.startswith(("xacrodoc", "robot_descr"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(tmp_path / "library"))
    yield write
    for name in [each for each in sys.modules if each.startswith(("xacrodoc", "robot_descr"))]:
        del sys.modules[name]


@pytest.fixture
def no_library(monkeypatch):
    for name in ("xacrodoc", "robot_descriptions"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    kept = [each for each in sys.path if not (Path(each) / "xacrodoc").exists()]
    kept = [each for each in kept if not (Path(each) / "robot_descriptions").exists()]
    monkeypatch.setattr(sys, "path", kept)


def xacro_file(at: Path, name: str = "arm.urdf.xacro", text: str = XACRO) -> Path:
    path = vendor_folder(at).with_name(name)
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "unexpanded.urdf"])
def test_a_xacro_file_without_its_library_is_told_how_to_install_it(tmp_path, no_library, name):
    with pytest.raises(NotInstalledError, match=r"pip install 'hoap3\[xacro\]'"):
        load(xacro_file(tmp_path, name))


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "unexpanded.urdf"])
def test_a_xacro_file_is_expanded_with_the_library(tmp_path, library, name):
    library("xacrodoc.py", STAND_IN)
    robot = import_robot(xacro_file(tmp_path, name))
    assert robot.description.name == "from_xacro"
    assert robot.parts.visuals  # package:// is ours to resolve


def test_a_macro_that_fails_is_told_in_one_line(tmp_path, library):
    library("xacrodoc.py", STAND_IN)
    with pytest.raises(DescriptionError, match=r"arm\.xacro: .*undefined") as caught:
        import_robot(xacro_file(tmp_path, "arm.xacro", XACRO + "<!-- fails -->"))
    assert "\n" not in str(caught.value)


def test_a_prefix_that_is_not_declared_is_called_xacros(tmp_path):
    with pytest.raises(DescriptionError, match="xmlns:xacro"):
        import_robot(xacro_file(tmp_path, "arm.urdf", XACRO.replace(XMLNS, "")))


def test_robot_descriptions_without_its_library_is_told_how_to_install_it(no_library):
    with pytest.raises(NotInstalledError, match=r"pip install 'hoap3\[descriptions\]'"):
        load("robot_descriptions:panda_description")


def test_a_robot_of_robot_descriptions_is_read(tmp_path, library):
    path = vendor_folder(tmp_path)
    library("robot_descriptions/__init__.py", "")
    library(
        "robot_descriptions/acme_description.py",
        f"PACKAGE_PATH = {str(tmp_path / PACKAGE)!r}\nURDF_PATH = {str(path)!r}\n",
    )
    with pytest.warns(UrdfWarning):
        robot = load("robot_descriptions:acme_description")
    assert robot.name == "acme_arm"
    assert "<cylinder" in robot.urdf


def test_a_xacro_of_robot_descriptions_gets_its_arguments(tmp_path, library):
    path = xacro_file(tmp_path)
    library("xacrodoc.py", STAND_IN)
    library("robot_descriptions/__init__.py", "")
    library(
        "robot_descriptions/acme_description.py",
        f"XACRO_PATH = {str(path)!r}\nXACRO_ARGS = {{'name': 'seven'}}\n",
    )
    assert import_robot("robot_descriptions:acme_description").description.name == "seven"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("robot_descriptions:", "NAME"),
        ("robot_descriptions:os.path", "NAME"),
        ("robot_descriptions:../x", "NAME"),
        ("robot_descriptions:no_such_description", "cannot be imported"),
        ("robot_descriptions:only_mjcf_description", "no URDF"),
    ],
)
def test_what_is_no_description_is_named(library, name, said):
    library("robot_descriptions/__init__.py", "")
    library("robot_descriptions/only_mjcf_description.py", "MJCF_PATH = ''\n")
    with pytest.raises(ConfigError, match=said):
        load(name)
