"""What QP12 refuses, and the kernel as plain Python."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from support.solvers.one_shot import qp12

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers import Qp12


def test_zero_gradient_is_infeasible_unless_nothing_is_asked() -> None:
    with pytest.raises(InfeasibleError, match=r"0\.25"):
        qp12([0.0, -0.0], 0.25, 0.5)
    np.testing.assert_array_equal(qp12([0.0, -0.0], 0.0, 0.5), [0.0, 0.0])
    np.testing.assert_array_equal(qp12([], 0.0, 0.5), [])
    with pytest.raises(InfeasibleError):
        qp12([], 1.0, 0.5)


@pytest.mark.parametrize(
    ("gradient", "decrease", "gamma"),
    [
        ([1.0, np.nan], 1.0, 0.5),
        ([1.0, -np.inf], 1.0, 0.5),
        ([np.nan, np.nan], 0.0, 0.5),
        ([1.0, 2.0], np.nan, 0.5),
        ([1.0, 2.0], np.inf, 0.5),
        ([1.0, 2.0], 1.0, -1e-300),
        ([1.0, 2.0], 1.0, 1 + 2.0**-52),
        ([1.0, 2.0], 0.0, np.nan),
        ([0.0, 0.0], np.nan, 0.5),
    ],
)
def test_bad_values_are_refused_and_leave_zeros(
    gradient: list[float], decrease: float, gamma: float
) -> None:
    solver, out = Qp12(2), np.full(2, 7.0)
    with pytest.raises(BadProblemError, match="gamma"):
        solver.solve(np.array(gradient), decrease, gamma, out)
    np.testing.assert_array_equal(out, [0.0, 0.0])
    assert solver.kkt_residual == np.inf


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("slope", "decrease"), [(1e-300, 1e10), (5e-324, 1e-10), (1e-5, 1e305)])
def test_an_answer_beyond_the_range_is_an_error_not_infinity(
    slope: float, decrease: float, gamma: float
) -> None:
    out = np.full(2, 7.0)
    with pytest.raises(BadProblemError):
        Qp12(2).solve(np.array([slope, 0.0]), decrease, gamma, out)
    np.testing.assert_array_equal(out, [0.0, 0.0])


def test_wrong_sizes_are_refused_before_anything_is_written() -> None:
    for n, gradient, out in ((2, 3, 2), (2, 2, 3), (3, 2, 2), (2, 0, 2)):
        u = np.full(out, 7.0)
        with pytest.raises(BadProblemError, match=rf"\({n},\)"):
            Qp12(n).solve(np.ones(gradient), 1.0, 0.5, u)
        np.testing.assert_array_equal(u, np.full(out, 7.0))


def test_class_refuses_arrays_that_its_kernel_was_not_compiled_for() -> None:
    good = np.ones(2)
    for gradient in (np.ones(4)[::2], np.ones(2, dtype=np.float32), [1.0, 1.0], np.ones((1, 2))):
        with pytest.raises(BadProblemError):
            Qp12(2).solve(gradient, 1.0, 0.5, good)  # type: ignore[arg-type]
    with pytest.raises(BadProblemError):
        Qp12(2).solve(good, None, 0.5, good)  # type: ignore[arg-type]


PLAIN = """
import json, sys
import numpy as np
from hoap3.remote_controller.solvers import Pinv, Qp12
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kernel
rng = np.random.default_rng(11)
bits = [type(qp12_kernel).__name__]
for gamma in (0.0, 0.1, 0.5, 0.99, 1 - 1e-15, 1.0):
    for scale in (1.0, 1e-300, 1e300):
        gradient = rng.normal(size=21) * scale
        gradient[3] = -gradient[5]
        for decrease in (0.3 * scale, -1e-12 * scale, 1e-300):
            solver, u = Qp12(21), np.empty(21)
            solver.solve(gradient, decrease, gamma, u)
            bits += [u.tobytes().hex(), float(solver.kkt_residual).hex()]
for rank in (1, 2, 3, 6):
    J = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, 21))
    e = J @ rng.normal(size=21)
    solver, u = Pinv(6, 21), np.empty(21)
    for solve in (solver.solve, solver.solve_plain):
        solve(J, e, 0.2, u)
        bits.append(u.tobytes().hex())
json.dump(bits, sys.stdout)
"""


@pytest.mark.slow
def test_plain_python_gives_the_same_bits() -> None:
    outputs = []
    for disable in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-c", PLAIN],
            env=os.environ | {"NUMBA_DISABLE_JIT": disable},
            capture_output=True,
            text=True,
            check=True,
        )
        outputs.append(json.loads(done.stdout))
    compiled, plain = outputs
    assert (compiled[0], plain[0]) == ("CPUDispatcher", "function")
    assert compiled[1:] == plain[1:]
