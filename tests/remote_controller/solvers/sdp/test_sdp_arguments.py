"""Arguments of the solver of certified gains: refused, or used as they are."""

from __future__ import annotations

import numpy as np
import pytest
from sdp_problems import ur5
from support.solvers.one_shot import sdp_gains

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.sdp.sdp_gains import NONE, SdpGains

GOOD = {
    "jacobians": [[[1.0, 1, 2, 1]], np.eye(2, 4)],
    "errors": [[0.1], [-0.1, 0.2]],
    "dt": 0.01,
    "dq_lower": [-1.0] * 4,
    "dq_upper": [1.0] * 4,
    "beta_desired": 2.0,
}


@pytest.mark.parametrize("change", [{"sizes": ()}, {"sizes": (2, 0)}, {"joints": 0}])
def test_a_solver_that_cannot_be_is_refused(change):
    with pytest.raises(BadProblemError):
        SdpGains(**({"sizes": (2, 1), "joints": 6} | change))


def test_where_nothing_overflows_the_size_of_jacobians_does_not_matter():
    limits = {"dq_lower": [-np.inf] * 4, "dq_upper": [np.inf] * 4}
    usual = sdp_gains(**GOOD | limits)
    for size in (1e-150, 1e153):
        jacobians = [size * np.array(each) for each in GOOD["jacobians"]]
        found = sdp_gains(**GOOD | limits | {"jacobians": jacobians})
        np.testing.assert_allclose(found.gains, usual.gains, rtol=1e-9)
        assert found.beta == pytest.approx(usual.beta, rel=1e-9)


@pytest.mark.parametrize("asked", [1e9, 1e12, 1e200, 1e308])
def test_however_much_is_asked_one_over_the_period_meets_it(asked):
    alone = {"jacobians": GOOD["jacobians"][:1], "errors": [[1e-3]], "beta_desired": asked}
    assert sdp_gains(**GOOD | alone).beta == pytest.approx(100.0, rel=1e-2)


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
