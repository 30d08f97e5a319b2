"""Rows of the UR5's runs: numbers next to the oracle's, and what the paper claims, (a) to (d)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.sdp import oracle
from hoap3.tools.reproduce.papers.sdp import runs as ref
from hoap3.tools.reproduce.papers.sdp.runs import AT_LIMIT, Run, Runs, scheduled
from hoap3.tools.reproduce.rows import NONE, Row, like, row, table

V_S = (0.1, 0.5, 1.0, 2.0, 3.0)
BETA_S = (0.0, 0.2, 1.0, 3.0)
"""When V and β are compared."""

TURN_S = 1.5  # before which λ₄ is least
END_S = 3.0  # at which the oracle ends, and runs have settled
GAIN_S = 0.5
EXACT = 1e-6  # of the oracle's value

BEHIND_S = 0.05
"""Δt from which on V may fall more slowly than certified [s]."""

LOW_V = 1e-6
LESS, MORE = float(np.nextafter(1.0, 0.0)), float(np.nextafter(1.0, 2.0))
"""Below and above 1."""

FIRST_ORDER = 0.25
"""Twice what a method of first order leaves between Δt = 0.01 and 0.005 s, as a share of what it
does between 0.05 and 0.01 s: 0.005/0.04, twice."""

TINY = 1e-6  # of δ


def rows(runs: Runs, expected: Runs) -> list[Row]:
    """All of them, next to the oracle's runs."""
    return [*figure_rows(runs, expected), *claim_rows(runs, expected), *regularised(runs)]


def same(item: str, ours: float, oracle: float, why: str, unit: str = "") -> Row:
    """Ours must be the oracle's value."""
    return row(item, None, ours, like(oracle, EXACT * abs(oracle)), why, unit)


def figure_rows(runs: Runs, expected: Runs) -> list[Row]:
    """All of them."""
    slow, fast = f"β̃ = {ref.SLOW:g}", f"β̃ = {ref.FAST:g}"
    low = f"{fast}, {ref.LOW_LIMIT_RAD_S:g} rad/s"
    made = [
        row("Fig. 1: V(0)", None, runs.fast.v[0], None, _START, "m²"),
        *_run("Fig. 1", "constant gains", runs.constant, expected.constant),
        *_no_proof(runs.constant, expected.constant),
        *_run("Fig. 1", slow, runs.slow, expected.slow),
        *_run("Figs. 1, 4", fast, runs.fast, expected.fast),
        *_run("Fig. 5", low, runs.limited, expected.limited),
    ]
    for dt, other in expected.periods.items():
        run, name = runs.periods[dt], f"{fast}, Δt = {dt:g} s"
        if dt != ref.DT_S:
            made += _run("Figs. 6, 7", name, run, other)
        gain, theirs = (each.gains[each.at(GAIN_S), 0] for each in (run, other))
        made.append(same(f"Fig. 6: λ₁ at {GAIN_S:g} s, Δt = {dt:g} s", gain, theirs, _CURVE, "1/s"))
    for name, pair in ((slow, (runs.slow, expected.slow)), (fast, (runs.fast, expected.fast))):
        ours, theirs = map(_second_gain, pair)
        made += [same(f"Fig. 3: λ₄ {when}, {name}", ours[when], theirs[when], _GAIN, "1/s")
                 for when in theirs]  # fmt: skip
    return made


def _run(figure: str, name: str, run: Run, other: Run) -> list[Row]:
    """V, β, the greatest speed and how many steps are at the limit."""
    run = _until_end(run)
    shown: list[tuple[str, Array, Array, tuple[float, ...], str]] = [
        ("V", run.v, other.v, V_S, "m²")
    ]
    if run.desired:
        shown.append(("β", run.beta, other.beta, BETA_S, "1/s"))
    made = [
        same(f"{figure}: {of}({time:g} s), {name}", ours[run.at(time)], theirs[other.at(time)],
             _CURVE, unit)
        for of, ours, theirs, times, unit in shown for time in times
    ]  # fmt: skip
    ours, theirs = (np.abs(each.dq).max() for each in (run, other))
    made.append(same(f"{figure}: greatest |dq|, {name}", ours, theirs, _CURVE, "rad/s"))
    if run.held or other.held:
        item = f"{figure}: steps with a joint at its limit, {name}"
        made.append(row(item, None, run.held, like(other.held, 0.0), _CURVE))
    return made


def _until_end(run: Run) -> Run:
    """The part that the oracle has."""
    names = ("errors", "beta", "gains", "dq", "proved")
    end = run.at(END_S) + 1
    return replace(run, **{name: getattr(run, name)[:end] for name in names})


