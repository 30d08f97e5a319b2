"""A log by time: each moment is its State, its answer and its places; and memory of a long one."""

from __future__ import annotations

import gc
import json
import tracemalloc
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.log_samples import describe, inputs, ticks, write
from view_samples import posed

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log
from hoap3.tools.view.picture.frame import PLOTS
from hoap3.tools.view.sources import log_overview
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


def written(path: Path, records: list[Record], robot: Any = ROBOT) -> Path:
    """A log of a robot with its config, at a path or in a folder."""
    path = path / "robot.mcap" if path.is_dir() else path
    files = {"config.yaml": b"robot: sample\n", "description.json": robot.to_json()}
    write(path, records, attachments=files)
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("view"), run(4000))


@pytest.fixture
def source(log: Path) -> Any:
    with closing(LogSource([log])) as found:
        yield found


@pytest.fixture
def found(source: LogSource) -> dict[str, Any]:
    """What the pass through the log found."""
    assert source.overview.join(60.0)
    return source.overview.as_json()


def passed(log: Log, begin: int = BEGIN, **more: Any) -> dict[str, Any]:
    """What a pass through this log finds."""
    overview = Overview(log, begin, **more)
    overview.start()
    assert overview.join(60.0)
    return overview.as_json()


def shown(player: Any, at_s: float) -> Any:
    player.seek(at_s)
    return player.frame()


@pytest.fixture
def clock() -> PlayClock:
    """One on a time of the test's own, `now`."""
    now = [100.0]
    made: Any = PlayClock(lambda: now[0])
    made.now, made.ends = now, (-1.0, 10.0)
    return made


def test_it_has_the_records_that_a_log_has(log):
    indexed, whole = Log.indexed(log), Log.open(log)
    assert indexed.chunks > 2
    found = [each for chunk in range(indexed.chunks) for each in indexed.chunk(chunk)]
    assert found == list(whole.records())
    assert indexed.description == whole.description
    assert indexed.config == whole.config


@pytest.mark.parametrize("tick", [0, 1, ACTIVE, 777, 2000, SLOW, 3999])
def test_a_moment_is_the_state_up_to_then_and_its_answer(log, tick):
    indexed = Log.indexed(log)
    for after in (0, 1, MS - 1):
        state, stamp, setpoint, answered = indexed.state_at(BEGIN + tick * MS + after)
        assert (state.tick, stamp) == (tick, BEGIN + tick * MS)
        assert (setpoint is None) == (answered is None)
        assert np.array_equal(state.q, motion(tick))
        if tick >= ACTIVE:
            assert (setpoint.tick, setpoint.v) == (tick, pytest.approx(1e-9 * tick))
    assert Log.indexed(log).state_at(BEGIN - 1) is None
    assert Log.indexed(log).state_at(BEGIN + MISSED * MS).setpoint is None


def test_no_more_chunks_are_kept_than_a_few(log, monkeypatch):
    monkeypatch.setattr("hoap3.tools.logs.log.KEPT", 2)
    indexed = Log.indexed(log)
    for tick in range(0, 4000, 100):
        indexed.state_at(BEGIN + tick * MS)
        assert len(indexed._kept) <= 2


def test_a_frame_is_forward_kinematics_of_its_state(source):
    player = source.player()
    for at_s in (0.0, 1.0, 2.5, 3.9):
        frame = shown(player, at_s)
        tick = round(at_s * 1e3) + ACTIVE
        assert (frame["tick"], frame["at_s"]) == (tick, pytest.approx(at_s))
        assert np.allclose(frame["poses"], posed(ROBOT, motion(tick)).poses, atol=1e-6)
        assert player.frame() is None  # it is shown already


def test_each_page_has_a_place_of_its_own(source):
    first, second = source.player(), source.player()
    first.seek(1.0)
    second.seek(2.0)
    assert (first.frame()["at_s"], second.frame()["at_s"]) == (1.0, 2.0)


def test_its_ends_are_not_passed(source):
    player = source.player()
    assert shown(player, 1e9)["tick"] == 3999
    frame = shown(player, -1e9)
    assert frame is None or frame["tick"] == 0


