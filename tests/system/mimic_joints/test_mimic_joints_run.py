"""Every family of controllers on an arm with mimic and continuous joints, checked by verify."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from support.command_bench import inside
from support.robots.following_arm import write

from hoap3.tools.services.simulate import simulate
from hoap3.tools.verify.verify import verify

SECONDS = 0.1
TARGET = {"kind": "point", "position_m": [0.1, 0.2, 0.9], "approach_s": 0.05}
HAND = {"frame": "tool", "reference": "base", "target": TARGET}
TURN = {"joints": ["turn", "roll"], "target_rad": [7.0, -7.0]}  # more than a turn away


def tasks(each: dict[str, Any], *, rest: bool = False) -> list[dict[str, Any]]:
    found = [
        {"name": "hand", "task": "frame_position", "parameters": HAND, **each},
        {"name": "turn", "task": "posture", "parameters": TURN, **each},
    ]
    posture = {"name": "rest", "task": "posture", "parameters": {"posture": "bent"}, **each}
    return [*found, posture] if rest else found


def dynamic(**more: object) -> dict[str, Any]:
    return {"tasks": tasks({"kp": 30.0, "kd": 12.0}, rest=True), **more}


TWO = {"order": ["hand", "turn"]}
ORDER = {"order": ["hand", "turn", "rest"]}
KEPT = [
    {"constraint": "joint_position"},
    {"constraint": "viability"},
    {"constraint": "distance", "parameters": {"joints_apart": 2, "activation_m": 0.3}},
]
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "qp12": ("position", {}),
    "pinv": ("position", {}),
    "osqp": ("position", {}),
    "clik": ("position", {"tasks": tasks({"gain_per_s": 2.0})}),
    "clik_sdp": ("position", {"tasks": tasks({}), "beta_per_s": 4.0}),
    "stable_qp": ("position", {"constraints": KEPT}),
    "ghc_velocity": ("position", {"tasks": tasks({"gain_per_s": 2.0}), "priorities": TWO}),
    "ghc": ("torque", dynamic(priorities=ORDER)),
    "ghc_torque": ("torque", dynamic(priorities=ORDER)),
    "hqp": ("torque", dynamic(priorities=ORDER)),
    "weighted": ("torque", dynamic(priorities={"weights": {"hand": 1.0, "turn": 0.1}})),
    "tsid": ("torque", {}),
    "joint_acceleration": ("acceleration", {"posture": "zero"}),
}
"""Command and parameters by controller."""
QUICK = ("clik", "stable_qp", "tsid")


EACH = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH)
def test_a_controller_moves_it_and_its_log_is_true(name: str, tmp_path: Path) -> None:
    command, parameters = CASES[name]
    config = {"controller": name, "robot": "following", "parameters": parameters}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    robot, out = write(tmp_path).parent, tmp_path / "run"
    given = "--robot", robot, "--controller", tmp_path / "own.yaml", "--duration", SECONDS
    done = inside("run", "--lockstep", *given, "--out", out, "--set", f"emulator.command={command}")
    assert done.code in {0, 1}, done.stderr
    found = verify(out)
    assert found.verdict == "true", found.claims


@pytest.mark.slow
def test_a_continuous_joint_turns_more_than_once(tmp_path: Path) -> None:
    """7 rad and back, where no limit is; mimic joints keep their relation."""
    robot = {"robot": str(write(tmp_path).parent), "command": "position"}
    parameters = {"tasks": tasks({"gain_per_s": 5.0})[1:]}
    found = simulate(robot, {"controller": "clik", "parameters": parameters}, 5.0)
    turn = found.states["q"][:, 1]
    assert turn[-1] == pytest.approx(7.0, abs=1e-3)
    assert np.abs(np.diff(turn)).max() <= 2.0 * 1e-3 * (1.0 + 1e-9)
    assert found.deadlines.run_rate == 1.0
