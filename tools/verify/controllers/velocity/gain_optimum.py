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
Indices = NDArray[np.intp]

ACTIVE = 1e-6  # of the largest eigenvalue, or of 1 + |limit|: what may have a multiplier
RAYS = 200  # y of Z that are tried
NEXT_TO_NOTHING = 1e-5  # M²c² is 1e-10


@dataclass(frozen=True)
class Gains:
    """The problems of N cycles, and the gains in question.

    Attributes:
        L: (N, m, m).
        S: (N, n, m).
        least, most: of Sλ, (N, n), around 0.
        dt, delta: Δt β̃ and δ.
        gains: λ, (N, m), which keep the limits.
    """

    L: Array
    S: Array
    least: Array
    most: Array
    dt: float
    delta: float
    gains: Array

    def gaps(self, enough: Array) -> Array:
        """What the objective, with the β that they certify, is above the optimum at most, (N,).

        Args:
            enough: gaps that need not be made less, (N,).
        """
        found = self._gaps_of(*self._active_multipliers())
        for k in np.flatnonzero(found > enough):
            one = self._only(int(k))
            Z, z = one._searched_multipliers(float(enough[k]))
            found[k] = min(found[k], one._gaps_of(Z, z)[0])
        return found

    def _only(self, k: int) -> Gains:
        at = slice(k, k + 1)
        limits = self.least[at], self.most[at], self.dt, self.delta
        return Gains(self.L[at], self.S[at], *limits, self.gains[at])

    @cached_property
    def _matrices(self) -> Array:
        step = self.L * self.gains[:, None, :]
        turned = step.transpose(0, 2, 1)
        return step + turned - self.dt * turned @ step

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self._matrices)
        return values, vectors

    @cached_property
    def _slopes(self) -> Array:
        """V: ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ of its columns."""
        turned = self.L.transpose(0, 2, 1)
        return self.L - self.dt * self.gains[:, :, None] * (turned @ self.L)

    @cached_property
    def _rooms(self) -> Array:
        """How far Sλ is from most and least, (N, 2n)."""
        speeds = (self.S @ self.gains[:, :, None])[:, :, 0]
        rooms = np.concatenate([self.most - speeds, speeds - self.least], 1)
        return np.asarray(np.maximum(rooms, 0.0))

    @cached_property
    def _sides(self) -> Array:
        """Rows of the limits, (N, 2n, m)."""
        return np.concatenate([self.S, -self.S], 1)

    def _terms(self, at: Indices, Y: Array, sides: Array) -> tuple[Array, Array, Array]:
        """What makes g, as a sum of squares: |of_W·W + of_z z − wanted|², with 2δ for H.

        Args:
            at: cycles, (a,).
            Y: (a, m, r) of Z = Y W Yᵀ.
            sides: (a, s, m) rows of limits.

        Returns:
            of_W (a, m + 1, r, r), of_z (a, m + 1, s), wanted (a, m + 1).
        """
        count, m, r = Y.shape
        scale = np.append(np.full(m, 0.5 / np.sqrt(self.delta)), 0.5)
        beta = self._eigen[0][at, :1]
        wanted = -scale * np.hstack([2.0 * self.delta * self.gains[at], 2.0 * (beta - 1.0)])
        # g_λ,i = −2 (VᵀY W Yᵀ)_ii, g_β = tr W
        X = self._slopes[at].transpose(0, 2, 1) @ Y
        of_W = np.zeros((count, m + 1, r, r))
        of_W[:, :m], of_W[:, m] = -2.0 * np.einsum("kia,kib->kiab", X, Y), np.eye(r)
        of_W = 0.5 * scale[:, None, None] * (of_W + of_W.transpose(0, 1, 3, 2))
        of_z = np.concatenate([sides.transpose(0, 2, 1), np.zeros((count, 1, sides.shape[1]))], 1)
        return of_W, scale[:, None] * of_z, wanted

    def _active_multipliers(self) -> tuple[Array, Array]:
        """Z and z of what is active, with the least g: those of an optimum, but for their signs."""
        values, vectors = self._eigen
        Z, z = np.zeros(self.L.shape), np.zeros(self._rooms.shape)
        largest = np.maximum(values[:, -1:], 1.0)
        ranks = (values - values[:, :1] <= ACTIVE * largest).sum(1)
        limits = np.abs(np.concatenate([self.most, self.least], 1))
        near = self._rooms <= ACTIVE * (1.0 + limits)
        kinds, which = np.unique(np.stack([ranks, near.sum(1)], 1), axis=0, return_inverse=True)
        for number, (r, holding) in enumerate(kinds.tolist()):
            at = np.flatnonzero(which.ravel() == number)
            Y, held = vectors[at, :, :r], np.nonzero(near[at])[1].reshape(len(at), holding)
            sides = np.take_along_axis(self._sides[at], held[:, :, None], 1)
            of_W, of_z, wanted = self._terms(at, Y, sides)
            A = np.concatenate([of_W.reshape(*of_W.shape[:2], -1), of_z], 2)
            x = (np.linalg.pinv(A, 1e-12) @ wanted[:, :, None])[:, :, 0]
            Z[at] = Y @ x[:, : r * r].reshape(-1, r, r) @ Y.transpose(0, 2, 1)
            z[at[:, None], held] = x[:, r * r :]
        return Z, z

    def _searched_multipliers(self, enough: float) -> tuple[Array, Array]:
        """Z = Σ x yyᵀ and z with the least gap, of one cycle: more y while one makes it less.

        The gap, with 2δ for H, is a sum of squares and what is linear in x, z ≥ 0. The latter is
        made a square as well: c = (Mc + 1/2M)² − M²c² − 1/4M², where M²c² is next to nothing: c is
        part of the gap.
        """
        (values,), (vectors,) = self._eigen
        terms = self._terms(np.zeros(1, np.intp), vectors[None], self._sides)
        of_W, of_z, wanted = (term[0] for term in terms)
        cost, rays = np.diag(values - values[0]), np.eye(len(values))
        M = min(1.0, max(NEXT_TO_NOTHING / enough, NEXT_TO_NOTHING))
        for _ in range(RAYS):
            of_rays = np.einsum("kab,la,lb->kl", of_W, rays, rays)
            paid = np.append(np.einsum("ab,la,lb->l", cost, rays, rays), self._rooms[0])
            A = np.vstack([np.hstack([of_rays, of_z]), M * paid])
            x = _non_negative(A, np.append(wanted, -0.5 / M))
            share, z = x[: len(rays)], x[len(rays) :]
            Z = vectors @ (rays.T * share) @ rays @ vectors.T
            rest = of_rays @ share + of_z @ z - wanted
            slopes, axes = np.linalg.eigh(2.0 * np.einsum("k,kab->ab", rest, of_W) + cost)
            if slopes[0] >= 0.0 or self._gaps_of(Z[None], z[None])[0] <= enough:
                break
            rays = np.vstack([rays[share > 0.0], axes[:, :1].T])
        return Z[None], z[None]

    def _gaps_of(self, Z: Array, z: Array) -> Array:
        """The gaps for any multipliers: what of them is negative is left out."""
        own, axes = np.linalg.eigh(Z)
        Z = axes * np.maximum(own, 0.0)[:, None, :] @ axes.transpose(0, 2, 1)
        z, beta, trace = np.maximum(z, 0.0), self._eigen[0][:, 0], np.trace(Z, axis1=1, axis2=2)
        slope = 2.0 * self.delta * self.gains - 2.0 * (self._slopes * Z).sum(1)
        slope += np.einsum("ks,ksi->ki", z, self._sides)
        last = 2.0 * (beta - 1.0) + trace
        turned = self.L.transpose(0, 2, 1)
        H = 2.0 * self.delta * np.eye(Z.shape[1]) + 2.0 * self.dt * (turned @ self.L) * Z
        less = 0.5 * (slope * np.linalg.solve(H, slope[:, :, None])[:, :, 0]).sum(1)
        pulled = (self._matrices * Z).sum((1, 2)) - beta * trace + (z * self._rooms).sum(1)
        return np.asarray(pulled + less + 0.25 * last**2)


def _non_negative(A: Array, b: Array) -> Array:
    """The x ≥ 0 with the least |Ax − b|; columns of any length."""
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0.0] = 1.0
    found: Array = nnls(A / lengths, b)[0] / lengths
    return found