def test_a_clock_moves_on_at_its_speed(clock):
    clock.go(2.0)
    clock.now[0] += 5.0
    assert clock.at_s == 2.0
    for speed, seconds, at_s in ((0.5, 4.0, 4.0), (-2.0, 1.0, 2.0)):
        clock.run(speed)
        clock.now[0] += seconds
        assert clock.at_s == at_s
    assert clock.runs()
    clock.now[0] += 100.0
    assert clock.at_s == -1.0
    clock.run(0.0)
    assert clock.at_s == -1.0
    assert not clock.runs()


@pytest.mark.parametrize(("speed", "first", "last"), [(2.0, -1.0, 10.0), (-1.0, 10.0, -1.0)])
def test_a_clock_stays_at_the_end_that_it_moved_to_and_begins_once_more(clock, speed, first, last):
    clock.go(3.0)
    clock.run(speed)
    clock.now[0] += 1000.0
    assert not clock.runs()
    assert clock.at_s == last
    clock.go(3.0)
    clock.now[0] += 1.0
    assert clock.at_s == 3.0
    clock.go(last)
    clock.run(speed)
    assert clock.runs()
    assert clock.at_s == first


def test_a_page_is_told_whether_its_log_plays(source, clock):
    player = source.player()
    player._clock, clock.ends = clock, (0.0, 3.96)
    player.play(1.0)
    for at_s, playing in ((1.0, True), (3.0, True), (100.0, False)):
        clock.now[0] = 100.0 + at_s
        assert player.frame()["playing"] is playing
    clock.now[0] += 1.0
    assert player.frame() is None
    player.play(1.0)
    clock.now[0] += 0.5
    assert player.frame()["playing"]


def test_worst_ticks_misses_and_events_are_found(found):
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


@pytest.mark.parametrize("most", [500, 1])  # events that are listed
def test_the_end_of_a_condition_says_how_long_it_held(most, tmp_path, monkeypatch):
    monkeypatch.setattr(log_overview, "EVENTS", most)
    records, event = run(300), Event()
    kinds = Event.schema.constants
    for tick, kind in ((100, "BEGAN"), (150, "ENDED"), (200, "BEGAN")):
        event.kind, event.tick, event.stamp = kinds[f"CONDITION_{kind}"], tick, BEGIN + tick * MS
        records.append(Record(Kind.EVENT, event.stamp, event.dump()))
    records.sort(key=lambda record: record.stamp)
    events = passed(Log.indexed(written(tmp_path, records)))["events"]
    first, *listed, last = [event["label"] for event in events[: most + 1]]
    assert "after" not in first
    assert [label.endswith("after 0.050 s") for label in listed] == [True, False][: most - 1]
    assert "for 0.100 s, until the end of the log" in last


@pytest.mark.parametrize("kind", [Kind.SESSION, Kind.GAP])
def test_a_condition_does_not_last_into_another_session_or_beyond_a_gap(kind, tmp_path):
    records, event = run(300), Event()
    event.kind, event.tick = Event.schema.constants["CONDITION_BEGAN"], 100
    event.stamp = BEGIN + 100 * MS
    records.append(Record(Kind.EVENT, event.stamp, event.dump()))
    records.append(Record(kind, BEGIN + 150 * MS, b'{"session_id": 8}'))
    records.sort(key=lambda record: record.stamp)
    events = passed(Log.indexed(written(tmp_path, records)))["events"]
    assert not any("until the end of the log" in each["label"] for each in events)


def test_no_answer_in_virtual_time_is_listed_as_slow(tmp_path):
    records = [
        Record(kind, stamp, payload.replace(b'"lockstep": false', b'"lockstep": true'))
        for kind, stamp, payload in run(200)
    ]
    (session,) = [payload for kind, _, payload in records if kind == Kind.SESSION]
    assert json.loads(session)["lockstep"]
    log = Log.indexed(written(tmp_path, records))
    assert passed(log, log.begin)["worst"] == []


def test_a_frame_says_how_long_its_answer_took(source):
    player = source.player()
    for tick, took_us in ((SLOW, 5000.0), (MISSED, None)):
        frame = shown(player, (tick - ACTIVE) * 1e-3)
        assert frame["tick"] == tick
        assert frame["values"].get("answer_us") == took_us


