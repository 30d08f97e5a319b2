"""One CPU or two: the arithmetic without sockets, and once with them."""

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

from protocol.clock import VirtualClock
from tools.doctor import judge_placement
from tools.doctor_placement import Order, measure_placement, recommend, time_exchanges


@given(
    one=st.lists(st.integers(1_000, 900_000), min_size=1, max_size=60),
    two=st.lists(st.integers(1_000, 900_000), min_size=1, max_size=60),
)
def test_round_trips_are_counted_where_they_belong(one, two):
    clock = VirtualClock(start=12_345)
    taken: dict[str, list[int]] = {"one_cpu": [], "two_cpus": []}
    script = {"one_cpu": one, "two_cpus": two}

    def peer(name: str):
        def exchange() -> None:
            duration = script[name][len(taken[name]) % len(script[name])]
            taken[name].append(duration)
            clock.advance(duration)

        return exchange

    timing = time_exchanges({name: peer(name) for name in script}, clock, 50, 1_000_000)
    for name, durations in taken.items():
        counted = durations[20:70]  # the first turn warms up, the last is cut off
        figures = timing.summary()["rtt_us"][name]
        assert figures["n"] == 50
        assert figures["min"] == min(counted) / 1e3
        assert figures["max"] == max(counted) / 1e3
    assert timing.summary()["wakeup_us"]["max"] == 0.0
    assert timing.skipped == 0


def test_placements_take_turns():
    clock, order = VirtualClock(), []
    peers = {name: lambda name=name: order.append((name, clock.now())) for name in ("a", "b")}
    time_exchanges(peers, clock, 40, 1_000_000)
    assert [name for name, _ in order] == (["a"] * 20 + ["b"] * 20) * 3
    stamps = [stamp for _, stamp in order]
    assert {after - before for before, after in pairwise(stamps)} == {10**6}


def test_an_exchange_that_takes_long_skips_ticks_and_keeps_the_phase():
    clock, begun = VirtualClock(), []

    def exchange() -> None:
        begun.append(clock.now())
        clock.advance(3_500_000 if len(begun) == 25 else 10_000)

    timing = time_exchanges({"one_cpu": exchange}, clock, 20, 1_000_000)
    assert timing.rtt["one_cpu"].summary()["max"] == 3500.0
    assert timing.skipped == 2
    assert begun[25] - begun[24] == 3_500_000  # late in its tick, but not a burst
    assert begun[26] - begun[24] == 4_000_000


def figures(one: float, two: float | None = None) -> dict[str, dict[str, float]]:
    rtt = {"one_cpu": {"p50": one, "p99": 3 * one}}
    return rtt if two is None else {**rtt, "two_cpus": {"p50": two, "p99": 3 * two}}


@pytest.mark.parametrize(
    ("one", "two", "dear", "choice", "cpus", "run_does_it"),
    [
        (15.0, 81.0, True, "one_cpu", (3, 3), True),
        (15.0, 81.0, False, "one_cpu", (3, 3), False),
        (15.0, 35.0, False, "two_cpus", (2, 3), True),
        (15.0, 35.0, True, "two_cpus", (2, 3), False),
        (15.0, 35.1, False, "one_cpu", (3, 3), False),
        (40.0, 15.0, False, "two_cpus", (2, 3), True),
    ],
)
def test_a_second_cpu_is_taken_where_it_costs_little(one, two, dear, choice, cpus, run_does_it):
    said = recommend(figures(one, two), (3, 2), dear)
    assert said["recommended"] == choice
    assert said["realtime_cpu"] == {"emulator": cpus[0], "controller": cpus[1]}
    assert said["run_does_it"] == run_does_it


@pytest.fixture(autouse=True)
def awake(monkeypatch):
    """CPUs that are kept awake, by word only."""
    cpus: list[int] = []

    @contextmanager
    def kept_awake(cpu):
        cpus.append(cpu)
        yield ""
        cpus.remove(cpu)

    monkeypatch.setattr("tools.doctor_placement.kept_awake", kept_awake)
    return cpus


