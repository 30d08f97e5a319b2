"""One CPU or two: the arithmetic without a network, and once with real processes."""

from __future__ import annotations

import os
import subprocess
import tempfile
from contextlib import contextmanager
from itertools import pairwise

import pytest
from doctor_machine import ADVICE, OK, PROBLEM
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.tools.bench.doctor.doctor import placement_finding
from hoap3.tools.services.placement import Order, exchange, measure_placement, recommend


class FakePeer:
    """Answers at the next drain, with the stamp of an arrival some time after the question."""

    def __init__(self, clock: VirtualClock, durations: list[int], lost: frozenset[int]) -> None:
        self.clock, self.durations, self.lost = clock, durations, lost
        self.asked: list[int] = []
        self.due: list[tuple[int, bytes]] = []

    def publish(self, state: bytes) -> None:
        count = len(self.asked)
        self.asked.append(self.clock.now())
        if count not in self.lost:
            duration = self.durations[count % len(self.durations)]
            self.due.append((self.clock.now() + duration, state))

    def drain(self) -> list[tuple[int, bytes]]:
        arrived = [item for item in self.due if item[0] <= self.clock.now()]
        self.due = [item for item in self.due if item[0] > self.clock.now()]
        return arrived


def exchanged(one, two, ticks=50, lost=frozenset()):
    clock = VirtualClock(start=12_345)
    peers = {"one_cpu": FakePeer(clock, one, lost), "two_cpus": FakePeer(clock, two, frozenset())}
    return exchange(peers, clock, ticks, 1_000_000, 300), peers


@given(
    one=st.lists(st.integers(1_000, 1_900_000), min_size=1, max_size=60),
    two=st.lists(st.integers(1_000, 900_000), min_size=1, max_size=60),
)
def test_round_trips_are_counted_where_they_belong(one, two):
    found, _ = exchanged(one, two)
    for name, script in {"one_cpu": one, "two_cpus": two}.items():
        asked = [script[at % len(script)] for at in range(80)]
        counted = [asked[at] for at in range(20, 80) if at % 20][:50]
        figures = found["rtt_us"][name]
        assert figures["n"] == 50
        assert figures["min"] == min(counted) / 1e3
        assert figures["max"] == max(counted) / 1e3
        assert found["lost"][name] == 0
    assert found["wakeup_us"]["max"] == 0.0
    assert found["skipped"] == 0


def test_placements_take_turns_at_each_period():
    _, peers = exchanged([10_000], [10_000], ticks=38)
    stamps = sorted(stamp for peer in peers.values() for stamp in peer.asked)
    assert {after - before for before, after in pairwise(stamps)} == {10**6}
    first, second = (peer.asked for peer in peers.values())
    assert len(first) == len(second) == 60
    assert first[19] < second[0] < second[19] < first[20]


def test_answers_that_never_come_are_counted():
    found, _ = exchanged([10_000], [10_000], ticks=57, lost=frozenset({25, 30}))
    assert found["lost"] == {"one_cpu": 2, "two_cpus": 0}
    assert found["rtt_us"]["one_cpu"]["n"] == 55


def test_a_last_answer_that_is_late_is_no_lost_one():
    found, _ = exchanged([10_000], [10_000] * 59 + [300_000_000], ticks=38)
    assert found["lost"] == {"one_cpu": 0, "two_cpus": 0}
    assert found["rtt_us"]["two_cpus"]["max"] == 300e3


def figures(one: float, two: float | None = None, tails=(3.0, 3.0)) -> dict[str, dict[str, float]]:
    rtt = {"one_cpu": {"p50": one, "p99": tails[0] * one}}
    return rtt if two is None else {**rtt, "two_cpus": {"p50": two, "p99": tails[1] * two}}


@pytest.mark.parametrize(
    ("one", "two", "tails", "choice", "cpus"),
    [
        (15.0, 81.0, (3.0, 3.0), "one_cpu", (3, 3)),
        (81.0, 15.0, (3.0, 3.0), "two_cpus", (2, 3)),
        (100.0, 130.0, (3.0, 2.0), "two_cpus", (2, 3)),  # p99 comes first
        (100.0, 130.0, (3.0, 2.2), "one_cpu", (3, 3)),  # of near p99, p50
        (130.0, 100.0, (2.2, 3.0), "two_cpus", (2, 3)),
    ],
)
def test_the_better_placement_by_p99_then_p50_is_chosen(one, two, tails, choice, cpus):
    said = recommend(figures(one, two, tails), (3, 2))
    assert said["recommended"] == choice
    assert said["realtime_cpu"] == {"emulator": cpus[0], "controller": cpus[1]}


@pytest.fixture(autouse=True)
def awake(monkeypatch):
    """CPUs that are kept awake, by word only."""
    awake: list[int] = []

    @contextmanager
    def monitor(cpus, keep_awake):
        assert keep_awake
        awake.extend(cpus)
        yield
        awake.clear()

    monkeypatch.setattr("hoap3.tools.services.placement.StallMonitor", monitor)
    return awake


def test_cpus_are_kept_awake_as_in_a_run(awake):
    seen = []

    def run(_: Order) -> dict:
        seen.extend(awake)
        return {"rtt_us": figures(15.0, 20.0), "lost": {"one_cpu": 0, "two_cpus": 0}}

    free = [7, 4]
    measure_placement(run, claim=lambda _: [Claim(cpu, []) for cpu in free])
    assert seen == [7, 4]
    assert awake == []


