"""What Figs. 4 to 8 say in figures, beside ours and the reference run."""

from __future__ import annotations

import numpy as np

from hoap3.tools.reproduce.papers.qp12 import reference as ref
from hoap3.tools.reproduce.papers.qp12.experiments import (
    BETA,
    START_M,
    U_MAX,
    Motion,
    Trials,
    joint_names,
    sole,
)
from hoap3.tools.reproduce.papers.qp12.reference import Law
from hoap3.tools.reproduce.rows import Row, between, bounded, measured, near

PAPERS_WAY_M = 0.0185
HALF_A_DIGIT_M = 5e-5  # m(q0) has four decimals
SLIDING_TICKS = 100  # before |e| = 1 mm

_AS_PAPER = "As the paper"
_SLOW = (
    "By (16) V falls with a time constant of about 0.85 s: no posture can meet the paper's 400 ms"
)
_FAST = (
    "Without 1/√n in (16) V is down to 2 % after the paper's 400 ms; (17) then bounds |u_i| by "
    "√n·u_max only"
)
_SPARSER = (
    "In SI units 100|∇V| is at most 0.57, so the adaptive γ is at most a third of γ_far; and with "
    "Ψ as slow as (16) fewer joints pass 0.001 rad/s than the paper's 6 at γ = 0.1"
)
_EIGHTEEN = (
    "18 is what the plain law u = −10 J⁺e starts with; with V̇ = −Ψ fewer joints pass 0.001 rad/s"
)
_HYPERBOLIC = "No figure is printed but 'almost linearly'; ours is hyperbolic, flat above 0.4"


def check_all(trials: Trials, plain: Motion) -> list[Row]:
    """All rows.

    Args:
        trials: of `run_trials`, with every law that the reference has figures of.
        plain: of `plain_pinv`.
    """
    return [*fig4(trials), *fig5(trials), *fig6(trials), *fig7(trials, plain), *fig8(trials)]


def fig4(trials: Trials) -> list[Row]:
    """Where the centre of mass starts, ends, and stays."""
    why = "As the paper, to its digits: its posture is not published, and ours is made so"
    rows = [
        near(f"Fig. 4: {axis} of m(q0)", *(it, m0, it, why), unit="m", absolute=HALF_A_DIGIT_M)
        for axis, it, m0 in zip("xyz", START_M, trials["C", ref.EVEN].com[0], strict=True)
    ]
    travelled = {case: float(np.ptp(trials[case, ref.EVEN].com[:, 0])) for case in ("A", "C")}
    item, why = "Fig. 4: ΔCoM_x at γ = 0, case", "With Ψ as printed it has not arrived after 3 s"
    rows += [
        measured(f"{item} A", PAPERS_WAY_M, travelled["A"], why, unit="m"),
        near(f"{item} C", PAPERS_WAY_M, travelled["C"], PAPERS_WAY_M, _AS_PAPER, unit="m"),
    ]
    corner = sole().max(axis=0)  # the sole is a rectangle about its centre
    margin = min(
        float((corner - np.abs(motion.com[:, :2])).min())
        for (_, law), motion in trials.items()
        if law in ref.TRIALS
    )
    item, why = "Fig. 4: least distance to the sole's edge", "The paths stay inside, as drawn"
    return [*rows, near(item, "inside", margin, ref.SOLE_MARGIN_M, why, unit="m")]


def fig5(trials: Trials) -> list[Row]:
    """How fast V falls, and that it never rises."""
    rows = []
    for case, why in (("A", _SLOW), ("C", _FAST)):
        shares = [trials[case, law].v[400] / trials[case, law].v[0] for law in ref.TRIALS]
        for name, share in (("least", min(shares)), ("greatest", max(shares))):
            item = f"Fig. 5a: V(400 ms)/V(0), {name} of 11 trials, case {case}"
            rows.append(between(item, "about 0", share, ref.V_AT_400_MS[case], why))
    for (case, law), ms in ref.MILLIMETRE_MS.items():
        item = f"Fig. 5a: time to |e| < 1 mm, {law}, case {case}"
        why = _SLOW if case == "A" else _FAST
        rows.append(near(item, "about 400", trials[case, law].arrival_ms, ms, why, unit="ms"))
    rises = sum(int((np.diff(motion.v) > 0.0).sum()) for motion in trials.values())
    item = "Fig. 5a: ticks at which V rises, all trials"
    rows.append(bounded(item, 0, rises, (0.0, 0.0), f"{_AS_PAPER}: stable by design"))
    limits = {
        "A": (1.0, f"{_AS_PAPER}: the bound holds"),
        "C": (float(np.sqrt(len(joint_names()))), "Without 1/√n the bound is √n times that"),
    }
    for case, (limit, why) in limits.items():
        ratio = max(_share_of_bound(trials[case, law]) for law in ref.TRIALS)
        item = f"Fig. 5: greatest |u_i| / (u_max·R), (17), case {case}"
        rows.append(bounded(item, "at most 1", ratio, (None, limit), why))
    return rows


def fig6(trials: Trials) -> list[Row]:
    """Mean number of active joints over γ."""
    return [
        near(
            f"Fig. 6: active joints, {law}, case {case}",
            _printed(law),
            trials[case, law].mean_active(0, 400),
            joints,
            _why_so_many(case, law),
        )
        for (case, law), joints in ref.ACTIVE.items()
    ]


