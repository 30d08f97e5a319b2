"""Which CPUs a run takes, on made-up machines."""

from __future__ import annotations

import pytest

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.tools.services import placement

AUTO = RealtimeSettings()


class Claim:
    def __init__(self, cpu: int) -> None:
        self.cpu = cpu


@pytest.fixture
def machine(monkeypatch):
    """Makes a machine up: CPUs that are free, the last first, and the placement that is better."""

    def make(free: list[int], choice: str) -> None:
        left = list(free)

        def claim(count, allowed):
            taken = [cpu for cpu in left if cpu in allowed][:count]
            left[:] = [cpu for cpu in left if cpu not in taken]
            return [Claim(cpu) for cpu in taken]

        monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1, 2, 3})
        monkeypatch.setattr(placement, "claim_cpus", claim)
        monkeypatch.setattr(placement, "chosen", lambda _: choice)

    return make


def places(robot: RealtimeSettings = AUTO, controller: RealtimeSettings = AUTO) -> tuple:
    """CPUs of the robot and of its controller, and those that were claimed."""
    ours, theirs, claims = placement.placed(robot, controller, print)
    return ours.cpu, theirs.cpu, sorted(claim.cpu for claim in claims)


def test_both_sides_take_what_was_better(machine):
    machine([3, 2, 1, 0], "two_cpus")
    assert places() == (2, 3, [2, 3])
    machine([3, 2, 1, 0], "one_cpu")
    assert places() == (3, 3, [3])


def test_what_is_free_must_do(machine):
    machine([1], "two_cpus")
    assert places() == (1, 1, [1])
    machine([], "two_cpus")
    assert places() == ("auto", "auto", [])


def test_a_side_that_names_its_cpu_has_it(machine):
    machine([3, 2], "two_cpus")
    assert places(RealtimeSettings(cpu=0), RealtimeSettings(cpu="none")) == (0, "none", [])
    assert places(RealtimeSettings(cpu=3), AUTO) == (3, 2, [2])
    machine([3, 2], "two_cpus")
    assert places(AUTO, RealtimeSettings(cpu=2)) == (3, 2, [3])
    machine([3, 2], "one_cpu")
    assert places(RealtimeSettings(cpu=1), AUTO) == (1, 1, [])


def test_nothing_is_measured_where_there_is_no_choice(machine, monkeypatch):
    machine([3, 2], "one_cpu")
    monkeypatch.setattr(placement, "chosen", None)  # would raise if it were called
    assert places(RealtimeSettings(cpu=0), RealtimeSettings(cpu=1)) == (0, 1, [])
    assert places(RealtimeSettings(cpu="none"), AUTO) == ("none", 3, [3])


@pytest.mark.parametrize(("choice", "robot", "controller"), [("one_cpu", 3, 3), ("two_cpus", 2, 3)])
def test_services_on_their_own_take_what_was_better(
    monkeypatch, tmp_path, choice, robot, controller
):
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1, 2, 3})
    monkeypatch.setattr(placement, "chosen", lambda _: choice)
    for _ in range(2):  # again after both have ended
        ours, first = placement.settled_alone(AUTO, "robot", print)
        theirs, second = placement.settled_alone(AUTO, "controller", print)
        assert (ours.cpu, theirs.cpu) == (robot, controller)
        first.release()
        second.release()
    named = RealtimeSettings(cpu=1)
    assert placement.settled_alone(named, "robot", print) == (named, None)


@pytest.fixture
def measurements(monkeypatch, tmp_path):
    """A runtime directory of its own, four CPUs, and measurements that are only counted."""
    made: list[dict] = []

    def measure() -> dict:
        found = {"measured": True, "recommended": "two_cpus", "why": "RTT", "two_cpus": {}}
        made.append(found)
        return found

    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1, 2, 3})
    monkeypatch.setattr(placement, "measure_placement", measure)
    return made


def test_it_is_measured_once_per_boot_and_set_of_cpus(measurements, monkeypatch):
    told: list[str] = []
    assert [placement.chosen(told.append) for _ in range(3)] == ["two_cpus"] * 3
    assert len(measurements) == 1
    assert "RTT" in told[-1]
    monkeypatch.setattr(placement, "_boot", lambda: "another")
    placement.chosen(told.append)
    assert len(measurements) == 2
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    placement.chosen(told.append)
    assert len(measurements) == 3
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})
    assert placement.chosen(told.append) == "one_cpu"
    assert len(measurements) == 3


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", "null", '{"boot": 1}', "\0", '{"found": {"recommended": []}}']
)
def test_a_file_that_says_something_else_is_replaced(measurements, tmp_path, content):
    placement.chosen(print)
    (tmp_path / "run" / "placement.json").write_text(content)
    assert placement.chosen(print) == "two_cpus"
    assert len(measurements) == 2


def test_what_could_not_be_measured_is_not_kept(measurements, monkeypatch):
    monkeypatch.setattr(
        placement, "measure_placement", lambda: {"measured": False, "why": "no CPU is free"}
    )
    assert placement.chosen(print) == "one_cpu"
    assert placement._stored() is None
