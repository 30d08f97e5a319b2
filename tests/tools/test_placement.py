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

        def claim(allowed):
            return next((Claim(left.pop(left.index(cpu))) for cpu in left if cpu in allowed), None)

        monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1, 2, 3})
        monkeypatch.setattr(placement, "claim_cpu", claim)
        monkeypatch.setattr(placement, "virtual_machine", lambda: virtual)
        monkeypatch.setattr(placement, "may_keep_awake", lambda: awake)

    return make


def places(robot: RealtimeSettings = AUTO, controller: RealtimeSettings = AUTO) -> tuple:
    """CPUs of the robot and of its controller, and those that were claimed."""
    ours, theirs, claims = placement.placed(robot, controller)
    return ours.cpu, theirs.cpu, sorted(claim.cpu for claim in claims)


@pytest.mark.parametrize(("virtual", "awake"), [(False, False), (False, True), (True, True)])
def test_two_cpus_where_waking_the_other_is_cheap(machine, virtual, awake):
    machine([3, 2, 1, 0], virtual=virtual, awake=awake)
    assert places() == (2, 3, [2, 3])


@pytest.mark.parametrize(
    "asleep",
    [
        RealtimeSettings(),
        RealtimeSettings(keep_awake=False),
        RealtimeSettings(watch_stalls="none"),
        RealtimeSettings(policy="none"),
    ],
)
def test_one_for_both_where_one_may_sleep_on_a_virtual_machine(machine, asleep):
    for sides in ((AUTO, asleep), (asleep, AUTO)):
        machine([3, 2], virtual=True, awake=asleep != AUTO)
        assert places(*sides) == (3, 3, [3])


def test_what_is_free_must_do(machine):
    machine([1], virtual=False, awake=False)
    assert places() == (1, 1, [1])
    machine([], virtual=False, awake=False)
    assert places() == ("auto", "auto", [])


def test_who_names_a_cpu_has_it_and_the_other_takes_another(machine):
    machine([3, 2], virtual=False, awake=False)
    assert places(RealtimeSettings(cpu=0), RealtimeSettings(cpu="none")) == (0, "none", [])
    assert places(RealtimeSettings(cpu=3), AUTO) == (3, 2, [2])
    machine([3, 2], virtual=False, awake=False)
    assert places(AUTO, RealtimeSettings(cpu=2)) == (3, 2, [3])


def test_who_names_a_cpu_shares_it_where_waking_another_is_dear(machine):
    machine([3, 2], virtual=True, awake=False)
    assert places(RealtimeSettings(cpu=1), AUTO) == (1, 1, [])
