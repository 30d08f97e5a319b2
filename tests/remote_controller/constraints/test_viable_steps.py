"""One period from a viable state violates nothing beyond what is stated, of each constraint.

A few states by default; `-m slow` tries 10,000 of each constraint at each level.
"""

from __future__ import annotations

import numpy as np
import pytest
from registered_constraints import BALL
from support.constraint_bench import PERIOD, AccelerationBench, Bench, posture, small

from hoap3.remote_controller.constraints.registry import BUILTIN, find

FEW, MANY = 150, 10_000
ENTRIES = {
    "joint_velocity": {"limit_rad_s": 2.0},
    "joint_position": {},
    "joint_acceleration": {"limit_rad_s2": 30.0},
    "viability": {},
    "support_polygon": {"margin_m": 0.12},
    "zmp": {},
    "friction_cone": {},
    "distance": {"obstacles": [BALL], "activation_m": 3.0, "joints_apart": 1},
    "fixed_frame": {"frame": "hand", "axes": ["x"]},
    "half_space": {"frame": "hand", "normal": [0, 1, 1], "offset_m": 0.2},
    "user_function": {"function": f"{__name__}:within_a_ball"},
    "minimum_speed": {"joints": {"elbow": 1.0, "wrist": -0.5}, "speed": 0.1},
    "pfaffian": {"function": f"{__name__}:rolling"},
}
RATE_LOST = 1e-3  # of ṁ + ηm, which is ≥ 0 in a viable state: |d³m/dt³|·T²/2
RESERVE = 1e-5  # of barriers; what curvature may cost in a period
LOST = {
    # the QP solver keeps rows of J·u to 1e-6, which is so much of J·u/T, and z/g times that
    ("velocity", "zmp"): 1e-4,
    ("velocity", "friction_cone"): 2e-3,
    # c̈ is that of the period's begin, the margin that of all of it: J̈·q̇ and J̇·q̈ times T/2
    ("acceleration", "zmp"): 2e-3,
    ("acceleration", "friction_cone"): 4e-2,
}
DRIFT = {  # of R(Σ|u|)²T²/2, of R(Σ|q̇|)(Σ|q̈|)T³/2, and of as much over T of what q̇ must keep
    ("velocity", "fixed_frame"): 5e-6,
    ("acceleration", "fixed_frame"): 5e-8,
    ("velocity", "pfaffian"): 0.0,
    ("acceleration", "pfaffian"): 2e-4,
}
LEVELS = [
    (level, name) for name in sorted(BUILTIN) for level in ("velocity", "acceleration")
    if find(name).serves(level) and name != "joint_torque"
]  # fmt: skip


def within_a_ball(q):
    return [4.0 - q @ q], [-2.0 * q]


def rolling(q):
    return np.array([[np.sin(q[0]), -np.cos(q[0]), 0.3]])


def entry(name):
    return {"constraint": name, **ENTRIES.get(name, {})}


def margins_after(bench, u):
    """Of one step of a velocity."""
    bench.at(bench.state.reference + PERIOD * u)
    return bench.only.margins.copy()


def steps_of_velocities(name, count, rng):
    """Try so many viable states; return how many had a margin within reach of the step."""
    bench, near = Bench(small(), entry(name)), 0
    for seed in range(count):
        bench.stack.reset()
        bench.state.dq[:] = 0.0
        bench.at(posture(small(), int(rng.integers(1 << 31)) + seed))
        before = bench.only.margins.copy()
        if not (before >= 0.0).all():
            continue
        wanted = rng.uniform(-1.0, 1.0, 3) * (30.0 if name.startswith("joint") else 1.0)
        for _ in range(1 + 3 * (name == "viability")):
            u = bench.nearest(wanted)
            after = margins_after(bench, u)
        lost = LOST.get(("velocity", name), RESERVE if bench.only.yields else 1e-9)
        assert (after >= -lost).all()
        if bench.only.yields:
            assert (after[before >= RESERVE] >= -1e-12).all()
        assert bench.stack.drift() <= DRIFT.get(("velocity", name), 0.0)
        near += bool((before < 0.05).any())
    return near