def test_curves_have_the_least_and_the_greatest_of_each_bin(found):
    curves = found["overview"]
    values = np.array(curves["v"])
    assert (values[:, 1] <= values[:, 2]).all()
    assert values[:, 1].min() == pytest.approx(1e-9 * ACTIVE, rel=1e-5)  # however small
    assert values[:, 2].max() == pytest.approx(1e-9 * 3999, rel=1e-5)
    greatest = {key: np.array(rows)[:, 2].max() for key, rows in curves.items()}
    least = np.array(curves["v_rate_predicted"])[:, 1].min()
    assert least == pytest.approx(-2e-9 * 3999, rel=1e-5)
    assert greatest["answer_us"] == pytest.approx(5000.0)
    assert greatest["misses"] == 1  # what was skipped is neither late nor lost
    assert greatest["skipped"] == 3
    assert greatest["active_joints"] == 2
    assert greatest["cycle_us"] == pytest.approx(100.0)
    assert greatest["error"] == pytest.approx(np.sqrt(2e-9 * 3999), rel=1e-5)
    assert greatest["speed_share"] == pytest.approx(100.0 * 3.999 / 5.0, rel=1e-5)


def test_whatever_a_page_plots_has_a_curve(tmp_path):
    path = written(tmp_path, run(200))
    curves = passed(Log.indexed(path), extras=1)["overview"]
    plotted = {key for key, *_ in PLOTS}
    assert plotted - {"effort_share"} == set(curves) - {"extra.0", "effort_share"}
    assert np.array(curves["extra.0"])[:, 1:].tolist() == [[5.0, 5.0]] * len(curves["extra.0"])


def test_what_is_found_later_is_told(source, found):
    (word,) = [word for word in source.events() if word["kind"] == "log"][-1:]
    assert word["log"]["done"]
    assert source.events() == []


def test_a_greeting_is_json(source):
    hello = source.hello()
    assert json.loads(json.dumps(hello, allow_nan=False)) == hello
    assert not hello["live"]
    assert hello["log"]["to_s"] == pytest.approx(3.96)


def test_the_verdict_is_that_of_the_whole_run(source):
    assert source.player().frame()["verdicts"]["deadlines"]["verdict"] == "pass"


def test_a_second_log_is_its_ghost(log, tmp_path):
    other = written(tmp_path, run(1000, phase=500))
    with closing(LogSource([log, other])) as source:
        ghost = shown(source.player(), 0.2)["ghost"]
        poses = posed(ROBOT, motion(200 + ACTIVE + 500))
        assert np.allclose(ghost, poses.poses, atol=1e-6)
        assert source.hello()["second"]


def test_a_second_log_of_another_robot_is_refused(log, tmp_path):
    other, robot = tmp_path / "robot.mcap", describe(5)
    written(other, inputs(robot), robot)
    with pytest.raises(UsageError, match="links"):
        LogSource([log, other])


def test_a_log_that_is_cut_off_is_shown_as_far_as_it_goes(log, tmp_path):
    cut = tmp_path / "robot.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    with closing(LogSource([cut])) as source:
        assert 1000 < shown(source.player(), 1e9)["tick"] < 3999
        assert source.overview.join(60.0)


def test_a_damaged_chunk_is_passed_over(log, tmp_path):
    raw = bytearray(log.read_bytes())
    middle = len(raw) // 2
    raw[middle : middle + 64] = bytes(64)
    damaged = tmp_path / "robot.mcap"
    damaged.write_bytes(raw)
    with closing(LogSource([damaged])) as source:
        player = source.player()
        frames = [shown(player, float(at_s)) for at_s in np.linspace(-0.04, 3.96, 81)]
        assert len({frame and frame["tick"] for frame in frames}) > 20
        assert source.overview.join(60.0)


def test_messages_that_no_service_writes_do_not_end_the_search(tmp_path):
    strange = State.allocate(**{**ROBOT.state_lengths, "dq": 0})
    records = run(1500)
    for place, record in enumerate(records[:900]):
        if record.kind == Kind.STATE:
            records[place] = record._replace(payload=strange.dump())
    log = Log.indexed(written(tmp_path, records))
    assert passed(log, log.begin)["overview"]["speed_share"]


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
    with closing(LogSource([path])) as source:
        assert source.player().frame()["verdicts"]["deadlines"]["verdict"] == "not judged"


