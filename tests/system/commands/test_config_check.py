"""`hoap3 config check` refuses what `hoap3 run` refuses, and says what it could not check."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest
from support import arm3
from support.command_bench import inside

from hoap3.remote_controller.config import read_config
from hoap3.remote_controller.solvers.qp import qp_backends

TASK = "{task: com, parameters: {target: {kind: point, position_m: [0.01, 0.025, 0.2869]}}}"
FAST = "{constraint: joint_position, parameters: {eta_per_s: 5000}}"
ROBOT = "robot: hoap3\n"
WRONG_FOR_HOAP3 = {
    "unknown frame": (
        "controller: qp12\nparameters: {point: com, reference_frame: r_soul}\n",
        "r_soul",
    ),
    "too fast a rate": (
        f"controller: stable_qp\nparameters: {{task: {TASK}, constraints: [{FAST}]}}\n",
        "η·T = 5",
    ),
    "solver that is not installed": (
        f"controller: stable_qp\nparameters: {{task: {TASK}, solver: piqp}}\n",
        "pip install piqp",
    ),
}


@pytest.fixture(autouse=True)
def without_piqp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    spec = qp_backends.find_spec
    monkeypatch.setattr(
        qp_backends, "find_spec", lambda each: (each != "piqp" and spec(each)) or None
    )
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("case", WRONG_FOR_HOAP3)
def test_what_a_run_refuses_the_check_refuses_too(case: str) -> None:
    text, word = WRONG_FOR_HOAP3[case]
    Path("mine.yaml").write_text(ROBOT + text, encoding="utf-8")
    Path("nobody.yaml").write_text(text, encoding="utf-8")
    run = inside("run", "--lockstep", "--duration", 0.1, "--controller", "mine.yaml")
    for refused in (
        inside("config", "check", "mine.yaml"),
        inside("config", "check", "nobody.yaml", "--robot", "hoap3"),
    ):
        assert refused.code == run.code == 2
        assert word in refused.stderr
    assert inside("config", "check", "mine.yaml").stderr == run.stderr
    unchecked = inside("config", "check", "nobody.yaml")
    assert unchecked.code == 0
    assert "it names no robot, so what depends on it was not checked" in unchecked.stdout


def test_a_robot_is_taken_to_be_given_what_the_controller_gives() -> None:
    done = inside("config", "check", "tsid")
    assert done.code == 0
    assert "for robot baxter_left_arm" in done.stdout
    Path("hoap3.yaml").write_text(
        "controller: tsid\nrobot: hoap3\nparameters: {frame: l_hand, goal: {posture: q0}}\n",
        encoding="utf-8",
    )
    done = inside("config", "check", "hoap3.yaml")
    assert done.code == 2
    assert "takes position, and the controller gives torque" in done.stderr


@pytest.mark.parametrize("name", ["qp12", "stable_qp"])
def test_it_says_for_which_robot_it_is_correct(name: str) -> None:
    done = inside("config", "check", name)
    assert done.code == 0
    assert done.stdout == f"{name}: a correct config of a controller for robot hoap3\n"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("controler: qp12\n", "'controller'"),
        ("controler: qp12\nrobot: hoap3\nlink: {}\n", "'controller'"),
        ("controller: qp12\nparametrs: {gamma: 0.5}\n", "'parameters'"),
        ("robot: hoap3\nmisses_to_stopp: 3\n", "'misses_to_stop'"),
        ("robto: hoap3\n", "'robot'"),
    ],
)
def test_a_hint_is_a_key_of_that_level_of_that_side(text: str, hint: str) -> None:
    Path("mine.yaml").write_text(text, encoding="utf-8")
    refused = inside("config", "check", "mine.yaml")
    assert refused.code == 2
    assert f"Did you mean {hint}?" in refused.stderr


def test_another_robot_can_be_named_and_its_frames_count(tmp_path: Path) -> None:
    arm = arm3.write(tmp_path)
    Path("mine.yaml").write_text(
        "controller: qp12\nrobot: my_arm\nparameters: {point: com, reference_frame: r_sole}\n",
        encoding="utf-8",
    )
    unknown = inside("config", "check", "mine.yaml")
    assert unknown.code == 2
    assert "mine.yaml: robot: no such robot" in unknown.stderr
    assert "--robot" in unknown.stderr
    refused = inside("config", "check", "mine.yaml", "--robot", arm)
    assert refused.code == 2
    assert "r_sole" in refused.stderr


def test_a_misspelt_robot_is_refused_with_the_one_that_was_meant() -> None:
    Path("mine.yaml").write_text("controller: qp12\nrobot: hoap4\n", encoding="utf-8")
    refused = inside("config", "check", "mine.yaml")
    assert refused.code == 2
    assert "'hoap4'" in refused.stderr
    assert "Did you mean 'hoap3'?" in refused.stderr


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("nothing.yaml", ""),
        ("truth.yaml", "controller: qp12\nparameters: {adaptive_gamma: 1}\n"),
        ("friction.yaml", "robot: hoap3\nplant: {friction: 1}\n"),
        ("seed.yaml", "robot: hoap3\nseed: true\n"),
    ],
)
def test_what_only_looks_like_a_config_is_refused_by_its_file(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")
    refused = inside("config", "check", name)
    assert refused.code == 2
    assert refused.stderr.startswith(f"error: {name}: ")


def test_all_that_is_wrong_in_a_file_is_told() -> None:
    Path("mine.yaml").write_text(
        "robot: hoap3\nplant: {friction: 1, substeps: 0}\nlink: {lease: 5}\n", encoding="utf-8"
    )
    refused = inside("config", "check", "mine.yaml")
    assert refused.code == 2
    for key in ("plant.friction", "plant.substeps", "link.lease"):
        assert f"mine.yaml: {key}: " in refused.stderr


def test_a_controller_config_names_a_xacro_file_with_its_arguments() -> None:
    Path("arm.urdf.xacro").touch()
    Path("mine.yaml").write_text(
        "controller: qp12\nrobot: ./arm.urdf.xacro prefix:=left_ kind:=a/b\n", encoding="utf-8"
    )
    robot = read_config("mine.yaml")[0]["robot"]
    assert robot == f"{Path('arm.urdf.xacro').resolve()} prefix:=left_ kind:=a/b"
    package = "robot_descriptions:ur5_description kind:=a/b"
    Path("mine.yaml").write_text(f"controller: qp12\nrobot: {package}\n", encoding="utf-8")
    assert read_config("mine.yaml")[0]["robot"] == package


def test_a_urdf_is_a_robot_and_no_config(tmp_path: Path) -> None:
    arm3.write(tmp_path)
    (urdf,) = tmp_path.glob("*.urdf")
    Path("mine.yaml").write_text(f"robot: {urdf.name}\n", encoding="utf-8")
    Path("arm.xml").write_bytes(urdf.read_bytes())
    for words in (
        ("config", "check", urdf.name),
        ("config", "check", urdf),
        ("config", "check", "qp12", "--robot", urdf.name),
        ("config", "check", "mine.yaml"),
        ("config", "show", urdf.name),
    ):
        taken = inside(*words)
        assert taken.code == 0, taken.stderr
    for words in (
        ("controller", urdf.name, "--no-realtime"),
        ("config", "check", "arm.xml"),
        ("run", "--lockstep", "--robot", "arm.xml"),
    ):
        refused = inside(*words)
        assert refused.code == 2
        assert "is a URDF" in refused.stderr
        assert "help new_robot" in refused.stderr


def test_a_schema_is_found_beside_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    missing = inside("config", "schema", "task", "swing_of_mine:Swing")
    assert missing.code == 2
    assert f"be in the folder of its module (this is {tmp_path})" in missing.stderr
    (tmp_path / "swing_of_mine.py").write_text(
        "from pydantic import Field\n\n"
        "from hoap3.protocol.config.settings import Settings\n"
        "from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction\n\n\n"
        "class Swing(LyapunovFunction):\n"
        "    class Parameters(Settings):\n"
        "        swing_rad: float = Field(0.1)\n\n"
        "    def update(self, kinematics, time_s):\n"
        "        pass\n"
    )
    importlib.invalidate_caches()
    found = inside("config", "schema", "task", "swing_of_mine:Swing")
    monkeypatch.delitem(sys.modules, "swing_of_mine", raising=False)
    assert found.code == 0, found.stdout
    assert "swing_rad" in found.json()["properties"]["parameters"]["properties"]


def test_an_emulator_is_for_no_robot_but_its_own() -> None:
    assert inside("config", "check", "hoap3").stdout == "hoap3: a correct config of an emulator\n"
    assert inside("config", "check", "hoap3", "--robot", "hoap3").code == 2


CODE = """
from pathlib import Path

