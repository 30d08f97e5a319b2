"""V, β, speeds and gains of Figs. 1 to 6 next to the oracle's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hoap3.tools.reproduce.papers.sdp import reference as ref
from hoap3.tools.reproduce.papers.sdp.loop import Run
from hoap3.tools.reproduce.papers.sdp.runs import Runs
from hoap3.tools.reproduce.rows import Row, bounded, measured, near

TURN_S = 1.5  # before which λ₄ is least
END_S = 3.0  # at which the oracle ends
GAIN_S = 0.5
EXACT = 1e-6  # of the oracle's value


def same(item: str, ours: float, oracle: float, why: str, unit: str = "") -> Row:
    """Ours must be the oracle's value."""
    return near(item, None, ours, oracle, why, unit=unit, absolute=EXACT * abs(oracle))


def rows(runs: Runs, expected: Runs) -> list[Row]:
    """All of them."""
    slow, fast = f"β̃ = {ref.SLOW:g}", f"β̃ = {ref.FAST:g}"
    low = f"{fast}, {ref.LOW_LIMIT_RAD_S:g} rad/s"
    made = [
        measured("Fig. 1: V(0)", None, float(runs.fast.v[0]), _START, unit="m²"),
        *_run("Fig. 1", "constant gains", runs.constant, expected.constant),
        *_no_proof(runs.constant, expected.constant),
        *_run("Fig. 1", slow, runs.slow, expected.slow),
        *_run("Figs. 1, 4", fast, runs.fast, expected.fast),
        *_run("Fig. 5", low, runs.limited, expected.limited),
    ]
    for dt, oracle in expected.periods.items():
        run, name = runs.periods[dt], f"{fast}, Δt = {dt:g} s"
        if dt != ref.DT_S:
            made += _run("Figs. 6, 7", name, run, oracle)
        item = f"(1 − V⁺/V)/Δt of the first step, {name}"
        made.append(same(item, float(run.actual[0]), float(oracle.actual[0]), _EULER, "1/s"))
        item = f"Fig. 6: λ₁ at {GAIN_S:g} s, Δt = {dt:g} s"
        found, expected_gain = (float(x.gains[x.at(GAIN_S), 0]) for x in (run, oracle))
        made.append(same(item, found, expected_gain, _CURVE, "1/s"))
    for name, run, oracle in ((slow, runs.slow, expected.slow), (fast, runs.fast, expected.fast)):
        ours, theirs = _second_gain(run), _second_gain(oracle)
        made += [
            same(f"Fig. 3: λ₄ {when}, {name}", ours[when], theirs[when], _GAIN, "1/s")
            for when in theirs
        ]
    return made


def _run(figure: str, name: str, run: Run, oracle: Run) -> list[Row]:
    """V, β, the greatest speed and how many steps are at the limit."""
    run = _until_end(run)
    made = [
        same(f"{figure}: V({time:g} s), {name}", float(run.v[run.at(time)]),
             float(oracle.v[oracle.at(time)]), _CURVE, "m²")
        for time in ref.V_S
    ]  # fmt: skip
    if run.desired:
        made += [
            same(f"{figure}: β({time:g} s), {name}", float(run.beta[run.at(time)]),
                 float(oracle.beta[oracle.at(time)]), _CURVE, "1/s")
            for time in ref.BETA_S
        ]  # fmt: skip
    ours, theirs = (float(np.abs(each.dq).max()) for each in (run, oracle))
    made.append(same(f"{figure}: greatest |dq|, {name}", ours, theirs, _CURVE, "rad/s"))
    if run.held or oracle.held:
        item = f"{figure}: steps with a joint at its limit, {name}"
        made.append(near(item, None, run.held, oracle.held, _CURVE, absolute=0.0))
    return made


def _until_end(run: Run) -> Run:
    """The part that the oracle has."""
    names = ("errors", "beta", "gains", "dq", "paths", "proved")
    end = run.at(END_S) + 1
    return replace(run, **{name: getattr(run, name)[:end] for name in names})


def _no_proof(run: Run, oracle: Run) -> list[Row]:
    """The β that constant gains would certify."""
    run = _until_end(run)
    ends = {"least": np.min, "greatest": np.max}
    made = [
        same(f"Fig. 1: {name} β, constant gains", float(end(run.beta)), float(end(oracle.beta)),
             _NO_PROOF, "1/s")
        for name, end in ends.items()
    ]  # fmt: skip
    item = "Fig. 1: steps in which constant gains have a certificate"
    count = int((run.beta > 0.0).sum())
    return [*made, bounded(item, "not guaranteed", count, (0.0, 0.0), _NO_PROOF)]


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
_EULER = "Not in the paper: V falls so fast in fact. Next to ours the oracle's run"
