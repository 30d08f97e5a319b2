"""A command that is refused at its start leaves no log: corrected, it runs into the same folder."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from support.command_bench import Done, assert_ran, hoap3, inside

pytestmark = pytest.mark.slow

LOGS = {"robot.mcap", "controller.mcap"}
WRONG = (
    *("--controller", "qp12", "--set", "controller.parameters.point=com"),
    *("--set", "controller.parameters.reference_frame=r_soul"),
)
SLOW = "[{constraint: joint_position, parameters: {eta_per_s: 5000}}]"


def lockstep(out: Path, *arguments: object) -> Done:
    return inside("run", "--lockstep", "--duration", 0.1, "--out", out, *arguments)


def test_in_lockstep_the_corrected_command_runs_into_the_same_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    refused = lockstep(out, *WRONG)
    assert refused.code == 2
    assert "r_soul" in refused.stderr
    assert not out.exists()
    assert_ran(lockstep(out))
    assert {path.name for path in out.iterdir()} == LOGS


def test_what_lay_in_the_folder_before_stays(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert lockstep(tmp_path, *WRONG).code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    empty = tmp_path / "empty"
    empty.mkdir()
    assert lockstep(empty, *WRONG).code == 2
    assert list(empty.iterdir()) == []


def test_a_log_of_another_run_is_never_touched(tmp_path: Path) -> None:
    assert_ran(lockstep(tmp_path / "run"))
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}
    again = lockstep(tmp_path / "run", *WRONG)
    assert again.code == 2
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before


def test_without_out_no_folder_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert inside("run", "--lockstep", "--duration", 0.1, *WRONG).code == 2
    assert list(tmp_path.glob("logs/*")) == []


def test_in_real_time_likewise(tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = ("run", "--duration", 0.2, "--out", out, "--controller", "stable_qp")
    with hoap3(*words, "--set", f"controller.parameters.constraints={SLOW}") as refused:
        assert refused.end() == 2
        assert "η·T = 5" in refused.stderr
    assert not out.exists()


def test_a_robot_that_cannot_listen_leaves_no_log(tmp_path: Path) -> None:
    out = tmp_path / "robot"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"link.listen=[tcp/127.0.0.1:{taken.getsockname()[1]}]"
        words = ("emulator", "hoap3", "--no-realtime", "--set", listen, "--out", out)
        assert inside(*words).code == 2
    assert not out.exists()


def test_a_controller_that_fails_on_a_state_keeps_the_log_of_it(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(
        "from hoap3.remote_controller.controllers.base import VelocityController\n\n\n"
        "class Fails(VelocityController):\n"
        "    def velocity(self, state):\n"
        "        raise RuntimeError('always')\n"
    )
    (tmp_path / "fails.yaml").write_text("controller: fails:Fails\n")
    failed = lockstep(tmp_path / "run", "--controller", tmp_path / "fails.yaml")
    assert failed.code == 1
    assert {path.name for path in (tmp_path / "run").iterdir()} == LOGS


@pytest.mark.parametrize("words", [("run", "--lockstep"), ("emulator", "hoap3")])
def test_too_few_open_files_are_named(tmp_path: Path, words: tuple[str, ...]) -> None:
    few = ("sh", "-c", 'ulimit -n 8; exec "$0" "$@"')
    with hoap3(*words, "--out", tmp_path / "run", wrapper=few) as refused:
        assert refused.end() == 2
        assert refused.stderr.startswith("error: this process may open 8 files at a time")
        assert "ulimit -n 1024" in refused.stderr
    assert not (tmp_path / "run").exists()
