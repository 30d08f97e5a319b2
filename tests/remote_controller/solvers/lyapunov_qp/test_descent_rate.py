"""Ψ in its forms: what each promises about speeds and about the fall of V."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, UnknownNameError
from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import qp12_descent
from hoap3.remote_controller.solvers import qp12
from hoap3.remote_controller.solvers.lyapunov_qp import descent_rate_kernels
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS, DescentRate

Array = NDArray[np.float64]
gradients = arrays(
    np.float64, st.integers(1, 21), elements=st.floats(-10, 10).filter(lambda x: abs(x) > 1e-6)
)


@given(gradients, st.floats(1e-3, 10), st.floats(0, 1), st.sampled_from([0, 1, 2]))
def test_speeds_of_qp12_stay_below_u_max(
    gradient: Array, error: float, gamma: float, form: int
) -> None:
    rate = DescentRate(FORMS[form], u_max=0.6, beta=46.0)
    u = qp12(gradient, rate(0.0, gradient, error), gamma)
    reach = 2 / math.pi * math.atan(46.0 * error)
    loose = math.sqrt(gradient.size) if form == 1 else 1.0
    assert np.abs(u).max() <= 0.6 * reach * loose * (1 + 1e-12)


@given(gradients)
def test_order_of_the_three_scalings(gradient: Array) -> None:
    slow, none, sharp = (DescentRate(form)(0.0, gradient, 0.1) for form in FORMS[:3])
    assert slow <= sharp * (1 + 1e-12)
    assert sharp <= none * (1 + 1e-12)
    assert none == pytest.approx(slow * math.sqrt(gradient.size))


def test_formulas() -> None:
    gradient = np.array([3.0, -4.0])
    assert DescentRate("tanh", eta=2.0, kappa=0.1)(0.7, gradient, 0.0) == pytest.approx(
        2 * 0.7 * math.tanh(0.5)
    )
    assert DescentRate("exponential", eta=2.0)(0.7, gradient, 0.0) == pytest.approx(1.4)
    reach = 2 / math.pi * math.atan(4.6)
    assert DescentRate("inverse_sqrt_n")(0.0, gradient, 0.1) == pytest.approx(
        0.6 * 5 / math.sqrt(2) * reach
    )


@pytest.mark.parametrize("form", [0, 1, 2])
def test_is_what_the_controllers_have(form: int) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        error, jacobian = rng.normal(size=3) * 0.02, rng.normal(size=(3, 21))
        gradient, u, certificate = np.zeros(21), np.zeros(21), np.zeros(6)
        qp12_descent(error, jacobian, 0.6, 46.0, form, 0.5, 0.0, gradient, u, certificate)
        psi = DescentRate(FORMS[form])(certificate[0], gradient, float(np.linalg.norm(error)))
        assert psi == pytest.approx(-certificate[1], rel=1e-13)


@pytest.mark.parametrize("form", [form for form in FORMS if form != "exponential"])
def test_vanishes_with_the_gradient_and_no_slower(form: str) -> None:
    """Condition (4): Ψ/|∇V| stays bounded where V does not vanish."""
    ratios = []
    for size in (1e-3, 1e-150, 1e-300):
        gradient = np.array([1.0, -1.0]) * size
        ratios.append(DescentRate(form)(1.0, gradient, 1.0) / size)
    assert np.allclose(ratios, ratios[0], rtol=1e-3)
    assert DescentRate(form)(1.0, np.zeros(2), 1.0) == 0.0


def test_the_exponential_form_does_not() -> None:
    assert DescentRate("exponential")(1.0, np.zeros(2), 1.0) == 1.0


def test_tanh_is_slower_than_any_exponential_near_the_target() -> None:
    """V' = −Ψ with ∇V = e: V falls like 1/t², the exponential form like exp(−t)."""
    left = {}
    for form in ("tanh", "exponential"):
        rate, V = DescentRate(form, eta=1.0, kappa=10.0), 0.5
        for _ in range(2000):
            V -= 2e-2 * rate(V, np.array([math.sqrt(2 * V)]), 0.0)
        left[form] = V
    assert left["exponential"] < 1e-15
    assert left["tanh"] > 1e-7


def test_forms_of_kernel_and_class_agree() -> None:
    assert [getattr(descent_rate_kernels, form.upper()) for form in FORMS] == [0, 1, 2, 3, 4]


def test_refusals() -> None:
    with pytest.raises(UnknownNameError, match="max_norm"):
        DescentRate("maxnorm")
    for parameter in ("u_max", "beta", "eta", "kappa"):
        for value in (0.0, -1.0, math.nan, math.inf):
            with pytest.raises(BadProblemError, match=parameter):
                DescentRate(**{parameter: value})
    rate, one = DescentRate(), np.ones(2)
    for V, gradient, error in (
        (-1.0, one, 0.0),
        (math.nan, one, 0.0),
        (0.0, one * math.inf, 0.0),
        (0.0, one, -0.1),
        (0.0, one, math.nan),
    ):
        with pytest.raises(BadProblemError):
            rate(V, gradient, error)  # type: ignore[arg-type]
    with pytest.raises(BadProblemError):
        DescentRate("exponential", eta=1e300)(1e300, one, 0.0)


def test_wrong_shapes_and_types_are_refused() -> None:
    with pytest.raises(BadProblemError):
        DescentRate()(0.0, [1.0, 2.0], 0.1)  # type: ignore[arg-type]
