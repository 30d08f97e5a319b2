"""What users get wrong: one line that says where, what and what to do, exit code 2, and no log."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from refusals import refusal, written
from support import arm3
from support.command_bench import Done, assert_ran, endpoint, hoap3, inside

RUN = ("run", "--no-realtime", "--duration", "0.1")
LOCKSTEP = (*RUN, "--lockstep")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a log would go by default."""
    monkeypatch.chdir(tmp_path)


QP12 = "controller: qp12\n"
WRONG_CONTROLLER = {
    "unknown key": ("controller: qp12\ngama: 1\n", ("gama", "unknown key", "Known keys:")),
    "unknown parameter": (f"{QP12}parameters: {{gama: 0.5}}\n", ("parameters.gama", "'gamma'")),
    "wrong type": (f"{QP12}log: {{cap_mb: much}}\n", ("log.cap_mb", "'much'", "integer")),
    "out of range": (f"{QP12}parameters: {{gamma: 1.2}}\n", ("parameters.gamma", "1.2")),
    "nothing": ("", ("is empty", "`controller: qp12`")),
    "no controller": ("robot: hoap3\n", ("controller", "is missing", "Add it")),
    "no mapping": ("- qp12\n", ("is not a mapping", "`key: value`")),
    "no YAML": ("controller: [qp12\n", ("is not valid YAML", "line 2", "bracket")),
    "not text": ("controller: \x00\n", ("is not valid YAML",)),
    "unknown controller": ("controller: qp21\n", ("qp21", "Did you mean 'qp12'?")),
    "bad name": ("controller: qp12\nrobot: HOAP 3\n", ("robot", "'HOAP 3'")),
    "no such robot": ("controller: qp12\nrobot: ./nowhere\n", ("robot", "nowhere")),
}


@pytest.mark.parametrize("case", WRONG_CONTROLLER)
def test_a_wrong_controller_config(case, tmp_path):
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
def test_a_wrong_emulator_config(case, tmp_path):
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
def test_a_wrong_set(set_, words):
    refusal(inside(*LOCKSTEP, "--set", set_), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*RUN, "--controller", "qp21"), ("'qp21'", "Did you mean 'qp12'?", "Known: clik, ")),
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
def test_a_wrong_name(arguments, words):
    refusal(inside(*arguments), *words)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "--duration", "-1"),
        ("run", "--duration", "nan"),
        ("run", "--duration", "inf"),
        ("run", "--lockstep", "--duration", "abc"),
        ("controller", "qp12", "--duration", "0"),
        ("run", "--seed", "-1"),
        ("replay", "somewhere", "--tolerance", "nan"),
        ("record", "--duration", "0"),
        ("export", "somewhere"),
        ("fly",),
    ],
)
def test_wrong_words_on_the_command_line(arguments):
    done = inside(*arguments)
    assert done.code == 2
    assert "Usage: " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_config_of_another_robot_says_so(tmp_path):
    command = ("--robot", "hoap3", "--controller", "clik_sdp_ur5", "--duration", "1")
    words = "parameters.tasks.0.parameters.frame: ", "'tool0'", "'ur5'", "'hoap3'", "another robot"
    refusal(inside("run", "--lockstep", *command), *words)
    refusal(inside("config", "check", "clik_sdp_ur5", "--robot", "hoap3"), *words)
    apart = hoap3("run", *command, "--out", tmp_path / "run")
    refusal(Done(apart.end(), apart.stdout, apart.stderr), *words)
    apart.assert_no_orphan()
    nobody = written(tmp_path, f"{QP12}parameters: {{point: com, reference_frame: r_soul}}\n")
    done = inside("run", "--lockstep", "--robot", arm3.write(tmp_path), "--controller", nobody)
    refusal(done, "'arm3' has no such frame")
    assert "another robot" not in done.stderr
    soul = ("--set", "controller.parameters={point: com, reference_frame: r_soul}")
    done = inside("run", "--lockstep", "--robot", "hoap3", "--controller", "qp12", *soul)
    refusal(done, "'hoap3' has no such frame")
    assert "another robot" not in done.stderr  # it is the one that the config names


def test_a_controller_made_for_another_robot(tmp_path):
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
    line = refusal(
        inside(*LOCKSTEP, "--robot", arm3.write(tmp_path), "--controller", law), str(law)
    )
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
def test_a_controller_that_is_none(code, words, tmp_path, request):
    name = f"broken{abs(hash(request.node.name))}"
    head = "from hoap3.remote_controller.controllers.base import Controller\n"
    written(tmp_path, head + code, f"{name}.py")
    law = written(tmp_path, f"controller: {name}:Mine\n")
    for command in ((*LOCKSTEP, "--controller", law), ("config", "check", "--allow-code", law)):
        refusal(inside(*command), str(law), f"{name}:Mine", *words)


