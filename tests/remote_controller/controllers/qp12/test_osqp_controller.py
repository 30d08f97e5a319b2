"""OSQP as a controller: the motion of `qp12`, certified only where it is as exact."""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, Run, controller_for, run

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.testing import Body


@pytest.mark.parametrize(
    "law",
    [
        {"gamma": 0.5},
        {"gamma": 0.0},
        {"gamma": 1.0},
        {"gamma": 0.99, "adaptive_gamma": True, "psi_scale": "one"},
    ],
    ids=str,
)
def test_it_moves_as_qp12_does(law):
    ours, theirs = run("qp12", 400, **law), run("osqp", 400, **law)
    np.testing.assert_allclose(theirs.u, ours.u, rtol=0, atol=1e-4)
    np.testing.assert_allclose(theirs.v, ours.v, rtol=1e-4)


def certified(found: Run) -> float:
    assert set(found.status) <= {STATUS["certified"], STATUS["uncertified"]}
    return float((found.status == STATUS["certified"]).mean())


def test_polished_it_is_certified_and_unpolished_it_is_not():
    assert certified(run("osqp", 400)) > 0.95
    assert certified(run("osqp", 400, polish=False)) < 0.05


def test_out_of_iterations_it_stays_and_goes_on_from_there_at_the_next_tick():
    found = run("osqp", 100, max_iterations=1)
    stays = found.status == STATUS["infeasible"]
    assert stays[:10].all()
    assert not found.u[stays].any()
    assert (found.status[~stays] == STATUS["certified"]).any()


@pytest.mark.parametrize("budget", [5, 20, 40])
def test_with_few_iterations_it_is_honest_tick_by_tick(budget):
    controller, body = controller_for(HOAP3, "osqp", max_iterations=budget), Body(HOAP3)
    controller.reset(body.state, None)
    for _ in range(200):
        command = controller.step(body.state)
        u = command.values - body.state.reference
        assert np.isfinite(command.values).all()
        assert np.isfinite([command.v, command.v_rate_predicted, command.kkt_residual]).all()
        assert 0 < command.extra[0] <= budget
        if command.solver_status == STATUS["infeasible"]:
            assert not u.any()
            assert command.v_rate_predicted == 0.0
        else:
            assert command.v_rate_predicted == pytest.approx(command.v_rate_required, rel=1e-3)
        body.follow(command.values)
