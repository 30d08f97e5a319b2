"""Where a URDF comes from: a xacro file or `robot_descriptions`, through libraries or without."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from support.urdfs.vendor_arm import PACKAGE, urdf, vendor_folder

from hoap3.protocol.errors import ConfigError, DescriptionError, NotInstalledError, UrdfWarning
from hoap3.robot_emulator.config import read_config
from hoap3.robot_emulator.robots import load, load_configured
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.tools.cli import app

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
XACRO = urdf().replace("<robot", f"<robot {XMLNS}", 1).replace(
    "<link", '<xacro:property name="m" value="2"/><link', 1
)  # fmt: skip

STAND_IN = """
import re
from pathlib import Path
import xacro
from xacro import substitution_args
class PackageNotFoundError(Exception): ...
class packages:
    look_in = reset = lambda *args: None
    def get_path(package):
        raise PackageNotFoundError(package)
class XacroDoc:
    @classmethod
    def from_file(cls, path, subargs, resolve_packages):
        document = cls()
        document.text = Path(path).read_text()
        part = re.search('<xacro:include filename="(.*?)"/>', document.text)
        if part:  # counts from the file that was begun last, which a failure leaves in the stack
            find = substitution_args._eval_find
            found = re.sub(r"\\$\\(find (.*?)\\)", lambda m: find(m[1]), part[1])
            xacro.filestack.append(str(Path(xacro.filestack[-1]).parent / found))
            document.text = document.text.replace(part[0], Path(xacro.filestack[-1]).read_text())
        if "fails" in document.text:
            raise ValueError("undefined\\nsubstitution")
        for name in re.findall(r"\\$\\(arg (.*?)\\)", document.text):
            if name not in subargs:
                raise ValueError("Undefined substitution argument " + name)
        document.name = subargs["name"] if "name" in subargs else "from_xacro"
        return document
    def to_urdf_string(self):
        head = '<xacro:property name="m" value="2"/>'
        return self.text.replace(head, "").replace("acme_arm", self.name)
"""

XACRO_STAND_IN = """
filestack = []
def init_stacks(file):
    filestack[:] = [file]
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """Write a stand-in for an optional library, and import none of it from elsewhere."""

    def write(name: str, text: str) -> None:
        path = tmp_path / "library" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    ours = ("xacro", "robot_descr")
    for name in [each for each in sys.modules if each.startswith(ours)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(tmp_path / "library"))
    write("xacro/__init__.py", XACRO_STAND_IN)
    write("xacro/substitution_args.py", "_eval_dict = {}\n")
    yield write
    for name in [each for each in sys.modules if each.startswith(ours)]:
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


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("arm.urdf.xacro", "xacro"),
        ("arm.xacro", "xacro"),
        ("unexpanded.urdf", "xacro"),
        ("robot_descriptions:panda_description", "descriptions"),
    ],
)
def test_without_its_library_the_extra_is_named(tmp_path, no_library, name, extra):
    robot = name if ":" in name else xacro_file(tmp_path, name)
    with pytest.raises(NotInstalledError, match=rf"pip install 'hoap3\[{extra}\]'"):
        load(robot)


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
        ("robot_descriptions:no_such_description", "no_such_description"),
        ("robot_descriptions:only_mjcf_description", "only_mjcf_description"),
    ],
)
def test_what_is_no_description_is_named(library, name, said):
    library("robot_descriptions/__init__.py", "")
    library("robot_descriptions/only_mjcf_description.py", "MJCF_PATH = ''\n")
    with pytest.raises(ConfigError, match=said):
        load(name)


def test_a_xacro_that_failed_leaves_nothing_to_the_next_one(tmp_path, library):
    library("xacrodoc.py", STAND_IN)
    include = '<xacro:include filename="part.xacro"/>'
    text = XACRO.replace("<link", f"{include}<link", 1)
    for name in ("one", "two"):
        xacro_file(tmp_path / name, text=text).with_name("part.xacro").write_text("<!-- part -->")
    broken = tmp_path / "one" / PACKAGE / "urdf" / "part.xacro"
    broken.write_text("<!-- fails -->")
    files = [tmp_path / name / PACKAGE / "urdf" / "arm.urdf.xacro" for name in ("one", "two")]
    with pytest.raises(DescriptionError):
        import_robot(files[0])
    assert import_robot(files[1]).description.n == 3


def test_a_folder_is_the_package_that_xacro_looks_for(tmp_path, library):
    library("xacrodoc.py", STAND_IN)
    part = tmp_path / "ws" / "plain_description" / "part.xacro"
    part.parent.mkdir(parents=True)
    part.write_text("<!-- part -->")
    include = '<xacro:include filename="$(find plain_description)/part.xacro"/>'
    path = xacro_file(tmp_path, text=XACRO.replace("<link", f"{include}<link", 1))
    assert import_robot(path, [tmp_path / "ws"]).description.n == 3
    with pytest.raises(DescriptionError, match=r"plain_description.*--package-path"):
        import_robot(path)


ASKS = XACRO.replace("<link", "<!-- $(arg name) $(arg dof) --><link", 1)


def test_arguments_stand_behind_a_xacro_file(tmp_path, library):
    library("xacrodoc.py", STAND_IN)
    path = xacro_file(tmp_path, text=ASKS)
    with pytest.raises(DescriptionError, match="dof:=VALUE"):
        import_robot(f"{path} name:=seven")
    with pytest.raises(DescriptionError, match=r"dofs:=.*'dof'"):
        import_robot(f"{path} name:=seven dof:=7 dofs:=7")
    robot = import_robot(f"{path} name:=seven dof:=7")
    assert robot.description.name == "seven"
    with pytest.warns(UrdfWarning):
        assert load(f"{path} name:=eight dof:=a/../b").name == "eight"


def test_arguments_of_what_is_no_xacro_file_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"arm\.urdf dof:=7"):
        load(f"{vendor_folder(tmp_path)} dof:=7")


def test_an_emulator_config_gives_arguments_to_its_robot(tmp_path, library):
    library("xacrodoc.py", STAND_IN)
    path = xacro_file(tmp_path, text=ASKS)
    config = path.with_name("emulator.yaml")
    config.write_text("robot: arm.urdf.xacro name:=seven dof:=a/../b\n")
    content, file = read_config(str(config))
    assert content["robot"] == f"{path} name:=seven dof:=a/../b"
    with pytest.warns(UrdfWarning):
        assert load_configured(content["robot"], file).name == "seven"


def test_arguments_of_a_command_line_go_to_its_xacro_file(tmp_path, library, monkeypatch, capsys):
    library("xacrodoc.py", STAND_IN)
    path = xacro_file(tmp_path, text=ASKS)
    monkeypatch.setattr(sys, "argv", ["hoap3", "robot", "check", "--json", str(path), "name:=six"])
    with pytest.raises(SystemExit) as left:
        app.main()
    assert left.value.code == 2
    assert "dof:=VALUE" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", [*sys.argv, "dof:=6"])
    with pytest.raises(SystemExit) as left:
        app.main()
    assert left.value.code == 0
    assert json.loads(capsys.readouterr().out)["name"] == "six"
    monkeypatch.setattr(sys, "argv", ["hoap3", "robot", "check", "ur5", "dof:=6"])
    with pytest.raises(SystemExit) as left:
        app.main()
    assert left.value.code == 2
    assert "dof:=6" in capsys.readouterr().err