def test_an_overview_can_be_ended_early(log):
    overview = Overview(Log.indexed(log), BEGIN)
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
    with closing(LogSource([written(tmp_path, records)])) as source:
        frames = [source.first.frame((tick - ACTIVE) * 1e-3 + 1e-4) for tick in range(99, 103)]
    assert [frame and frame["tick"] for frame in frames] == [99, None, None, 102]


def test_a_file_that_goes_while_it_is_read_ends_nothing(tmp_path):
    """As the oldest of a log that rotates does."""
    path = written(tmp_path, run(1500))
    log = Log.indexed(path)
    path.unlink()
    passed(log, log.begin)
    assert log.state_at(log.end) is None


@pytest.mark.parametrize("asked", [False, True])
def test_of_a_log_that_asks_for_no_answer_it_is_said_where_seconds_begin(asked, tmp_path):
    path = written(tmp_path, run(ACTIVE + asked))
    with closing(LogSource([path])) as source:
        assert source.first.zero == (BEGIN + ACTIVE * MS if asked else source.first.log.begin)
        assert bool(source.hello()["notes"]) == (not asked)


def test_the_pass_waits_while_somebody_looks_for_a_place(log, monkeypatch):
    monkeypatch.setattr("hoap3.tools.view.sources.log_overview.LOOK_S", 3600.0)
    with closing(LogSource([log])) as source:
        assert source.overview.join(60.0)
        indexed, seen = source.first.log, []
        monkeypatch.setattr(indexed, "chunk", lambda chunk, keep: seen.append(chunk) or [])
        monkeypatch.setattr(source, "overview", Overview(indexed, BEGIN))
        source.player().seek(1.0)
        source.overview.start()
        assert not source.overview.join(0.3)
    assert seen == [0]


SECOND = 1_000_000_000
STILL = describe(3)
TICKS = 2500  # of a part, which is longer than what is kept unpacked
PARTS = 8  # of the long log
SHARE = 20  # of what the long log has more, less than one part in so many may be kept


@pytest.fixture(scope="module")
def part() -> list[Record]:
    return ticks(STILL.n, TICKS)


def in_parts(folder: Path, part: list[Record], parts: int) -> Path:
    """A log in which the same happens so many times, one after the other."""
    later = [
        Record(kind, stamp + place * TICKS * SECOND // 1000, payload)
        for place in range(parts)
        for kind, stamp, payload in part
    ]
    path = folder / "robot.mcap"
    write(path, [*inputs(STILL), *later], attachments={"description.json": STILL.to_json()})
    return path


def kept_by(path: Path) -> tuple[int, dict[str, Any]]:
    """Bytes that are held once all was seen and many places were shown, and what a page is told."""
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    source = LogSource([path])
    try:
        assert source.overview.join(300.0)
        player, told = source.player(), source.hello()["log"]
        for at_s in np.random.default_rng(0).uniform(told["from_s"], told["to_s"], 40):
            shown(player, float(at_s))
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before, told
    finally:
        source.close()


@pytest.mark.slow
def test_a_long_log_is_kept_in_no_more_memory_than_a_short_one(part, tmp_path):
    paths = []
    for parts in (1, PARTS):
        folder = tmp_path / str(parts)
        folder.mkdir()
        paths.append(in_parts(folder, part, parts))
    kept_by(paths[0])  # what is loaded once for all
    tracemalloc.start()
    try:
        short, long = (kept_by(path)[0] for path in paths)
    finally:
        tracemalloc.stop()
    more = (PARTS - 1) * sum(len(record.payload) for record in part)
    assert long - short < more / SHARE


@pytest.mark.slow
def test_a_page_is_told_no_more_of_a_long_log_than_fits_on_it(part, tmp_path):
    tracemalloc.start()
    try:
        _, told = kept_by(in_parts(tmp_path, part, PARTS))
    finally:
        tracemalloc.stop()
    assert told["to_s"] - told["from_s"] == pytest.approx(PARTS * TICKS / 1000, rel=1e-2)
    assert len(told["events"]) == log_overview.EVENTS + 1  # the last counts the others
    assert 0 < len(told["worst"]) <= 2 * log_overview.WORST
    assert told["overview"]
    assert all(len(curve) <= log_overview.BINS for curve in told["overview"].values())
