"""Rows of Figs. 4 to 8: what they print, next to ours and to the oracle's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hoap3.tools.reproduce.papers.qp12 import oracle, runs
from hoap3.tools.reproduce.rows import NONE, Row, like, row

ANKLE = ("r_ankle_pitch", "r_ankle_roll")
"""The joints that the paper names for γ = 0.99."""

Both = Mapping[tuple[str, runs.Law], tuple[runs.Motion, runs.Motion]]
"""Ours and the oracle's motion of each trial."""

PAPERS_WAY_M = 0.0185  # section V-C.1
PAPERS_MS = 400  # section V-C.2
SLIDING_TICKS = 100  # before |e| = 1 mm

_AS_PAPER = "As the paper"
_ORACLE = "Next to it the same motion in plain numpy, without this controller (oracle)"
_STABLE = {
    "A": "With e in metres V falls with a time constant of about 0.85 s by (16)",
    "B": "With e in centimetres by (16) as printed: 'stable after approximately 400 ms' names no "
    "threshold; |e| is 3 mm then, and 1 mm 15 to 20 % later",
    "C": "Without 1/√n in (16), e in metres: V is down to 2 % after 400 ms, |e| to 1 mm 50 % later",
}
_ARRIVED = "V has not fallen far enough yet when the run ends"
_JOINTS = {
    "A": "In metres 100|∇V| is at most 0.57, so the adaptive γ is at most a third of γ_far, and "
    "speeds are so low that fewer joints pass 0.001 rad/s than in the paper",
    "B": "In centimetres γ ≈ γ_far as the paper says, which is sparser at γ = 0.1 than its figure; "
    "13 of 21 joints pass 0.001 rad/s at γ = 0",
    "C": "Without 1/√n 12 to 17 joints pass 0.001 rad/s at γ = 0. The paper's 18 is what the plain "
    "law u = −10 J⁺e starts with; at large γ the adaptive γ is too small to be as sparse",
}
_BOUND = {
    True: f"{_AS_PAPER}: the bound (17) holds",
    False: "Without 1/√n the claimed bound does not hold: √n times that does",
}
_MORE = "More than before 400 ms, as the paper: γ falls near the target"
_NOT_MORE = "The paper has more joints active after 400 ms: not in this reading of (16)"
_CHATTERS = f"What the adaptive γ is for; over the last 100 ms before |e| < 1 mm. {_ORACLE}"
_SHARES = "The paper names both joints, but no shares"
_UNIT_OF_E = "The paper prints no unit of e: γ ≈ γ_far far from the target holds in centimetres"


def rows(
    trials: runs.Trials, plain: runs.Motion, expected: runs.Trials, expected_plain: runs.Motion
) -> list[Row]:
    """What Figs. 4 to 8 print, next to ours and to the oracle's.

    Args:
        trials, plain: of `run_trials` and `plain_pinv`.
        expected, expected_plain: the same of `oracle`.
    """
    both = {key: (motion, expected[key]) for key, motion in trials.items()}
    found = [*_rows4(trials), *_rows5(both), *_rows6(both), *_rows7(both), *_rows8(both)]
    return [*found, *_plain((plain, expected_plain))]


def _rows4(trials: runs.Trials) -> list[Row]:
    """Where the centre of mass starts, ends, and stays."""
    why = "The paper's posture is not published: ours was made so that m(q0) is the printed one"
    rows = [
        row(f"Fig. 4: {axis} of m(q0)", it, m0, None, why, "m", fitted="posture q0")
        for axis, it, m0 in zip("xyz", runs.START_M, trials["C", runs.EVEN].com[0], strict=True)
    ]
    why = f"{_AS_PAPER}: m_d − m_0"
    for case in runs.CASES:
        item = f"Fig. 4: ΔCoM_x at γ = 0, case {case}"
        way = np.ptp(trials[case, runs.EVEN].com[:, 0])
        rows.append(row(item, PAPERS_WAY_M, way, None, why, "m", differs=_ARRIVED))
    corner = runs.sole().max(axis=0)  # the sole is a rectangle about its centre
    coms = (motion.com[:, :2] for (_, law), motion in trials.items() if law in runs.TRIALS)
    margin = min((corner - np.abs(com)).min() for com in coms)
    item, why = "Fig. 4: least distance to the sole's edge", "The paths stay inside, as drawn"
    return [*rows, row(item, "inside", margin, (0.0, None), why, "m")]