class Claim:
    """A CPU that is ours until released."""

    held: list[int]

    def __init__(self, cpu: int, held: list[int]) -> None:
        self.cpu, self.held = cpu, held
        held.append(cpu)

    def release(self) -> None:
        self.held.remove(self.cpu)


def measured(free: list[int], rtt=None, **options: object) -> tuple[dict, list[Order], list[int]]:
    """Outcome of a measurement by a runner that only writes down its order."""
    orders, held, left = [], [], list(free)

    def run(order: Order) -> dict:
        orders.append(order)
        assert held == free[:2]
        rest = {"wakeup_us": {}, "skipped": 0, "rights": "scheduling policy: SCHED_FIFO 80"}
        lost = dict.fromkeys(order.echoes, 0)
        return {"rtt_us": rtt or figures(15.0, 80.0), "lost": lost, **rest}

    def claim(count: int) -> list[Claim]:
        return [Claim(cpu, held) for cpu in left[:count]]

    return measure_placement(run, claim=claim, **options), orders, held


def test_both_placements_are_measured_on_claimed_cpus_that_are_given_back():
    outcome, orders, held = measured([7, 4, 2], ticks=30, policy="none")
    assert orders == [Order(7, {"one_cpu": 7, "two_cpus": 4}, 30, policy="none")]
    assert outcome["one_cpu"] == {"cpus": [7], "rtt_us": {"p50": 15.0, "p99": 45.0}, "lost": 0}
    assert outcome["two_cpus"] == {"cpus": [4, 7], "rtt_us": {"p50": 80.0, "p99": 240.0}, "lost": 0}
    assert outcome["recommended"] == "one_cpu"
    assert held == []


def test_with_one_free_cpu_only_one_placement_is_measured():
    outcome, orders, _ = measured([7], figures(15.0))
    assert orders[0].echoes == {"one_cpu": 7}
    assert "two_cpus" not in outcome
    assert outcome["recommended"] == "one_cpu"


@pytest.mark.parametrize("lost", [{"one_cpu": 9, "two_cpus": 0}, {"one_cpu": 0, "two_cpus": 800}])
def test_a_placement_that_loses_answers_is_not_chosen(lost):
    rtt = figures(15.0, 80.0)
    if lost["two_cpus"]:
        rtt["two_cpus"] = {"n": 0}

    def run(_: Order) -> dict:
        return {"rtt_us": rtt, "lost": lost, "wakeup_us": {}, "skipped": 0, "rights": ""}

    outcome = measure_placement(run, claim=lambda _: [Claim(3, []), Claim(2, [])])
    assert not outcome["measured"]
    assert outcome["why"]


def test_a_running_robot_is_not_disturbed():
    outcome, orders, _ = measured([])
    assert not outcome["measured"]
    assert orders == []
    assert placement_finding(outcome).level == ADVICE


@pytest.mark.parametrize(
    "error", [OSError("no sockets"), ValueError("died"), subprocess.TimeoutExpired("x", 1)]
)
def test_processes_that_fail_are_reported_and_cpus_given_back(error):
    held = []

    def run(_: Order) -> dict:
        raise error

    outcome = measure_placement(run, claim=lambda _: [Claim(1, held)])
    assert not outcome["measured"]
    assert str(error) in outcome["why"]
    assert held == []


@pytest.mark.parametrize(
    ("one", "two", "level", "remedy"),
    [
        (15.0, 81.0, OK, ""),
        (400.0, 600.0, ADVICE, "priority"),
        (501.0, 600.0, PROBLEM, ""),
    ],
)
def test_a_placement_is_judged(one, two, level, remedy):
    outcome, _, _ = measured([3, 2], figures(one, two))
    finding = placement_finding(outcome)
    assert finding.level == level
    assert remedy in finding.remedy
    for part in (f"{one:.0f} / {3 * one:.0f} us", "SCHED_FIFO 80"):
        assert part in finding.found


@pytest.fixture
def locks(monkeypatch):
    """Claims of CPUs lie in a folder of their own, so that other runs do not matter."""
    with tempfile.TemporaryDirectory(prefix="hoap3-locks-") as folder:
        monkeypatch.setenv("HOAP3_RUNTIME_DIR", folder)
        yield


@pytest.mark.slow
def test_processes_really_exchange_messages(locks, monkeypatch):
    share = "hoap3.tools.services.placement.LOST"
    monkeypatch.setattr(share, 0.9)  # a busy machine loses some
    before = os.sched_getaffinity(0), os.sched_getscheduler(0)
    outcome = measure_placement(ticks=200, policy="none")
    assert outcome["measured"], outcome
    assert "ordinary" in outcome["rights"]
    for name in {"one_cpu", "two_cpus"} & outcome.keys():
        rtt = outcome[name]["rtt_us"]
        assert rtt["n"] + outcome[name]["lost"] == 200
        assert 0 < rtt["min"] <= rtt["p50"] <= rtt["p99"] <= rtt["max"]
    assert outcome["one_cpu"]["cpus"] == [max(before[0])]
    assert (os.sched_getaffinity(0), os.sched_getscheduler(0)) == before


def test_a_cpu_that_cannot_be_had_is_told():
    held = []
    outcome = measure_placement(
        claim=lambda _: [Claim(4000, held), Claim(4001, held)], ticks=20, policy="none"
    )
    assert not outcome["measured"]
    assert outcome["why"]
