"""What `clik` and `clik_sdp` claim of V: how fast it falls, and how near it comes to a floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import schema
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controllers.velocity.answers import Answers
from hoap3.tools.verify.controllers.velocity.task_stack import PLACE, Tasks

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

EPS = float(np.finfo(float).eps)
STATUS = schema("Setpoint").constants
AT_TARGET = 1e-5  # of |e|, all tasks [m or rad]
TINY = 1e-300  # 1/s: a β that is positive is not less
FIRST_ORDER = 0.01  # of β: by how much V may fall slower


@dataclass(frozen=True)
class Claimed:
    """What is stated of each answer, and known of how it came about.

    Attributes:
        columns: by name, (N,).
        fed_back: what of u is not fed forward, (N, n).
        unsure: share of B that rounding may change, (N,).
        exact, sure: whether u is what optimal gains ask for, and where that is beyond doubt, (N,).
    """

    columns: Mapping[str, Array]
    fed_back: Array
    unsure: Array
    exact: Flags
    sure: Flags


class Certificate:
    """V = ½ Σ w e² of each cycle, and how exactly it is known.

    Args:
        answers, tasks: what is judged.
        weights: w of each row, (m,).
        claimed: of each answer.
    """

    def __init__(self, answers: Answers, tasks: Tasks, weights: Array, claimed: Claimed) -> None:
        run, cycles = answers.run, answers.cycles
        self._answers, self._T, self._cycles = run.answers, run.description.period_s, cycles
        self._tick, self._claimed, self._weights = answers.tick, claimed, weights
        self._u, self._doubt = answers.u, answers.doubt
        self._errors = len(tasks.labels)
        self.moving: Flags = np.asarray(cycles.rate.any(1))
        self.V, self.end = cycles.squares(weights)
        place = tasks.places  # of each row
        e, ahead = np.abs(cycles.e), np.abs(cycles.ahead)
        self._near = RELATIVE * self.V + (e * place + place**2) @ weights
        slope = np.abs(np.einsum("nm,nmj->nj", weights * cycles.e, cycles.J))
        led = (slope * self._doubt).sum(1)
        rounded = 8.0 * EPS * (self.V + self.end) + ((e + ahead) * place + 2.0 * place**2) @ weights
        self._fall = rounded / self._T + led  # of (V − end)/T
        self._place = float(np.sqrt(0.5 * (place**2 @ weights)))

    def check(self, floor_tolerance: float, claims: Claims) -> None:
        """Everything of it."""
        answers, tick, claimed = self._answers, self._tick, self._claimed
        claims.equal("V", tick, answers["v"], self.V, self._near)
        some = self.V > 0.0
        V = np.where(some, self.V, 1.0)
        actual = np.where(some, (self.V - self.end) / (V * self._T), 0.0)
        near = np.where(some, (self._fall + np.abs(actual) * self._near) / V, 0.0)
        near += RELATIVE * np.abs(actual)
        claims.equal("beta_actual", tick, claimed.columns["beta_actual"], actual, near)
        rho, sure = answers["rho"], claimed.sure
        claims.equal("rho", tick, rho, np.where(sure, claimed.exact, np.round(rho).clip(0, 1)))
        for kind in ("CERTIFIED", "AT_TARGET"):
            proven = answers["solver_status"] == STATUS[f"STATUS_{kind}"]
            name = f"{kind.lower()}: rho"
            claims.equal(name, tick[proven], rho[proven], np.ones(proven.sum()))
        self._check_standing(~self.moving, actual, near, claims)
        self._check_moving(self.moving, floor_tolerance, claims)

    def _check_standing(self, at: Flags, actual: Array, near: Array, claims: Claims) -> None:
        """Beside targets that stand: V⁺ ≤ (1 − βT) V, (12)."""
        answers, tick, claimed, cycles = (
            self._answers[at],
            self._tick[at],
            self._claimed,
            self._cycles,
        )
        weighted = self._weights * cycles.e[at]
        moved = cycles.J[at] @ self._u[at][:, :, None]
        size = np.abs(cycles.J[at]) @ np.abs(self._u[at])[:, :, None]
        slope = np.abs(np.einsum("nm,nmj->nj", weighted, cycles.J[at]))
        found = (weighted * moved[:, :, 0]).sum(1)
        exact = (RELATIVE * np.abs(weighted) + PLACE * self._weights) * size[:, :, 0]
        exact = exact.sum(1) + (slope * self._doubt[at]).sum(1)
        claims.equal("predicted V rate", tick, answers["v_rate_predicted"], found, exact)
        status, beta = answers["solver_status"], claimed.columns["beta"][at]
        length = np.linalg.norm(answers["extra"][:, : self._errors], axis=1)
        arrived = (answers["rho"] == 1.0) & (length <= AT_TARGET)
        sure = np.abs(length - AT_TARGET) > RELATIVE * AT_TARGET
        stated = status == STATUS["STATUS_AT_TARGET"]
        sure &= stated  # else an error may be above its tolerance
        claims.equal("at_target", tick[sure], stated[sure], arrived[sure])
        required = np.where(stated, 0.0, -np.maximum(beta, 0.0) * answers["v"])
        claims.equal("required V rate", tick, answers["v_rate_required"], required)
        for name in ("remainder", "floor"):
            claims.equal(name, tick, claimed.columns[name][at], np.zeros(at.sum()))
        proven = status == STATUS["STATUS_CERTIFIED"]
        slow = (1.0 - FIRST_ORDER) * beta - actual[at]
        claims.at_most("certified: V falls", tick[proven], slow[proven], 0.0, near[at][proven])
        claims.at_most("certified: beta", tick[proven], -beta[proven], -TINY, 0.0)

    def _check_moving(self, at: Flags, floor_tolerance: float, claims: Claims) -> None:
        """Beside targets that move: √V⁺ ≤ √(1 − βT)·√V + r, and the floor that follows."""
        answers, tick, claimed, T = self._answers[at], self._tick[at], self._claimed, self._T
        cycles, columns = self._cycles, {key: at_[at] for key, at_ in self._claimed.columns.items()}
        fall = (self.end - self.V)[at] / T
        exact = RELATIVE * np.abs(fall) + self._fall[at]
        claims.equal("predicted V rate", tick, answers["v_rate_predicted"], fall, exact)
        led = T * (cycles.J[at] @ claimed.fed_back[at][:, :, None])[:, :, 0]
        rest = cycles.e[at] + led - cycles.ahead[at]  # −ρ, of e⁺ = (I − T L Λ)e + ρ
        r = np.sqrt(0.5 * (rest**2 @ self._weights))
        size = (np.abs(cycles.J[at]) @ np.abs(claimed.fed_back[at])[:, :, None])[:, :, 0]
        off = T * (RELATIVE + claimed.unsure[at])[:, None] * size + 4.0 * EPS * np.abs(cycles.e[at])
        near = np.sqrt(0.5 * (off**2 @ self._weights)) + 3.0 * self._place + RELATIVE * r
        claims.equal("remainder", tick, columns["remainder"], r, near)
        kept = np.sqrt(np.maximum(1.0 - np.maximum(columns["beta"], 0.0) * T, 0.0))
        stated = columns["remainder"]
        bound = (kept * np.sqrt(answers["v"]) + stated) ** 2
        exact = RELATIVE * np.abs(bound - answers["v"]) / T + 8.0 * EPS * (bound + answers["v"]) / T
        required = (bound - answers["v"]) / T
        claims.equal("required V rate", tick, answers["v_rate_required"], required, exact)
        falls = kept < 1.0
        left = np.where(falls, 1.0 - kept, 1.0)
        floor = np.where(falls, np.sqrt(2.0) * stated / left, -1.0)
        exact = np.abs(floor) * (RELATIVE + 4.0 * EPS / left)
        claims.equal("floor", tick, columns["floor"], floor, exact)
        status = answers["solver_status"]
        proven = status == STATUS["STATUS_CERTIFIED"]
        high = np.where(floor >= 0.0, floor, np.inf)[proven]
        claims.at_most("certified: floor", tick[proven], high, floor_tolerance, exact[proven])
        arrived = status == STATUS["STATUS_AT_TARGET"]
        claims.equal("at_target", tick, arrived, np.zeros(at.sum()))
