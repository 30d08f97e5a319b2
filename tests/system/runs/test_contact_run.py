"""A run in contact, from its configs to the figures of its log."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.command_bench import assert_ran, inside

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log

PLANE = {"frame": "ee", "point_m": [0.0, 0.0, 0.554], "normal": [0.0, 0.0, 1.0]}
ROBOT = {"robot": "lwr", "command": "torque", "plant": {"gravity": "none", "contacts": [PLANE]}}
LOWER = [0.3, 0.55, 0.2, -1.2, 0.4, 0.8, 0.1]  # than where it starts, and below the plane
LAW = {"frame": "ee", "goal": {"posture_rad": LOWER}, "task": {"kp": 30.0}}


@pytest.mark.slow
def test_logs_and_exports_carry_the_wrench(tmp_path: Path):
    robot, law = tmp_path / "cell.yaml", tmp_path / "law.yaml"
    robot.write_text(yaml.safe_dump(ROBOT))
    law.write_text(yaml.safe_dump({"controller": "tsid", "robot": "lwr", "parameters": LAW}))
    words = ("run", "--lockstep", "--robot", robot, "--controller", law, "--duration", "0.6")
    done = inside(*words, "--json", "--out", tmp_path / "run")
    assert_ran(done)
    _, states = Log.open(tmp_path / "run", side="robot").table(Kind.STATE)
    assert np.abs(states["wrench"]).max() > 1.0
    export(tmp_path / "run", tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as found:
        np.testing.assert_array_equal(found["state.wrench"], states["wrench"])
    export(tmp_path / "run", tmp_path / "run.csv")
    lines = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(lines))
    shown = [[float(row[f"wrench.{number}"]) for number in range(6)] for row in rows]
    np.testing.assert_array_equal(shown, states["wrench"])


def test_a_wrong_contact_is_one_line(tmp_path: Path):
    robot = tmp_path / "cell.yaml"
    wrong = {**ROBOT, "plant": {"contacts": [{**PLANE, "frame": "hand"}]}}
    robot.write_text(yaml.safe_dump(wrong))
    done = inside("config", "check", robot)
    assert done.code == 2
    for word in (f"{robot}: plant.contacts.0.frame: ", "'hand'"):
        assert word in done.stderr
