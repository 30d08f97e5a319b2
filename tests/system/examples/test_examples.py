"""The examples do what they say: the tour, an arm of one's own, controllers beside each other."""

from __future__ import annotations

import contextlib
import io
import json
import runpy

import numpy as np
import pytest
from support import HOUSE
from support.command_bench import endpoint, followed, inside
from support.pages.steered_arm import pose, tool

import hoap3

EXAMPLES = HOUSE / "examples"
ARM = EXAMPLES / "own_arm"
TOUR = json.loads((EXAMPLES / "tour.ipynb").read_text(encoding="utf-8"))
CELLS = [cell for cell in TOUR["cells"] if cell["cell_type"] == "code"]
STEER = runpy.run_path(str(ARM / "steer.py"))
COMPARING = runpy.run_path(str(EXAMPLES / "comparing_controllers.py"))


def test_the_tour_is_stored_without_outputs():
    assert TOUR["nbformat"] == 4
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CELLS)
    assert len({cell["id"] for cell in TOUR["cells"]}) == len(TOUR["cells"])


@pytest.mark.slow
def test_the_tour_goes_from_top_to_bottom(monkeypatch):
    at, names, printed = endpoint(), {"__name__": "__main__"}, io.StringIO()
    monkeypatch.setenv("HOAP3_CONNECT", at)
    with (
        followed(at, ("ur5", "steered_ur5")),
        contextlib.redirect_stdout(printed),
    ):
        try:
            for cell in CELLS:
                exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
        finally:
            names["robot"].close()
    assert names["hand"]["unit"] == "m"
    assert "taken 1 late" in printed.getvalue()
    assert names["heard"] == ["SAFE_STOP", "AT_REST"]
    assert names["before"]["priorities"]["alpha"] == [[0.0, 0.0], [1.0, 0.0]]
    end_of_circle = names["circle"][-1]
    reached = tool(names["on_circle"].q)[:3, 3]
    assert np.linalg.norm(reached - end_of_circle) < 2e-3


@pytest.mark.slow
def test_the_tip_of_ones_own_arm_goes_from_corner_to_corner():
    at = endpoint()
    with followed(at, (ARM / "desk_arm", ARM / "steered.yaml")):
        *corners, refused = STEER["square"](at)
    robot = hoap3.load_robot(str(ARM / "desk_arm"))
    for corner, q in zip(STEER["CORNERS"], corners, strict=True):
        assert np.linalg.norm(pose(robot, "tip", q)[:3, 3] - corner) < 2e-3
    np.testing.assert_allclose(refused, corners[-1], atol=1e-2)


@pytest.mark.slow
def test_the_folder_of_ones_own_arm_is_what_the_command_writes(tmp_path, monkeypatch):
    monkeypatch.chdir(ARM)
    assert inside("robot", "import", "desk_arm.urdf", "--out", tmp_path / "desk_arm").code == 0
    written, kept = (
        {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}
        for folder in (tmp_path / "desk_arm", ARM / "desk_arm")
    )
    assert kept.pop("robot.yaml").startswith(written.pop("robot.yaml"))  # a posture was added
    assert kept == written
    assert inside("robot", "check", ARM / "desk_arm").code == 0


@pytest.mark.slow
def test_controllers_are_compared_on_the_same_task():
    made = COMPARING["measured"](["qp12", "gentle=qp12@gamma=0.9", "pinv"], "ur5", 4.0)
    heading, *rows = COMPARING["rows"](made)
    assert [row[0] for row in rows] == ["qp12", "gentle", "pinv"]
    assert all(len(row) == len(heading) for row in rows)
    starts = [figures["error"]["start"] for figures in made.figures]
    np.testing.assert_allclose(starts, starts[0])
    efforts = {
        label: figures["control_effort"]["l1"]
        for label, figures in zip(made.labels, made.figures, strict=True)
    }
    assert COMPARING["best"](made)["label"] == min(efforts, key=efforts.__getitem__)
