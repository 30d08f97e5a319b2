"""The program that other solvers get says what the matrix inequality and the limits say."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.sdp_backends import ConicForm


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 6))
def test_its_slack_is_that_of_the_limits_and_the_matrix(seed: int, n: int, joints: int) -> None:
    """Filled twice, with other limits in between: what is laid out once is no memory."""
    rng = np.random.default_rng(seed)
    form = ConicForm(n, joints)
    for _ in range(3):
        L, S = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.8), rng.normal(size=(n, joints))
        limits = np.where(rng.random((2, joints)) < 0.7, rng.random((2, joints)), np.inf)
        limits[0] *= -1.0
        dt, delta, gains, beta = rng.uniform(0.01, 1), rng.uniform(0.1, 1), rng.normal(size=n), 0.3
        P, q, A, b = form.fill(L, S, limits, dt, delta)
        x = np.append(gains, beta)
        slack = b - A @ x
        speed = gains @ S
        room = np.concatenate([limits[1] - speed, speed - limits[0]])
        np.testing.assert_array_equal(form.used, np.flatnonzero(np.isfinite(room)))
        np.testing.assert_allclose(slack[: form.used.size], room[form.used], atol=1e-12)
        tall = L * gains
        top = np.hstack([tall + tall.T - beta * np.eye(n), np.sqrt(dt) * tall.T])
        whole = np.vstack([top, np.hstack([np.sqrt(dt) * tall, np.eye(n)])])
        entries = slack[form.used.size :] / form.roots
        assert entries.size == n * (2 * n + 1)
        np.testing.assert_allclose(entries, whole[form.rows, form.columns], atol=1e-12)
        np.testing.assert_array_equal(form.rows <= form.columns, True)
        objective = 0.5 * x @ (P @ x) + q @ x + 1.0
        assert abs(objective - (delta * gains @ gains + (beta - 1.0) ** 2)) < 1e-12
        assert A.has_sorted_indices
        assert np.all(A.data != 0.0)
