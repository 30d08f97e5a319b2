"""How far gains may be from the best ones, by the dual of their semidefinite program.

Marti-Saumell et al., (27): min (β − 1)² + δ|λ|² such that C(λ, β) ⪰ 0 and least ≤ Sλ ≤ most, see
`GainProgram`. For any multipliers Z ⪰ 0 of C and z ≥ 0 of the limits the least value of

    (β − 1)² + δ|λ|² − ⟨Z, C(λ, β)⟩ + z₊·(Sλ − most) + z₋·(least − Sλ)

bounds the optimum from below, wherever Z and z come from. It is a quadratic in (λ, β) with the
Hessian 2δI + 2Δt (LᵀL ∘ Z) and 2, so the bound follows from its gradient g at the gains, and

    gap = ⟨Z, C⟩ + z₊·(most − Sλ) + z₋·(Sλ − least) + ½ g_λᵀ H⁻¹ g_λ + ¼ g_β²

is by how much their objective may be above the optimum. Only this sum is trusted. The multipliers
come from the constraints that are active, then from a search, then from Clarabel.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import nnls

from hoap3.remote_controller.problems.statement import Array, GainProgram

ACTIVE = 1e-6  # of the largest eigenvalue, or of 1 + |limit|: what may have a multiplier
MAX_RAYS = 200  # y of Z = Σ x yyᵀ that are tried
NEGLIGIBLE = 1e-5  # M²c² is 1e-10 of the gap
PRECISE = {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-13}  # of Clarabel

Multipliers = tuple[Array, Array]


def gap_of(problem: GainProgram, enough: float) -> float:
    """By how much the objective, with the β that the gains certify, may be above its optimum.

    Args:
        problem: with gains that keep the limits.
        enough: a gap that need not be reduced further.
    """
    if not np.isfinite(problem.gains).all():
        return np.inf
    point = _Point(problem)
    witnesses: tuple[Callable[[], Multipliers], ...] = (
        point.active_multipliers,
        lambda: point.searched_multipliers(enough),
        lambda: _clarabel_multipliers(problem, point.sides, point.limits),
    )
    gap = np.inf
    for witness in witnesses:
        gap = min(gap, point.gap(*witness()))
        if gap <= enough:
            break
    return gap


class _Point:
    """The constraints and their slopes at the gains in question.

    Attributes:
        C: C(λ, 0), (m, m); its least eigenvalue is β.
        slopes: (m, m), ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ of its columns v_i.
        sides, limits: finite limits as rows, sides λ ≤ limits, (s, m) and (s,).
        rooms: limits − sides λ, (s,); what is beyond a limit counts as at it.
    """

    def __init__(self, problem: GainProgram) -> None:
        L, gains, self.dt, self.delta = problem.L, problem.gains, problem.dt, problem.delta
        step = L * gains
        self.gains, self.LL = gains, L.T @ L
        self.C = step + step.T - self.dt * step.T @ step
        self.values, self.vectors = np.linalg.eigh(self.C)
        self.beta = float(self.values[0])
        self.slopes = L - self.dt * gains[:, None] * self.LL
        sides, limits = np.vstack([problem.S, -problem.S]), np.append(problem.most, -problem.least)
        some = np.isfinite(limits)
        self.sides, self.limits = sides[some], limits[some]
        self.rooms = np.maximum(self.limits - self.sides @ gains, 0.0)

    def gap(self, Z: Array, z: Array) -> float:
        """The gap for any multipliers, (m, m) and (s,); what of them is negative is left out."""
        own, axes = np.linalg.eigh(0.5 * (Z + Z.T))
        Z, z = axes * np.maximum(own, 0.0) @ axes.T, np.maximum(z, 0.0)
        slope = 2.0 * self.delta * self.gains - 2.0 * (self.slopes * Z).sum(0) + z @ self.sides
        last = 2.0 * (self.beta - 1.0) + np.trace(Z)
        H = 2.0 * self.delta * np.eye(len(Z)) + 2.0 * self.dt * self.LL * Z
        pulled = (self.C * Z).sum() - self.beta * np.trace(Z) + z @ self.rooms
        return float(pulled + 0.5 * slope @ np.linalg.solve(H, slope) + 0.25 * last**2)

    def active_multipliers(self) -> Multipliers:
        """Those of what is active, with the least g: at an optimum they are exact."""
        values = self.values
        r = int((values - values[0] <= ACTIVE * max(values[-1], 1.0)).sum())
        near = self.rooms <= ACTIVE * (1.0 + np.abs(self.limits))
        Y, z = self.vectors[:, :r], np.zeros(len(near))
        of_W, of_z, wanted = self._terms(Y, self.sides[near])
        A = np.hstack([of_W.reshape(len(of_W), r * r), of_z])
        x = np.linalg.lstsq(A, wanted, rcond=1e-12)[0]
        z[near] = x[r * r :]
        return Y @ x[: r * r].reshape(r, r) @ Y.T, z

    def searched_multipliers(self, enough: float) -> Multipliers:
        """Z = Σ x yyᵀ and z with the least gap: rays y are added while one reduces it.

        The gap, with 2δ for H, is a sum of squares and c, which is linear in x, z ≥ 0. The latter
        becomes a square as well: c = (Mc + 1/2M)² − M²c² − 1/4M², where M²c² is negligible, since
        c is part of the gap.
        """
        of_W, of_z, wanted = self._terms(self.vectors, self.sides)
        cost, rays = np.diag(self.values - self.beta), np.eye(len(self.values))
        M = min(1.0, max(NEGLIGIBLE / max(enough, 1e-300), NEGLIGIBLE))
        Z, z = np.zeros_like(self.C), np.zeros(len(self.rooms))
        for _ in range(MAX_RAYS):
            of_rays = np.einsum("kab,la,lb->kl", of_W, rays, rays)
            paid = np.append(np.einsum("ab,la,lb->l", cost, rays, rays), self.rooms)
            A = np.vstack([np.hstack([of_rays, of_z]), M * paid])
            lengths = np.linalg.norm(A, axis=0)
            lengths[lengths == 0.0] = 1.0
            try:
                x = nnls(A / lengths, np.append(wanted, -0.5 / M))[0] / lengths
            except RuntimeError:  # too many steps: the rays so far have to do
                break
            share, z = x[: len(rays)], x[len(rays) :]
            Z = self.vectors @ (rays.T * share) @ rays @ self.vectors.T
            rest = of_rays @ share + of_z @ z - wanted
            slopes, axes = np.linalg.eigh(2.0 * np.einsum("k,kab->ab", rest, of_W) + cost)
            if slopes[0] >= 0.0 or self.gap(Z, z) <= enough:
                break
            rays = np.vstack([rays[share > 0.0], axes[:, :1].T])
        return Z, z

    def _terms(self, Y: Array, sides: Array) -> tuple[Array, Array, Array]:
        """What makes g, as a sum of squares |of_W·W + of_z z − wanted|², with 2δ for H.

        Args:
            Y: (m, r) of Z = Y W Yᵀ.
            sides: (s, m).

        Returns:
            of_W (m + 1, r, r), of_z (m + 1, s), wanted (m + 1,).
        """
        m, r = Y.shape
        scale = np.append(np.full(m, 0.5 / np.sqrt(self.delta)), 0.5)
        wanted = -scale * np.append(2.0 * self.delta * self.gains, 2.0 * (self.beta - 1.0))
        X, of_W = self.slopes.T @ Y, np.zeros((m + 1, r, r))
        of_W[:m] = -X[:, :, None] * Y[:, None, :] - Y[:, :, None] * X[:, None, :]
        of_W[m] = np.eye(r)  # g_λ,i = −2 (VᵀY W Yᵀ)_ii, g_β = tr W
        of_z = np.vstack([sides.T, np.zeros(len(sides))])
        return scale[:, None, None] * of_W, scale[:, None] * of_z, wanted


def _clarabel_multipliers(problem: GainProgram, sides: Array, limits: Array) -> Multipliers:
    """Those of an interior-point solution; none where Clarabel is not installed.

    C(λ, β) ⪰ 0 is the Schur complement of [[LΛ + ΛLᵀ − βI, √Δt ΛLᵀ], [√Δt LΛ, I]] ⪰ 0, (21), and
    its multiplier is the upper left block.
    """
    m, s = len(problem.L), len(limits)
    Z, z = np.zeros((m, m)), np.zeros(s)
    try:
        import clarabel
        from scipy.sparse import csc_matrix
    except ImportError:
        return Z, z
    rows, columns = (each.T for each in np.triu_indices(2 * m))
    order = np.lexsort((rows, columns))  # the upper triangle, column by column
    upper = rows[order], columns[order]
    scale = np.where(upper[0] == upper[1], 1.0, np.sqrt(2.0))
    A = np.zeros((s + len(scale), m + 1))
    A[:s, :m] = sides
    for i in range(m):
        step = np.zeros((m, m))
        step[:, i] = problem.L[:, i]
        F = np.zeros((2 * m, 2 * m))
        F[:m, :m], F[:m, m:] = step + step.T, np.sqrt(problem.dt) * step.T
        A[s:, i] = -scale * F[upper]
    A[s:, m] = scale * np.diag(np.repeat([1.0, 0.0], m))[upper]
    b = np.append(limits, scale * np.diag(np.repeat([0.0, 1.0], m))[upper])
    P = np.diag(np.append(np.full(m, 2.0 * problem.delta), 2.0))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    for name, tolerance in PRECISE.items():
        setattr(settings, name, tolerance)
    cones = [clarabel.NonnegativeConeT(s), clarabel.PSDTriangleConeT(2 * m)]
    cost = np.append(np.zeros(m), -2.0)
    solver = clarabel.DefaultSolver(csc_matrix(P), cost, csc_matrix(A), b, cones, settings)
    found = np.array(solver.solve().z, float)
    if not np.isfinite(found).all():
        return Z, z
    whole = np.zeros((2 * m, 2 * m))
    whole[upper] = found[s:] / scale
    whole = whole + np.triu(whole, 1).T
    return whole[:m, :m], found[:s]
