"""Every command: its result on standard output, notes on standard error, and JSON where asked."""

from __future__ import annotations

import os
import pty
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from support import HOUSE
from support.command_bench import (
    HOAP3,
    PATIENT,
    QUIET,
    STOPS,
    Command,
    Done,
    controller,
    emulator,
    endpoint,
    inside,
    wait_for_mode,
)

from hoap3.tools.cli.app import app

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
    "bench limits": ("bench", "limits", "--samples", 10, "--sampled", 100),
    "bench scaling": ("bench", "scaling", "--samples", 10, "--most", 7),
    "config show": ("config", "show", "qp12"),
    "config check": ("config", "check", "qp12"),
    "config schema": ("config", "schema", "qp12"),
    "config keys": ("config", "keys", "qp12"),
    "export": ("export", "{log}", "--to", "{out}.csv"),
    "robot import": ("robot", "import", UR5, "--out", "{out}"),
    "robot check": ("robot", "check", UR5),
    "trajectory check": ("trajectory", "check", WAVE, "--robot", "ur5"),
    "help": ("help", "view"),
    "trajectory from": ("trajectory", "from", "{log}", "--out", "{out}.csv"),
}
"""What needs no robot that runs."""

ELSEWHERE = {
    "reproduce": "tests/tools/reproduce: a paper takes minutes",
    "bench hierarchy": "tests/tools/bench/test_bench_hierarchy.py",
    "bench gains": "tests/tools/bench/test_bench_gains.py",
    "bench clients": "tests/tools/beside/test_beside.py",
    "bench flood": "tests/tools/beside/test_beside.py",
    "bench pushes": "tests/tools/bench/test_pushes.py",
    "bench view": "tests/tools/beside/test_beside.py",
    "bridge foxglove": "tests/tools/bridge/test_bridges_run.py: it runs until it is stopped",
    "bridge layouts": "tests/tools/bridge/test_bridge_commands.py: what it writes are files",
    "bridge ros2": "tests/tools/bridge/test_bridges_run.py: it runs until it is stopped",
    **dict.fromkeys(
        ("certs init", "certs issue", "certs list", "certs renew", "certs revoke"),
        "tests/tools/certs/test_certs_command.py",
    ),
    "soak": "tests/system/services/test_soak.py",
    "view": "tests/system/view: it runs until it is stopped",
    "new": "tests/tools/new",
    "service install": "tests/tools/services/units/test_units.py: what it writes are files",
    "priorities": "tests/system/runs/test_live_changes.py",
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
    *("change", "config show", "config check", "config schema", "export", "controller", "help"),
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
    with (
        emulator("lwr_weightless", "--set", "command=torque", *QUIET, *PATIENT, at=at) as arm,
        controller("ghc", *QUIET, at=at) as law,
    ):
        law.hear("following robot")
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


def test_a_full_disk_behind_standard_output_is_told():
    with open("/dev/full", "w") as full:
        command = [HOAP3, "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "error: standard output cannot be written (No space left on device)\n"


def test_no_colour_and_no_control_character_where_nobody_watches():
    with Command("list") as plain:
        assert plain.end() == 0
    assert "\x1b" not in plain.stdout + plain.stderr


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
