"""The QP12 paper's experiment, number by number, against an independent reference run.

A is the law as printed: Ψ = u_max|∇V|R/√n; C leaves √n out; M takes |∇V|∞ instead. A joint is
active from 0.001 rad/s on, and its count is the mean over the first 400 ms, as in the paper. Here
the robot may go to its stops, as in the reference run; `hoap3 reproduce qp12` keeps to the usable
range.
"""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, Run, controller_for, run

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.testing import Body

SCALES = {"A": "inverse_sqrt_n", "C": "one", "M": "max_norm"}
NAMES = HOAP3.joint_names


def experiment(case: str, *law: object, ticks: int = 401, until: float = 0.0) -> Run:
    """`law`: "pinv", or γ, or γ and "adaptive"."""
    if law[0] == "pinv":
        return run("pinv", ticks, until, psi_scale=SCALES[case])
    adaptive = law[1:] == ("adaptive",)
    return run("qp12", ticks, until, psi_scale=SCALES[case], gamma=law[0], adaptive_gamma=adaptive)


def first_velocities(gamma: float) -> dict[str, float]:
    controller, body = controller_for(HOAP3, "qp12", gamma=gamma), Body(HOAP3)
    controller.reset(body.state, None)
    u = (controller.step(body.state).values - body.state.reference) / 1e-3
    return {name: speed for name, speed in zip(NAMES, u, strict=True) if speed != 0.0}


@pytest.mark.parametrize("gamma", [0.5, 0.99])
def test_at_the_start_only_the_right_ankle_pitches(gamma):
    assert first_velocities(gamma) == {"r_ankle_pitch": pytest.approx(-0.07484482, abs=1e-8)}


def test_at_the_start_without_sparsity_many_joints_move():
    speeds = first_velocities(0.0)
    assert len(speeds) > 10
    for name, speed in {
        "r_knee": -0.02979371,
        "r_ankle_pitch": -0.04693614,
        "r_ankle_roll": -0.00747475,
        "waist_pitch": 0.01020066,
    }.items():
        assert speeds[name] == pytest.approx(speed, abs=1e-8), name


TO_A_TENTH = [
    ("A", ("pinv",), 4578),
    ("A", (0.0,), 13258),
    ("A", (0.1, "adaptive"), 7617),
    ("A", (0.5, "adaptive"), 13217),
    ("A", (0.99, "adaptive"), 13359),
    ("A", (0.1,), 12912),
    ("A", (0.5,), 13035),
    ("A", (0.99,), 13044),
    ("C", ("pinv",), 997),
    ("C", (0.0,), 2892),
    ("C", (0.1, "adaptive"), 2576),
    ("C", (0.5, "adaptive"), 1333),
    ("C", (0.99, "adaptive"), 1963),
    ("C", (0.1,), 1059),
    ("C", (0.5,), 2870),
    ("C", (0.99,), 2878),
]


@pytest.mark.parametrize(("case", "law", "ticks"), TO_A_TENTH, ids=str)
def test_so_long_to_a_tenth_of_a_millimetre(case, law, ticks):
    found = experiment(case, *law, ticks=15000, until=1e-4).ticks_to(1e-4)
    assert found == pytest.approx(ticks, abs=1)  # chattering makes a tick of rounding


def test_constant_sparsity_chatters_and_adaptive_does_not():
    """On/off switches per second in the two seconds before |e| < 1 mm: sliding, against resting."""

    def switches(*law: object) -> float:
        active = experiment("A", *law, ticks=4000, until=1e-3).active[-1000:]
        return float((active[1:] != active[:-1]).any(axis=1).mean() * 1e3)

    assert switches(0.99) > 500
    assert switches(0.99, "adaptive") < 20


@pytest.mark.parametrize("gamma", [0.0, 0.1, 0.5, 0.99])
def test_the_largest_gradient_as_scale_is_at_least_twice_as_fast(gamma):
    root = experiment("A", gamma, ticks=15000, until=1e-4).ticks_to(1e-4)
    largest = experiment("M", gamma, ticks=15000, until=1e-4)
    assert largest.ticks_to(1e-4) <= root / 2
    bound = 0.6 * 2 / np.pi * np.arctan(46 * largest.error)
    assert (np.abs(largest.u).max(axis=1) <= bound * (1 + 1e-9)).all()


def test_what_the_robot_will_hold_back_is_not_certified():
    """The waist starts on its usable limit, and QP12 knows no limits: it pushes against it."""
    law = {"psi_scale": "one", "gamma": 0.5, "adaptive_gamma": True}
    blocked = run("qp12", 2000, usable_limits=True, **law)
    waist = NAMES.index("waist_pitch")
    pushes = blocked.q[:, waist] + blocked.u[:, waist] * 1e-3 < 0.0
    assert pushes.sum() > 500
    assert (blocked.status[pushes] == STATUS["uncertified"]).all()
    assert (blocked.status[~pushes] == STATUS["certified"]).all()
    assert (blocked.q[:, waist] >= 0.0).all()
    free = run("qp12", 2000, **law)
    assert (free.status == STATUS["certified"]).all()


def test_the_same_law_in_metres_has_the_same_bits():
    """β of 46/cm is 4600/m, and a slope of 100 rad/cm² is 10⁶ rad/m²; V stays in m²."""
    given = {"gamma": 0.5, "adaptive_gamma": True}
    metres = run("qp12", 300, 0.0, beta=4600.0, gamma_slope=1e6, **given)
    for name in ("v", "rate", "u"):
        found = getattr(run("qp12", 300, 0.0, error_unit="cm", **given), name)
        np.testing.assert_array_equal(found, getattr(metres, name))
    one = run("pinv", 50, 0.0, error_unit="mm").u
    np.testing.assert_array_equal(one, run("pinv", 50, 0.0, beta=46e3).u)
    one = run("osqp", 50, 0.0, error_unit="cm", **given).u
    np.testing.assert_array_equal(
        one, run("osqp", 50, 0.0, beta=4600.0, gamma_slope=1e6, **given).u
    )


@pytest.mark.parametrize(
    "wrong", [{"error_unit": "inch"}, {"gamma_slope": 0.0}, {"gamma_slope": 1e13}]
)
def test_another_unit_or_slope_is_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        controller_for(HOAP3, "qp12", **wrong)
