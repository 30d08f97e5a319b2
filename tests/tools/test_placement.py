"""Which CPUs a run takes, on made-up machines."""

from __future__ import annotations

import pytest

from protocol.settings import RealtimeSettings
from tools import placement

AUTO = RealtimeSettings()


class Claim:
    def __init__(self, cpu: int) -> None:
        self.cpu = cpu


@pytest.fixture
def machine(monkeypatch):
    """Makes a machine up: CPUs that are free, the last first; its kind; whether it can be awake."""

    def make(free: list[int], *, virtual: bool, awake: bool) -> None:
        left = list(free)
        monkeypatch.setattr(placement, "claim_cpu", lambda: Claim(left.pop(0)) if left else None)
        monkeypatch.setattr(placement, "virtual_machine", lambda: virtual)
        monkeypatch.setattr(placement, "may_keep_awake", lambda: awake)

    return make


def claimed(robot: RealtimeSettings = AUTO, controller: RealtimeSettings = AUTO) -> list[int]:
    return [claim.cpu for claim in placement.claim_cpus(robot, controller)]


@pytest.mark.parametrize(
    ("virtual", "awake", "expected"),
    [(False, False, [2, 3]), (False, True, [2, 3]), (True, True, [2, 3]), (True, False, [3])],
)
def test_two_cpus_where_waking_the_other_is_cheap(machine, virtual, awake, expected):
    machine([3, 2, 1, 0], virtual=virtual, awake=awake)
    assert claimed() == expected


@pytest.mark.parametrize(
    "asleep",
    [
        RealtimeSettings(keep_awake=False),
        RealtimeSettings(watch_stalls="none"),
        RealtimeSettings(policy="none"),
    ],
)
def test_both_sides_must_stay_awake(machine, asleep):
    for sides in ((AUTO, asleep), (asleep, AUTO)):
        machine([3, 2], virtual=True, awake=True)
        assert claimed(*sides) == [3]


def test_what_is_free_must_do(machine):
    machine([1], virtual=False, awake=False)
    assert claimed() == [1]
    machine([], virtual=False, awake=False)
    assert claimed() == []


def test_who_says_where_claims_nothing(machine):
    machine([3, 2], virtual=False, awake=False)
    assert claimed(RealtimeSettings(cpu=0), RealtimeSettings(cpu="none")) == []
    assert claimed(RealtimeSettings(cpu=0), AUTO) == [2, 3]
