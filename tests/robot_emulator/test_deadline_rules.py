"""Until when an answer is in time: both rules, with and without a delay, on virtual time."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.log_samples import write
from support.robot_bench import Bench
from support.small_arm import PERIOD_NS as T
from support.small_arm import arm

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.tick_metrics import longest_run, tick_figures
from hoap3.tools.analysis.ticks import IN_TIME, LATE, LOST, TickTable
from hoap3.tools.verify.deadline_checker import Recount

RULES = ("next_tick", "after_receipt")
CASES = [(rule, d) for rule in RULES for d in (0, 1, 3)]
both = pytest.mark.parametrize(("rule", "d"), CASES)


@dataclass
class Script:
    """When the answers to each tick come, after its intended start [ns], and how late it wakes."""

    arrivals: dict[int, list[int]]
    late: dict[int, int] = field(default_factory=dict)
    usual: int = T // 5


def bench(rule: str, d: int, script: Script, lead: int = 0, **config: object) -> Bench:
    """A robot whose answers and wake-ups are scripted."""

    def fate(tick: int, answer: bytes) -> list[tuple[int, bytes]]:
        now = made.clock.now() - tick * T
        wanted = script.arrivals.get(tick, [now + script.usual])
        return [(max(0, at - now), answer) for at in wanted]

    robot = arm(deadline=rule, delay_ticks=d)
    made = Bench(fate, description=robot, lead=lead, **config)
    made.speed[:] = 0.1
    made.link.ask("acquire", "test")
    made.oversleep(dict(script.late))
    return made


def counts(made: Bench) -> tuple[int, int, int, int]:
    """Of ticks asked, in time, late, lost."""
    found = made.robot.validator.deadlines
    return found.asked, found.in_time, found.late, found.lost


def follows(made: Bench) -> list[int]:
    """Which tick's answer each period follows, -1 for none, as the filter is told."""
    told: list[int] = []
    own = made.robot._setpoint_filter
    follow, hold = own.follow, own.hold
    own.follow = lambda values, tick: (told.append(tick), follow(values, tick))[1]
    own.hold = lambda: (told.append(-1), hold())[1]
    return told


def publication(script: Script, tick: int) -> int:
    """After the intended start [ns]."""
    return script.late.get(tick, 0)