def _rows5(both: Both) -> list[Row]:
    """How fast V falls, that it never rises, and that speeds are bounded."""
    rows = []
    for case in runs.CASES:
        shares = np.array([
            [motion.v[PAPERS_MS] / motion.v[0] for motion in both[case, law]] for law in runs.TRIALS
        ])  # fmt: skip
        for name, ends in (("least", shares.min(axis=0)), ("greatest", shares.max(axis=0))):
            item = f"Fig. 5a: V(400 ms)/V(0), {name} of 11 trials, case {case}"
            rows.append(_near(item, None, ends, _ORACLE))
        for law in (runs.EVEN, runs.SPARSE):
            item = f"Fig. 5a: time to |e| < 1 mm, {law}, case {case}"
            ms = (motion.arrival_ms for motion in both[case, law])
            rows.append(_near(item, PAPERS_MS, ms, _ORACLE, unit="ms", differs=_STABLE[case]))
        ratio = max(_share_of_bound(case, both[case, law][0]) for law in runs.TRIALS)
        item = f"Fig. 5: greatest |u_i| / (u_max·R), (17), case {case}"
        holds = case != "C"
        bounds = (None, 1.0) if holds else (1.0, float(np.sqrt(len(runs.joint_names()))))
        rows.append(row(item, "at most 1" if holds else None, ratio, bounds, _BOUND[holds]))
    rises = sum(motion.rises for motion, _ in both.values())
    item = "Fig. 5a: ticks at which V rises, all trials"
    return [*rows, row(item, 0, rises, NONE, f"{_AS_PAPER}: stable by design")]


def _rows6(both: Both) -> list[Row]:
    """Mean number of active joints over γ."""
    rows = []
    for (case, law), motions in both.items():
        joints = (motion.mean_active(0, PAPERS_MS) for motion in motions)
        item = f"Fig. 6: active joints, {law}, case {case}"
        rows.append(_near(item, _printed(law), joints, _ORACLE, differs=_JOINTS[case]))
    return rows


def _rows7(both: Both) -> list[Row]:
    """Number of active joints over time, and which they are."""
    rows = []
    for case in runs.CASES:
        for law in (runs.PINV, runs.EVEN):
            item = f"Fig. 7: active joints at the start, {law}, case {case}"
            first = (motion.active_count[0] for motion in both[case, law])
            rows.append(_near(item, 18, first, _ORACLE, differs=_JOINTS[case]))
        ratios = [each.mean_active(400, 1000) / each.mean_active(0, 400)
                  for each in both[case, runs.SPARSE]]  # fmt: skip
        item = f"Fig. 7: active joints, 400 ms to 1 s / before, {runs.SPARSE}, case {case}"
        if case == "C":
            rows.append(row(item, "more", ratios[0], (1.0, None), _MORE))
        else:
            rows.append(_near(item, None, ratios, f"{_NOT_MORE}. {_ORACLE}"))
        rows += _ankle(both[case, runs.SPARSE_CONSTANT], case)
    return rows


