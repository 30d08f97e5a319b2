"""A CPU kept from falling asleep: the setting is made, and left as it was found."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support import HOUSE

from hoap3.tools.machine.cpu_idle import kept_awake, let_sleep


@pytest.fixture
def setting(tmp_path):
    path = tmp_path / "cpu3" / "power" / "pm_qos_resume_latency_us"
    path.parent.mkdir(parents=True)
    path.write_text("40\n")
    return path


def awake(folder):
    return kept_awake(3, folder, folder)


def test_it_is_awake_for_so_long_and_what_was_set_before_comes_back(setting, tmp_path):
    with awake(tmp_path) as refusal:
        assert refusal == ""
        assert setting.read_text() == "n/a"
    assert setting.read_text() == "40"


def test_it_comes_back_after_an_error_too(setting, tmp_path):
    with pytest.raises(RuntimeError), awake(tmp_path):
        raise RuntimeError
    assert setting.read_text() == "40"


def test_of_two_that_overlap_the_last_one_lets_it_sleep(setting, tmp_path):
    first, second = awake(tmp_path), awake(tmp_path)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert setting.read_text() == "n/a"
    second.__exit__(None, None, None)
    assert setting.read_text() == "40"


def test_what_a_killed_one_left_is_repaired_by_the_next(setting, tmp_path):
    code = (
        "import os, pathlib, signal, sys\n"
        "from hoap3.tools.machine.cpu_idle import kept_awake\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "held = kept_awake(3, folder, folder)\n"
        "held.__enter__()\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False, cwd=HOUSE)
    assert setting.read_text() == "n/a"
    with awake(tmp_path):
        assert setting.read_text() == "n/a"
    assert setting.read_text() == "40"
    setting.write_text("7")  # and it is not remembered for ever
    with awake(tmp_path):
        pass
    assert setting.read_text() == "7"


def test_one_that_somebody_else_keeps_awake_is_left_alone(setting, tmp_path):
    setting.write_text("n/a")
    with awake(tmp_path) as first, awake(tmp_path) as second:
        assert first == second == ""
    assert setting.read_text() == "n/a"


@pytest.mark.parametrize("content", ["", "n/a", "-1", "rm -rf", "7" * 10_000, "\0"])
def test_a_note_that_is_no_figure_is_never_set(setting, tmp_path, content):
    (tmp_path / "awake3").write_text(content)
    with awake(tmp_path) as refusal:
        assert refusal == ""
        assert setting.read_text() == "n/a"
    assert setting.read_text() == "40"


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir, lambda path: path.symlink_to("/dev/full")])
def test_what_lies_in_place_of_a_note_is_refused_and_not_waited_for(setting, tmp_path, make):
    make(tmp_path / "awake3")
    with awake(tmp_path) as refusal:
        assert refusal
    let_sleep(tmp_path, tmp_path)
    assert setting.read_text() == "40\n"


def test_a_locked_note_is_not_waited_for_long(setting, tmp_path, monkeypatch):
    monkeypatch.setattr("hoap3.tools.machine.cpu_idle.PATIENCE_S", 0.01)
    with (tmp_path / "awake3").open("w") as squatted:
        fcntl.flock(squatted, fcntl.LOCK_EX)
        with awake(tmp_path) as refusal:
            assert refusal
    assert setting.read_text() == "40\n"


def test_without_a_directory_of_ours_no_cpu_is_kept_awake(setting, tmp_path, monkeypatch):
    tmp_path.chmod(0o777)
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path))
    with kept_awake(3, tmp_path) as refusal:
        assert "HOAP3_RUNTIME_DIR" in refusal
    assert setting.read_text() == "40\n"


def test_a_refusal_says_what_it_takes(tmp_path):
    with kept_awake(7, tmp_path, tmp_path) as refusal:
        assert "root" in refusal
