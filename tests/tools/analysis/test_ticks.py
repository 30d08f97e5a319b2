"""What became of each tick: from logs of runs in which every stage has a known length."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.log_samples import describe, write
from support.tick_story import MS, START, US, USUAL_US, Story

from hoap3.protocol.errors import LogError
from hoap3.tools.analysis.cycles import NEVER
from hoap3.tools.analysis.miss_attribution import StallTime
from hoap3.tools.analysis.tick_metrics import tick_figures
from hoap3.tools.analysis.ticks import IN_TIME, LATE, LOST, SKIPPED, STAGES, TickTable
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.stalls import Stall, overlapping


@pytest.fixture
def table(tmp_path):
    """Reads the table of a story."""

    def read(story, *, controller=True):
        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        return TickTable.from_run(story.write(folder, controller=controller))

    return read


def every(n, count, first=100):
    return np.arange(first, count, n)


@pytest.mark.parametrize("controller", [True, False], ids=["both logs", "the robot's alone"])
def test_every_stage_has_the_length_that_it_was_given(table, controller):
    story = Story(300)
    ticks = table(story, controller=controller)
    assert ticks.tick.tolist() == list(range(300))
    assert (ticks.outcome == IN_TIME).all()
    for name in STAGES:
        if name == "wait":
            expected = np.zeros(300)
        elif name == "network":
            expected = story.lengths["inbound"] + story.lengths["outbound"]
        else:
            expected = story.lengths[name]
        found = ticks.stage(name)
        if name == "send":
            assert np.isnan(found[-1])  # no later message tells it
            found, expected = found[:-1], expected[:-1]
        if name == "network":
            found, expected = found[:-1], expected[:-1]  # and here it is included
        assert found / US == pytest.approx(expected, abs=2e-3), name
    parts = np.nansum([ticks.stage(name) for name in STAGES[2:]], axis=0)
    assert np.array_equal(parts, ticks.stage("rtt"))
    assert not ticks.stage("unaccounted").any()


def test_the_clocks_of_both_sides_are_never_compared(table):
    spoilt = {"solve": (every(50, 500), 2000.0)}
    found = []
    for offset in (0, -3_000_000_000, 10**15):
        story = Story(500, offset=offset)
        for stage, (ticks, length) in spoilt.items():
            story.slow(stage, ticks, length)
        ticks = table(story)
        found.append((ticks.attributed_stages, [ticks.stage(name).tobytes() for name in STAGES]))
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("controller", [True, False], ids=["both logs", "the robot's alone"])
@pytest.mark.parametrize(
    ("stage", "guilty"),
    [
        ("wakeup", "wakeup"),
        ("publish", "publish"),
        ("inbound", "network"),
        ("decode", "decode"),
        ("kinematics", "kinematics"),
        ("solve", "solve"),
        ("encode", "encode"),
        ("send", "send"),
        ("outbound", "network"),
    ],
)
def test_misses_go_to_the_stage_that_was_slow(table, stage, guilty, controller):
    count = 2500
    slow = 950.0 if stage in {"wakeup", "publish"} else 2000.0
    ticks = table(Story(count).slow(stage, every(250, count), slow), controller=controller)
    counts = ticks.attributed_counts()
    if not controller and stage in {"inbound", "send"}:  # only the controller knows the rest
        assert counts.keys() == {"network", "no answer"}
        return
    assert counts.get(guilty, 0) >= 0.99 * sum(counts.values()) > 0
    assert sum(counts.values()) == ticks.count(LATE) + ticks.count(LOST) >= 10


@pytest.mark.parametrize("length", [1500.0, 1990.0, 2500.0, 7300.0])
def test_one_slow_solve_answers_for_every_tick_that_it_cost(table, length):
    story = Story(400).slow("solve", [200], length)
    ticks = table(story)
    missed = ticks.tick[ticks.missed]
    assert missed[0] == 200
    assert len(missed) >= length // 1000
    assert set(ticks.attributed_stages.values()) == {"solve"}
    waited = ticks.stage("wait")
    assert (waited[:201] == 0).all()
    after = int(np.flatnonzero(ticks.cycle > ticks.cycle[200])[0])
    ends = 200 * MS + round(sum(story.lengths[s][200] for s in WAY_THERE) * US)
    came = after * MS + round(sum(story.lengths[s][after] for s in WAY_THERE[:3]) * US)
    assert waited[after] == pytest.approx(max(0, ends - came), abs=2 * US + US)


WAY_THERE = ("wakeup", "publish", "inbound", "decode", "kinematics", "solve", "encode", "send")


def test_a_waiting_tick_passes_the_blame_on_through_several_cycles(table):
    story = Story(400).slow("encode", [200], 1940.0)
    for tick in (201, 202, 203):
        story.slow("decode", [tick], 450.0)  # slow, but not guilty
    ticks = table(story)
    assert ticks.attributed_stages[201] == "encode"
    assert set(ticks.attributed_stages.values()) == {"encode"}
    assert len(ticks.attributed_stages) >= 3
    assert (table(story.slow("encode", [200], 5.0)).outcome == IN_TIME).all()


def test_a_tick_whose_state_vanished_is_the_networks(table):
    ticks = table(Story(300, undelivered={100, 101, 200}))
    assert ticks.attributed_stages == dict.fromkeys((100, 101, 200), "network")
    assert ticks.count(LOST) == 3


def test_a_lost_answer_needs_the_controllers_log(table):
    story = Story(300, vanished={100, 200}, kept_silent={150})
    assert table(story).attributed_stages == {100: "network", 150: "silent", 200: "network"}
    alone = table(story, controller=False)
    assert alone.attributed_stages == dict.fromkeys((100, 150, 200), "no answer")
    assert (alone.cycle[[100, 150, 200]] == -1).all()


def test_what_the_robot_refused_is_rejected(table):
    ticks = table(Story(300, refuse={100, 101}))
    assert ticks.attributed_stages == {100: "rejected", 101: "rejected"}
    assert (ticks.arrival[[100, 101]] == NEVER).all()


def test_a_stage_that_is_always_long_is_not_guilty_of_one_that_is_long_once(table):
    story = Story(300).slow("solve", np.arange(300), 500.0).slow("encode", [200], 450.0)
    assert table(story).attributed_stages == {200: "encode"}


def test_where_all_is_slow_the_slowest_stage_is_guilty(table):
    story = Story(300)
    ticks = table(story.slow("kinematics", np.arange(300), 1200.0))
    assert not np.any(ticks.outcome == IN_TIME)
    assert ticks.attributed_counts() == {"kinematics": 300}


def test_a_host_stall_is_not_ours(table):
    story = Story(1000, stalls=[(300 * MS + 100 * US, 2 * MS), (700 * MS, MS // 2)])
    story.slow("solve", [300, 500], 2000.0)
    ticks = table(story)
    assert ticks.stalls == [
        Stall(START + 300 * MS + 100 * US, START + 302 * MS + 100 * US),
        Stall(START + 700 * MS, START + 700 * MS + 500 * US),
    ]
    guilty = ticks.attributed_stages
    assert {tick for tick, name in guilty.items() if name == "host"} == {300, 301, 302} & set(
        guilty
    )
    assert guilty[500] == "solve"
    outside = [tick for tick in guilty if not 300 <= tick <= 302]
    assert ticks.misses_outside_stalls == len(outside) > 0
    assert tick_figures([ticks])["success_rate"]["outside_stalls"] == pytest.approx(
        1 - len(outside) / (1000 - len(guilty) + len(outside))
    )
    assert tick_figures([ticks])["success_rate"]["run"] == pytest.approx(1 - len(guilty) / 1000)


@pytest.mark.parametrize(
    ("stall_us", "guilty"), [(200, "solve"), (900, "solve"), (1100, "host"), (2000, "host")]
)
def test_a_stage_that_cost_the_tick_by_itself_cannot_blame_a_stall(table, stall_us, guilty):
    story = Story(1000, stalls=[(500 * MS + 200 * US, stall_us * US)]).slow("solve", [500], 2060.0)
    ticks = table(story)
    assert ticks.stalled[500]
    assert ticks.attributed_stages[500] == guilty


def test_a_tick_that_was_never_seen_for_a_slow_solve_cannot_blame_a_stall_either(table):
    story = Story(1000, stalls=[(501 * MS, 200 * US), (502 * MS, 200 * US)])
    ticks = table(story.slow("solve", [500], 3300.0))
    missed = [int(tick) for tick in ticks.tick[ticks.missed]]
    assert missed[:3] == [500, 501, 502]
    assert np.isnan(ticks.stage("rtt")[501])
    assert ticks.stalled[501]
    assert ticks.stalled[502]
    assert set(ticks.attributed_stages.values()) == {"solve"}


@given(
    st.lists(st.tuples(st.integers(0, 3000), st.integers(1, 400)), max_size=12),
    st.integers(0, 3000),
    st.integers(0, 3000),
)
def test_time_away_is_that_of_the_union_of_all_stalls(pairs, begin, end):
    away = StallTime(sorted((Stall(start, start + n) for start, n in pairs), key=lambda s: s.start))
    gone = np.zeros(4000, bool)
    for start, length in pairs:
        gone[start : start + length] = True
    assert away.between(begin, end) == gone[begin:end].sum()


def test_without_a_monitor_nothing_is_said_of_stalls(table):
    ticks = table(Story(100).slow("solve", [50], 2000.0))
    assert ticks.stalls is None
    assert ticks.stalled is None
    assert ticks.misses_outside_stalls is None
    assert tick_figures([ticks])["success_rate"]["outside_stalls"] is None
    assert ticks.worst()[0]["stalled"] is None
    watched = table(Story(100, stalls=[]).slow("solve", [50], 2000.0))
    assert watched.misses_outside_stalls == watched.count(LATE) + watched.count(LOST)


def test_skipped_ticks_are_misses_only_outside_stalls(table):
    story = Story(400, skipped={100, 101, 250}, stalls=[(100 * MS, 2 * MS)])
    ticks = table(story)
    assert ticks.tick[ticks.outcome == SKIPPED].tolist() == [100, 101, 250]
    assert ticks.intended[250] == START + 250 * MS
    assert ticks.attributed_stages == {100: "host", 101: "host", 250: "wakeup"}
    assert ticks.count(LATE) + ticks.count(LOST) == 0
    assert tick_figures([ticks])["success_rate"]["run"] == 1.0
    assert ticks.misses_outside_stalls == 1
    rates = tick_figures([ticks])["success_rate"]
    assert rates["outside_stalls"] == pytest.approx(1 - 1 / 398)


@given(
    st.lists(st.tuples(st.integers(0, 400), st.integers(1, 30)), max_size=8),
)
@settings(max_examples=20)
def test_stalled_ticks_are_those_that_a_search_finds(tmp_path_factory, pairs):
    stalls = [(100 * US * start, 100 * US * length) for start, length in pairs]
    folder = tmp_path_factory.mktemp("stalls")
    ticks = TickTable.from_run(Story(40, stalls=stalls).write(folder))
    each = [Stall(START + start, START + start + length) for start, length in stalls]
    expected = [
        any(overlapping([stall], at, at + MS) for stall in each) for at in ticks.intended.tolist()
    ]
    assert ticks.stalled.tolist() == expected


def test_outcomes_at_the_edge_of_the_deadline(table):
    story = Story(10)
    way = sum(
        round(story.lengths[stage][5] * US)
        for stage in USUAL_US
        if stage not in {"outbound", "wait"}
    )
    story.lengths["outbound"][5] = (MS - way) / US
    assert table(story).outcome[5] == IN_TIME
    story.lengths["outbound"][5] += 1e-3
    ticks = table(story)
    assert ticks.outcome[5] == LATE
    assert ticks.arrival[5] == START + 6 * MS + 1


def test_the_last_tick_of_a_log_that_breaks_off_counts_only_with_its_answer(tmp_path):
    robot, _ = Story(50).records()
    cut = [r for r in robot if r.stamp < START + 49 * MS + 100 * US]  # State 49, no answer to it
    about = {"attachments": {"description.json": describe(1).to_json()}}
    assert TickTable.from_run(write(tmp_path / "cut.mcap", cut, **about).paths[0]).tick[-1] == 48
    whole = [r for r in robot if r.stamp < START + 50 * MS]
    ticks = TickTable.from_run(write(tmp_path / "whole.mcap", whole, **about).paths[0])
    assert ticks.tick[-1] == 49
    assert ticks.count(LATE) + ticks.count(LOST) == 0


def test_worst_are_the_longest_round_trips_with_their_stages(table):
    story = Story(1000, vanished={7}).slow("solve", every(50, 1000), 700.0)
    story.slow("outbound", [333], 800.0)
    ticks = table(story)
    worst = ticks.worst(10)
    rtt = ticks.stage("rtt")
    assert [each["rtt_us"] for each in worst] == pytest.approx(
        np.sort(rtt[~np.isnan(rtt)])[::-1][:10] / 1e3
    )
    assert worst[0]["tick"] == 333
    for each in worst:
        stages = each["stages_us"]
        inside = sum(stages[name] for name in STAGES if name not in {"wakeup", "publish"})
        assert inside == pytest.approx(each["rtt_us"])
        assert each["guilty"] is None
    assert json.loads(json.dumps(worst)) == worst


@given(seed=st.integers(0, 1000))
@settings(max_examples=10)
def test_the_table_agrees_with_numpy_on_random_runs(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    story = Story(200, seed, stalls=[])
    for stage in USUAL_US:
        slow = rng.random(200) < 0.02
        slow[0] = False  # what came before the first State that it saw, no controller can tell
        story.lengths[stage][slow] += rng.exponential(700.0, slow.sum())
    story.lengths["wakeup"] = np.minimum(story.lengths["wakeup"], 900.0)
    story.vanished = set(np.flatnonzero(rng.random(200) < 0.02).tolist())
    ticks = TickTable.from_run(story.write(tmp_path_factory.mktemp("run")))
    rtt = ticks.stage("rtt")
    late = rtt > ticks.intended + MS - ticks.published
    assert ticks.count(LATE) == np.count_nonzero(late)
    assert ticks.count(LOST) == np.count_nonzero(np.isnan(rtt)) >= len(story.vanished)
    assert ticks.misses_outside_stalls == ticks.count(LATE) + ticks.count(LOST)
    assert ticks.attributed_stages.keys() == set(ticks.tick[ticks.missed].tolist())
    assert sum(ticks.attributed_counts().values()) == ticks.count(LATE) + ticks.count(LOST)
    assert "no answer" not in ticks.attributed_counts()
    answered = ~np.isnan(rtt)
    parts = np.nansum([ticks.stage(name) for name in STAGES[2:]], axis=0)
    assert np.array_equal(parts[answered], rtt[answered])


def test_stamps_that_contradict_each_other_leave_the_round_trip_unaccounted(tmp_path):
    story = Story(100)
    story.lengths["solve"][50] = -30.0
    ticks = TickTable.from_run(story.write(tmp_path))
    assert np.isnan(ticks.stage("solve")[50])
    assert ticks.stage("unaccounted")[50] == ticks.stage("rtt")[50]
    assert np.isnan(ticks.stage("network")[50])
    assert ticks.stage("unaccounted")[51] == 0


def test_a_log_without_states_or_recorded_from_outside_is_refused(tmp_path):
    about = {"attachments": {"description.json": describe(1).to_json()}}
    outside = {"metadata": {"run": {"recorded": "from outside"}}}
    cases = {"none": ([], {}), "outside": (Story(10).records()[0], outside)}
    for name, (records, more) in cases.items():
        (tmp_path / name).mkdir()
        write(tmp_path / name / "robot.mcap", records, **about, **more)
        with pytest.raises(LogError, match=name):
            TickTable.from_run(tmp_path / name)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("rule", ["next_tick", "after_receipt"])
def test_the_table_counts_from_where_the_rule_does(tmp_path, rule, delay):
    """A wake-up late by 0.5 ms leaves too little on the schedule for an answer of 0.7 ms."""
    story = Story(100).slow("wakeup", [40], 500.0).slow("solve", [40], 600.0)
    for tick in (60, 61):
        story.slow("outbound", [tick], 1000.0 + 1000.0 * delay)
    log = Log.open(story.write(tmp_path), side="robot")
    rules = {"deadline": rule, "delay_ticks": delay}
    log.description = log.description.model_copy(update=rules)
    table = TickTable.from_logs(log, Log.open(tmp_path, side="controller"))
    late = [60, 61] if delay or rule == "after_receipt" else [40, 60, 61]
    assert table.tick[table.outcome == LATE].tolist() == late
    begin = table.published if rule == "after_receipt" else table.intended
    assert np.array_equal(table.end - begin, np.full(len(table), (1 + delay) * MS))
    assert table.rule == {"deadline": rule, "delay_ticks": delay}
    assert table.rule.items() <= tick_figures([table]).items()
