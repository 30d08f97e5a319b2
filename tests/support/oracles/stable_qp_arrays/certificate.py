"""What a certificate of `stable_qp` says of V, cycle by cycle: value, drift, Ψ, V̇ and ρ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import schema
from hoap3.remote_controller.problems.stable_qp_settings import Settings
from hoap3.tools.verify.claims import RELATIVE, Claims
from support.oracles.stable_qp_arrays.answers import ANSWERED, PROVEN, Answers
from support.oracles.stable_qp_arrays.problem import PLACES, Cycle

Array = NDArray[np.float64]

CONSTANTS = schema("Setpoint").constants
CERTIFIED, AT_TARGET = CONSTANTS["STATUS_CERTIFIED"], CONSTANTS["STATUS_AT_TARGET"]
NO_ANSWER = CONSTANTS["STATUS_INFEASIBLE"]
AS_ASKED = 1e-9  # speed by which V's rate may miss what is asked for and counts as that [rad/s]
SUMMED = 1e-12  # of what is summed up, relative to the sizes of its terms: rounding
LARGEST_RHO = 1e9  # stands for infinity
KEPT_RATE = 1e-9  # of the required V̇: what a certified one may be off
FIELDS = "V", "psi", "drift", "error", "rate"


@dataclass(frozen=True)
class Rates:
    """V and what it rests on in some cycles with answers, and how exactly that is known.

    Attributes:
        V, psi, drift, error, rate: as of `Cycle`, (N,).
        gradient, gradient_doubt: ∇V, (N, n).
        psi_off, drift_off: (N,).
        V_rate, V_rate_off: ∇V·u + ∂V/∂t, (N,).
    """

    V: Array
    psi: Array
    drift: Array
    error: Array
    rate: Array
    gradient: Array
    gradient_doubt: Array
    psi_off: Array
    drift_off: Array
    V_rate: Array
    V_rate_off: Array

    @classmethod
    def of(cls, chunk: Sequence[Cycle], u: Array, doubt: Array) -> Rates:
        """Those of cycles with their u and how exactly it is known, both (N, n)."""
        V, psi, drift, error, rate = (
            np.array([getattr(cycle, name) for cycle in chunk], float) for name in FIELDS
        )
        g = np.array([cycle.gradient for cycle in chunk])
        off = np.array([cycle.gradient_doubt for cycle in chunk])
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = PLACES / error + np.linalg.norm(off, axis=1) / np.abs(g).max(1)
            psi_off = np.where(psi > 0.0, psi * (RELATIVE + relative), 0.0)
        V_rate = (g * u).sum(1) + drift
        drift_off = RELATIVE * np.abs(drift) + SUMMED * error * rate + PLACES * rate
        V_rate_off = RELATIVE * np.abs(V_rate) + SUMMED * np.abs(g * u).sum(1)
        V_rate_off += (np.abs(g) * doubt + off * np.abs(u)).sum(1) + SUMMED * error * rate
        return cls(
            V, psi, drift, error, rate, g, off, psi_off, drift_off,
            V_rate, V_rate_off + PLACES * rate,
        )  # fmt: skip


def check_certificate(
    chunk: Sequence[Cycle], sent: Answers, settings: Settings, claims: Claims, *, u_known: bool
) -> None:
    """Compare what answers state of V with what was recomputed.

    Args:
        chunk: cycles in a row.
        sent: all answers.
        settings: of the controller.
        claims: takes what was compared.
        u_known: whether `sent` knows the velocities.
    """
    chunk = [cycle for cycle in chunk if sent.there[cycle.number]]
    if not chunk:
        return
    at = np.array([cycle.number for cycle in chunk])
    tick, stated = sent.tick[at], {name: values[at] for name, values in sent.stated.items()}
    found = Rates.of(chunk, sent.u[at], sent.doubt[at])
    V_off = RELATIVE * found.V + PLACES * found.error + PLACES**2
    claims.equal("V", tick, stated["v"], found.V, V_off)
    claims.equal("psi", tick, sent.psi[at], found.psi, found.psi_off)
    claims.equal("drift", tick, sent.drift[at], found.drift, found.drift_off)
    answered = np.isin(sent.status[at], ANSWERED)
    equality = settings.rest["lyapunov"] == "equality"
    share = np.where(answered & equality, stated["rho"], 0.0)
    off = np.abs(share) * (found.psi_off + RELATIVE * found.psi)
    claims.equal("required V rate", tick, stated["v_rate_required"], -share * found.psi, off)
    none = stated["solver_status"] == NO_ANSWER
    claims.equal("answered", tick, ~none, answered, 0.0)
    for name in ("rho", "v_rate_predicted", "kkt_residual"):
        claims.equal(
            f"no answer: {name}", tick[~answered], stated[name][~answered], 0.0 * at[~answered]
        )
    if not u_known:
        return
    V_rate = np.where(answered, found.V_rate, 0.0)
    claims.equal("predicted V rate", tick, stated["v_rate_predicted"], V_rate, found.V_rate_off)
    _check_share(found, stated["rho"], tick, answered, claims)
    _check_words(chunk, found, sent, at, equality, claims)


def _check_share(
    found: Rates,
    rho: Array,
    tick: Array,
    answered: NDArray[np.bool_],
    claims: Claims,
) -> None:
    """ρ = −V̇/Ψ, at most 1; within what counts as asked for, that."""
    top = np.abs(found.gradient).max(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(-found.V_rate / found.psi, -LARGEST_RHO, LARGEST_RHO)
        wanted = np.abs(found.psi + found.drift)
        near = AS_ASKED * (top + wanted) + found.V_rate_off + found.psi_off
        off = RELATIVE * np.abs(share) + near / found.psi
    still = found.psi == 0.0
    share = np.where(still, np.where(found.V_rate <= found.V_rate_off, 1.0, -LARGEST_RHO), share)
    off, share = np.where(still, RELATIVE, off), np.minimum(share, 1.0)
    claims.equal("rho", tick[answered], rho[answered], share[answered], off[answered])


def _check_words(
    chunk: Sequence[Cycle],
    found: Rates,
    sent: Answers,
    at: NDArray[np.int64],
    equality: bool,
    claims: Claims,
) -> None:
    """What `certified` and `at target` say of V."""
    tick, verdict = sent.tick[at], sent.stated["solver_status"][at]
    rho = sent.stated["rho"][at]
    proven = verdict == CERTIFIED
    required = -rho * found.psi if equality else 0.0 * rho
    short = found.V_rate - required
    off = np.abs(short) if equality else short
    allowed = KEPT_RATE * np.abs(required) + found.V_rate_off + np.abs(rho) * found.psi_off
    claims.at_most("certified: V rate", tick[proven], off[proven], allowed[proven], 0.0)
    left_out = np.array([cycle.rejected for cycle in chunk], float)
    claims.at_most("certified: rows left out", tick[proven], left_out[proven], 0.0, 0.0)
    claims.at_most("certified: rho", tick[proven], -rho[proven], 0.0, 0.0)
    claims.equal(
        "certified: solved",
        tick[proven],
        np.isin(sent.status[at], PROVEN)[proven],
        1.0 + 0.0 * tick[proven],
    )
    arrived = verdict == AT_TARGET
    claims.equal("at target: psi", tick[arrived], found.psi[arrived], 0.0 * tick[arrived])
    claims.equal(
        "at target: u",
        tick[arrived],
        np.abs(sent.u[at]).max(1)[arrived],
        0.0 * tick[arrived],
        sent.doubt[at].max(1)[arrived],
    )
