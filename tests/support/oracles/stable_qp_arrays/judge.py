"""How far an answer is from the optimum, and from the largest ρ that it must have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.stable_qp_settings import Settings
from support.oracles.stable_qp_arrays import box, farkas, optimality
from support.oracles.stable_qp_arrays.largest import Missing, missing
from support.oracles.stable_qp_arrays.scaled import Objective, Scaled, Stacked

Array = NDArray[np.float64]


class Judge:
    """Judges answers by the settings of a controller.

    Where V falls as asked, an answer is optimal for any multiplier of V's rate. Where it falls
    less, that is as much as the constraints allow, by Farkas' lemma; or, where ρ is damped, the
    multiplier is the price of a faster fall: more is not worth its speed.

    Attributes:
        equality: whether V̇ is given.
        always: whether answers cannot be judged many at a time.
    """

    def __init__(self, settings: Settings, objective: Objective) -> None:
        self._kind, self._objective = objective.kind, objective
        self._ratio = float(settings.rest["max_speed_ratio"])
        self.equality, self.always = settings.rest["lyapunov"] == "equality", objective.alone
        self._damped = self.equality and settings.rest["rho"] == "damped"
        self._rate = optimality.FREE if self.equality else optimality.FALLING

    def alone(self, stack: Stacked, equations: bool) -> Array:
        """Residuals as if there were bounds alone, (N,); inf where that says nothing."""
        if self._kind != "norm" or equations:
            return np.full(len(stack.y), np.inf)
        parts = stack.y, stack.slope, stack.kappa, stack.lower, stack.upper
        return np.asarray(box.deviation(*parts) / stack.scale)

    def __call__(
        self, p: Scaled, alone: float, enough: float, kept: float, *, short: bool
    ) -> tuple[float, Missing]:
        """Residual of an answer, and by how much its fall of V is below what it must be.

        Args:
            p: the problem with its answer.
            alone: its residual as if there were bounds alone.
            enough: a residual that counts as optimal.
            kept: what the answer may be beyond a side.
            short: whether V falls less than asked.
        """
        if self._objective.alone:
            exponent = float(self._objective.exponent or 0.0)
            return optimality.holder_gap(p.slope, p.y, exponent), Missing()
        if alone <= enough:
            return alone, self._missing(p, enough, kept) if short else Missing()
        if short and self._damped:
            found = self._priced(p, enough)
            if found <= enough:
                return found, Missing()
        found = optimality.residual(p, self._kind, enough, self._rate)
        return found, missing(p, farkas.most_fall(p), kept) if short else Missing()

    def _missing(self, p: Scaled, enough: float, kept: float) -> Missing:
        """What V's fall lacks where no row is in its way."""
        found = missing(p, most_by_bounds(p), kept)
        if found.nothing:
            return found
        if self._damped and self._priced(p, enough) <= enough:
            return Missing()
        return missing(p, farkas.most_fall(p), kept)

    def _priced(self, p: Scaled, enough: float) -> float:
        """Residual where the multiplier of V's rate is the price of a faster fall."""
        price = p.price(self._ratio, self._kind)
        return optimality.residual(p, self._kind, enough, optimality.FIXED, price)


def most_by_bounds(p: Scaled) -> farkas.Most:
    """The most that −s·y can be within the bounds."""
    moves = p.slope != 0.0
    s = p.slope[moves]
    most = np.maximum(-s * p.lower[moves], -s * p.upper[moves]).sum()
    return farkas.Most(float(most), float(np.abs(s).sum()))