def _no_proof(run: Run, other: Run) -> list[Row]:
    """The β that constant gains would certify."""
    beta = _until_end(run).beta
    item = "Fig. 1: steps in which constant gains have a certificate"
    return [
        same("Fig. 1: least β, constant gains", beta.min(), other.beta.min(), _NO_PROOF, "1/s"),
        same("Fig. 1: greatest β, constant gains", beta.max(), other.beta.max(), _NO_PROOF, "1/s"),
        row(item, "not guaranteed", (beta > 0.0).sum(), NONE, _NO_PROOF),
    ]


def _second_gain(run: Run) -> dict[str, float]:
    """Λ₄ as it falls, and rises towards the singularity."""
    gain = run.gains[: run.at(END_S) + 1, 3]
    low = int(np.argmin(gain[: run.at(TURN_S)]))
    return {
        "at the start": float(gain[0]),
        "at its least": float(gain[low]),
        "at its greatest after that": float(gain[low:].max()),
        f"at {END_S:g} s": float(gain[-1]),
    }


_START = (
    "Not printed. Start and targets are; with the toolbox's frames they give this, or twice as "
    "much where |e|² is drawn, as the authors' own code does"
)
_CURVE = "The paper prints a curve; next to ours the oracle's run"
_NO_PROOF = (
    "The paper says that constant gains have no guarantee; here is how far from one they are. V "
    "falls nevertheless: a certificate is for any e, a motion has one"
)
_GAIN = (
    "The paper prints a curve, and once calls this the gain of the orientation, which no task is: "
    "it is that of the wrist's y. Next to ours the oracle's run"
)


def claim_rows(runs: Runs, expected: Runs) -> list[Row]:
    """What the paper claims of all its runs."""
    made = [row for name, run in runs.scheduled.items() for row in certificate(name, run)]
    item, rise = "(a) V⁺/V, greatest, constant gains", runs.constant.rise
    made.append(row(item, "not guaranteed", rise, (None, LESS), _FALLS))
    return [*made, *speeds(runs, expected), *limits(runs), *periods(runs.periods)]


def certificate(name: str, run: Run) -> list[Row]:
    """Of a run with scheduled gains: V falls, limits hold, β is positive and kept."""
    return table(
        "",
        (f"(a) V⁺/V, greatest, {name}", "decreases monotonically", run.rise, (None, LESS),
         "As the paper"),
        (f"(a) steps without a certificate, {name}", "(15) holds", (run.beta <= 0.0).sum(), NONE,
         "As the paper: β > 0 at every step"),
        (f"(a) steps that are not proved to be optimal, {name}", None, (~run.proved).sum(), NONE,
         _OPTIMAL),
        (f"(c) greatest |dq| − limit, {name}", "respected", run.excess, (None, 0.0),
         "As the paper, without any tolerance", "rad/s"),
        (f"(d) steps of {len(run.v) - 1} in which V falls more slowly than β, {name}", None,
         run.behind, (1.0, None) if run.dt >= BEHIND_S else NONE, _BEHIND),
    )  # fmt: skip


def speeds(runs: Runs, expected: Runs) -> list[Row]:
    """(b), the greater β̃, the faster."""
    constant, slow, fast = runs.constant, runs.slow, runs.fast
    under, end = np.flatnonzero(fast.v < LOW_V), slow.at(END_S)
    faster = "As the paper: the greater β̃, the faster"
    return table(
        "(b) ",
        ("β̃ = 2 is slower than constant gains until", None, _slower_until(runs),
         like(_slower_until(expected)), _SLOWER, "s"),
        (f"V({END_S:g} s)/V(0), β̃ = 2", "converges", slow.v[end] / slow.v[0], (None, 1e-3),
         "As the paper: it does converge"),
        ("β̃ = 8 has V below 10⁻⁶ from", "faster", _time(fast, under, 0), (None, 2.0), faster, "s"),
        ("V, β̃ = 8 / β̃ = 2, greatest after the start", "faster",
         (fast.v[1:] / slow.v[1:]).max(), (None, LESS), faster),
        ("V(3 s) / V(2 s), constant gains", None, constant.v[end] / constant.v[constant.at(2.0)],
         None, "The paper: V remains stable once the first task has converged"),
    )  # fmt: skip


def limits(runs: Runs) -> list[Row]:
    """(c), the lower the limits, the further β from β̃."""
    item = f", {ref.LOW_LIMIT_RAD_S:g} / {ref.LIMIT_RAD_S:g} rad/s"
    return table(
        "Fig. 5: β̃ − β at ",
        (f"the start{item}", "further", _relaxed(runs, 0.0), (MORE, None), _FURTHER),
        (f"1 s{item}", None, _relaxed(runs, 1.0), None, _FURTHER),
    )