Path(__file__).with_name("ran").touch()
from hoap3.remote_controller.controllers.qp12.pinv import PinvController as Law
from hoap3.remote_controller.tasks.com import ComTask as Task


def rows(*arguments):
    raise NotImplementedError
"""
POINT = "{target: {kind: point, position_m: [0.01, 0.025, 0.2869]}}"
NAMING_CODE = {
    "controller": "controller: code_of_mine:Law\nrobot: hoap3\n",
    "task": "controller: stable_qp\nrobot: hoap3\n"
    f"parameters: {{task: {{task: 'code_of_mine:Task', parameters: {POINT}}}}}\n",
    "function": f"controller: stable_qp\nrobot: hoap3\nparameters: {{task: {TASK}, "
    "constraints: [{constraint: pfaffian, parameters: {function: 'code_of_mine:rows'}}]}\n",
}


@pytest.mark.parametrize("kind", NAMING_CODE)
def test_code_is_named_and_not_run_unless_it_is_allowed(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    Path("mine.yaml").write_text(NAMING_CODE[kind], encoding="utf-8")
    ran = tmp_path / "ran"
    refused = inside("config", "check", "mine.yaml")
    assert refused.code == 2
    assert "'code_of_mine:" in refused.stderr
    assert "add --allow-code" in refused.stderr
    assert inside("config", "check", "qp12", "--set", "robot=hoap3").code == 0
    shown = inside("config", "show", "mine.yaml")
    assert shown.code == 0
    assert str(tmp_path) not in sys.path  # where also installed packages could be imitated
    assert not ran.exists()
    importlib.invalidate_caches()
    allowed = inside("config", "check", "mine.yaml", "--allow-code")
    sys.modules.pop("code_of_mine")
    assert ran.exists()
    assert "imports code_of_mine:" in allowed.stderr
    assert allowed.code == (2 if kind == "function" else 0), allowed.stderr


def test_a_package_beside_a_config_is_no_installed_one(tmp_path: Path) -> None:
    """Else its entry points would be code by a registered name."""
    facts = tmp_path / "law_of_mine-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: law-of-mine\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[hoap3.controllers]\nmine = code_of_mine:Law\n")
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    Path("mine.yaml").write_text("controller: mine\nrobot: hoap3\n", encoding="utf-8")
    refused = inside("config", "check", "mine.yaml")
    assert refused.code == 2
    assert "'mine'" in refused.stderr
    assert not (tmp_path / "ran").exists()


def test_a_log_runs_no_code_by_what_its_parameters_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = ("run", "--lockstep", "--duration", 0.1, "--controller", "stable_qp", "--out", "log")
    inside(*short)
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    task = f"parameters.task={{task: 'code_of_mine:Task', parameters: {POINT}}}"
    refused = inside("replay", "log", "--set", task)  # stands for a log that names it
    assert refused.code == 2
    assert "add --allow-code" in refused.stderr
    assert not (tmp_path / "ran").exists()
    allowed = inside("replay", "log", "--set", task, "--allow-code")
    sys.modules.pop("code_of_mine")
    assert allowed.code in {0, 1}, allowed.stderr
    assert (tmp_path / "ran").exists()
