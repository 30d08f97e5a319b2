"""What users get wrong: one line that says where, what and what to do instead, and exit code 2."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support import arm3
from support.command_bench import Done, assert_ran, endpoint, hoap3, inside

RUN = ("run", "--no-realtime", "--duration", "0.1")
LOCKSTEP = (*RUN, "--lockstep")


def refusal(done: Done, *words: str) -> str:
    """The one line of a refusal, which has all these words."""
    assert done.code == 2, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    assert lines[-1] == errors[0]
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in errors[0], errors[0]
    return errors[0]


def written(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a log would go by default."""
    monkeypatch.chdir(tmp_path)


WRONG_CONTROLLER = {
    "unknown key": ("controller: qp12\ngama: 1\n", ("gama", "unknown key", "Known keys:")),
    "unknown parameter": (
        "controller: qp12\nparameters: {gama: 0.5}\n",
        ("parameters.gama", "0.5", "Did you mean 'gamma'?"),
    ),
    "wrong type": (
        "controller: qp12\nlog: {cap_mb: much}\n",
        ("log.cap_mb", "'much'", "valid integer"),
    ),
    "out of range": (
        "controller: qp12\nparameters: {gamma: 1.2}\n",
        ("parameters.gamma", "1.2", "less than or equal to 1"),
    ),
    "nothing": ("", ("is empty", "`controller: qp12`")),
    "no controller": ("robot: hoap3\n", ("controller", "is missing", "Add it")),
    "no mapping": ("- qp12\n", ("is not a mapping", "`key: value`")),
    "no YAML": ("controller: [qp12\n", ("is not valid YAML", "line 2", "bracket")),
    "not text": ("controller: \x00\n", ("is not valid YAML",)),
    "unknown controller": ("controller: qp21\n", ("qp21", "Did you mean 'qp12'?")),
    "bad name": ("controller: qp12\nrobot: HOAP 3\n", ("robot", "'HOAP 3'")),
}


@pytest.mark.parametrize("case", WRONG_CONTROLLER)
def test_a_wrong_controller_config(case: str, tmp_path: Path) -> None:
    text, words = WRONG_CONTROLLER[case]
    path = written(tmp_path, text)
    named = () if case == "unknown controller" else (str(path),)
    refusal(inside(*LOCKSTEP, "--controller", path), *named, *words)
    refusal(inside(*RUN, "--controller", path), *named, *words)
    refusal(inside("controller", path, "--no-realtime"), *named, *words)
    assert [found.name for found in tmp_path.iterdir()] == ["mine.yaml"]  # nothing was begun


WRONG_EMULATOR = {
    "unknown key": ("robot: hoap3\nplant: {servos: lag}\n", ("plant.servos", "Did you mean")),
    "wrong choice": ("loss_policy: pray\n", ("loss_policy", "'pray'", "'hold' or 'extrapolate'")),
    "unknown posture": ("posture: lotus\n", ("posture", "'lotus'", "Known: ")),
    "unknown robot": ("robot: hoap4\n", ("'hoap4'", "Did you mean 'hoap3'?", "mine.yaml: robot")),
    "robot without folder": ("robot: ./nowhere\n", ("mine.yaml: robot: ", "no such")),
}


@pytest.mark.parametrize("case", WRONG_EMULATOR)
def test_a_wrong_emulator_config(case: str, tmp_path: Path) -> None:
    text, words = WRONG_EMULATOR[case]
    path = written(tmp_path, text)
    refusal(inside(*LOCKSTEP, "--robot", path), *words)
    refusal(inside("emulator", path, "--no-realtime"), *words)
    refusal(inside("config", "check", path), *words)
    assert [found.name for found in tmp_path.iterdir()] == ["mine.yaml"]


