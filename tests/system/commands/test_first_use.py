"""What stops a first user: paths, names, memory, interrupts, and what commands offer next."""

from __future__ import annotations

import ast
import ctypes
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from support import HOUSE
from support.command_bench import (
    QUIET,
    Command,
    assert_no_traceback,
    endpoint,
    followed,
    hoap3,
    inside,
    on_path,
)

from hoap3.tools.analysis import output
from hoap3.tools.cli.app import command_line
from hoap3.tools.cli.help import GROUPS

UR5 = HOUSE / "robot_emulator" / "robots" / "ur5"
LOCKSTEP = ("run", "--lockstep", "--duration", "0.05", "--no-realtime")
NOT_RECORDED = ("--set", "emulator.log.record=false")
LONG = "r" * 256
MEGABYTES = [100, 1000, *(pytest.param(size, marks=pytest.mark.long) for size in (200, 500))]
SLOW = """
import sys
import time

sys.stderr.write("importing\\n")
sys.stderr.flush()
try:
    time.sleep({seconds})
except BaseException as error:  # as libraries do
    raise ImportError("cannot import") from error
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A folder with a robot of its own, and a config of a controller beside it."""
    shutil.copytree(UR5, tmp_path / "own")
    text = (tmp_path / "own" / "robot.yaml").read_text()
    (tmp_path / "own" / "robot.yaml").write_text(text.replace("name: ur5", "name: own_arm"))
    content = {"controller": "qp12", "robot": "./own"}
    (tmp_path / "law.yaml").write_text(yaml.safe_dump(content))
    return tmp_path


@pytest.mark.slow
def test_the_robot_of_a_controller_is_a_path(arm):
    checked = inside("config", "check", arm / "law.yaml")
    assert (checked.code, checked.stderr) == (0, "")
    assert "own_arm" in checked.stdout
    ran = inside(*LOCKSTEP, "--controller", arm / "law.yaml", "--json", "--out", arm / "log")
    assert ran.json()["ticks"] == 50


@pytest.mark.slow
def test_a_controller_finds_the_robot_that_its_path_describes(arm):
    at = endpoint()
    names, short = (arm / "own", arm / "law.yaml"), ("--duration", 0.2, *QUIET)
    with followed(at, names, robot=QUIET, law=short) as (robot, law):
        assert law.end() == 0  # by itself
        robot.end(signal.SIGTERM)
    assert_no_traceback(law)


def test_a_controller_is_given_as_json():
    text = json.dumps({"controller": "qp12", "robot": "ur5"})
    done = inside(*LOCKSTEP, "--controller", text, "--json", *NOT_RECORDED)
    assert done.json()["ticks"] == 50


@pytest.mark.parametrize("text", ['{"controller": "qp12"', "controller: qp12", "{controler: qp12}"])
def test_wrong_text_for_a_controller_is_no_python_error(text):
    done = inside(*LOCKSTEP, "--controller", text)
    assert done.code == 2
    assert "controller" in done.stderr
    assert "Error:" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        (*LOCKSTEP, "--robot", LONG),
        (*LOCKSTEP, "--controller", LONG),
        ("robot", "check", LONG),
        ("config", "check", LONG),
        ("emulator", f"./{LONG}"),
        ("config", "check", "ur5", "--set", f"robot={LONG}"),
        ("config", "check", "qp12", "--set", f"robot={LONG}"),
        ("report", LONG),
        ("verify", LONG),
        (*LOCKSTEP, "--out", LONG),
    ],
    ids=lambda words: " ".join(words)[:30],
)
def test_a_name_that_no_file_can_have_is_one_error(words):
    done = inside(*words)
    assert done.code in {1, 2}
    assert done.stderr.startswith("error: ")
    assert "rrrrrrrr" in done.stderr


@pytest.mark.slow
def test_a_folder_that_is_not_utf8_is_named(tmp_path):
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/f\xff"))
    shutil.copytree(UR5, folder / "arm")
    refused = hoap3(*LOCKSTEP[:-1], "--robot", "arm/robot.yaml", "--out", "log", cwd=folder)
    assert refused.end() == 2
    assert_no_traceback(refused)
    assert "robot: " in refused.stderr
    assert not (folder / "log").exists()
    ran = hoap3(*LOCKSTEP[:-1], "--robot", "ur5", "--out", folder / "log", cwd=folder)
    assert ran.end() in {0, 1}
    assert_no_traceback(ran)
    assert (folder / "log" / "robot.mcap").exists()


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", MEGABYTES)
@pytest.mark.parametrize("words", [LOCKSTEP, ("run",), ("emulator", "ur5"), ("robot", "check")])
def test_too_little_memory_is_said_before_anything_is_imported(words, megabytes):
    limited = ("prlimit", f"--as={megabytes << 20}")
    words = (*words, str(UR5)) if words[0] == "robot" else words
    with Command(*words, wrapper=limited) as command:
        assert command.end() == 2
    assert re.fullmatch(rf"error: .* {megabytes} MB .*ulimit -v.*\n", command.stderr)


