"""Logs of trajectories hold their points: they replay and verify without the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import HOUSE
from support.command_bench import inside
from tampering import config_of, rewrite
from tampering import ran as ran_with

from hoap3.protocol.errors import ConfigError, LogError
from hoap3.tools.analysis.replay import replay
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.motion_files import FOLDER, enclosed, motion_of, reopened
from hoap3.tools.services.configs import load_controller_config
from hoap3.tools.verify.verify import verify

CSV = "t,elbow_joint,elbow_joint/velocity\n0,1.6,0\n0.05,1.61,0.2\n0.1,1.62,0\n"
NAME = f"{FOLDER}points.csv"


def config(folder: Path, controller: str, **target: object) -> Path:
    target = {"kind": "trajectory", "file": "points.csv", "approach_s": 0.04, **target}
    task = {"task": "posture", "parameters": {"target": target}}
    parameters = {"task": task} if controller == "stable_qp" else {"tasks": [task]}
    path = folder / "config.yaml"
    path.write_text(json.dumps({"controller": controller, "parameters": parameters}))
    return path


def ran(folder: Path, controller: str, **target: object) -> Path:
    """The log of a run whose points are no longer there."""
    points = folder / "points.csv"
    points.write_text(CSV)
    given = "--robot", "ur5", "--controller", config(folder, controller, **target)
    run = ran_with(folder / "run", *given, seconds=0.18)
    points.unlink()
    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "target"),
    [
        ("clik_sdp", {"path_tolerance": 1e-8}),
        ("clik_sdp", {"path_tolerance": 1e-4, "goal_tolerance": 1e-6}),
        ("ghc_velocity", {"interpolation": "quintic", "path_tolerance": 1e-5}),
        ("stable_qp", {"interpolation": "linear", "path_tolerance": 1e-5}),
        ("weighted", {"time_scaling": 0.9, "path_tolerance": 1e-5}),
    ],
)
def test_a_log_replays_and_is_true_without_the_file(controller, target, tmp_path):
    log = ran(tmp_path, controller, **target)
    assert Log.open(log, side="controller").attachments[NAME].decode() == CSV
    assert replay(log, []).identical
    found = verify(log)
    assert found.verdict == "true", found.as_json()


@pytest.mark.slow
def test_other_points_make_its_claims_false_and_its_replay_another(tmp_path):
    log = ran(tmp_path, "clik_sdp")
    changed = CSV.replace("1.61", "1.610001"), CSV.replace("0.1,", "0.11,")
    for number, points in enumerate(changed):
        out = tmp_path / f"other{number}"
        rewrite(log, "controller", out, list, enclosed={NAME: points.encode()})
        assert verify(out).verdict == "false"
        assert not replay(out, []).identical


@pytest.mark.slow
def test_a_tolerance_that_was_not_the_config_s_makes_its_claims_false(tmp_path):
    log = ran(tmp_path, "clik_sdp", path_tolerance=1e-8)
    given = config_of(log)
    other = given.replace("1.0e-08", "1.0").encode()
    assert other != given.encode()
    rewrite(log, "controller", tmp_path / "other", list, config=other)
    assert verify(tmp_path / "other").verdict == "false"


def test_what_a_log_does_not_enclose_is_refused():
    content = {"parameters": {"tasks": [{"target": {"kind": "trajectory", "file": "points.csv"}}]}}
    with pytest.raises(LogError):
        reopened(content, {"motion/else.csv": CSV.encode()})
    found = reopened(content, {NAME: CSV.encode()})
    assert found["parameters"]["tasks"][0]["target"]["csv"] == CSV


@pytest.mark.slow
def test_no_file_is_read_on_the_word_of_a_log(tmp_path):
    log = ran(tmp_path, "clik_sdp")
    (tmp_path / "run" / "points.csv").write_text(CSV)
    given = config_of(log).replace("points.csv", "else.csv").encode()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "else.csv").write_text(CSV)
    rewrite(log, "controller", tmp_path / "other", list, config=given)
    with pytest.raises(LogError):
        replay(tmp_path / "other", [])
    assert verify(tmp_path / "other").verdict == "not verified"


@pytest.mark.slow
def test_a_log_is_played_back_as_it_was(tmp_path):
    log = ran(tmp_path, "clik_sdp")
    states = Log.open(log, side="robot").states()
    for played, columns in (("measured", "q"), ("applied", "reference")):
        rows = np.genfromtxt(motion_of(log, played, 0.02).splitlines(), delimiter=",", names=True)
        ticks = np.rint(rows["t"] / 0.001).astype(int)
        assert ticks[0] == 0
        assert (np.diff(ticks)[:-1] == 20).all()
        elbow = states[columns][:, 2]
        first = int(np.flatnonzero(states["mode"] == states["mode"][5])[0])
        np.testing.assert_array_equal(rows["elbow_joint"], elbow[first + ticks])
        assert rows["elbow_jointvelocity"][-1] == 0.0

    (tmp_path / "again").mkdir()
    path = config(tmp_path, "clik_sdp", file="run", played="applied", played_every_s=0.005)
    given = "--robot", "ur5", "--controller", path
    ran_with(tmp_path / "again", *given, seconds=0.3)
    again = Log.open(tmp_path / "again", side="robot").states()["q"][:, 2]
    elbow = states["q"][:, 2]
    np.testing.assert_allclose(again[41:200], elbow[1:160], rtol=0, atol=2e-5)
    assert replay(tmp_path / "again", []).identical


def test_what_is_no_log_is_refused_by_its_key(tmp_path):
    (tmp_path / "none").mkdir()
    (tmp_path / "points.csv").write_text(CSV)
    for name in ("none", "a.mcap"):
        with pytest.raises(ConfigError) as caught:
            load_controller_config(str(config(tmp_path, "clik_sdp", file=name)), [])
        assert name in str(caught.value)


def test_a_config_is_written_as_its_author_wrote_it(tmp_path):
    (tmp_path / "points.csv").write_text(CSV)
    path = config(tmp_path, "clik_sdp")
    settings, file = load_controller_config(str(path), [])
    assert json.dumps(settings.parameters).count("0.1,1.62") == 1
    assert enclosed(settings, file) == settings
    shown = inside("config", "show", path).stdout
    assert "points.csv" in shown
    assert "1.62" not in shown


@pytest.mark.slow
def test_the_example_is_checked_runs_and_is_true(tmp_path):
    example = HOUSE / "examples" / "trajectory"
    given = "--robot", "ur5", "--approach", "0.5"
    assert inside("trajectory", "check", example / "wave.csv", *given).code == 0
    given = "--controller", example / "wave.yaml", "--duration", "5", "--json"
    summary = inside("run", "--lockstep", *given, "--out", tmp_path / "run").json()
    assert set(summary["verdicts"].values()) <= {"pass"}
    assert verify(tmp_path / "run").verdict == "true"