def fig7(trials: Trials, plain: Motion) -> list[Row]:
    """Number of active joints over time, and which they are."""
    rows = []
    for (case, law), joints in ref.ACTIVE_AT_START.items():
        item = f"Fig. 7: active joints at the start, {law}, case {case}"
        rows.append(near(item, 18, trials[case, law].active_count[0], joints, _EIGHTEEN))
    why = "The law, without Ψ, that the paper's 18 fits"
    found = {
        "active at the start": (18, plain.active_count[0], ""),
        "active over 200 ms": (None, plain.mean_active(0, 200), ""),
        "greatest |u_i|": (None, float(np.abs(plain.u).max()), "rad/s"),
    }
    for name, (paper, ours, unit) in found.items():
        item = f"Fig. 7: plain law u = −10 J⁺e, {name}"
        rows.append(near(item, paper, ours, ref.PLAIN_PINV[name], why, unit=unit))
    why = "More than before 400 ms, as the paper: γ falls near the target"
    for (case, law), joints in ref.ACTIVE_AFTER_400_MS.items():
        item = f"Fig. 7: active joints from 400 ms to 1 s, {law}, case {case}"
        rows.append(near(item, "more", trials[case, law].mean_active(400, 1000), joints, why))
    return [*rows, *_ankle(trials, "A"), *_ankle(trials, "C")]


def fig8(trials: Trials) -> list[Row]:
    """How abrupt the inputs are."""
    rows = []
    why = "What the adaptive γ is for; counted over the last 100 ms before |e| < 1 mm"
    for case in ("A", "C"):
        motion = trials[case, ref.SPARSE_CONSTANT]
        item = f"Fig. 8: starts and stops of joints, {ref.SPARSE_CONSTANT}, case {case}"
        rate = _switches_per_s(motion.until_a_millimetre.active[-SLIDING_TICKS:])
        known = ref.SWITCHES_PER_S[ref.SPARSE_CONSTANT]
        rows.append(near(item, "chattering", rate, known, why, unit="1/s"))
    item = f"Fig. 8: starts and stops of joints, {ref.SPARSE}, case C"
    rate = _switches_per_s(trials["C", ref.SPARSE].until_a_millimetre.active)
    why = f"{_AS_PAPER}: one in all, until |e| < 1 mm"
    rows.append(near(item, "none", rate, ref.SWITCHES_PER_S[ref.SPARSE], why, unit="1/s"))
    item = "Fig. 8: greatest |u_i| of all trials"
    fastest = max(float(np.abs(motion.u).max()) for motion in trials.values())
    why = f"Below u_max = {U_MAX} rad/s, as the paper, even without 1/√n"
    rows.append(near(item, "at most 0.6", fastest, ref.FASTEST_RAD_S, why, unit="rad/s"))
    return rows


def _ankle(trials: Trials, case: str) -> list[Row]:
    """Who moves at constant γ = 0.99: the joint that is fastest, tick by tick, until 1 mm."""
    names = joint_names()
    motion = trials[case, ref.SPARSE_CONSTANT].until_a_millimetre
    fastest = np.abs(motion.u).argmax(axis=1)
    rows = []
    why = "The paper names both joints, but no shares. The reference has whole percents: ± 1 point"
    for name, known in ref.ANKLE_SHARES.items():
        item = f"Fig. 7: share of time of {name}, {ref.SPARSE_CONSTANT}, case {case}"
        share = float(np.mean(fastest == names.index(name)))
        rows.append(near(item, None, share, known, why, absolute=0.01))
    ankle = [names.index(name) for name in ref.ANKLE_SHARES]
    others = float(np.delete(motion.active, ankle, axis=1).any(axis=0).sum())
    item = f"Fig. 7: other joints that ever move, {ref.SPARSE_CONSTANT}, case {case}"
    why = f"{_AS_PAPER}: pitch and roll of the right ankle"
    return [*rows, bounded(item, 0, others, (0.0, 0.0), why)]


def _share_of_bound(motion: Motion) -> float:
    """Greatest |u_i| relative to u_max·R, while |e| ≥ 1 mm: beyond, positions' rounding counts."""
    part = motion.until_a_millimetre
    bound = U_MAX * 2 / np.pi * np.arctan(BETA * part.error)
    return float((np.abs(part.u).max(axis=1) / bound).max())


def _switches_per_s(active: np.ndarray) -> float:
    """Ticks per second at which some joint starts or stops being active."""
    return float((active[1:] != active[:-1]).any(axis=1).mean() * 1e3)


def _printed(law: Law) -> float | str | None:
    """Active joints in the paper's text."""
    if law in {ref.PINV, ref.EVEN}:
        return 18
    if law == Law(0.1):
        return 6
    return "1 to 2" if law.gamma == ref.SPARSE.gamma else None


def _why_so_many(case: str, law: Law) -> str:
    if law in {ref.PINV, ref.EVEN}:
        return _EIGHTEEN
    if law == ref.SPARSE_CONSTANT:
        return f"{_AS_PAPER}: one at a time, two where they change"
    if not law.adaptive:
        return "Not in the paper: what a constant γ does"
    if case == "A":
        return _SPARSER
    if law == Law(0.1):
        return f"{_AS_PAPER}, without 1/√n"
    if law == ref.SPARSE:
        return "The knee helps near the target, where γ falls; constant γ gives the paper's 1 to 2"
    return _HYPERBOLIC
