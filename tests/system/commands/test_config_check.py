"""`hoap3 config check` refuses what a run refuses, and former names; what it left unchecked."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest
from refusals import checked, refusal, written
from support import arm3
from support.command_bench import inside
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.former_names import FORMER_NAMES, FormerName, check_command_line
from hoap3.remote_controller.config import read_config

TASK = "{task: com, parameters: {target: {kind: point, position_m: [0.01, 0.025, 0.2869]}}}"
FAST = "{constraint: joint_position, parameters: {eta_per_s: 5000}}"
ROBOT = "robot: hoap3\n"
UNKNOWN = "controller: qp12\nparameters: {point: com, reference_frame: r_soul}\n"
TOO_FAST = f"controller: stable_qp\nparameters: {{task: {TASK}, constraints: [{FAST}]}}\n"


@pytest.fixture(autouse=True)
def in_an_empty_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("text", "word"), [(UNKNOWN, "r_soul"), (TOO_FAST, "eta_per_s")])
def test_what_a_run_refuses_the_check_refuses_too(text, word):
    refusal(checked(text, "--robot", "hoap3"), word)
    refused = checked(ROBOT + text)
    refusal(refused, word)
    run = inside("run", "--lockstep", "--duration", 0.1, "--controller", "mine.yaml")
    assert refused == run
    assert checked(text).code == 0  # it names no robot


def test_a_robot_is_taken_to_be_given_what_the_controller_gives():
    done = inside("config", "check", "tsid")
    assert done.code == 0
    assert "baxter_left_arm" in done.stdout
    text = "controller: tsid\nrobot: hoap3\nparameters: {frame: l_hand, goal: {posture: q0}}\n"
    refusal(checked(text), "position", "torque")


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
def test_a_hint_is_a_known_name_of_that_place(text, hint):
    refusal(checked(text), hint)


def test_another_robot_can_be_named_and_its_frames_count(tmp_path):
    arm = arm3.write(tmp_path)
    text = "controller: qp12\nrobot: my_arm\nparameters: {point: com, reference_frame: r_sole}\n"
    unknown = checked(text)  # `hoap3 controller` waits for a robot of that name
    assert unknown.code == 0
    assert "'my_arm'" in unknown.stdout
    assert "--robot" in unknown.stdout
    refusal(checked(text, "--robot", arm), "r_sole")
    assert "'hoap3'" in checked("controller: qp12\nrobot: hoap4\n").stdout


@pytest.mark.parametrize(
    "text",
    [
        "",
        "controller: qp12\nparameters: {adaptive_gamma: 1}\n",
        "robot: hoap3\nplant: {friction: 1}\n",
        "robot: hoap3\nseed: true\n",
    ],
)
def test_what_only_looks_like_a_config_is_refused_by_its_file(text):
    assert refusal(checked(text)).startswith("error: mine.yaml: ")


def test_a_controller_config_names_a_xacro_file_with_its_arguments():
    Path("arm.urdf.xacro").touch()
    package = "robot_descriptions:ur5_description kind:=a/b"
    file = " prefix:=left_ kind:=a/b"
    found = str(Path("arm.urdf.xacro").resolve())
    for text, robot in ((f"./arm.urdf.xacro{file}", found + file), (package, package)):
        written(Path(), f"controller: qp12\nrobot: {text}\n")
        assert read_config("mine.yaml")[0]["robot"] == robot


def test_a_urdf_is_a_robot_and_no_config(tmp_path):
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
        refusal(inside(*words), "URDF", "hoap3 help robots")


def test_a_schema_is_found_beside_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    missing = inside("config", "schema", "task", "swing_of_mine:Swing")
    refusal(missing, str(tmp_path))
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


def test_an_emulator_is_for_no_robot_but_its_own():
    assert inside("config", "check", "hoap3").code == 0
    assert inside("config", "check", "hoap3", "--robot", "hoap3").code == 2


CODE = """
from pathlib import Path