@pytest.mark.parametrize(("dear", "expected"), [(True, []), (False, [7, 4])])
def test_cpus_are_kept_awake_where_a_run_would_do_so(awake, dear, expected):
    seen = []

    def run(_: Order) -> dict:
        seen.extend(awake)
        return {"rtt_us": figures(15.0, 20.0)}

    free = [7, 4]
    measure_placement(run, claim=lambda: Claim(free.pop(0), []), dear=dear)
    assert seen == expected
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
        return {"rtt_us": rtt or figures(15.0, 80.0), **rest}

    def claim() -> Claim | None:
        return Claim(left.pop(0), held) if left else None

    return measure_placement(run, claim=claim, **options), orders, held


def test_both_placements_are_measured_on_claimed_cpus_that_are_given_back():
    outcome, orders, held = measured([7, 4, 2], dear=True, exchanges=30, policy="none")
    assert orders == [Order(7, {"one_cpu": 7, "two_cpus": 4}, 30, policy="none")]
    assert outcome["one_cpu"] == {"cpus": [7], "rtt_us": {"p50": 15.0, "p99": 45.0}}
    assert outcome["two_cpus"] == {"cpus": [4, 7], "rtt_us": {"p50": 80.0, "p99": 240.0}}
    assert outcome["recommended"] == "one_cpu"
    assert held == []


def test_with_one_free_cpu_only_one_placement_is_measured():
    outcome, orders, _ = measured([7], figures(15.0), dear=False)
    assert orders[0].echoes == {"one_cpu": 7}
    assert "two_cpus" not in outcome
    assert outcome["recommended"] == "one_cpu"
    assert outcome["run_does_it"]


def test_a_running_robot_is_not_disturbed():
    outcome, orders, _ = measured([], dear=True)
    assert not outcome["measured"]
    assert "claimed" in outcome["why"]
    assert orders == []
    assert judge_placement(outcome).level == ADVICE


@pytest.mark.parametrize(
    "error", [OSError("no sockets"), ValueError("died"), subprocess.TimeoutExpired("x", 1)]
)
def test_processes_that_fail_are_reported_and_cpus_given_back(error):
    held = []

    def run(_: Order) -> dict:
        raise error

    outcome = measure_placement(run, claim=lambda: Claim(1, held), dear=True)
    assert not outcome["measured"]
    assert str(error) in outcome["why"]
    assert held == []


@pytest.mark.parametrize(
    ("one", "two", "dear", "level", "remedy"),
    [
        (15.0, 81.0, True, OK, "services on their own: realtime.cpu=3"),
        (15.0, 20.0, False, OK, ""),
        (15.0, 81.0, False, ADVICE, "emulator.realtime.cpu=3 controller.realtime.cpu=3"),
        (15.0, 20.0, True, ADVICE, "emulator.realtime.cpu=2 controller.realtime.cpu=3"),
        (400.0, 600.0, True, ADVICE, "priority"),
        (501.0, 600.0, True, PROBLEM, "findings above"),
    ],
)
def test_a_placement_is_judged(one, two, dear, level, remedy):
    outcome, _, _ = measured([3, 2], figures(one, two), dear=dear)
    finding = judge_placement(outcome)
    assert finding.level == level
    assert remedy in finding.remedy
    assert f"one cpu {one:.0f} / {3 * one:.0f} us" in finding.found
    assert "SCHED_FIFO 80" in finding.found


@pytest.fixture
def locks(monkeypatch):
    """Claims of CPUs lie in a folder of their own, so that other runs do not matter."""
    with tempfile.TemporaryDirectory(prefix="hoap3-locks-") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        yield


def test_two_processes_really_exchange_bytes(locks):
    before = os.sched_getaffinity(0), os.sched_getscheduler(0)
    outcome = measure_placement(exchanges=25, policy="none")
    assert outcome["measured"], outcome
    assert "ordinary" in outcome["rights"]
    for name in {"one_cpu", "two_cpus"} & outcome.keys():
        rtt = outcome[name]["rtt_us"]
        assert rtt["n"] == 25
        assert 0 < rtt["min"] <= rtt["p50"] <= rtt["p99"] <= rtt["max"]
    assert outcome["one_cpu"]["cpus"] == [max(before[0])]
    assert (os.sched_getaffinity(0), os.sched_getscheduler(0)) == before


def test_a_cpu_that_cannot_be_had_is_told():
    held = []
    outcome = measure_placement(
        claim=lambda: Claim(4000 + len(held), held), exchanges=20, policy="none"
    )
    assert not outcome["measured"]
    assert "CPU: refused, pinning to" in outcome["why"]
