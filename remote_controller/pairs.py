"""Which shipped controller configs run on which robots: for errors, `hoap3 list` and the docs.

A config that leaves its task to the robot runs on every robot that takes its commands. One that
names frames, postures or targets is for the robots that have them. Each pair is run by
`tests/system/commands/test_pairs.py`, which refuses a config that is missing here.
"""

from __future__ import annotations

from pathlib import Path

HOAP3, HUMANOID, UR5 = ("hoap3",), ("humanoid32",), ("ur5",)
ARMS = ("ur5", "lwr", "baxter", "baxter_left_arm", "baxter_right_arm")

DEFAULT_CONFIG = "qp12_bounded"
"""The config that `hoap3 run`, `hoap3 soak` and `simulate` use where none is named."""

PAIRS: dict[str, tuple[str, ...]] = {
    "qp12_bounded": (*HOAP3, *HUMANOID, *ARMS),
    "qp12": (*HOAP3, *HUMANOID, *ARMS),
    "pinv": (*HOAP3, *HUMANOID, *ARMS),
    "osqp": (*HOAP3, *HUMANOID, *ARMS),
    "stable_qp": (*HOAP3, *HUMANOID, *ARMS),
    "clik_sdp": (*HOAP3, *HUMANOID, *ARMS),
    "tsid": (*HUMANOID, *ARMS),
    "clik_sdp_hoap3": HOAP3,
    "clik_sdp_humanoid": HUMANOID,
    "clik_sdp_ur5": UR5,
    "clik_sdp_writing": UR5,
    "clik_ur5": UR5,
    "com_circulation": HOAP3,
    "com_tracking": HOAP3,
    "ghc": ("lwr_weightless",),
    "ghc_force": ("lwr_with_table",),
    "ghc_humanoid": ("humanoid32_torque",),
    "ghc_standing": ("hoap3_standing_torque",),
    "ghc_standing_humanoid": ("humanoid32_standing",),
    "ghc_torque": ("lwr_weightless",),
    "ghc_velocity": HOAP3,
    "hqp": ("lwr_weightless",),
    "joint_acceleration": HOAP3,
    "obstacle": HOAP3,
    "qp12_paper": HOAP3,
    "stable_qp_hoap3": HOAP3,
    "stable_qp_standing": ("hoap3_standing",),
    "steered_ur5": UR5,
    "tsid_baxter": ("baxter",),
    "tsid_standing": ("hoap3_standing_torque",),
    "tsid_standing_humanoid": ("humanoid32_standing",),
    "weighted": ("lwr_weightless",),
}
"""By controller config, what `--robot` takes: names of robots, and of emulator configs."""

POSTURES = {
    ("clik_sdp_ur5", "ur5"): "outstretched",
    ("clik_sdp_writing", "ur5"): "outstretched",
    ("clik_ur5", "ur5"): "outstretched",
}
"""Where a pair does not start in the robot's own posture: `--set emulator.posture=…`."""

HELD_BACK = {("pinv", "hoap3"), ("osqp", "hoap3")}
"""Pairs whose controller knows no joint limits, so that the robot holds a joint back at one."""


def configs_for(robot: str) -> list[str]:
    """Names of the shipped controller configs that run on a robot, or on an emulator config."""
    return [name for name, robots in PAIRS.items() if robot in robots]


def robots_for(file: str) -> list[str]:
    """Robots and emulator configs that the shipped config in a file runs on; [] for other files.

    Args:
        file: its path, as errors name it: " with --set" may follow.
    """
    path = Path(file.removesuffix(" with --set"))
    shipped = path.parent == Path(__file__).parent / "configs"
    return list(PAIRS.get(path.stem, ())) if shipped else []
