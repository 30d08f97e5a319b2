"""When the loop has its controller begin anew, on a virtual clock."""

from __future__ import annotations

import numpy as np
import pytest
from loop_bench import Bench

from hoap3.protocol.messages import State
from hoap3.remote_controller.loop import RUN_UP


def test_without_a_run_up_it_resets_at_the_beginning_at_engagement_and_at_disengagement():
    bench = Bench(epoch=2)
    for tick in range(4):
        bench.answer(bench.state(tick, mode=State.IDLE, epoch=0))
    for tick in range(4, 8):
        bench.answer(bench.state(tick, epoch=2))
    for tick in range(8, 12):
        bench.answer(bench.state(tick, mode=State.STOPPING, epoch=2))
    for tick in range(12, 16):
        bench.answer(bench.state(tick, epoch=2))
    last = (np.full(3, 0.1) * 7 + 1e-3).tolist()
    assert bench.controller.resets == [
        (0, None),
        (4, None),
        (8, pytest.approx(last)),  # what was last sent
        (12, None),  # nothing has been sent since
    ]
    assert bench.resets_told() == [0, 4, 8, 12]


def test_it_begins_anew_at_each_of_the_last_silent_ticks_as_at_the_first_answer():
    bench, first = Bench(epoch=2), 9
    for tick in range(first):
        bench.answer(bench.state(tick, mode=State.IDLE, epoch=0, epoch_from_tick=first))
    for tick in range(first, first + 3):
        bench.answer(bench.state(tick, epoch=2, epoch_from_tick=first))
    run_up = range(first - RUN_UP, first)
    assert bench.controller.resets == [(tick, None) for tick in (0, *run_up, first)]
    assert bench.controller.steps == list(range(first + 3))
    assert bench.loop.answered == 3
    assert bench.resets_told() == [0, first]  # what nobody sees is not told


def test_without_authority_it_has_no_run_up():
    bench = Bench(epoch=0)
    for tick in range(5):
        bench.answer(bench.state(tick, mode=State.IDLE, epoch=0, epoch_from_tick=5))
    for tick in range(5, 8):
        bench.answer(bench.state(tick, epoch=1, epoch_from_tick=5))
    assert bench.controller.resets == [(0, None)]


def test_it_resets_once_where_it_begins_engaged():
    bench = Bench()
    for tick in range(3):
        bench.answer(bench.state(tick))
    assert bench.controller.resets == [(0, None)]


def test_a_new_epoch_alone_ends_and_begins_an_engagement():
    bench = Bench(epoch=1)
    bench.answer(bench.state(0))
    bench.answer(bench.state(1, epoch=2))
    bench.loop.grant(2)
    assert bench.answer(bench.state(2, epoch=2)) is not None
    assert [tick for tick, _ in bench.controller.resets] == [0, 1, 2]


def test_the_reset_comes_before_the_step_that_it_prepares():
    bench = Bench()
    order: list[str] = []
    reset, step = bench.controller.reset, bench.controller.step
    bench.controller.reset = lambda *args: order.append("reset") or reset(*args)
    bench.controller.step = lambda *args: order.append("step") or step(*args)
    bench.answer(bench.state(0))
    bench.answer(bench.state(1))
    assert order == ["reset", "step", "step"]
