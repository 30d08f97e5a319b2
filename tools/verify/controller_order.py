"""Whether a controller's log is in order: no cycle missing or swapped, each answer to its State."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import State
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun

STAMPS = ("received", "decoded", "solved", "encoded")


def check_order(run: ControllerRun, claims: Claims) -> None:
    """Ticks, echoes, epochs and stamps of one engagement."""
    if run.strange:
        claims.unverified("message", run.strange, "no State or Setpoint of this robot")
    claims.unverified("answer", run.orphans, "its State is missing")
    if len(run.states):
        _check_states(run, claims)
        _check_silence(run, claims)
    if len(run.answers):
        _check_answers(run, claims)


def _check_states(run: ControllerRun, claims: Claims) -> None:
    """Each State follows the last, but for those that the controller says it never saw."""
    tick = run.states["tick"].astype(np.int64)
    unseen = [run.overwritten.get(place, 0) for place in range(1, len(tick))]
    known = np.array([place not in run.gaps for place in range(1, len(tick))], bool)
    claims.equal(
        "States between", tick[1:][known], np.diff(tick)[known] - 1, np.array(unseen)[known]
    )
    claims.unverified("States between", int((~known).sum()), "records are missing there")
    same = run.states["session_id"] == np.uint64(run.session.get("session_id", 0))
    claims.equal("session", tick, same, np.ones(len(tick)))


def _check_answers(run: ControllerRun, claims: Claims) -> None:
    """Each answer echoes its State, which asked for it, under the epoch in force."""
    answers, states = run.answers, run.answered_states
    tick = states["tick"].astype(np.int64)
    for echo, of in (("tick", "tick"), ("stamp_state", "stamp_published"), ("epoch", "epoch")):
        off = answers[echo].astype(np.int64) - states[of].astype(np.int64)
        claims.equal(f"echoed {of}", tick, off, np.zeros(len(tick)), 0.0)
    in_force = _epochs(run)[run.answered]
    claims.equal("epoch", tick, answers["epoch"].astype(np.int64), in_force, 0.0)
    for before, after in pairwise(STAMPS):
        early = (answers[f"stamp_{before}"] - answers[f"stamp_{after}"]).astype(float)
        claims.at_most(f"{before} before {after}", tick, early, 0.0, 0.0)
    again = np.diff(run.answered, prepend=-1) == 0
    claims.equal("answered once", tick, again, np.zeros(len(tick)), 0.0)
    asked = run.states["mode"] == State.ACTIVE
    claims.equal("State asked", tick, asked[run.answered], np.ones(len(tick)), 0.0)


def _check_silence(run: ControllerRun, claims: Claims) -> None:
    """Each State that asks is answered; the last one may be what the controller failed on."""
    states, answered = run.states, np.zeros(len(run.states), bool)
    answered[run.answered] = True
    asks = (states["mode"] == State.ACTIVE) & (states["epoch"].astype(np.int64) == _epochs(run))
    before_gap = [place - 1 for place in run.gaps if place]
    asks[[len(states) - 1, *before_gap]] = False
    claims.equal("asked and answered", states["tick"][asks], answered[asks], np.ones(asks.sum()))


def _epochs(run: ControllerRun) -> NDArray[np.int64]:
    """The epoch under which the controller answers at each State; -1 before the first."""
    places = np.array([place for place, _ in run.epochs], np.int64)
    epochs = np.array([-1, *(epoch for _, epoch in run.epochs)], np.int64)
    return epochs[np.searchsorted(places, np.arange(len(run.states)), "right")]
