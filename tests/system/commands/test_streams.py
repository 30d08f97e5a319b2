"""Commands as processes: streams, signals, and where they run."""

from __future__ import annotations

import os
import pty
import random
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
import typer
from mcap.reader import make_reader
from support import HOUSE
from support.command_bench import (
    HOAP3,
    PATIENCE_S,
    PATIENT,
    QUIET,
    STOPS,
    Command,
    Done,
    assert_at_rest,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    followed,
    hoap3,
    inside,
    on_path,
    wait_for_mode,
)

from hoap3.tools.cli.app import app
from hoap3.tools.logs.log import Log

LOCKSTEP = ("run", "--lockstep", "--duration", 0.05, "--no-realtime")
WAVE = HOUSE / "examples" / "trajectory" / "wave.csv"
UR5 = HOUSE / "robot_emulator" / "robots" / "ur5" / "ur5.urdf"
LOCAL: dict[str, tuple[object, ...]] = {
    "list": ("list",),
    "run": (*LOCKSTEP, "--out", "{out}"),
    "replay": ("replay", "{log}"),
    "report": ("report", "{log}"),
    "verify": ("verify", "{log}"),
    "record": ("record", "--repair", "{log}/robot.mcap"),
    "limits": ("limits", "ur5", "--samples", 100),
    "doctor": ("doctor", "--no-measure"),
    "latency": ("latency", "--log", "{log}"),
    "compare": ("compare", "qp12", "pinv", "--duration", 0.01, "--no-timing", "--out", "{out}"),
    "bench solvers": ("bench", "solvers", "-n", 7, "--samples", 10),
    "bench cycle": ("bench", "cycle", "--samples", 10),
    "config show": ("config", "show", "qp12"),
    "config check": ("config", "check", "qp12"),
    "config schema": ("config", "schema", "qp12"),
    "config keys": ("config", "keys", "qp12"),
    "export": ("export", "{log}", "--to", "{out}.csv"),
    "robot import": ("robot", "import", UR5, "--out", "{out}"),
    "robot check": ("robot", "check", UR5),
    "trajectory check": ("trajectory", "check", WAVE, "--robot", "ur5"),
    "help": ("help", "live"),
    "trajectory from": ("trajectory", "from", "{log}", "--out", "{out}.csv"),
}
"""What needs no robot that runs."""

ELSEWHERE = {
    "reproduce": "tests/tools/reproduce: a paper takes minutes",
    "bridge foxglove": "tests/tools/bridge/test_bridges_run.py: it runs until it is stopped",
    "bridge layouts": "tests/tools/bridge/test_bridge_commands.py: what it writes are files",
    "bridge ros2": "tests/tools/bridge/test_bridges_run.py: it runs until it is stopped",
    **dict.fromkeys(
        ("certs init", "certs issue", "certs list", "certs renew", "certs revoke"),
        "tests/tools/services/test_certs_command.py",
    ),
    "soak": "tests/system/services/test_soak.py",
    "view": "tests/system/view: it runs until it is stopped",
    "new": "tests/tools/new",
    "service install": "tests/tools/services/test_systemd_unit.py: what it writes are files",
}
LIVE: dict[str, tuple[object, ...]] = {
    "status": ("status", "lwr"),
    "change": ("change", '{"set": [["hand", "elbow", 1.0]], "over_s": 0}', "--robot", "lwr"),
    "stop": ("stop", "lwr"),
    "recover": ("recover", "lwr"),
    "release": ("release", "lwr"),
}
SERVICES = {"emulator", "controller"}
ONE_FORM = {
    *("config show", "config check", "config schema", "export", "controller", "help"),
    "trajectory from",
}
"""Commands without `--json`."""


def names(of: typer.Typer, before: str = "") -> Iterator[str]:
    """Every command, with the words before it."""
    for command in of.registered_commands:
        yield before + (command.name or getattr(command.callback, "__name__", ""))
    for group in of.registered_groups:
        if group.typer_instance is not None:
            yield from names(group.typer_instance, f"{before}{group.name} ")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("streams") / "log"
    assert inside(*LOCKSTEP, "--out", folder).code == 1  # too short to arrive
    return folder


def filled(words: tuple[object, ...], log: Path, out: Path) -> list[str]:
    return [str(word).format(log=log, out=out) for word in words]


def assert_result(done: Done) -> None:
    """There is a result, and no note of ours in it."""
    assert done.code in {0, 1}, done.stderr
    assert done.stdout.strip()
    assert "error:" not in done.stderr


def test_every_command_is_looked_at():
    assert set(names(app)) == LOCAL.keys() | LIVE.keys() | ELSEWHERE.keys() | SERVICES


@pytest.mark.slow
@pytest.mark.parametrize("name", LOCAL)
def test_a_result_is_on_standard_output(name, log, tmp_path):
    done = inside(*filled(LOCAL[name], log, tmp_path / "people"))
    assert_result(done)
    if name in ONE_FORM:
        return
    done = inside(*filled(LOCAL[name], log, tmp_path / "program"), "--json")
    assert done.code in {0, 1}, done.stderr
    assert isinstance(done.json(), dict)