@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_an_unsupported_system_is_one_error(system):
    code = (
        f"import sys; sys.platform = {system!r}; sys.argv = ['hoap3', 'list']\n"
        "sys.modules |= dict.fromkeys(('fcntl', 'resource', 'termios'))  # not on Windows\n"
        "from hoap3.tools.cli.app import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"error: hoap3 needs Linux (found {system!r}). Use Linux or WSL\n"


def test_a_missing_openmp_library_is_one_error(monkeypatch):
    def load(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", load)
    done = inside("run")
    assert done.code == 2
    assert re.fullmatch(r"error: libgomp\.so\.1: cannot open .*apt-get install.*\n", done.stderr)


@pytest.mark.slow
def test_too_little_memory_is_an_error_in_python_too():
    code = (
        "import hoap3\n"
        "try:\n    hoap3.simulate()\n"
        "except hoap3.UsageError as error:\n    print(error)"
    )
    command = ["prlimit", f"--as={500 << 20}", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=HOUSE)
    assert "500 MB" in done.stdout
    assert done.stderr == ""


either_signal = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


@pytest.mark.slow
@either_signal
@pytest.mark.parametrize("module", ["numba", "numpy", "pydantic"])
def test_an_interrupt_during_an_import_ends_at_once(tmp_path, module, number):
    (tmp_path / f"{module}.py").write_text(SLOW.format(seconds=600))
    words = ("run", "--lockstep", "--out", tmp_path / "log")
    with Command(*words, environment=on_path(tmp_path)) as run:
        run.wait_for("importing")
        run.send(number)
        assert run.end() == -number
    assert run.stderr == "importing\n"
    assert not (tmp_path / "log").exists()


@pytest.mark.slow
@either_signal
def test_an_interrupted_start_leaves_no_folder(tmp_path, number):
    law = "from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller as Law\n"
    (tmp_path / "slow_law.py").write_text(SLOW.format(seconds=1) + law)
    (tmp_path / "law.yaml").write_text("controller: slow_law:Law\n")
    words = ("run", "--controller", tmp_path / "law.yaml", "--out", tmp_path / "new" / "log")
    with Command(*words) as run:
        run.wait_for("importing", 2)  # by this process, and by the controller's
        run.send(number)
        assert run.end() == 1
    assert_no_traceback(run)
    assert not (tmp_path / "new").exists()


def test_a_folder_is_removed_only_if_it_was_made_and_is_empty(tmp_path):
    (tmp_path / "old").mkdir()
    code = f"""
from pathlib import Path
from hoap3.tools.analysis.result_folder import remove_if_empty
for name in ("old", "new/empty", "new/full"):
    folder = Path({str(tmp_path)!r}, name)
    remove_if_empty(folder)
    folder.mkdir(parents=True, exist_ok=True)
(folder / "file").touch()
"""
    subprocess.run([sys.executable, "-c", code], check=True, env=dict(os.environ), cwd=HOUSE)
    found = sorted(str(each.relative_to(tmp_path)) for each in tmp_path.rglob("*"))
    assert found == ["new", "new/full", "new/full/file", "old"]


def test_every_command_is_in_one_group_of_the_help():
    shown = [name for name, each in command_line().commands.items() if not each.hidden]
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(shown)


def messages() -> list[str]:
    """All text of the product that is no docstring, and its pages' scripts."""
    found = []
    for room in ("protocol", "robot_emulator", "remote_controller", "tools"):
        for path in (HOUSE / room).rglob("*.py"):
            tree = ast.parse(path.read_text())
            described = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
            texts = [node for node in ast.walk(tree) if isinstance(getattr(node, "value", 0), str)]
            found += [node.value for node in texts if id(node) not in described]
    static = HOUSE / "tools" / "view" / "static"
    return found + [path.read_text() for path in static.glob("*.js")]


@pytest.mark.slow
def test_messages_name_topics_that_the_command_prints():
    topics = {topic for text in messages() for topic in re.findall(r"hoap3 help (\w+)", text)}
    assert {"operation"} < topics
    listed = inside("help").stdout.split()
    assert topics <= set(listed)
    for topic in topics:
        assert inside("help", topic).stdout.startswith("# ")
    assert inside("help", "nothing").code == 2


def test_bad_connections_are_one_line_in_a_while(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    logger = output.bad_connections("page")
    for _ in range(900):
        try:
            raise ValueError("garbage")
        except ValueError:
            logger.exception("refused")
    logger.info("not bad")
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "garbage" in told
    assert "Traceback" not in told
    now[0] = output.QUIET_S
    logger.warning("again")
    assert "901" in capsys.readouterr().err
