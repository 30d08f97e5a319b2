"""Who steers, and what becomes of messages: each that does not count is counted by its reason."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hoap3
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.references.live.live import Live
from hoap3.remote_controller.references.live.live_plan import Bounds
from hoap3.remote_controller.steering import LEASE_S, REFUSALS, Steering
from hoap3.tools.replay import replay_records
from hoap3.tools.simulate import controller_settings

T = 1e-3
LEASE = round(LEASE_S / T)
ME, OTHER = "client-1", "client-2"


def steering() -> Steering:
    """Of one live target that has begun."""
    live = Live("hand", "m", Bounds(0.25, 1.0, 20.0), np.full(3, -1.0), np.full(3, 1.0))
    live.start(np.zeros(3), 0.0)
    return Steering([live], session_id=7, period_s=T)


def message(number: int = 1, epoch: int = 0, points: int = 1, **fields: int) -> Target:
    """A Target to the origin."""
    made = Target(points, 3)
    made.number, made.epoch, made.session_id, made.tick_step = number, epoch, 7, 50
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def test_one_operator_at_a_time_and_the_next_after_it_has_gone_or_given_up():
    it = steering()
    first = it.acquire(ME, 3, 0)
    assert it.acquire(ME, 3, 10)["epoch"] == first["epoch"]
    with pytest.raises(UsageError, match=ME):
        it.acquire(OTHER, 3, 20)
    assert not it.release(OTHER)
    assert it.release(ME)
    second = it.acquire(OTHER, 3, 30)
    assert second["epoch"] > first["epoch"]
    with pytest.raises(UsageError):
        it.acquire(ME, 3, 30 + LEASE)
    assert it.acquire(ME, 3, 31 + LEASE)["epoch"] > second["epoch"]


def test_targets_keep_the_lease_and_silence_ends_it():
    it = steering()
    epoch = it.acquire(ME, 1, 0)["epoch"]
    for number in range(1, 6):
        tick = number * LEASE
        assert it.take(ME, message(number, epoch).dump(), tick, following=True)
    assert not it.take(ME, message(6, epoch).dump(), tick + LEASE + 1, following=True)
    assert it.refused["not_operator"] == 1
    assert it.acquire(OTHER, 1, tick + LEASE + 1)["epoch"] == epoch + 1


def test_epochs_of_two_grants_of_the_robot_are_never_the_same():
    early, late = steering(), steering()
    assert late.acquire(ME, 2, 0)["epoch"] - early.acquire(ME, 1, 0)["epoch"] > 1 << 19


def test_a_controller_without_live_targets_has_nothing_to_steer():
    with pytest.raises(UsageError, match="live"):
        Steering([], 7, T).acquire(ME, 1, 0)


class Fuzz:
    """Sends messages of every kind, wrong in every way, to a robot that moves."""

    def __init__(self, seed: int, most: int) -> None:
        self.rng, self.left = np.random.default_rng(seed), most
        self.grant: dict = {}
        self.number = 0
        self.steering: Steering | None = None

    def __call__(self, loop: ControllerLoop) -> None:
        if not loop.epoch:
            return
        self.steering = loop.steering
        if loop.last_tick % 500 == 0:
            loop.operate("release", ME)
            self.grant, self.number = loop.operate("acquire", ME), 0
        for _ in range(min(self.left, 10) if self.grant else 0):
            self.left -= 1
            loop.steer(*self.one(loop.last_tick))

    def one(self, tick: int) -> tuple[str, bytes]:
        rng, wrong = self.rng, self.rng.choice(["none", *REFUSALS])
        count = int(rng.integers(1, 8))
        self.number += 1
        made = message(
            self.number,
            self.grant["epoch"],
            count,
            session_id=self.grant["session_id"],
            first_tick=max(0, tick + int(rng.integers(-20, 300))),
        )
        place = np.array([0.3, 0.3, 0.4]) + np.cumsum(rng.normal(0, 3e-3, (count, 3)), axis=0)
        made.values[:] = place.ravel()
        if wrong == "other_session":
            made.session_id += 1
        elif wrong == "unknown_target":
            made.target = int(rng.integers(1, 2**32))
        elif wrong == "behind":
            made.number = int(rng.integers(0, self.number))
        elif wrong == "wrong_size":
            made.points = int(rng.integers(0, 2**32))
        elif wrong == "not_finite":
            made.values[rng.integers(made.values.size)] = rng.choice([np.nan, np.inf, -np.inf])
        elif wrong == "late":
            made = message(self.number, made.epoch, 2, session_id=made.session_id, tick_step=1)
        elif wrong == "too_far_ahead":
            made.first_tick = tick + int(rng.integers(11_000, 2**40))
        elif wrong == "out_of_range":
            made.values[0] = rng.choice([-1e3, 1e300])
        elif wrong == "too_fast":
            made = message(
                self.number, made.epoch, 2, session_id=made.session_id, first_tick=tick + 5
            )
            made.values[:] = rng.uniform(-0.9, 0.9, 6)
        payload = made.dump()
        if wrong == "malformed":
            payload = bytes(rng.bytes(int(rng.integers(0, 200))))
        return OTHER if wrong == "not_operator" else ME, payload


def assert_fuzzed(messages: int, each: int) -> None:
    """So many messages: none breaks a limit, every reason is hit so often."""
    target = {"kind": "live", "lower_m": [-1.0] * 3, "upper_m": [1.0] * 3}
    config = controller_settings("steered_ur5").model_copy(deep=True)
    config.parameters["tasks"][0]["parameters"]["target"] = target
    fuzz = Fuzz(0, messages)
    done = hoap3.simulate("ur5", config, messages / 10 * T + 0.1, steer=fuzz)
    assert fuzz.left == 0
    assert fuzz.steering is not None
    refused = fuzz.steering.refused
    assert all(refused[reason] >= each for reason in REFUSALS if reason != "not_following")
    assert fuzz.steering.taken >= each
    robot = hoap3.load_robot("ur5")
    moving = done.states[done.states["mode"] == State.ACTIVE]
    assert (moving["reference"] >= robot.lower).all()
    assert (moving["reference"] <= robot.upper).all()
    speed = moving["reference_rate"]
    assert (np.abs(speed) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max
    assert (np.abs(moving["reference_acceleration"]) <= most * (1 + 1e-9) + 1e-7).all()
    taken = [record for record in done.records if record.kind == Kind.TARGET]
    assert len(taken) == fuzz.steering.taken
    assert replay_records(done.records, config).identical
    told = [json.loads(r.payload) for r in done.records if r.kind == Kind.SUMMARY][-1]["targets"]
    assert told["taken"] == fuzz.steering.taken


def test_messages_of_every_kind_break_no_limit_and_are_counted_by_reason():
    assert_fuzzed(2000, 20)


@pytest.mark.long
def test_ten_thousand_messages_break_no_limit_and_are_counted_by_reason():
    assert_fuzzed(10_000, 100)


def test_without_a_robot_that_follows_nothing_is_taken():
    it = steering()
    epoch = it.acquire(ME, 1, 0)["epoch"]
    assert not it.take(ME, message(1, epoch).dump(), 1, following=False)
    assert it.as_json()["refused"] == {"not_following": 1}


def test_a_stale_target_that_stops_makes_the_robot_stop_safely():
    target = {"kind": "live", "stale_after_s": 0.2, "when_stale": "stop"}
    config = controller_settings("steered_ur5").model_copy(deep=True)
    config.parameters["tasks"][0]["parameters"]["target"] = target

    def steer(loop: ControllerLoop) -> None:
        if loop.last_tick == 100:
            grant = loop.operate("acquire", ME)
            made = message(1, grant["epoch"], session_id=grant["session_id"])
            made.values[:] = 0.3
            loop.steer(ME, made.dump())

    done = hoap3.simulate("ur5", config, 1.0, steer=steer)
    stopping = done.states["tick"][done.states["mode"] == State.STOPPING]
    assert 301 < stopping[0] < 400
    assert replay_records(done.records, config).identical
