"""How far gains may be from the best ones, by the dual of their semidefinite program.

Marti-Saumell et al.: min (β − β̃)² + δ|λ|² such that C(λ, β) ⪰ 0, see `clik_law`, and the limits of
dq = fed + Sλ, S = B diag(e). For any Z ⪰ 0 and z ≥ 0 the least value of

    (β − β̃)² + δ|λ|² − ⟨Z, C(λ, β)⟩ + z₊·(Sλ − most) + z₋·(least − Sλ)

is a bound of it from below, whoever found Z and z. It is a quadratic in (λ, β) with the Hessian
2δI + 2Δt (LᵀL ∘ Z) and 2, so the bound follows from the gradient g at the gains in question, and

    gap = ⟨Z, C⟩ + z₊·(most − Sλ) + z₋·(Sλ − least) + ½ g_λᵀ H⁻¹ g_λ + ¼ g_β²

is what their objective may lie above the optimum. All is in units of β̃ here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

ACTIVE = 1e-6  # of the largest eigenvalue, or of 1 + |limit|: what may have a multiplier
RAYS = 200  # y of Z that are tried
LITTLE = 1e-2  # M, see there


@dataclass(frozen=True)
class Gains:
    """The problem of one cycle and the gains in question.

    Attributes:
        L: (m, m).
        S: (n, m).
        least, most: of Sλ, (n,), around 0.
        dt, delta: Δt β̃ and δ.
        gains: λ, (m,), which keep the limits.
    """

    L: Array
    S: Array
    least: Array
    most: Array
    dt: float
    delta: float
    gains: Array

    def gap(self, enough: float) -> float:
        """What their objective, with the β that they certify, is above the optimum at most.

        Args:
            enough: a gap that need not be made less.
        """
        found = self._gap_of(*self._active_multipliers())
        if found > enough:
            found = min(found, self._gap_of(*self._searched_multipliers(enough)))
        return found

    @cached_property
    def _matrix(self) -> Array:
        step = self.L * self.gains
        return step + step.T - self.dt * step.T @ step

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self._matrix)
        return values, vectors

    @cached_property
    def _slopes(self) -> Array:
        """V: ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ of its columns."""
        return self.L - self.dt * self.gains[:, None] * (self.L.T @ self.L)

    @cached_property
    def _rooms(self) -> Array:
        """How far Sλ is from most and least, (2n,)."""
        speeds = self.S @ self.gains
        rooms = np.concatenate([self.most - speeds, speeds - self.least])
        return np.asarray(np.maximum(rooms, 0.0))

    def _terms(self, Y: Array, sides: Array) -> tuple[Array, Array, Array]:
        """What makes g, as a sum of squares: |of_W·W + of_z z − wanted|², with 2δ for H.

        Args:
            Y: (m, r) of Z = Y W Yᵀ.
            sides: (s, m) rows of the limits.

        Returns:
            of_W (m + 1, r, r), of_z (m + 1, s), wanted (m + 1,).
        """
        m, r = Y.shape
        scale = np.append(np.full(m, 0.5 / np.sqrt(self.delta)), 0.5)
        wanted = -scale * np.append(2.0 * self.delta * self.gains, 2.0 * (self._eigen[0][0] - 1.0))
        # g_λ,i = −2 (VᵀY W Yᵀ)_ii, g_β = tr W
        of_W = np.concatenate([-2.0 * np.einsum("ia,ib->iab", self._slopes.T @ Y, Y), [np.eye(r)]])
        of_W = 0.5 * scale[:, None, None] * (of_W + of_W.transpose(0, 2, 1))
        return of_W, scale[:, None] * np.vstack([sides.T, np.zeros((1, len(sides)))]), wanted

    def _active_multipliers(self) -> tuple[Array, Array]:
        """Z and z of what is active, with the least g: those of an optimum, but for their signs."""
        values, vectors = self._eigen
        Y = vectors[:, values - values[0] <= ACTIVE * max(1.0, values[-1])]
        near = self._rooms <= ACTIVE * (1.0 + np.abs(np.concatenate([self.most, self.least])))
        of_W, of_z, wanted = self._terms(Y, np.vstack([self.S, -self.S])[near])
        A, r, z = np.hstack([of_W.reshape(len(wanted), -1), of_z]), Y.shape[1], np.zeros(len(near))
        x = np.linalg.lstsq(A, wanted, rcond=1e-12)[0]
        z[near] = x[r * r :]
        return Y @ x[: r * r].reshape(r, r) @ Y.T, z

    def _searched_multipliers(self, enough: float) -> tuple[Array, Array]:
        """Z = Σ x yyᵀ and z with the least gap: more y while one makes it less.

        The gap, with 2δ for H, is a sum of squares and what is linear in x, z ≥ 0. The latter is
        made a square as well: c = (Mc + 1/2M)² − M²c² − 1/4M², where M²c² is next to nothing.
        """
        values, vectors = self._eigen
        sides, rooms = np.vstack([self.S, -self.S]), self._rooms
        of_W, of_z, wanted = self._terms(vectors, sides)
        cost, rays = np.diag(values - values[0]), np.eye(len(values))
        for _ in range(RAYS):
            of_rays = np.einsum("kab,la,lb->kl", of_W, rays, rays)
            paid = np.concatenate([np.einsum("ab,la,lb->l", cost, rays, rays), rooms])
            A = np.vstack([np.hstack([of_rays, of_z]), LITTLE * paid])
            x = _non_negative(A, np.append(wanted, -0.5 / LITTLE))
            share, z = x[: len(rays)], x[len(rays) :]
            W = (rays.T * share) @ rays
            Z = vectors @ W @ vectors.T
            rest = of_rays @ share + of_z @ z - wanted
            slopes, axes = np.linalg.eigh(2.0 * np.einsum("k,kab->ab", rest, of_W) + cost)
            if slopes[0] >= 0.0 or self._gap_of(Z, z) <= enough:
                break
            rays = np.vstack([rays[share > 0.0], axes[:, :1].T])
        return Z, z

    def _gap_of(self, Z: Array, z: Array) -> float:
        """The gap for any multipliers: what of them is negative is left out."""
        own, axes = np.linalg.eigh(Z)
        Z = (axes * np.maximum(own, 0.0)) @ axes.T
        z, n, beta = np.maximum(z, 0.0), len(self.most), self._eigen[0][0]
        slope = 2.0 * self.delta * self.gains - 2.0 * (self._slopes * Z).sum(0)
        slope += self.S.T @ (z[:n] - z[n:])
        last = 2.0 * (beta - 1.0) + np.trace(Z)
        H = 2.0 * self.delta * np.eye(len(Z)) + 2.0 * self.dt * (self.L.T @ self.L) * Z
        gap = (self._matrix * Z).sum() - beta * np.trace(Z) + z @ self._rooms
        return float(gap + 0.5 * slope @ np.linalg.solve(H, slope) + 0.25 * last**2)


def _non_negative(A: Array, b: Array) -> Array:
    """The x ≥ 0 with the least |Ax − b|; columns of any length."""
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0.0] = 1.0
    found: Array = nnls(A / lengths, b)[0] / lengths
    return found