def test_a_folder_that_cannot_be_written_or_is_taken(tmp_path):
    file = written(tmp_path, "", "file")
    refusal(inside(*LOCKSTEP, "--out", file), "--out", str(file), "File exists")
    refusal(inside(*LOCKSTEP, "--out", file / "below"), "Not a directory")
    named = tmp_path / "x.mcap"
    refusal(inside(*LOCKSTEP, "--out", named), "--out", "name of a log")
    assert not named.exists()
    assert_ran(inside(*LOCKSTEP, "--out", tmp_path / "log"))
    services = ("emulator", "hoap3", "--no-realtime"), ("controller", "qp12", "--no-realtime")
    for command in (LOCKSTEP, RUN, *services):
        side = "controller" if command[0] == "controller" else "robot"
        refusal(inside(*command, "--out", tmp_path / "log"), f"holds {side}.mcap already")


def test_nobody_to_talk_to():
    at = endpoint()
    refusal(inside("status", "--connect", at), at, code=1)


@pytest.mark.parametrize("command", ["status", "stop", "recover", "release", "record"])
@pytest.mark.parametrize("name", ["", "*", "a/b", "HOAP-3", "arm-1"])
def test_what_cannot_be_the_name_of_a_robot(command, name):
    refusal(inside(command, name), repr(name), "is not the name of a robot")


def test_a_log_that_is_cut_off_or_of_somebody_else(tmp_path):
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
    assert "Traceback" not in inside("replay", cut).stderr
    exported = inside("export", cut, "--to", tmp_path / "a.csv")
    assert exported.code == 1
    assert (tmp_path / "a.csv").read_text()
    assert "not complete" in exported.stderr


LOGS = {"robot.mcap", "controller.mcap"}
WRONG = (
    *("--controller", "qp12", "--set", "controller.parameters.point=com"),
    *("--set", "controller.parameters.reference_frame=r_soul"),
)
SLOW = "[{constraint: joint_position, parameters: {eta_per_s: 5000}}]"


def run_lockstep(out: Path, *arguments: object) -> Done:
    return inside("run", "--lockstep", "--duration", 0.1, "--out", out, *arguments)


@pytest.mark.slow
def test_in_lockstep_the_corrected_command_runs_into_the_same_folder(tmp_path):
    out = tmp_path / "run"
    refusal(run_lockstep(out, *WRONG), "r_soul")
    assert not out.exists()
    assert_ran(run_lockstep(out))
    assert {path.name for path in out.iterdir()} == LOGS


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
def test_what_lay_in_the_folder_before_stays(tmp_path):
    notes, empty, run = (tmp_path / name for name in ("notes", "empty", "run"))
    notes.mkdir()
    (notes / "notes.txt").write_text("mine")
    empty.mkdir()
    assert_ran(run_lockstep(run))
    for folder in (notes, empty, run):
        before = contents(folder)
        assert run_lockstep(folder, *WRONG).code == 2
        assert contents(folder) == before


@pytest.mark.slow
def test_without_out_no_folder_is_left(tmp_path):
    assert inside("run", "--lockstep", "--duration", 0.1, *WRONG).code == 2
    assert list(tmp_path.glob("logs/*")) == []


@pytest.mark.slow
def test_in_real_time_likewise(tmp_path):
    out = tmp_path / "run"
    words = ("run", "--duration", 0.2, "--out", out, "--controller", "stable_qp")
    with hoap3(*words, "--set", f"controller.parameters.constraints={SLOW}") as refused:
        assert refused.end() == 2
        assert "η·T = 5" in refused.stderr
    assert not out.exists()


@pytest.mark.slow
def test_a_robot_that_cannot_listen_leaves_no_log(tmp_path):
    out = tmp_path / "robot"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"link.listen=[tcp/127.0.0.1:{taken.getsockname()[1]}]"
        words = ("emulator", "hoap3", "--no-realtime", "--set", listen, "--out", out)
        assert inside(*words).code == 2
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize("words", [("run", "--lockstep"), ("emulator", "hoap3")])
def test_too_few_open_files_are_named(tmp_path, words):
    few = ("sh", "-c", 'ulimit -n 8; exec "$0" "$@"')
    with hoap3(*words, "--out", tmp_path / "run", wrapper=few) as refused:
        assert refused.end() == 2
        assert refused.stderr.startswith("error: this process may open 8 files at a time")
        assert "ulimit -n 1024" in refused.stderr
    assert not (tmp_path / "run").exists()
