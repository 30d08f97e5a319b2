"""Times are taken in turn, over the same States in their order, and are of steps alone."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from support.log_samples import describe

from hoap3.protocol.messages import Setpoint, State
from hoap3.tools.analysis.compare.loops import Answers, time_answers


class Clock:
    """Time that passes only when somebody works."""

    def __init__(self) -> None:
        self.now = 0


class Worker:
    """A controller that works for so long, and notes what it was asked."""

    def __init__(self, clock, name, step_ns, diary):
        self._clock, self._name, self._step, self._diary = clock, name, step_ns, diary
        self.command = Setpoint(2, 0)

    def reset(self, state, last_command):
        assert last_command is None
        self._diary.append((self._name, "reset", state.tick))

    def step(self, state):
        self._clock.now += self._step
        self._diary.append((self._name, "step", state.tick))
        return self.command


@pytest.fixture
def bench(monkeypatch):
    """Measure workers of these durations [ns] on so many States; figures and diary."""

    def bench(durations, counts):
        clock, diary = Clock(), []
        fake = SimpleNamespace(perf_counter_ns=lambda: clock.now)
        monkeypatch.setattr("hoap3.tools.bench.case_runner.time", fake)
        answers = []
        for name, (duration, count) in enumerate(zip(durations, counts, strict=True)):
            state, asked = State(2), []
            for tick in range(count):
                state.tick = tick
                asked.append(state.dump())
            worker = Worker(clock, name, duration, diary)
            answers.append(Answers(describe(2), worker, None, None, asked, closed_loop=False))
        labels = [str(name) for name in range(len(durations))]
        return time_answers(labels, answers), diary

    return bench


def test_steps_take_as_long_as_they_took(bench):
    found, _ = bench([4000, 10_000], [100, 100])
    first, second = found["rows"]
    assert (first["step_us"]["min"], first["step_us"]["max"]) == (4.0, 4.0)
    assert second["step_us"]["p50"] == 10.0
    assert (first["times_first"], second["times_first"]) == (1.0, 2.5)


def test_blocks_alternate_and_states_keep_their_order(bench):
    found, diary = bench([2, 2], [45, 50])
    assert found["blocks"] == 4
    assert [each for each in diary if each[1] == "reset"] == [(0, "reset", 0), (1, "reset", 0)]
    steps = [(name, tick) for name, what, tick in diary if what == "step"]
    expected = []
    for block in range(4):
        for name in (0, 1):
            expected += [(name, tick) for tick in range(11 * block, 11 * block + 11)]
    assert steps == expected
    assert {row["step_us"]["n"] for row in found["rows"]} == {4 * (11 - 3)}


@pytest.mark.parametrize("count", [0, 1, 3, 9])
def test_a_few_answers_are_enough(bench, count):
    found, _ = bench([2, 4], [count, 9])
    for row in found["rows"]:
        assert row["step_us"]["n"] == max(0, count - min(3, max(0, count - 1)))
    assert (found["rows"][1]["times_first"] is None) == (count == 0)