def periods(by_dt: Mapping[float, Run]) -> list[Row]:
    """(d), what Δt changes."""
    way = {dt: np.trapezoid(by_dt[dt].wrist, dx=dt) for dt in ref.PERIODS_S}
    last = [by_dt[dt].wrist[by_dt[dt].at(END_S)] for dt in ref.PERIODS_S]
    shortest, usual = way[min(ref.PERIODS_S)], by_dt[ref.DT_S]
    coarse, fine = _apart(by_dt[0.05], usual, 0), _apart(usual, by_dt[0.005], 0)
    converge = "As the paper: curves converge as Δt falls"
    return table(
        "Fig. ",
        ("7: ∫|e₂| dt, Δt = 0.1 s / 0.005 s", "improves", way[0.1] / shortest, (MORE, None),
         _IMPROVES),
        ("7: ∫|e₂| dt, Δt = 0.05 s / 0.005 s", None, way[0.05] / shortest, None, _IMPROVES),
        ("7: ∫|e₂| dt, Δt = 0.01 s / 0.005 s", "converge", way[ref.DT_S] / shortest, like(1.0),
         converge),
        ("7: |e₂| at 3 s, Δt = 0.1 s / 0.005 s", None, last[0] / last[-1], None, _IMPROVES),
        ("6: mean change of λ₁, Δt = 0.01 to 0.005 s / 0.05 to 0.01 s", "converge", fine / coarse,
         (None, FIRST_ORDER), converge),
        ("6: mean change of λ₄, Δt = 0.01 to 0.005 s / λ₄", None,
         _apart(usual, by_dt[0.005], 3) / usual.gains[:, 3].mean(), None,
         "The paper notices none, and shows none"),
    )  # fmt: skip


def _relaxed(runs: Runs, time_s: float) -> float:
    """β̃ − β with the lower limit / with the other one."""
    low, high = runs.limited, runs.fast
    return float((ref.FAST - low.beta[low.at(time_s)]) / (ref.FAST - high.beta[high.at(time_s)]))


def _slower_until(runs: Runs) -> float:
    """When V with β̃ = 2 is last above that with constant gains [s]."""
    steps = min(len(runs.slow.v), len(runs.constant.v))
    behind = np.flatnonzero(runs.slow.v[:steps] > runs.constant.v[:steps])
    return _time(runs.slow, behind, -1)


def _time(run: Run, steps: np.ndarray, place: int) -> float:
    """When a step was; NaN where there is none."""
    return float(run.time_s[steps[place]]) if steps.size else float("nan")


def _apart(long: Run, short: Run, gain: int) -> float:
    """How far a gain differs between two periods, in the mean over the longer one's steps."""
    every = round(long.dt / short.dt)
    return float(np.abs(long.gains[:, gain] - short.gains[::every, gain]).mean())


_FALLS = (
    "The paper shows it, too: V falls and stays. Constant gains are not unstable here, they have "
    "no proof and leave the wrist where it is"
)
_OPTIMAL = (
    "Not in the paper, whose solver is a general one. Each answer is proved by its duality gap, "
    "10⁻⁹ β̃² at most"
)
_BEHIND = (
    "β is that of the linear model. The paper takes it for the real rate at all Δt; with 0.05 s "
    "and more Euler's steps are too long for that, and the first ones fall short of it"
)
_SLOWER = (
    "The paper shows faster convergence for a greater β̃, and does not say that β̃ = 2 is slower "
    f"than constant gains at first, since β̃ caps the rate; β̃ = {ref.FAST:g} is faster throughout"
)
_FURTHER = (
    "As the paper, while a joint is at its limit. Afterwards it depends on where the arm then is, "
    "and the lower limits may have the greater β"
)
_IMPROVES = (
    "The paper: the shorter Δt, the faster. So it is for 0.1 s beside the others; 0.05 s is no "
    "slower than 0.005 s, and on a logarithmic scale the longest Δt is the fastest in the end"
)


def regularised(runs: Runs) -> list[Row]:
    """δ of (27) lowers β where no limit does."""
    margin = ref.LIMIT_RAD_S - float(np.abs(runs.slow.dq[0]).max())
    slow = f"β(0), β̃ = {ref.SLOW:g}, δ"
    exact = oracle.scheduled(ref.SLOW, seconds=0.0).beta[0]
    least = scheduled(ref.SLOW, seconds=0.0, delta=TINY * DELTA).beta[0]
    return [
        same(f"(27): {slow} = 5·10⁻⁵", runs.slow.beta[0], exact, _DELTA, "1/s"),
        *table(
            "(27): ",
            ("least distance from a limit there", None, margin, (AT_LIMIT, None), _DELTA, "rad/s"),
            (f"{slow} a millionth of that", None, least, like(ref.SLOW, 1e-3), _DELTA, "1/s"),
        ),
    ]  # fmt: skip


_DELTA = (
    "The paper relaxes β where limits ask for it, and has δ for solvability only; but δ|λ|² alone "
    "lowers β, by a lot where tasks are nearly dependent"
)
