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
    "unknown key": ("controller: qp12\ngama: 1\n", ("gama",)),
    "unknown parameter": (f"{QP12}parameters: {{gama: 0.5}}\n", ("parameters.gama", "'gamma'")),
    "out of range": (f"{QP12}parameters: {{gamma: 1.2}}\n", ("parameters.gamma", "1.2")),
    "nothing": ("", ("`controller: qp12`",)),
    "no controller": ("robot: hoap3\n", ("controller",)),
    "no YAML": ("controller: [qp12\n", ("line 2",)),
    "unknown controller": ("controller: qp21\n", ("qp21", "'qp12'")),
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
    "unknown key": ("robot: hoap3\nplant: {servos: lag}\n", ("plant.servos", "'servo'")),
    "wrong choice": ("loss_policy: pray\n", ("loss_policy", "'pray'", "'hold'")),
    "unknown posture": ("posture: lotus\n", ("posture", "'lotus'")),
    "unknown robot": ("robot: hoap4\n", ("'hoap4'", "'hoap3'", "mine.yaml: robot")),
    "robot without folder": ("robot: ./nowhere\n", ("mine.yaml: robot: ",)),
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
        ("controller.parameters.objective.gamma=1.2", ("objective.gamma", "1.2")),
        ("controller.parameters.objective.gama=1", ("gama", "'gamma'")),
        ("controller.parameters.gamma=0.5", ("parameters.gamma", "objective.gamma")),
        ("controller.parameters.gamma", ("--set", "parameters.gamma")),
        ("emulator.plant=[", ("--set", "plant")),
        ("emulator.robot.deep.er=1", ("--set", "'robot'")),
        ("robot.seed=1", ("--set", "robot.seed", "`emulator.`")),
        ("nonsense", ("--set", "nonsense", "`emulator.`")),
        ("emulator.seed=-1", ("seed", "-1")),
        ("emulator.seed=99999999999999999999", ("seed", "9999")),
    ],
)
def test_a_wrong_set(set_, words):
    refusal(inside(*LOCKSTEP, "--set", set_), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*RUN, "--controller", "qp21"), ("'qp21'", "'qp12'", "clik, ")),
        ((*RUN, "--robot", "hoap4"), ("'hoap4'", "'hoap3'")),
        ((*RUN, "--robot", "nowhere.yaml"), ("nowhere.yaml",)),
        ((*RUN, "--controller", "nowhere.yaml"), ("nowhere.yaml",)),
        ((*RUN, "--robot", "./nowhere"), ("./nowhere: ",)),
        ((*RUN, "--controller", "./nowhere"), ("./nowhere: ",)),
        (("config", "check", "./nowhere"), ("./nowhere: ",)),
        ((*RUN, "--controller", "no.such:Thing"), ("no.such:Thing",)),
        ((*RUN, "--controller", "json:dumps"), ("json:dumps",)),
        (("config", "check", "qp21"), ("'qp21'", "'qp12'")),
        (("config", "schema", "emulater"), ("'emulater'", "'emulator'")),
        (("config", "schema", "com"), ("'com'", "task com")),
        (("config", "schema", "task", "con"), ("'con'", "'com'")),
        (("config", "schema", "constraint", "zmq"), ("'zmq'", "'zmp'", "half_space")),
        (("config", "schema", "tasks", "com"), ("'tasks'", "'task'")),
        (("config", "schema", "task", "json:dumps"), ("json:dumps",)),
        (("replay", "nowhere"), ("nowhere",)),
        (("replay", "."), ("controller.mcap",)),
        (("export", "nowhere.mcap", "--to", "a.csv"), ("nowhere.mcap",)),
        (("record", "--repair", "nowhere.mcap"), ("nowhere.mcap",)),
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
    words = "parameters.tasks.0.parameters.frame: ", "'tool0'", "'ur5'", "'hoap3'"
    refusal(inside("run", "--lockstep", *command), *words)
    refusal(inside("config", "check", "clik_sdp_ur5", "--robot", "hoap3"), *words)
    apart = hoap3("run", *command, "--out", tmp_path / "run")
    refusal(Done(apart.end(), apart.stdout, apart.stderr), *words)
    apart.assert_no_orphan()
    config = written(tmp_path, f"{QP12}parameters: {{point: com, reference_frame: r_soul}}\n")
    done = inside("run", "--lockstep", "--robot", arm3.write(tmp_path), "--controller", config)
    refusal(done, "'arm3'", "'r_soul'")
    soul = ("--set", "controller.parameters={point: com, reference_frame: r_soul}")
    done = inside("run", "--lockstep", "--robot", "hoap3", "--controller", "qp12", *soul)
    refusal(done, "'hoap3'", "'r_soul'")


@pytest.mark.slow
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
    for word in ("'made_for_21:Mine'", "'arm3'", "made_for_21.py, line 6"):
        assert word in line


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("class Mine(Controller):\n    def reset(self, *_): pass\n", ("step",)),
        ("class Mine: pass\n", ("Controller",)),
        ("class Other: pass\n", ("Mine",)),
        ("import no_such_module\n", ("no_such_module", "broken")),
        ("class Mine(Controller\n", ("SyntaxError", "broken")),
        ("1 / 0\n", ("ZeroDivisionError", "line 2")),
    ],
)
def test_a_controller_that_is_none(code, words, tmp_path, request):
    name = f"broken{abs(hash(request.node.name))}"
    head = "from hoap3.remote_controller.controllers.base import Controller\n"
    written(tmp_path, head + code, f"{name}.py")
    law = written(tmp_path, f"controller: {name}:Mine\n")
    for command in ((*LOCKSTEP, "--controller", law), ("config", "check", "--allow-code", law)):
        refusal(inside(*command), str(law), f"{name}:Mine", *words)


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_or_is_taken(tmp_path):
    file = written(tmp_path, "", "file")
    refusal(inside(*LOCKSTEP, "--out", file), "--out", "file")
    refusal(inside(*LOCKSTEP, "--out", file / "below"), "--out", "file/below")
    named = tmp_path / "x.mcap"
    refusal(inside(*LOCKSTEP, "--out", named), "--out", "x.mcap")
    assert not named.exists()
    assert_ran(inside(*LOCKSTEP, "--out", tmp_path / "log"))
    services = ("emulator", "hoap3", "--no-realtime"), ("controller", "qp12", "--no-realtime")
    for command in (LOCKSTEP, RUN, *services):
        side = "controller" if command[0] == "controller" else "robot"
        refusal(inside(*command, "--out", tmp_path / "log"), f"{side}.mcap")


@pytest.mark.slow
def test_nobody_to_talk_to():
    at = endpoint()
    refusal(inside("status", "--connect", at), at, code=1)


@pytest.mark.parametrize("command", ["status", "stop", "recover", "release", "record"])
@pytest.mark.parametrize("name", ["", "*", "a/b", "HOAP-3", "arm-1"])
def test_what_cannot_be_the_name_of_a_robot(command, name):
    refusal(inside(command, name), repr(name))


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
        assert "eta_per_s" in refused.stderr
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
        assert refused.stderr.startswith("error: ")
        assert "ulimit -n 1024" in refused.stderr
    assert not (tmp_path / "run").exists()
