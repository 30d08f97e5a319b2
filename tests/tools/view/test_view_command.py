"""The command `hoap3 view`: what it refuses before anything is served."""

from __future__ import annotations

import pytest
from support.command_bench import inside

from hoap3.tools.cli.viewers import is_log
from hoap3.tools.machine import machine as extras
from hoap3.tools.view.serve import warn_of


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    done = inside("view", "ur5")
    assert done.code == 2
    assert "hoap3[view]" in done.stderr


def test_a_log_that_is_none_and_a_second_of_a_robot_are_refused(tmp_path):
    for words in (
        (str(tmp_path / "nothing.mcap"),),
        (str(tmp_path),),
        ("ur5", str(tmp_path)),
        ("ur5", "--port", "70000"),
        ("ur5", "--connect", "nonsense"),
        ("*", "--connect", "tcp/127.0.0.1:1"),
    ):
        done = inside("view", *words)
        assert done.code == 2, words
        assert not done.stdout


@pytest.mark.parametrize(
    ("what", "log"), [("ur5", False), ("a.mcap", True), ("logs/run", True), ("./x", True)]
)
def test_logs_are_told_from_robots(what, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ur5").mkdir()  # as a checkout has a folder of a robot's name
    assert is_log(what) is log


def test_the_folder_of_a_run_is_a_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "robot.mcap").touch()
    assert is_log("run")


def test_whoever_listens_to_others_than_itself_is_warned():
    assert not warn_of("127.0.0.1")
    assert not warn_of("::1")
    assert not warn_of("localhost")
    for host in ("0.0.0.0", "192.168.0.7", "robot.example"):
        assert host in warn_of(host)
