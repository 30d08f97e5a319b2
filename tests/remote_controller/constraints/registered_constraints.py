"""Every registered constraint: ours as below, those of installed packages with their defaults."""

from __future__ import annotations

from support.constraint_bench import entry, hoap3, small

from hoap3.remote_controller.constraints.registry import ConstraintSettings, registered
from hoap3.testing import ConstraintCase


def within_a_ball(q):
    """A user's function: |q|² ≤ 40."""
    return [40.0 - q @ q], [-2.0 * q]


BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
OURS = {
    "joint_velocity": {"limit_rad_s": 0.5},
    "joint_position": {"margin_rad": 0.01},
    "joint_acceleration": {"limit_rad_s2": 20.0},
    "viability": {},
    "support_polygon": {"margin_m": 0.002},
    "zmp": {},
    "friction_cone": {},
    "user_function": {"function": f"{__name__}:within_a_ball"},
    "distance": {"rows": 800, "activation_m": 2.0},  # so that all pairs have rows
    "fixed_frame": {"frame": "l_sole", "axes": ["x", "y", "rz"]},
    "half_space": {"frame": "r_forearm", "normal": [0, 1, 1], "offset_m": -0.5},
    "minimum_speed": {"joints": {"waist_pitch": 1.0}, "speed": 0.1},
    "pfaffian": {"matrix": [[1.0] * 21]},
}
SMALL = {
    "half_space": {"frame": "hand", "normal": [0, 0, 1], "offset_m": 0.2},
    "distance": {"obstacles": [BALL], "activation_m": 0.5, "joints_apart": 1},
    "support_polygon": {},
}


def cases() -> list[ConstraintCase]:
    """What the property suite runs over."""
    ours = [
        ConstraintCase(name + suffix, robot, entry({"constraint": name, **parameters}), name)
        for suffix, robot, given in (("", hoap3(), OURS), (" of an arm", small(), SMALL))
        for name, parameters in given.items()
    ]
    others = [
        ConstraintCase(name, hoap3(), ConstraintSettings(constraint=name), f"constraint {name}")
        for name in sorted(set(registered()) - set(OURS) - {"joint_torque"})  # says nothing of u
    ]
    return [*ours, *others]
