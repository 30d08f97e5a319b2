"""A log by time: each moment is its State, its answer, and forward kinematics of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.log_samples import describe, inputs, write

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.indexed_log import IndexedLog
from hoap3.tools.logs.log import Log
from hoap3.tools.view.picture.frame import PLOTS
from hoap3.tools.view.picture.kinematics import Poses
from hoap3.tools.view.sources.log_overview import Overview
from hoap3.tools.view.sources.log_source import LogSource
from hoap3.tools.view.sources.play_clock import PlayClock

MS = 1_000_000
BEGIN = 7_000_000_000
ACTIVE = 40  # first tick that asks for an answer
SLOW, MISSED, SKIPPED = 1234, 2345, 3500  # ticks
ROBOT = describe(3)


def motion(tick: int) -> np.ndarray:
    return np.array([np.sin(1e-3 * tick), 0.3 * np.cos(2e-3 * tick), 1e-4 * tick])


def run(ticks: int, phase: int = 0) -> list[Record]:
    """A robot that moves, and is answered in 300 µs; in 5 ms once, and not at all once."""
    records = inputs(ROBOT, BEGIN - 10)
    state, setpoint, event = State.allocate(**ROBOT.state_lengths), Setpoint(3, 2), Event()
    event.kind, event.tick, event.stamp = Event.schema.constants["CLIPPED"], 500, BEGIN + 500 * MS
    event.detail = 1
    due: list[tuple[int, Record]] = []
    for tick in range(ticks):
        now = BEGIN + tick * MS
        for at, late in list(due):
            if at <= now:
                records.append(late)
                due.remove((at, late))
        state.session_id, state.tick = 7, tick
        state.mode = State.ACTIVE if tick >= ACTIVE else State.IDLE
        state.q[:] = motion(tick + phase)
        state.lost, state.success_rate = int(tick > MISSED), 1.0
        state.skipped = 3 if tick > SKIPPED else 0
        state.dq[:] = 0.0, 1e-3 * tick, 0.0
        state.stamp_published = now
        records.append(Record(Kind.STATE, now, state.dump()))
        if tick == 500:
            records.append(Record(Kind.EVENT, event.stamp, event.dump()))
        if tick < ACTIVE or tick == MISSED:
            continue
        setpoint.session_id, setpoint.tick, setpoint.stamp_state = 7, tick, now
        setpoint.v = 1e-9 * tick
        setpoint.v_rate_predicted, setpoint.active_joints = -2e-9 * tick, 2
        setpoint.extra[:] = 5.0, tick
        setpoint.stamp_received, setpoint.stamp_encoded = now + 50_000, now + 150_000
        came = now + (5 * MS if tick == SLOW else 300_000)
        answer = Record(Kind.SETPOINT, came, setpoint.dump())
        due.append((came, answer)) if came > now + MS else records.append(answer)
    summary = {"asked": ticks - ACTIVE, "in_time": ticks - ACTIVE - 2, "safe_stops": 0}
    return [*records, Record(Kind.SUMMARY, BEGIN + ticks * MS, json.dumps(summary).encode())]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "robot.mcap"
    files = {"config.yaml": b"robot: sample\n", "description.json": ROBOT.to_json()}
    write(path, run(4000), attachments=files)
    return path


@pytest.fixture
def source(log: Path) -> Any:
    found = LogSource([log])
    yield found
    found.close()


def test_it_has_the_records_that_a_log_has(log):
    indexed, whole = IndexedLog(log), Log.open(log)
    assert indexed.chunks > 2
    found = [each for chunk in range(indexed.chunks) for each in indexed.records(chunk)]
    assert found == list(whole.records())
    assert indexed.description == whole.description
    assert indexed.config == whole.config


@pytest.mark.parametrize("tick", [0, 1, ACTIVE, 777, 2000, SLOW, 3999])
def test_a_moment_is_the_state_up_to_then_and_its_answer(log, tick):
    indexed = IndexedLog(log)
    for after in (0, 1, MS - 1):
        state, stamp, setpoint, answered = indexed.state_at(BEGIN + tick * MS + after)
        assert (state.tick, stamp) == (tick, BEGIN + tick * MS)
        assert (setpoint is None) == (answered is None)
        assert np.array_equal(state.q, motion(tick))
        if tick >= ACTIVE:
            assert (setpoint.tick, setpoint.v) == (tick, pytest.approx(1e-9 * tick))
    assert IndexedLog(log).state_at(BEGIN - 1) is None


def test_a_tick_without_an_answer_has_none(log):
    assert IndexedLog(log).state_at(BEGIN + MISSED * MS).setpoint is None


def test_no_more_chunks_are_kept_than_a_few(log, monkeypatch):
    from hoap3.tools.logs import indexed_log

    monkeypatch.setattr(indexed_log, "KEPT", 2)
    indexed = IndexedLog(log)
    for tick in range(0, 4000, 100):
        indexed.state_at(BEGIN + tick * MS)
        assert len(indexed._kept) <= 2


def test_a_frame_is_forward_kinematics_of_its_state(source):
    player = source.player()
    for at_s in (0.0, 1.0, 2.5, 3.9):
        player.seek(at_s)
        frame = player.frame()
        tick = round(at_s * 1e3) + ACTIVE
        assert (frame["tick"], frame["at_s"]) == (tick, pytest.approx(at_s))
        poses = Poses(ROBOT)
        poses.update(motion(tick))
        assert np.allclose(frame["poses"], poses.poses, atol=1e-6)
        assert player.frame() is None  # it is shown already


def test_each_page_has_a_place_of_its_own(source):
    first, second = source.player(), source.player()
    first.seek(1.0)
    second.seek(2.0)
    assert (first.frame()["at_s"], second.frame()["at_s"]) == (1.0, 2.0)


def test_its_ends_are_not_passed(source):
    player = source.player()
    player.seek(1e9)
    assert player.frame()["tick"] == 3999
    player.seek(-1e9)
    frame = player.frame()
    assert frame is None or frame["tick"] == 0


def test_a_clock_moves_on_at_its_speed():
    now = [100.0]
    clock = PlayClock(lambda: now[0])
    clock.ends = (-1.0, 10.0)
    clock.go(2.0)
    now[0] += 5.0
    assert clock.at_s == 2.0
    clock.run(0.5)
    now[0] += 4.0
    assert clock.at_s == 4.0
    clock.run(-2.0)
    now[0] += 1.0
    assert clock.at_s == 2.0
    assert clock.runs()
    now[0] += 100.0
    assert clock.at_s == -1.0
    clock.run(0.0)
    assert clock.at_s == -1.0
    assert not clock.runs()


@pytest.mark.parametrize(("speed", "first", "last"), [(2.0, -1.0, 10.0), (-1.0, 10.0, -1.0)])
def test_a_clock_stays_at_the_end_that_it_moved_to_and_begins_once_more(speed, first, last):
    now = [100.0]
    clock = PlayClock(lambda: now[0])
    clock.ends = (-1.0, 10.0)
    clock.go(3.0)
    clock.run(speed)
    now[0] += 1000.0
    assert not clock.runs()
    assert clock.at_s == last
    clock.go(3.0)
    now[0] += 1.0
    assert clock.at_s == 3.0
    clock.go(last)
    clock.run(speed)
    assert clock.runs()
    assert clock.at_s == first


def test_a_page_is_told_whether_its_log_plays(source):
    player = source.player()
    now = [0.0]
    player._clock = PlayClock(lambda: now[0])
    player._clock.ends = (0.0, 3.96)
    player.play(1.0)
    for at_s, playing in ((1.0, True), (3.0, True), (100.0, False)):
        now[0] = at_s
        assert player.frame()["playing"] is playing
    now[0] += 1.0
    assert player.frame() is None
    player.play(1.0)
    now[0] += 0.5
    assert player.frame()["playing"]


def test_worst_ticks_misses_and_events_are_found(source):
    assert source.overview.join(60.0)
    found = source.overview.as_json()
    assert found["done"]
    assert (found["from_s"], found["to_s"]) == (pytest.approx(-0.04, abs=1e-6), pytest.approx(3.96))
    slowest = found["worst"][0]
    assert slowest["at_s"] == pytest.approx((SLOW - ACTIVE) * 1e-3 + 5e-3)
    assert str(SLOW) in slowest["label"]
    for place, tick in ((-2, MISSED + 1), (-1, SKIPPED + 1)):
        assert found["worst"][place]["at_s"] == pytest.approx((tick - ACTIVE) * 1e-3)
    (event,) = found["events"]
    assert event["at_s"] == pytest.approx(0.46)
    assert ROBOT.joint_names[1] in event["label"]


def test_a_frame_says_how_long_its_answer_took(source):
    player = source.player()
    for tick, took_us in ((SLOW, 5000.0), (MISSED, None)):
        player.seek((tick - ACTIVE) * 1e-3)
        shown = player.frame()
        assert shown["tick"] == tick
        assert shown["values"].get("answer_us") == took_us


def test_curves_have_the_least_and_the_greatest_of_each_bin(source):
    source.overview.join(60.0)
    curves = source.overview.as_json()["overview"]
    values = np.array(curves["v"])
    assert (values[:, 1] <= values[:, 2]).all()
    assert values[:, 1].min() == pytest.approx(1e-9 * ACTIVE, rel=1e-5)  # however small
    assert values[:, 2].max() == pytest.approx(1e-9 * 3999, rel=1e-5)
    assert np.array(curves["answer_us"])[:, 2].max() == pytest.approx(5000.0)
    greatest = {key: np.array(rows)[:, 2].max() for key, rows in curves.items()}
    least = {key: np.array(rows)[:, 1].min() for key, rows in curves.items()}
    assert least["v_rate_predicted"] == pytest.approx(-2e-9 * 3999, rel=1e-5)
    assert greatest["active_joints"] == 2
    assert greatest["cycle_us"] == pytest.approx(100.0)
    assert greatest["error"] == pytest.approx(np.sqrt(2e-9 * 3999), rel=1e-5)
    assert greatest["fastest"] == pytest.approx(3.999)
    assert greatest["speed_share"] == pytest.approx(3.999 / 5.0, rel=1e-5)


def test_what_was_skipped_is_neither_late_nor_lost(source):
    source.overview.join(60.0)
    curves = source.overview.as_json()["overview"]
    assert np.array(curves["misses"])[:, 2].max() == 1
    assert np.array(curves["skipped"])[:, 2].max() == 3


def test_whatever_a_page_plots_has_a_curve(tmp_path):
    path = tmp_path / "robot.mcap"
    files = {"config.yaml": b"robot: sample\n", "description.json": ROBOT.to_json()}
    write(path, run(200), attachments=files)
    overview = Overview(IndexedLog(path), BEGIN, extras=1)
    overview.start()
    assert overview.join(60.0)
    curves = overview.as_json()["overview"]
    assert {key for key, *_ in PLOTS} == set(curves) - {"extra.0"}  # of two columns one
    assert np.array(curves["extra.0"])[:, 1:].tolist() == [[5.0, 5.0]] * len(curves["extra.0"])


def test_what_is_found_later_is_told(source):
    source.overview.join(60.0)
    (word,) = [word for word in source.events() if word["kind"] == "log"][-1:]
    assert word["log"]["done"]
    assert source.events() == []


def test_a_greeting_is_json(source):
    hello = source.hello()
    assert json.loads(json.dumps(hello, allow_nan=False)) == hello
    assert not hello["live"]
    assert hello["log"]["to_s"] == pytest.approx(3.96)


def test_the_verdict_is_that_of_the_whole_run(source):
    player = source.player()
    assert player.frame()["verdicts"]["deadlines"]["verdict"] == "pass"


def test_a_second_log_is_its_ghost(log, tmp_path):
    other = tmp_path / "robot.mcap"
    files = {"config.yaml": b"robot: sample\n", "description.json": ROBOT.to_json()}
    write(other, run(1000, phase=500), attachments=files)
    source = LogSource([log, other])
    try:
        player = source.player()
        player.seek(0.2)
        frame = player.frame()
        poses = Poses(ROBOT)
        poses.update(motion(200 + ACTIVE + 500))
        assert np.allclose(frame["ghost"], poses.poses, atol=1e-6)
        assert source.hello()["second"]
    finally:
        source.close()


def test_a_second_log_of_another_robot_is_refused(log, tmp_path):
    other, robot = tmp_path / "robot.mcap", describe(5)
    files = {"config.yaml": b"robot: sample\n", "description.json": robot.to_json()}
    write(other, inputs(robot), attachments=files)
    with pytest.raises(UsageError, match="links"):
        LogSource([log, other])


def test_a_log_that_is_cut_off_is_shown_as_far_as_it_goes(log, tmp_path):
    cut = tmp_path / "robot.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    source = LogSource([cut])
    try:
        player = source.player()
        player.seek(1e9)
        assert 1000 < player.frame()["tick"] < 3999
        assert source.overview.join(60.0)
    finally:
        source.close()


def test_a_damaged_chunk_is_passed_over(log, tmp_path):
    raw = bytearray(log.read_bytes())
    middle = len(raw) // 2
    raw[middle : middle + 64] = bytes(64)
    damaged = tmp_path / "robot.mcap"
    damaged.write_bytes(raw)
    source = LogSource([damaged])
    try:
        player = source.player()
        seen = set()
        for at_s in np.linspace(-0.04, 3.96, 81):
            player.seek(float(at_s))
            frame = player.frame()
            seen.add(None if frame is None else frame["tick"])
        assert len(seen) > 20
        assert source.overview.join(60.0)
    finally:
        source.close()


def test_messages_that_no_service_writes_do_not_end_the_search(tmp_path):
    strange = State.allocate(**{**ROBOT.state_lengths, "dq": 0})
    records = run(1500)
    for place, record in enumerate(records[:900]):
        if record.kind == Kind.STATE:
            records[place] = record._replace(payload=strange.dump())
    path = tmp_path / "robot.mcap"
    write(path, records, attachments={"description.json": ROBOT.to_json()})
    log = IndexedLog(path)
    overview = Overview(log, log.begin)
    overview.start()
    assert overview.join(60.0)
    assert overview.as_json()["overview"]["fastest"]


def test_what_is_no_log_is_refused(tmp_path):
    path = tmp_path / "robot.mcap"
    for content in (b"", b"hello", b"\x89MCAP0\r\n" + bytes(100)):
        path.write_bytes(content)
        with pytest.raises(LogError):
            LogSource([path])
    with pytest.raises(LogError):
        LogSource([tmp_path / "nothing.mcap"])


def test_a_summary_that_is_nonsense_gives_no_verdict(tmp_path):
    path = tmp_path / "robot.mcap"
    nonsense = {"asked": "many", "in_time": None, "interventions": [], "base": 3}
    records = [
        *run(100)[:-1],
        Record(Kind.SUMMARY, BEGIN + MS * 100, json.dumps(nonsense).encode()),
    ]
    files = {"config.yaml": b"- 1\n", "description.json": ROBOT.to_json()}
    write(path, records, attachments=files)
    source = LogSource([path])
    try:
        assert source.player().frame()["verdicts"]["deadlines"]["verdict"] == "not judged"
    finally:
        source.close()


def test_an_overview_can_be_ended_early(log):
    overview = Overview(IndexedLog(log), BEGIN)
    overview.start()
    overview.close()
    assert overview.as_json()["to_s"] > 0


def test_a_moment_of_a_log_that_is_no_number_is_not_shown_and_all_others_are(tmp_path):
    records, state = run(300), State.allocate(**ROBOT.state_lengths)
    for place, record in enumerate(records):
        if record.kind == Kind.STATE:
            state.load(record.payload)
            if state.tick in {100, 101}:
                state.q[1] = np.nan
                records[place] = Record(Kind.STATE, record.stamp, state.dump())
    path = tmp_path / "robot.mcap"
    write(path, records, attachments={"description.json": ROBOT.to_json()})
    shown = LogSource([path])
    try:
        ticks = {}
        for tick in (99, 100, 101, 102):
            found = shown.first.frame((tick - ACTIVE) * 1e-3 + 1e-4)
            ticks[tick] = found and found["tick"]
    finally:
        shown.close()
    assert ticks == {99: 99, 100: None, 101: None, 102: 102}


def test_a_file_that_goes_while_it_is_read_ends_nothing(tmp_path):
    """As the oldest of a log that rotates does."""
    path = tmp_path / "robot.mcap"
    write(path, run(1500), attachments={"description.json": ROBOT.to_json()})
    log = IndexedLog(path)
    path.unlink()
    overview = Overview(log, log.begin)
    overview.start()
    assert overview.join(60.0)
    assert log.state_at(log.end) is None


@pytest.mark.parametrize("asked", [False, True])
def test_of_a_log_that_asks_for_no_answer_it_is_said_where_seconds_begin(asked, tmp_path):
    path = tmp_path / "robot.mcap"
    ticks = run(ACTIVE + asked)
    write(path, ticks, attachments={"description.json": ROBOT.to_json()})
    source = LogSource([path])
    try:
        assert source.first.zero == (BEGIN + ACTIVE * MS if asked else source.first.log.begin)
        assert bool(source.hello()["notes"]) == (not asked)
    finally:
        source.close()


def test_the_pass_waits_while_somebody_looks_for_a_place(log, monkeypatch):
    monkeypatch.setattr("hoap3.tools.view.sources.log_overview.LOOK_S", 3600.0)
    source = LogSource([log])
    try:
        assert source.overview.join(60.0)
        indexed, seen = source.first.log, []
        monkeypatch.setattr(indexed, "records", lambda chunk, keep: seen.append(chunk) or [])
        monkeypatch.setattr(source, "overview", Overview(indexed, BEGIN))
        source.player().seek(1.0)
        source.overview.start()
        assert not source.overview.join(0.3)
    finally:
        source.close()
    assert seen == [0]