def rates(bench, q, dq):
    """ṁ of conditional margins, by differences."""
    found = []
    for side in (1e-6, -1e-6):
        bench.kinematics.update(q + side * dq)
        found.append(np.zeros(bench.only.margins.size))
        bench.only.margins_at(bench.kinematics, found[-1])
    with np.errstate(invalid="ignore"):  # of what is switched off
        return (found[0] - found[1]) / 2e-6


def viable(bench, name, rng):
    """A state that keeps the constraint, and can; None where this posture does not."""
    q, dq = posture(small(), int(rng.integers(1 << 31))), rng.uniform(-1.0, 1.0, 3)
    stack, only = bench.stack, bench.only
    if name in {"zmp", "friction_cone"}:
        dq *= 0.2
    if name == "viability":  # as fast as it can stop, from where it stops
        room = np.minimum(q - small().lower, small().upper - q)
        dq *= np.minimum(np.sqrt(2.0 * 39.0 * room), 3.0) * 0.99
        dq *= np.maximum(0.0, 1.0 - 3e-3 / np.maximum(room, 3e-3))
    if name == "joint_position":
        dq *= np.sqrt(2.0 * 39.0 * np.minimum(q - small().lower, small().upper - q)) * 0.9
    stack.reset()
    bench.at(q, dq)
    if only.equality:
        rows = stack.rows
        dq = dq - np.linalg.pinv(rows) @ (rows @ dq)
    if only.guarantee == "conditional":
        if only.margin() < 0.0:
            return None
        speed, room = rates(bench, q, dq), only._eta_in_use * only.margins
        too_fast = np.isfinite(room) & (speed < -room)
        if too_fast.any():
            dq = dq * float((room[too_fast] / -speed[too_fast]).min()) * 0.999
    if name == "minimum_speed" and dq[1] - 0.5 * dq[2] < 0.1:
        dq[1] += 0.1 - (dq[1] - 0.5 * dq[2]) + rng.uniform(0.0, 0.1)
    return q, dq


def steps_of_accelerations(name, count, rng):
    bench, near = AccelerationBench(small(), entry(name)), 0
    stack, only = bench.stack, bench.only
    only._eta_in_use = getattr(only, "_eta", 0.0) or 0.0
    if name == "distance":
        only._eta_in_use = float(only._settings[3])
    for _ in range(count):
        state = viable(bench, name, rng)
        if state is None:
            continue
        q, dq = state
        stack.reset()
        bench.at(q, dq)
        before = only.margins.copy()
        push = 10.0 if name in {"zmp", "friction_cone"} else 40.0
        ddq = bench.nearest(rng.uniform(-push, push, 3), most=1e3)
        if ddq is None:
            continue
        bench.hold(ddq)
        lost = LOST.get(("acceleration", name), RESERVE if only.yields else 1e-9)
        assert (only.margins >= -lost).all()
        assert stack.drift() <= DRIFT.get(("acceleration", name), 0.0)
        if only.yields and name != "distance":  # where another point may have become the nearest
            speed = rates(bench, bench.state.q, bench.state.dq)
            known = np.isfinite(only.margins)
            assert (speed + only._eta_in_use * only.margins >= -RATE_LOST)[known].all()
        if name == "joint_velocity":
            assert (np.abs(bench.state.dq) <= 2.0 + 1e-9).all()
        if name == "joint_acceleration":
            assert (np.abs(ddq) <= 30.0 + 1e-9).all()
        near += bool((before < 0.05).any())
    return near


STEPS = {"velocity": steps_of_velocities, "acceleration": steps_of_accelerations}


def test_every_constraint_of_ours_is_tried():
    assert {name for _, name in LEVELS} | {"joint_torque"} == set(BUILTIN)


@pytest.mark.parametrize(("level", "name"), LEVELS)
def test_a_period_from_a_viable_state_violates_nothing(level, name):
    STEPS[level](name, FEW, np.random.default_rng(1))


@pytest.mark.slow
@pytest.mark.parametrize(("level", "name"), LEVELS)
def test_ten_thousand_of_them(level, name):
    near = STEPS[level](name, MANY, np.random.default_rng(2))
    if find(name).yields:
        assert near > 100