Path(__file__).with_name("ran").touch()
from hoap3.remote_controller.controllers.qp12.qp12 import PinvController as Law
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
def test_code_is_named_and_not_run_unless_it_is_allowed(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    ran = tmp_path / "ran"
    refusal(checked(NAMING_CODE[kind]), "'code_of_mine:", "--allow-code")
    assert inside("config", "check", "qp12", "--set", "robot=hoap3").code == 0
    shown = inside("config", "show", "mine.yaml")
    assert shown.code == 0
    assert str(tmp_path) not in sys.path  # where also installed packages could be imitated
    assert not ran.exists()
    importlib.invalidate_caches()
    allowed = checked(NAMING_CODE[kind], "--allow-code")
    sys.modules.pop("code_of_mine")
    assert ran.exists()
    assert "code_of_mine:" in allowed.stderr
    assert allowed.code == (2 if kind == "function" else 0), allowed.stderr


def test_a_package_beside_a_config_is_no_installed_one(tmp_path):
    """Else its entry points would be code by a registered name."""
    facts = tmp_path / "law_of_mine-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: law-of-mine\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[hoap3.controllers]\nmine = code_of_mine:Law\n")
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    refusal(checked("controller: mine\nrobot: hoap3\n"), "'mine'")
    assert not (tmp_path / "ran").exists()


@pytest.mark.slow
def test_a_log_runs_no_code_by_what_its_parameters_name(tmp_path, monkeypatch):
    inside("run", "--lockstep", "--duration", 0.1, "--controller", "stable_qp", "--out", "log")
    Path("code_of_mine.py").write_text(CODE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    task = f"parameters.task={{task: 'code_of_mine:Task', parameters: {POINT}}}"
    refused = inside("replay", "log", "--set", task)  # stands for a log that names it
    refusal(refused, "--allow-code")
    assert not (tmp_path / "ran").exists()
    allowed = inside("replay", "log", "--set", task, "--allow-code")
    sys.modules.pop("code_of_mine")
    assert allowed.code in {0, 1}, allowed.stderr
    assert (tmp_path / "ran").exists()


CONFIGS = {
    ("config key", "effort"): "stable_qp {effort: 2.0}",
    ("config key", "frame"): "qp12 {frame: r_sole}",
    ("config key", "keep_rho"): "stable_qp {keep_rho: true}",
    ("config key", "kind"): "ghc {tasks: [{name: hand, kind: pose, frame: ee}]}",
    ("config key", "posture_rad"): (
        "ghc {tasks: [{name: rest, task: posture, parameters: {posture_rad: [0.0]}}]}"
    ),
    ("constraint", "frame_still"): "stable_qp {constraints: [constraint: frame_still]}",
    ("constraint", "joint_speed"): "stable_qp {constraints: [constraint: joint_speed]}",
    ("task", "force"): "ghc {tasks: [{name: a, task: force}]}",
    ("task", "pose"): "ghc {tasks: [{name: a, task: pose}]}",
    ("task", "position"): "ghc {tasks: [{name: a, task: position}]}",
}
"""A controller and its parameters that use the name, by kind and name."""


WRITTEN = [each for each in FORMER_NAMES if each.kind != "method"]  # by a user


@pytest.mark.parametrize("former", WRITTEN, ids=lambda each: f"{each.kind} {each.old}")
def test_a_former_name_is_refused_with_the_name_of_today(former, tmp_path, monkeypatch):
    match former.kind:
        case "command" | "option":
            done = inside(*former.old.split(), "--anything")
        case "log":
            version = int(former.old.rpartition(" ")[2])
            monkeypatch.setattr("hoap3.tools.logs.log_writer.WIRE_VERSION", version)
            write(tmp_path, inputs(describe(2)) + ticks(2, 20))
            done = inside("export", tmp_path, "--to", tmp_path / "run.csv")
        case _:
            name, _, parameters = CONFIGS[former.kind, former.old].partition(" ")
            path = tmp_path / "mine.yaml"
            path.write_text(f"controller: {name}\nrobot: ur5\nparameters: {parameters}\n")
            done = inside("config", "check", path)
            assert former.old in done.stderr
    assert done.code != 0
    assert former.remedy in done.stderr


def test_a_former_option_is_refused_for_its_command_only(monkeypatch):
    former = FormerName("option", "bench solvers --times", "--count", "0.3")
    monkeypatch.setattr("hoap3.protocol.former_names.FORMER_NAMES", (former,))
    check_command_line(["bench", "solvers", "--count", "3"])
    check_command_line(["bench", "cycle", "--times", "3"])
    for words in (["--times", "3"], ["--times=3"]):
        with pytest.raises(Exception, match="--count"):
            check_command_line(["bench", "solvers", *words])
