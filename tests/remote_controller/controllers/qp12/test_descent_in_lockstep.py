"""V never rises, in lockstep on the ideal plant, for every γ: the paper's promise (section V-C)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from com_runs import HOAP3, PERIOD, TARGET, run
from free_flyer import FreeFlyer

from hoap3.protocol.messages import FloatArray
from hoap3.tools.services.simulate import Simulation, simulate

GAMMAS = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0]
CLOSE = 1e-9  # m: from there on V may do what rounding does, as long as |e| stays below
U_MAX, BETA = 0.6, 46.0


def lockstep(duration: float, **parameters: object) -> Simulation:
    return simulate("hoap3", {"controller": "qp12", "parameters": parameters}, duration)


def speeds(simulation: Simulation) -> FloatArray:
    """(ticks, n) [rad/s]."""
    setpoints = simulation.setpoints["values"]
    return (setpoints - simulation.states["reference"][: len(setpoints)]) / PERIOD


def check_descent(simulation: Simulation, target: FloatArray = TARGET) -> None:
    v = simulation.setpoints["v"]
    error = np.sqrt(2 * v)
    far = error > CLOSE
    assert (np.diff(v)[far[:-1]] <= 0.0).all()
    if not far.all():
        assert not far[np.argmin(far) :].any()
    check_from_outside(simulation, target)


def check_from_outside(simulation: Simulation, target: FloatArray) -> None:
    """The same from the measured positions alone, at every hundredth tick."""
    floating = FreeFlyer(HOAP3)
    q = simulation.states["q"][: len(simulation.setpoints)]
    seen = [np.linalg.norm(floating.com("r_sole", row)[0] - target) for row in q[::100]]
    reported = np.sqrt(2 * simulation.setpoints["v"][::100])
    np.testing.assert_allclose(seen, reported, rtol=0, atol=5e-15)
    assert all(later <= max(before, CLOSE) for before, later in pairwise(seen))


def check_speed(simulation: Simulation) -> None:
    """|u|∞ ≤ u_max·R(e) ≤ u_max, (17)."""
    error = np.sqrt(2 * simulation.setpoints["v"])
    bound = U_MAX * 2 / np.pi * np.arctan(BETA * error)
    rounding = 2 * np.finfo(float).eps * np.pi / PERIOD  # of a difference of positions
    assert (np.abs(speeds(simulation)).max(axis=1) <= bound + rounding).all()


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.99, 1.0])
def test_v_never_rises_as_printed(gamma):
    simulation = lockstep(4.0, gamma=gamma)
    check_descent(simulation)
    check_speed(simulation)
    assert simulation.setpoints["v"][-1] < 1e-2 * simulation.setpoints["v"][0]


@pytest.mark.slow
def test_v_never_rises_until_e_is_a_nanometre():
    simulation = lockstep(14.0, gamma=0.1, psi_scale="one")
    check_descent(simulation)
    assert np.sqrt(2 * simulation.setpoints["v"][-1]) < CLOSE


@pytest.mark.long
@pytest.mark.parametrize("adaptive", [False, True], ids=["constant", "adaptive"])
@pytest.mark.parametrize("scale", ["inverse_sqrt_n", "one", "max_norm"])
@pytest.mark.parametrize("gamma", GAMMAS)
def test_v_never_rises_in_20_seconds(gamma, scale, adaptive):
    simulation = lockstep(20.0, gamma=gamma, psi_scale=scale, adaptive_gamma=adaptive)
    check_descent(simulation)
    assert np.abs(speeds(simulation)).max() <= U_MAX
    if scale != "one":  # which gives up the bound for speed
        check_speed(simulation)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_at_the_target_nothing_moves(gamma):
    """Where rounding is all that is left of e, the printed algorithm answers with 97 rad/s."""
    target = FreeFlyer(HOAP3).com("r_sole", HOAP3.initial_position)[0]
    simulation = lockstep(0.3, gamma=gamma, target_m=target.tolist())
    assert np.sqrt(2 * simulation.setpoints["v"]).max() <= 1e-15
    assert np.abs(speeds(simulation)).max() <= 1e-12


@pytest.mark.parametrize("gamma", GAMMAS)
def test_from_nearby_it_comes_and_stays(gamma):
    start = FreeFlyer(HOAP3).com("r_sole", HOAP3.initial_position)[0]
    target = start + np.array([1e-8, 0.0, 0.0])
    simulation = lockstep(1.0, gamma=gamma, psi_scale="one", target_m=target.tolist())
    check_descent(simulation, target)
    assert np.sqrt(2 * simulation.setpoints["v"][-1]) < CLOSE


@pytest.mark.parametrize("scale", ["inverse_sqrt_n", "one", "max_norm"])
def test_psi_is_what_the_paper_says(scale):
    """(16) with (39) and (41), from an independent Jacobian."""
    simulation = lockstep(0.2, psi_scale=scale)
    floating = FreeFlyer(HOAP3)
    for tick in (0, 50, 199):
        com, jacobian = floating.com("r_sole", simulation.states["q"][tick])
        error = com - TARGET
        gradient = jacobian.T @ error
        reach = 2 / np.pi * np.arctan(BETA * np.linalg.norm(error))
        psi = {
            "inverse_sqrt_n": U_MAX * np.linalg.norm(gradient) / np.sqrt(21) * reach,
            "one": U_MAX * np.linalg.norm(gradient) * reach,
            "max_norm": U_MAX * np.abs(gradient).max() * reach,
        }[scale]
        required = simulation.setpoints["v_rate_required"][tick]
        assert required == pytest.approx(-psi, rel=1e-12)
        assert gradient @ speeds(simulation)[tick] == pytest.approx(-psi, rel=1e-9)


def test_the_tests_own_loop_moves_as_lockstep_does():
    """What the other files find without loops and links holds with them."""
    simulation = lockstep(0.5, gamma=0.5)
    alone = run("qp12", 500, usable_limits=True, gamma=0.5)
    np.testing.assert_array_equal(simulation.states["q"][:500], alone.q)
    np.testing.assert_array_equal(simulation.setpoints["v"], alone.v)