@pytest.mark.parametrize(
    ("set_", "words"),
    [
        ("controller.parameters.objective.gamma=1.2", ("objective.gamma", "1.2", "less than")),
        ("controller.parameters.objective.gama=1", ("gama", "Did you mean 'gamma'?")),
        ("controller.parameters.gamma=0.5", ("parameters.gamma", "Write objective.gamma")),
        ("controller.parameters.gamma", ("--set", "is not key=value", "Write --set a.b=1")),
        ("emulator.plant=[", ("--set", "plant", "is not a YAML value")),
        ("emulator.robot.deep.er=1", ("--set", "'robot' has no keys below it")),
        ("robot.seed=1", ("--set", "robot.seed", "Begin with `emulator.` or `controller.`")),
        ("nonsense", ("--set", "nonsense", "Begin with `emulator.` or `controller.`")),
        ("emulator.seed=-1", ("seed", "-1", "greater than or equal to 0")),
        ("emulator.seed=99999999999999999999", ("seed", "less than")),
    ],
)
def test_a_wrong_set(set_: str, words: tuple[str, ...]) -> None:
    refusal(inside(*LOCKSTEP, "--set", set_), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            (*RUN, "--controller", "qp21"),
            ("'qp21'", "Did you mean 'qp12'?", "Known: clik, "),
        ),
        ((*RUN, "--robot", "hoap4"), ("'hoap4'", "Did you mean 'hoap3'?")),
        ((*RUN, "--robot", "nowhere.yaml"), ("nowhere.yaml", "No such file")),
        ((*RUN, "--controller", "nowhere.yaml"), ("nowhere.yaml", "No such file")),
        ((*RUN, "--robot", "./nowhere"), ("./nowhere: ", "no such file")),
        ((*RUN, "--controller", "./nowhere"), ("./nowhere: ", "no such file")),
        (("config", "check", "./nowhere"), ("./nowhere: ", "no such file")),
        ((*RUN, "--controller", "no.such:Thing"), ("no.such:Thing", "cannot be imported")),
        ((*RUN, "--controller", "json:dumps"), ("json:dumps", "is not a controller class")),
        (("config", "check", "qp21"), ("'qp21'", "Did you mean 'qp12'?")),
        (("config", "schema", "emulater"), ("'emulater'", "Did you mean 'emulator'?")),
        (("config", "schema", "com"), ("no kind of config is called 'com'", "task com?")),
        (("config", "schema", "task", "con"), ("no task is called 'con'", "Did you mean 'com'?")),
        (("config", "schema", "constraint", "zmq"), ("'zmq'", "Did you mean 'zmp'?", "half_space")),
        (("config", "schema", "tasks", "com"), ("'tasks'", "Did you mean 'task'?")),
        (("config", "schema", "task", "json:dumps"), ("json:dumps", "is not a task class")),
        (("replay", "nowhere"), ("nowhere", "cannot be read")),
        (("replay", "."), ("holds no controller.mcap",)),
        (("export", "nowhere.mcap", "--to", "a.csv"), ("nowhere.mcap", "cannot be read")),
        (("record", "--repair", "nowhere.mcap"), ("nowhere.mcap", "cannot be read")),
    ],
)
def test_a_wrong_name(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    refusal(inside(*arguments), *words)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "--duration", "-1"),
        ("run", "--duration", "nan"),
        ("run", "--duration", "inf"),
        ("run", "--seed", "-1"),
        ("replay", "somewhere", "--tolerance", "nan"),
        ("record", "--duration", "0"),
        ("export", "somewhere"),
        ("fly",),
    ],
)
def test_wrong_words_on_the_command_line(arguments: tuple[str, ...]) -> None:
    done = inside(*arguments)
    assert done.code == 2
    assert "Usage: " in done.stderr
    assert "Traceback" not in done.stderr


def arm(folder: Path) -> Path:
    """The three-joint arm, which has no foot to stand on."""
    return arm3.write(folder)


@pytest.mark.slow
def test_a_robot_without_a_default_task(tmp_path: Path) -> None:
    words = ("qp12_bounded.yaml", "parameters.task", "'arm3' has no default task", "robot.yaml")
    robot = arm(tmp_path)
    refusal(inside(*LOCKSTEP, "--robot", robot), *words)
    apart = hoap3("run", "--duration", "1", "--robot", robot)
    refusal(Done(apart.end(), apart.stdout, apart.stderr), *words)
    apart.assert_no_orphan()


@pytest.mark.slow
def test_a_config_of_another_robot_says_so(tmp_path: Path) -> None:
    command = ("--robot", "hoap3", "--controller", "clik_sdp_ur5", "--duration", "1")
    words = (
        "parameters.tasks.0.parameters.frame: robot 'hoap3' has no such frame (found 'tool0')",
        "The config is for another robot: its key `robot` names 'ur5', and 'hoap3' is given.",
        "Take --robot ur5, or a config for 'hoap3'",
    )
    refusal(inside("run", "--lockstep", *command), *words)
    refusal(inside("config", "check", "clik_sdp_ur5", "--robot", "hoap3"), *words)
    apart = hoap3("run", *command, "--out", tmp_path / "run")
    refusal(Done(apart.end(), apart.stdout, apart.stderr), *words)
    apart.assert_no_orphan()
    nobody = written(
        tmp_path,
        "controller: qp12\n"  # names no robot: any will do
        "parameters: {point: com, reference_frame: r_soul}\n",
    )
    done = inside("run", "--lockstep", "--robot", arm(tmp_path), "--controller", nobody)
    refusal(done, "'arm3' has no such frame")
    assert "another robot" not in done.stderr
    soul = ("--set", "controller.parameters={point: com, reference_frame: r_soul}")
    done = inside("run", "--lockstep", "--robot", "hoap3", "--controller", "qp12", *soul)
    refusal(done, "'hoap3' has no such frame")
    assert "another robot" not in done.stderr  # it is the one that the config names