@pytest.mark.slow
def test_a_live_result_is_on_standard_output():
    at = endpoint()
    with followed(
        at, ("lwr_weightless", "ghc"), robot=("--set", "command=torque", *QUIET, *PATIENT)
    ) as (arm, law):
        wait_for_mode("active", at, "lwr")
        for name, words in LIVE.items():
            if name == "recover":
                wait_for_mode("stopped", at, "lwr")
            where = () if name == "release" else ("--connect", at)  # it needs no network
            assert_result(inside(*words, *where))
            if name not in ONE_FORM:
                assert isinstance(inside(*words, *where, "--json").json(), dict)
        assert law.end(STOPS[0]) == 0
        assert arm.end(STOPS[0]) in {0, 1}
    assert "deadlines" in arm.stdout
    assert law.stdout.strip() == "log: none"


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [("list",), (*LOCKSTEP, "--set", "emulator.log.record=false"), ("config", "schema", "qp12")],
    ids=lambda words: words[0],
)
def test_a_reader_that_leaves_is_no_error(words):
    reader, writer = os.pipe()
    os.close(reader)
    command = [HOAP3, *map(str, words)]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert done.returncode == (1 if words[0] == "run" else 0)  # it is too short to arrive
    assert "rror" not in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_full_disk_behind_standard_output_is_told():
    with open("/dev/full", "w") as full:
        command = [HOAP3, "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert re.fullmatch(r"error: .*No space left on device.*\n", done.stderr)


def test_no_colour_and_no_control_character_where_nobody_watches():
    with Command("list") as plain:
        assert plain.end() == 0
    assert "\x1b" not in plain.stdout + plain.stderr


@pytest.mark.slow
def test_a_narrow_terminal_without_colour_gets_no_escape_sequence():
    mine, theirs = pty.openpty()
    subprocess.run(["stty", "cols", "30"], stdin=theirs, check=True)
    environment = {**os.environ, "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.Popen([HOAP3, "list"], stdout=theirs, stderr=theirs, env=environment)
    assert done.wait() == 0
    os.close(theirs)
    text = os.read(mine, 65536).decode()
    os.close(mine)
    assert "\x1b" not in text
    assert "robots: " in text


LATEST_S = {"run": 3.0, "emulator": 1.2, "controller": 2.5}


def moments(command: str, count: int, seed: int) -> list[tuple[str, int, float, bool]]:
    """Which command, signal, moment after its start [s], and whether it comes twice."""
    chance = random.Random(f"{command} {seed}")
    return [
        (command, STOPS[number % 2], chance.uniform(0.0, LATEST_S[command]), number % 3 == 1)
        for number in range(count)
    ]


def interrupted(command: Command, number: int, after_s: float, *, twice: bool) -> int:
    """Exit code of a command that got a signal `after_s` seconds after its start."""
    if command.ended_within(after_s):
        return command.end()
    command.send(number)
    if twice and command.process.poll() is None:
        command.send(number)
    return command.end()


def check(command: Command, code: int, number: int, folder: Path, allowed: set[int]) -> None:
    """The end was an orderly one, or came before the command had done anything."""
    command.assert_no_orphan()
    if not folder.exists():  # nothing had begun; Python and the shell have their own codes then
        assert code in {0, 1, 128 + number, -number}
        return
    assert code in allowed, command.stderr
    assert_no_traceback(command)
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as stream:
            assert make_reader(stream).get_summary() is not None
        log = Log.open(path)
        assert not log.truncated
        if log.side == "robot" and len(log.states()):
            assert_at_rest(log)


def end_anyhow(command: str, number: int, after_s: float, twice: bool, folder: Path) -> None:
    at = endpoint()
    if command == "run":
        with Command("run", "--duration", PATIENCE_S, "--out", folder) as run:
            code = interrupted(run, number, after_s, twice=twice)
            check(run, code, number, folder, {0, 1})
    elif command == "emulator":
        words = ("emulator", "hoap3", "--out", folder, "--set", f"link.listen=[{at}]")
        with Command(*words) as robot:
            code = interrupted(robot, number, after_s, twice=twice)
            check(robot, code, number, folder, {0})
    else:
        with (
            emulator("hoap3", *QUIET, at=at) as robot,
            controller("qp12", "--out", folder, at=at) as law,
        ):
            code = interrupted(law, number, after_s, twice=twice)
            check(law, code, number, folder, {0})
            assert robot.end(signal.SIGTERM) in {0, 1}  # 1: a busy machine made it stop before


MANY = [moment for command in LATEST_S for moment in moments(command, 20, seed=2)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "number", "after_s", "twice"),
    [*moments("run", 1, seed=1), *(pytest.param(*each, marks=pytest.mark.long) for each in MANY)],
)
def test_an_end_at_any_moment_is_orderly(tmp_path, command, number, after_s, twice):
    end_anyhow(command, number, after_s, twice, tmp_path / "log")


@pytest.mark.slow
def test_an_end_in_full_motion_is_orderly(tmp_path):
    folder = tmp_path / "log"
    patient = [word.replace("misses", "emulator.misses") for word in PATIENT]
    for side in ("emulator", "controller"):  # a busy machine may be silent for longer than a lease
        patient += ["--set", f"{side}.link.lease_ms=60000"]
    with Command("run", "--duration", PATIENCE_S, "--json", "--out", folder, *patient) as run:
        first = int(run.wait_for(r"following robot 'hoap3' from tick (\d+)")[1])
        reset = r"controller: tick (\d+): reset"
        if (
            int(run.wait_for(reset)[1]) < first
        ):  # what comes before does not count, if anything does
            run.wait_for(reset, 2)
        code = run.end(signal.SIGINT)
        check(run, code, signal.SIGINT, folder, {0, 1})
    summary = run.json()
    assert summary["ticks"] > 0
    assert code == (1 if {"fail"} & {*summary["verdicts"].values()} else 0)
    assert {path.name for path in folder.iterdir()} == {"robot.mcap", "controller.mcap"}


@pytest.mark.slow
def test_nothing_survives_a_killed_run(tmp_path):
    with Command("run", "--duration", PATIENCE_S, "--out", tmp_path / "log") as run:
        run.wait_for(r"following robot")
        assert len(run.family()) == 4  # two services, an observer beside each
        assert run.end(signal.SIGKILL) == -signal.SIGKILL
        run.assert_no_orphan()
    for side in ("robot", "controller"):
        assert not Log.open(tmp_path / "log", side=side).truncated
    assert_at_rest(Log.open(tmp_path / "log", side="robot"))


NOBODY = 65534
MAY_READ = "+dac_read_search"  # as if the interpreter stood where everybody can read it
HOMELESS: dict[str, str | None] = {"HOME": None, "XDG_CACHE_HOME": None, "HOAP3_CACHE_DIR": None}
RUN = ("run", "--lockstep", "--duration", "0.2")


def as_nobody(
    *arguments: object, cwd: Path, environment: Mapping[str, str | None] = HOMELESS
) -> Command:
    """Run a command as an ordinary user; who is one already just loses the home."""
    words = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    rights = (f"--inh-caps={MAY_READ}", f"--ambient-caps={MAY_READ}")
    wrapper = (*words, *rights) if os.geteuid() == 0 else ()
    return hoap3(*arguments, wrapper=wrapper, environment=environment, cwd=cwd)


@pytest.fixture
def way() -> Iterator[Path]:
    """A folder that everybody can reach; pytest's own are for their owner alone."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.fixture
def read_only(way: Path) -> Path:
    folder = way / "read_only"
    folder.mkdir(mode=0o555)
    return folder


@pytest.mark.slow
def test_a_folder_that_may_not_be_written(read_only):
    refused = as_nobody(*RUN, cwd=read_only)
    assert refused.end() == 2
    assert_no_traceback(refused)
    assert refused.stderr.startswith("error: settings: log.directory: ")
    given = as_nobody(*RUN, "--out", read_only, cwd=read_only)
    assert given.end() == 2
    assert given.stderr.startswith("error: --out: ")
    assert_no_traceback(given)


@pytest.mark.slow
@pytest.mark.parametrize(
    "interpreted", ["1", pytest.param("0", marks=pytest.mark.long, id="compiled afresh")]
)
def test_an_ordinary_user_without_home_gets_the_same_bytes(way, read_only, tmp_path, interpreted):
    way.chmod(0o777)
    environment = {**HOMELESS, "NUMBA_DISABLE_JIT": interpreted}
    words = (*RUN, "--json", "--out")
    theirs = as_nobody(*words, way / "log", cwd=read_only, environment=environment)
    assert theirs.end() in {0, 1}, theirs.stderr  # it is too short to arrive
    assert_no_traceback(theirs)
    written = way / "log" / "robot.mcap"
    assert written.stat().st_uid == (NOBODY if os.geteuid() == 0 else os.geteuid())
    ours = inside(*words, tmp_path / "log")
    assert theirs.json()["payload_sha256"] == ours.json()["payload_sha256"]


@pytest.mark.slow
def test_packages_called_like_our_rooms_do_not_matter(tmp_path):
    for room in ("protocol", "remote_controller", "robot_emulator", "tools"):
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text("raise SystemExit('of somebody else')")
    out = tmp_path / "log"
    words = ("run", "--lockstep", "--duration", "0.1", "--json", "--out", out)
    done = hoap3(*words, environment=on_path(tmp_path))
    assert done.end() in {0, 1}, done.stderr  # it is too short to arrive
    assert_no_traceback(done)
    assert done.json()["ticks"] == 100
