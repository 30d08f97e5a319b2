"""The pseudo-inverse as a controller: QP12's rate of decrease, or the plain law."""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, TARGET, controller_for, run
from free_flyer import FreeFlyer

from hoap3.protocol.messages import State
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.testing import Body

SCALES = ["inverse_sqrt_n", "one", "max_norm"]


def state_at(q: np.ndarray) -> State:
    state = State(HOAP3.n)
    state.q[:] = state.reference[:] = q
    return state


def velocity(controller, state: State) -> np.ndarray:
    controller.reset(state, None)
    controller.step(state)
    return controller.u.copy()


@pytest.mark.parametrize("scale", SCALES)
def test_at_equal_states_v_falls_as_fast_as_with_qp12(scale):
    pinv = controller_for(HOAP3, "pinv", psi_scale=scale)
    sparse = controller_for(HOAP3, "qp12", psi_scale=scale)
    for q in run("pinv", 2000, psi_scale=scale).q[::100]:
        one, other = pinv.step(state_at(q)), sparse.step(state_at(q))
        assert one.v == other.v
        assert one.v_rate_predicted == pytest.approx(other.v_rate_predicted, rel=1e-9)


@pytest.mark.parametrize("gain", [1.0, 10.0])
def test_the_plain_law_is_numpys_pseudo_inverse(gain):
    controller = controller_for(HOAP3, "pinv", law="plain", gain_per_s=gain)
    floating = FreeFlyer(HOAP3)
    rng = np.random.default_rng(4)
    for q in (HOAP3.initial_position, *rng.uniform(HOAP3.lower, HOAP3.upper, (50, HOAP3.n))):
        com, jacobian = floating.com("r_sole", q)
        expected = -gain * np.linalg.pinv(jacobian) @ (com - TARGET)
        u = velocity(controller, state_at(q))
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_the_plain_law_starts_with_18_joints_as_the_paper_says():
    plain = run("pinv", law="plain", gain_per_s=10.0)
    assert plain.active[0].sum() == 18
    assert np.abs(plain.u[0]).max() == pytest.approx(0.59, abs=0.005)


def test_a_joint_beyond_u_max_is_not_certified():
    controller, body = controller_for(HOAP3, "pinv", law="plain", gain_per_s=30.0), Body(HOAP3)
    command = controller.step(body.state)
    assert np.abs(controller.u).max() > 0.6
    assert command.margin == pytest.approx(0.6 - np.abs(controller.u).max())
    assert command.solver_status == STATUS["uncertified"]