def _rows8(both: Both) -> list[Row]:
    """How sparse γ makes the inputs at the start, and how abrupt they are."""
    rows = []
    for case in runs.CASES:
        item = f"Fig. 8: adaptive γ / γ_far at the start, case {case}"
        shares = [oracle.share_of_gamma(case, motion) for motion in both[case, runs.SPARSE]]
        if case == "B":
            rows.append(row(item, "about 1", shares[0], (0.9, 1.0), _UNIT_OF_E))
        else:
            rows.append(_near(item, None, shares, f"{_UNIT_OF_E}. {_ORACLE}"))
        item = f"Fig. 8: starts and stops of joints, {runs.SPARSE_CONSTANT}, case {case}"
        rates = (
            _switches_per_s(motion.until_a_millimetre.active[-SLIDING_TICKS:])
            for motion in both[case, runs.SPARSE_CONSTANT]
        )
        rows.append(_near(item, "chattering", rates, _CHATTERS, unit="1/s"))
    item = f"Fig. 8: starts and stops of joints, {runs.SPARSE}, case C"
    active = both["C", runs.SPARSE][0].until_a_millimetre.active
    switches = _switches_per_s(active) * len(active) * 1e-3
    rows.append(row(item, "none", switches, (None, 1.5), "One in all, until |e| < 1 mm"))
    fastest = max(float(np.abs(motion.u).max()) for motion, _ in both.values())
    item, why = "Fig. 8: greatest |u_i| of all trials", "Below u_max, as the paper, in each case"
    return [*rows, row(item, "at most 0.6", fastest, (None, runs.U_MAX), why, unit="rad/s")]


def _near(
    item: str, paper: Any, both: Iterable[Any], why: str, absolute: float | None = None, **more: Any
) -> Row:
    """Ours must be the oracle's."""
    ours, expected = both
    return row(item, paper, ours, like(expected, absolute), why, **more)


def _plain(plain: tuple[runs.Motion, runs.Motion]) -> list[Row]:
    """The law whose number of joints is the paper's."""
    item, why = "Fig. 7: plain law u = −10 J⁺e,", f"Without Ψ: fits the paper's 18. {_ORACLE}"
    count = (motion.active_count[0] for motion in plain)
    mean = (motion.mean_active(0, 200) for motion in plain)
    fastest = (np.abs(motion.u).max() for motion in plain)
    return [
        _near(f"{item} active at the start", 18, count, why, fitted="law and gain"),
        _near(f"{item} active over 200 ms", None, mean, why),
        _near(f"{item} greatest |u_i|", None, fastest, why, unit="rad/s"),
    ]


def _ankle(motions: tuple[runs.Motion, runs.Motion], case: str) -> list[Row]:
    """Who moves at constant γ = 0.99: the joint that is fastest, tick by tick, until 1 mm."""
    names, rows = runs.joint_names(), []
    parts = [motion.until_a_millimetre for motion in motions]
    ankle = [names.index(name) for name in ANKLE]
    for joint in ankle:
        item = f"Fig. 7: share of time of {names[joint]}, {runs.SPARSE_CONSTANT}, case {case}"
        shares = (float(np.mean(np.abs(part.u).argmax(axis=1) == joint)) for part in parts)
        rows.append(_near(item, None, shares, f"{_SHARES}. {_ORACLE}", absolute=0.01))
    others = float(np.delete(parts[0].active, ankle, axis=1).any(axis=0).sum())
    item = f"Fig. 7: other joints that ever move, {runs.SPARSE_CONSTANT}, case {case}"
    why = f"{_AS_PAPER}: pitch and roll of the right ankle"
    return [*rows, row(item, 0, others, NONE, why)]


def _share_of_bound(case: str, motion: runs.Motion) -> float:
    """Greatest |u_i| relative to u_max·R, while |e| ≥ 1 mm: beyond, positions' rounding counts."""
    part = motion.until_a_millimetre
    bound = runs.U_MAX * oracle.reach(case, part.error)
    return float((np.abs(part.u).max(axis=1) / bound).max())


def _switches_per_s(active: np.ndarray) -> float:
    """Ticks per second at which some joint starts or stops being active."""
    return float((active[1:] != active[:-1]).any(axis=1).mean() * 1e3)


def _printed(law: runs.Law) -> float | str | None:
    """Active joints in the paper's text, section V-C.2."""
    if law in {runs.PINV, runs.EVEN}:
        return 18
    if law == runs.Law(0.1):
        return 6
    return "1 to 2" if law.gamma == runs.SPARSE.gamma else None