def test_a_controller_made_for_another_robot(tmp_path: Path) -> None:
    written(
        tmp_path,
        "import numpy as np\n"
        "from hoap3.remote_controller.controllers.base import Controller\n"
        "class Mine(Controller):\n"
        "    def __init__(self, description, parameters):\n"
        "        super().__init__(description, parameters)\n"
        "        self.command.values[:] = np.ones(21)\n"
        "    def reset(self, state, last_command): pass\n"
        "    def step(self, state): return self.command\n",
        "made_for_21.py",
    )
    law = written(tmp_path, "controller: made_for_21:Mine\n")
    line = refusal(inside(*LOCKSTEP, "--robot", arm(tmp_path), "--controller", law), str(law))
    for word in ("'made_for_21:Mine'", "'arm3' with 3 joints", "(made_for_21.py, line 6)"):
        assert word in line


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("class Mine(Controller):\n    def reset(self, *_): pass\n", ("lacks the method step",)),
        ("class Mine: pass\n", ("is not a controller class", "Derive it from")),
        ("class Other: pass\n", ("cannot be imported", "Mine")),
        ("import no_such_module\n", ("cannot be imported", "no_such_module", "broken")),
        ("class Mine(Controller\n", ("cannot be imported", "SyntaxError", "broken")),
        ("1 / 0\n", ("cannot be imported", "ZeroDivisionError", "line 2")),
    ],
)
def test_a_controller_that_is_none(
    code: str, words: tuple[str, ...], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    name = f"broken{abs(hash(request.node.name))}"
    head = "from hoap3.remote_controller.controllers.base import Controller\n"
    written(tmp_path, head + code, f"{name}.py")
    law = written(tmp_path, f"controller: {name}:Mine\n")
    for command in ((*LOCKSTEP, "--controller", law), ("config", "check", "--allow-code", law)):
        refusal(inside(*command), str(law), f"{name}:Mine", *words)


def test_a_folder_that_cannot_be_written_or_is_taken(tmp_path: Path) -> None:
    file = written(tmp_path, "", "file")
    refusal(inside(*LOCKSTEP, "--out", file), "--out", str(file), "File exists")
    refusal(inside(*LOCKSTEP, "--out", file / "below"), "Not a directory")
    named = tmp_path / "x.mcap"
    refusal(inside(*LOCKSTEP, "--out", named), "--out", "name of a log")
    assert not named.exists()
    assert_ran(inside(*LOCKSTEP, "--out", tmp_path / "log"))
    for command in (LOCKSTEP, RUN):
        refusal(inside(*command, "--out", tmp_path / "log"), "--out", "holds robot.mcap already")
    for side, command in (("robot", "emulator"), ("controller", "controller")):
        name = {"robot": "hoap3", "controller": "qp12"}[side]
        again = inside(command, name, "--out", tmp_path / "log", "--no-realtime")
        refusal(again, f"holds {side}.mcap already")


def test_nobody_to_talk_to() -> None:
    at = endpoint()
    done = inside("status", "--connect", at)
    assert (done.code, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    assert at in done.stderr


@pytest.mark.parametrize("command", ["status", "stop", "recover", "record"])
@pytest.mark.parametrize("name", ["", "*", "a/b", "HOAP-3"])
def test_what_cannot_be_the_name_of_a_robot(command: str, name: str) -> None:
    refusal(inside(command, name), repr(name), "is not the name of a robot")


def test_a_log_that_is_cut_off_or_of_somebody_else(tmp_path: Path) -> None:
    from mcap.writer import Writer

    foreign = tmp_path / "foreign.mcap"
    with foreign.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(os.urandom(1000))
    assert_ran(inside(*LOCKSTEP, "--out", tmp_path / "log"))
    whole = (tmp_path / "log" / "controller.mcap").read_bytes()
    short = tmp_path / "short.mcap"
    short.write_bytes(whole[:100])
    for path in (foreign, noise, short):
        for command in (("replay", path), ("export", path, "--to", tmp_path / "a.npz")):
            refusal(inside(*command), str(path))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    replayed = inside("replay", cut)
    assert "Traceback" not in replayed.stderr
    exported = inside("export", cut, "--to", tmp_path / "a.csv")
    assert exported.code == 1
    assert (tmp_path / "a.csv").read_text()
    assert "not complete" in exported.stderr
