"""What gains are given: refused by its name, its value and a remedy, or passed on as it is."""

from __future__ import annotations

import numpy as np
import pytest
from sdp_problems import ur5

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers import sdp_gains
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.sdp.sdp_backends import ConicGains
from hoap3.remote_controller.solvers.sdp.sdp_gains import NONE, SdpGains

GOOD = {
    "jacobians": [[[1.0, 1, 2, 1]], np.eye(2, 4)],
    "errors": [[0.1], [-0.1, 0.2]],
    "dt": 0.01,
    "dq_lower": [-1.0] * 4,
    "dq_upper": [1.0] * 4,
    "beta_desired": 2.0,
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"budget": 2.5}, ("budget", "whole number", "found 2.5", "iterations")),
        ({"budget": True}, ("budget", "whole number", "found True", "iterations")),
        ({"budget": None}, ("budget", "whole number", "found None", "iterations")),
        ({"budget": 0}, ("budget", "1 or more", "found 0", "iterations")),
        ({"joints": 6.0}, ("joints", "whole number", "found 6.0", "as an int")),
        ({"joints": "6"}, ("joints", "whole number", "found '6'", "as an int")),
        ({"joints": -6}, ("joints", "1 or more", "found -6", "as an int")),
        ({"sizes": [2.0, 3]}, ("sizes[0]", "whole number", "found 2.0", "rows of the task")),
        ({"sizes": [2, np.True_]}, ("sizes[1]", "whole number", "True", "rows of the task")),
        ({"sizes": [2, 0]}, ("sizes[1]", "1 or more", "found 0", "rows of the task")),
        ({"sizes": []}, ("sizes", "one task or more", "found []", "such as [3, 1]")),
        ({"sizes": 3}, ("sizes", "one task or more", "found 3", "such as [3, 1]")),
        ({"sizes": "31"}, ("sizes[0]", "whole number", "found '3'", "rows of the task")),
        ({"damping": -1.0}, ("damping", "not negative", "found -1.0", "Give 0 for none")),
        ({"damping": float("nan")}, ("damping", "finite", "found nan", "Give 0 for none")),
        ({"damping": 1e200}, ("damping", "square", "found 1e+200", "Give 0 for none")),
    ],
)
def test_a_solver_that_cannot_be_is_refused(change, words):
    arguments = {"sizes": (2, 1), "joints": 6} | change
    made = [lambda: SdpGains(**arguments), lambda: ConicGains(**arguments)]
    if "budget" not in change:
        made.append(lambda: ConstantGains(wanted=np.ones(3), **arguments))
    for make in made:
        with pytest.raises(BadProblemError) as caught:
            make()
        for word in words:
            assert word in str(caught.value)


def test_whole_numbers_of_numpy_are_taken():
    solver = SdpGains(np.array([2, 1]), np.int64(6), budget=np.int32(7))
    assert (solver.n, solver.joints, solver.budget) == (3, 6, 7)
    assert {type(each) for each in (solver.n, solver.joints, solver.budget)} == {int}


@pytest.mark.parametrize("task", [0, 1])
@pytest.mark.parametrize("size", [1.4e154, 1e200, 1.7e308])
def test_a_row_whose_length_overflows_is_named(task, size):
    jacobians = [np.array(each, float) for each in GOOD["jacobians"]]
    jacobians[task][-1, 2] = -size
    with pytest.raises(BadProblemError) as caught:
        sdp_gains(**GOOD | {"jacobians": jacobians})
    words = f"jacobians[{task}]", f"row {task}", f"up to {size:.3g}", "Check the units"
    for word in words:
        assert word in str(caught.value)


def test_where_nothing_overflows_the_size_of_jacobians_does_not_matter():
    limits = {"dq_lower": [-np.inf] * 4, "dq_upper": [np.inf] * 4}
    gains, beta = sdp_gains(**GOOD | limits)
    for size in (1e-150, 1e153):
        jacobians = [size * np.array(each) for each in GOOD["jacobians"]]
        found, proved = sdp_gains(**GOOD | limits | {"jacobians": jacobians})
        np.testing.assert_allclose(found, gains, rtol=1e-9)
        assert proved == pytest.approx(beta, rel=1e-9)


def test_a_value_that_is_not_finite_is_told_as_such():
    jacobians = [[[np.inf, 1.0, 2.0, 1.0]], np.eye(2, 4)]
    with pytest.raises(BadProblemError, match=r"jacobians: a value is not finite"):
        sdp_gains(**GOOD | {"jacobians": jacobians})
    with pytest.raises(BadProblemError, match=r"beta_desired must be positive and finite .*inf"):
        sdp_gains(**GOOD | {"beta_desired": np.inf})


@pytest.mark.parametrize("asked", [1e9, 1e12, 1e200, 1e308])
def test_however_much_is_asked_one_over_the_period_meets_it(asked):
    alone = {"jacobians": GOOD["jacobians"][:1], "errors": [[1e-3]], "beta_desired": asked}
    _, beta = sdp_gains(**GOOD | alone)
    assert beta == pytest.approx(100.0, rel=1e-2)


def test_the_function_passes_on_what_it_is_given():
    more = {
        "weights": [1.0, 0.2],
        "damping": 0.3,
        "delta": 1e-2,
        "dq_lower": [-0.03, -0.06, -0.07, -0.03],
        "dq_upper": [0.05, 0.06, 0.07, 0.08],
    }
    gains, beta = sdp_gains(**GOOD | more)
    solver = SdpGains((1, 2), 4, weights=[1.0, 0.2, 0.2], damping=0.3)
    solver.lower[:], solver.upper[:] = more["dq_lower"], more["dq_upper"]
    J, e = np.vstack(GOOD["jacobians"]), np.concatenate(GOOD["errors"])
    assert solver.solve(J, e, 0.01, 2.0, 1e-2) == status.OK
    assert gains.tobytes() == solver.gains.tobytes()
    assert beta == solver.beta > 0.0
    for name in more:
        without = {key: value for key, value in more.items() if key != name}
        other, _ = sdp_gains(**GOOD | without)
        assert np.abs(other - gains).max() > 1e-6, name


def test_after_wrong_arrays_nothing_of_an_answer_is_left():
    it = ur5(0)
    solver = it.solved()
    assert solver.beta > 0.0
    with pytest.raises(BadProblemError, match="float64"):
        solver.solve(it.J.astype(np.float32), it.e, it.dt, it.desired)
    assert (solver.status, solver.path, solver.beta) == (status.UNSOLVED, NONE, 0.0)
    assert not solver.gains.any()
    assert not solver.dq.any()
    fresh = it.solved()
    assert solver.solve(it.J, it.e, it.dt, it.desired) == fresh.status == status.OK
    assert (solver.path, solver.gains.tobytes()) == (fresh.path, fresh.gains.tobytes())


def test_what_was_asked_is_known_afterwards():
    it = ur5(0)
    solver = it.solver()
    assert solver.desired == 0.0
    solver.solve(it.J, it.e, it.dt, 3.5)
    assert solver.desired == 3.5
