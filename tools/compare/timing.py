"""How long controllers take for an answer, in turn: the only figures that no two runs share.

Stamps of a lockstep run are virtual. So after it every controller answers the same States once
more, from a reset at the first, with a real clock around `step`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.tools.bench.timing import BLOCKS, SETTLE, Times, undisturbed
from hoap3.tools.compare.answers import Answers
from hoap3.tools.compare.open_loop import state_for
from hoap3.tools.html.numbers import summary
from hoap3.tools.machine.machine import machine_block

LEAST = 10  # answers in a block


def measure(labels: Sequence[str], answers: Sequence[Answers]) -> dict[str, Any]:
    """Time all controllers, block by block in turn, so that a drift of the machine meets them all.

    In each block a controller answers the States that follow those of its last block; the first
    three of them, while another's data leave the caches, do not count.

    Returns:
        `rows`, with `step_us` around the whole of `step`, `solve_us` from the controller's mark
        behind its kinematics to the end, each as n, min, percentiles and max, and `times_first`,
        the median over the blocks of the ratio of medians; and `machine`.
    """
    k = min(len(each.asked) for each in answers)
    blocks = max(1, min(BLOCKS, k // LEAST))
    size = k // blocks
    settle = min(SETTLE, max(0, size - 1))
    taken = [np.zeros((2, blocks, size - settle), np.int64) for _ in answers]
    racers = [_Racer(each) for each in answers]
    with undisturbed():
        for block in range(blocks):
            for racer, times in zip(racers, taken, strict=True):
                racer.take(settle)
                times[:, block] = np.array(racer.take(size - settle)).reshape(-1, 2).T
    steps = [Times(times[0] / 1e3, np.empty(0)) for times in taken]
    return {
        "rows": [
            {
                "label": label,
                "step_us": summary(times[0].ravel() / 1e3),
                "solve_us": summary(times[1].ravel() / 1e3),
                "times_first": step.times(steps[0]) if size > settle else None,
            }
            for label, times, step in zip(labels, taken, steps, strict=True)
        ],
        "blocks": blocks,
        "machine": machine_block(),
    }


class _Racer:
    """A controller and the States that it has yet to answer."""

    def __init__(self, answers: Answers) -> None:
        self._controller, self._asked = answers.controller, iter(answers.asked)
        self._state = state_for(answers.description)
        if answers.asked:
            self._state.load(answers.asked[0])
            self._controller.reset(self._state, None)
        self._controller.now = time.perf_counter_ns

    def take(self, count: int) -> list[tuple[int, int]]:
        """Answer so many States: nanoseconds of the step, and of what follows the kinematics."""
        state, step, now = self._state, self._controller.step, time.perf_counter_ns
        taken = []
        for _, payload in zip(range(count), self._asked, strict=False):
            state.load(payload)
            begin = now()
            command = step(state)
            end = now()
            taken.append((end - begin, end - command.stamp_kinematics))
        return taken