@both
@pytest.mark.parametrize("late", [0, T // 10])
def test_each_side_of_the_threshold(rule, d, late):
    due = (1 + d) * T + (late if rule == "after_receipt" else 0)
    for at, expected in ((due - 1, 0), (due, 0), (due + 1, 1)):
        made = bench(rule, d, Script({30: [at]}, {30: late}))
        made.run(60 + d)
        found = made.robot.validator.deadlines
        assert (found.late, found.lost) == (expected, 0), at
        assert found.asked - found.in_time == expected


@both
def test_an_answer_is_applied_exactly_so_many_ticks_later(rule, d):
    made = bench(rule, d, Script({}))
    told = follows(made)
    made.run(40)
    assert told == [-1] * (1 + d) + list(range(39 - d))


@pytest.mark.parametrize("d", [1, 3])
def test_answers_that_overtake_each_other_wait_for_their_ticks(d):
    swapped = Script({20: [T + 1 + T // 2], 21: [T // 4]})  # 21 comes before 20
    made = bench("next_tick", d, swapped)
    told = follows(made)
    made.run(40)
    assert told == [-1] * (1 + d) + list(range(39 - d))
    assert made.robot.validator.out_of_order == 1
    assert not made.robot.validator.deadlines.late


@both
def test_late_lost_and_duplicate(rule, d):
    script = Script({20: [], 25: [(1 + d) * T + T // 2], 30: [T // 4, T // 3]})
    made = bench(rule, d, script)
    told = follows(made)
    made.run(60)
    assert counts(made)[2:] == (1, 1)
    assert made.robot.validator.duplicate == 1
    missing = {20, 25}  # 25 is here when 26 is, which is newer
    assert [tick for tick in range(59 - d) if tick not in told] == sorted(missing)
    assert told.count(-1) == 1 + d + 2


@both
def test_a_late_answer_is_followed_where_nothing_newer_is_due(rule, d):
    script = Script({25: [(1 + d) * T + T // 2], 26: []})
    made = bench(rule, d, script)
    told = follows(made)
    made.run(60)
    assert told[25 + 1 + d] == -1
    assert told[25 + 2 + d] == 25
    assert counts(made)[2:] == (1, 1)


@both
@pytest.mark.parametrize("misses", [7, 8])
def test_so_many_misses_stop_and_one_less_do_not(rule, d, misses):
    made = bench(rule, d, Script({tick: [] for tick in range(20, 20 + misses)}), misses_to_stop=8)
    made.run(20 + 8 + d)
    assert made.robot.mode == State.ACTIVE
    made.run(1)
    assert (made.robot.mode != State.ACTIVE) == (misses == 8)
    made.run(40)
    assert made.robot.safe_stops == (misses == 8)
    assert made.robot.validator.deadlines.longest_run == misses


@both
def test_a_late_publication_defers_the_stop_by_a_tick_after_receipt(rule, d):
    script = Script({tick: [] for tick in range(20, 28)}, {27: 5})
    made = bench(rule, d, script, misses_to_stop=8)
    made.run(20 + 8 + d + 1)
    assert (made.robot.mode == State.ACTIVE) == (rule == "after_receipt")
    made.run(1)
    assert made.robot.mode != State.ACTIVE


@both
def test_after_a_recovery_earlier_misses_do_not_count(rule, d):
    made = bench(rule, d, Script({tick: [] for tick in range(20, 200)}), misses_to_stop=8)
    made.run(60)
    assert made.robot.mode == State.STOPPED
    asked = counts(made)[0]
    made.link.ask("recover", "test")
    made.run(8 + d)
    assert made.robot.mode == State.ACTIVE
    made.run(1)
    assert made.robot.mode != State.ACTIVE
    made.run(20)
    assert counts(made)[0] == asked + 8 + d
    assert made.robot.safe_stops == 2


@pytest.mark.parametrize("d", [1, 3])
def test_a_new_grant_waits_for_the_deadlines_of_the_one_before(d):
    made = bench("next_tick", d, Script({}))
    made.speed[:] = 0.0
    made.run(30)
    made.link.ask("release", "test")
    made.run(1)
    answer = made.link.ask("acquire", "test")
    made.run(1)
    assert answer[0]["from_tick"] == 29 + 1 + d
    assert (answer[0]["deadline"], answer[0]["delay_ticks"]) == ("next_tick", d)
    made.run(20)
    asked, in_time, late, lost = counts(made)
    assert (late, lost) == (0, 0)
    assert asked == in_time


@both
def test_the_schedule_ends_when_every_tick_has_been_judged(rule, d):
    made = bench(rule, d, Script({}))
    made.speed[:] = 0.0
    made.robot.run(0, lambda: False, 50)
    assert counts(made) == (50, 50, 0, 0)


def table(made: Bench, folder: Path) -> TickTable:
    """Of the robot's own log."""
    about = made.description.to_json()
    head = Record(Kind.DESCRIPTION, 0, about)
    records = [head, *made.recorder.records]
    write(folder / "robot.mcap", records, attachments={"description.json": about})
    return TickTable.from_run(folder)


delays = st.one_of(
    st.just([T // 5]),
    st.lists(st.integers(0, 6 * T), max_size=3),
    st.sampled_from([[n * T + off] for n in range(1, 5) for off in (-1, 0, 1)]),
)
scripts = st.builds(
    Script,
    st.dictionaries(st.integers(0, 59), delays, max_size=40),
    st.dictionaries(st.integers(0, 59), st.sampled_from([1, 7, T // 3, T - 1]), max_size=20),
)


def plain(rule: str, d: int, script: Script, asked: range, end: int) -> dict[int, int]:
    """The definition, word for word: the outcome of each tick."""
    outcome = {}
    for tick in asked:
        published = publication(script, tick)
        came = [max(at, published) for at in script.arrivals.get(tick, [published + script.usual])]
        came = [at for at in came if tick * T + at <= end]
        due = (1 + d) * T + (published if rule == "after_receipt" else 0)
        if not came:
            outcome[tick] = LOST
        else:
            outcome[tick] = IN_TIME if min(came) <= due else LATE
    return outcome


@pytest.mark.slow
@given(st.sampled_from(CASES), scripts)
def test_counts_are_those_of_the_definition_and_of_the_log(tmp_path_factory, case, script):
    rule, d = case
    made = bench(rule, d, script, misses_to_stop=10_000)
    made.robot.run(0, lambda: False, 60)
    found = made.robot.validator.deadlines
    log = table(made, tmp_path_factory.mktemp("log"))
    end = made.states()[-1].stamp_actual
    expected = plain(rule, d, script, range(60), end)
    assert [expected[tick] for tick in log.tick.tolist()] == log.outcome.tolist()
    assert counts(made) == (60, *(log.count(each) for each in (IN_TIME, LATE, LOST)))
    assert longest_run(log) == found.longest_run
    assert tick_figures([log])["success_rate"]["run"] == found.run_rate
    due = made.description.due
    begin = log.published if rule == "after_receipt" else log.intended
    assert np.array_equal(log.end, begin + due)


@pytest.mark.slow
@given(st.sampled_from(CASES), scripts)
def test_who_acts_ahead_counts_and_follows_the_same(case, script):
    found = []
    for lead in (0, T // 4):
        made = bench(*case, script, lead=lead, misses_to_stop=8)
        made.robot.run(0, lambda: False, 50)
        found.append(([state.dump() for state in made.states()], made.robot.summary()))
    assert found[0] == found[1]


@pytest.mark.slow
@given(
    st.sampled_from(CASES),
    scripts,
    st.dictionaries(st.integers(0, 50), st.integers(T, 4 * T), max_size=4),
    st.sampled_from([0, T // 4]),
)
def test_skipped_ticks_change_no_outcome_of_others(tmp_path_factory, case, script, asleep, lead):
    slept = Script(script.arrivals, {**script.late, **asleep})
    made = bench(*case, slept, lead=lead, misses_to_stop=10_000)
    made.robot.run(0, lambda: False, 60)
    log = table(made, tmp_path_factory.mktemp("log"))
    outcomes = [log.count(each) for each in (IN_TIME, LATE, LOST)]
    assert counts(made) == (sum(outcomes), *outcomes)
    assert longest_run(log) == made.robot.validator.deadlines.longest_run
    assert_counted_by_tick(made)


def assert_counted_by_tick(made: Bench) -> None:
    """Each State has the counts of the deadlines that have passed by its intended start."""
    recount = Recount(made.description)
    for record in made.recorder.records:
        if record.kind == Kind.SETPOINT:
            recount.setpoint(record.stamp, record.payload)
        elif record.kind == Kind.STATE:
            recount.state(record.payload)
    assert recount.ticks
    assert list(recount.stated) == pytest.approx(list(recount.found), abs=1e-12)


@both
@pytest.mark.parametrize("lead", [0, T // 4])
def test_who_skips_ticks_has_counted_what_came_due_in_them(rule, d, lead):
    """Also where it had acted for the first of them already."""
    silent = {tick: [] for tick in range(8, 12)}
    made = bench(rule, d, Script(silent, {8 + d: 3 * T, 20: T + T // 2}), lead=lead)
    made.robot.run(0, lambda: False, 40)
    assert made.robot.skipped == 4
    assert_counted_by_tick(made)
