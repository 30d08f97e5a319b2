"""Who steers, and what becomes of messages: each that does not count is counted by its reason."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hoap3
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.live.live import Live
from hoap3.remote_controller.references.live.live_plan import Bounds
from hoap3.remote_controller.steering import LEASE_S, REFUSALS, Steering
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.configs import load_controller_config
from hoap3.tools.services.simulate import Simulation

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


def test_an_operator_is_told_which_of_its_messages_came_last():
    it = steering()
    told = it.acquire(ME, 3, 0)
    assert told["newest"] == 0
    sent = message(number=3, epoch=told["epoch"]).dump()
    assert it.take(ME, sent, 10, following=True)
    assert it.acquire(ME, 3, 11)["newest"] == 3
    it.release(ME)
    assert it.acquire(OTHER, 3, 12)["newest"] == 0


def test_an_operator_is_told_limits_and_when_what_it_sent_has_come_to_rest():
    it = steering()
    (target,) = it.acquire(ME, 3, 0)["targets"]
    assert (target["lower"], target["upper"]) == ([-1.0] * 3, [1.0] * 3)
    assert target["at_rest"]
    sent = message(epoch=it.acquire(ME, 3, 0)["epoch"])
    sent.values[:] = 0.2, 0.0, 0.0
    assert it.take(ME, sent.dump(), 10, following=True)
    at_rest = {tick: it.acquire(ME, 3, tick)["targets"][0]["at_rest"] for tick in (11, 700, 2000)}
    assert at_rest == {11: False, 700: False, 2000: True}  # 0.2 m at 0.25 m/s takes 0.8 s or more


def test_messages_that_never_arrived_are_counted_by_the_gaps_between_numbers():
    it = steering()
    epoch = it.acquire(ME, 3, 0)["epoch"]
    for number, following in [(2, False), (3, True), (3, True), (7, True), (6, True)]:
        it.take(ME, message(number, epoch).dump(), 10, following=following)
    it.take(OTHER, message(99, epoch).dump(), 10, following=True)
    counts = it.counts()
    assert counts["lost"] == 1 + 3
    assert counts["refused"] == {"not_following": 1, "behind": 2, "not_operator": 1}
    it.release(ME)
    assert it.acquire(OTHER, 3, 12)["lost"] == 0


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


def test_what_has_another_header_is_malformed_and_keeps_no_lease():
    it = steering()
    epoch = it.acquire(ME, 1, 0)["epoch"]
    good = message(5, epoch).dump()
    bad = b"\x01" + good[1:]
    assert not it.take(OTHER, bad, LEASE, following=False)
    assert not it.take(ME, bad, LEASE, following=True)
    assert it.refused["malformed"] == sum(it.refused.values()) == 2
    assert it.acquire(OTHER, 1, LEASE + 1)["epoch"] == epoch + 1

    again = steering()
    epoch = again.acquire(ME, 1, 0)["epoch"]
    assert not again.take(ME, b"\x01" + message(5, epoch).dump()[1:], 1, following=True)
    assert again.take(ME, message(1, epoch).dump(), 1, following=True)


def test_a_message_of_a_log_that_is_none_is_refused_and_told():
    it = steering()
    assert it.follow(message().dump()[:-1], 0) == "malformed"
    assert not it.take(ME, b"", 0, following=True)
    assert "1 malformed" in str(it)
    assert it.as_json() == {"operator": None, **it.counts()}


def test_epochs_of_two_grants_of_the_robot_are_never_the_same():
    early, late = steering(), steering()
    assert late.acquire(ME, 2, 0)["epoch"] - early.acquire(ME, 1, 0)["epoch"] > 1 << 19


def test_a_controller_without_live_targets_has_nothing_to_steer():
    with pytest.raises(UsageError, match="live"):
        Steering([], 7, T).acquire(ME, 1, 0)


PLACE = {"lower_m": [-1.0] * 3, "upper_m": [1.0] * 3}


def steered_task(kind: str, key: str = "target", /, **parameters: Any) -> dict[str, Any]:
    """An entry of `parameters.tasks`, called as its live target is, which stands under a key."""
    name = str(parameters.pop("name"))
    live = {"kind": "live", "name": name, **parameters.pop("live", {})}
    return {"name": name, "task": kind, "parameters": {**parameters, key: live}}


def law(controller: str, tasks: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """Settings of a controller with these tasks, the first above all."""
    order = {"order": [each["name"] for each in tasks]}
    return {"controller": controller, "parameters": {"tasks": tasks, "priorities": order, **more}}


ARM = law(
    "ghc_velocity",
    [
        steered_task("frame_position", name="hand", frame="tool0", live=PLACE),
        steered_task("frame_pose", name="pose", frame="tool0", live={**PLACE, "within_rad": 1.0}),
        steered_task("frame_orientation", name="turn", frame="wrist_2_link"),
        steered_task("com", name="mass", frame="base", live=PLACE),
        steered_task("posture", name="joints"),
    ],
    bounds={"speed_rad_s": 1.5},
)
PRESS = law(
    "ghc",
    [
        steered_task(
            "wrench",
            "wrench_target",
            name="force",
            frame="ee",
            normal=[0.0, 0.0, 1.0],
            force_n=10.0,
            target={"kind": "point", "position_m": [-0.5, -0.25, 0.49]},
            live={"upper": [20.0]},
        ),
        steered_task("frame_pose", name="elbow", frame="elbow", live=PLACE),
        steered_task("posture", name="joints"),
    ],
)


class Fuzz:
    """Sends messages of every kind, wrong in every way, to all live targets of a robot that moves.

    Args:
        seed, most: of the messages.
        begins: by target, where it is at the begin as its messages count.
    """

    def __init__(self, seed: int, most: int, begins: Mapping[str, np.ndarray]) -> None:
        self.rng, self.left, self.begins = np.random.default_rng(seed), most, begins
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

    def target_for(self, wrong: str) -> tuple[int, dict[str, Any]]:
        """A target that can be wrong so."""
        fit = [
            (place, target)
            for place, target in enumerate(self.grant["targets"])
            if wrong != "not_unit" or "qx" in target["layout"]
            if wrong != "out_of_range" or target["layout"][0] != "qx"
        ]
        return fit[int(self.rng.integers(len(fit)))]

    def points(self, target: dict[str, Any], count: int) -> np.ndarray:
        """Points that follow each other closely, (p, d)."""
        rng, begin, turns = self.rng, self.begins[target["name"]], "qx" in target["layout"]
        plain = begin.size - 4 * turns
        place = begin[:plain] + np.cumsum(rng.normal(0, 3e-3, (count, plain)), axis=0)
        if not turns:
            return place
        away = Rotation.from_rotvec(np.cumsum(rng.normal(0, 3e-3, (count, 3)), axis=0))
        turned = (away * Rotation.from_quat(begin[plain:])).as_quat()
        return np.hstack([place, rng.choice([-1.0, 1.0]) * turned])

    def one(self, tick: int) -> tuple[str, bytes]:
        rng, wrong = self.rng, self.rng.choice(["none", *REFUSALS])
        count = int(rng.integers(1, 8)) if wrong not in {"late", "too_fast"} else 2
        place, target = self.target_for(wrong)
        moves = target["rates"] if rng.random() < 0.3 else 0
        made = Target(count, target["dimension"], rates=moves)
        self.number += 1
        made.number, made.epoch, made.tick_step = self.number, self.grant["epoch"], 50
        made.session_id, made.target = self.grant["session_id"], place
        made.first_tick = max(0, tick + int(rng.integers(-20, 300)))
        made.values[:] = self.points(target, count).ravel()
        made.rates[:] = rng.normal(0.0, 1e-3, made.rates.size)
        if wrong == "other_session":
            made.session_id += 1
        elif wrong == "unknown_target":
            made.target = int(rng.integers(len(self.grant["targets"]), 2**32))
        elif wrong == "behind":
            made.number = int(rng.integers(0, self.number))
        elif wrong == "wrong_size":
            made.points = int(rng.integers(count + 1, 2**32))
        elif wrong == "not_finite":
            made.values[rng.integers(made.values.size)] = rng.choice([np.nan, np.inf, -np.inf])
        elif wrong == "not_unit":
            made.values[:] *= rng.choice([0.0, 0.5, 1.01, -7.0])
        elif wrong == "late":
            made.first_tick, made.tick_step = 0, 1
        elif wrong == "too_far_ahead":
            made.first_tick = tick + int(rng.integers(11_000, 2**40))
        elif wrong == "out_of_range":
            made.values[0] = rng.choice([-1e3, 1e300])
        elif wrong == "too_fast":
            made.first_tick, made.tick_step = tick + 5, 1
        payload = made.dump()
        if wrong == "malformed":
            payload = bytes(rng.bytes(int(rng.integers(0, 200))))
        return OTHER if wrong == "not_operator" else ME, payload


def begins(robot: str, posture: str, frames: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Where the robot is in a posture, by target: its joints, and frames as poses, (7,)."""
    description = hoap3.load_robot(robot)
    kinematics, q = Kinematics(description), np.array(description.postures[posture])
    kinematics.update(q)
    found, place, turn = {"joints": q}, np.zeros(3), np.zeros((3, 3))
    base = kinematics.frame_id(description.base_frame)
    for name, frame in frames.items():
        twist = np.zeros((6, description.n))
        kinematics.frame(kinematics.frame_id(frame), base, place, turn, twist)
        found[name] = np.hstack([place, Rotation.from_matrix(turn).as_quat()])
    return found


def fuzzed(
    robot: str, config: dict[str, Any], start: dict[str, np.ndarray], messages: int, each: int
) -> Simulation:
    """So many messages: each reason is hit so often, and all of it is replayed to the bit."""
    fuzz = Fuzz(0, messages, start)
    done = hoap3.simulate(robot, config, messages / 10 * T + 0.1, steer=fuzz)
    assert fuzz.left == 0
    assert fuzz.steering is not None
    refused = fuzz.steering.refused
    assert all(refused[reason] >= each for reason in REFUSALS if reason != "not_following"), refused
    assert fuzz.steering.taken >= each
    taken = [record for record in done.records if record.kind == Kind.TARGET]
    assert len(taken) == fuzz.steering.taken
    sent = {Target.scalars(record.payload, "target") for record in taken}
    assert len(sent) == len(done.controller.live)
    assert replay_records(done.records, load_controller_config(config)[0]).identical
    told = [json.loads(r.payload) for r in done.records if r.kind == Kind.SUMMARY][-1]["targets"]
    assert told["taken"] == fuzz.steering.taken
    return done


def assert_arm_keeps_limits(messages: int, each: int) -> None:
    """An arm by velocities: positions, speeds and accelerations of its reference."""
    robot = hoap3.load_robot("ur5")
    start = begins("ur5", robot.initial_posture, {"pose": "tool0", "turn": "wrist_2_link"})
    start |= {"hand": start["pose"][:3], "turn": start["turn"][3:], "mass": np.full(3, 0.1)}
    done = fuzzed("ur5", ARM, start, messages, each)
    moving = done.states[done.states["mode"] == State.ACTIVE]
    assert (moving["reference"] >= robot.lower).all()
    assert (moving["reference"] <= robot.upper).all()
    speed = moving["reference_rate"]
    assert (np.abs(speed) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max
    assert (np.abs(moving["reference_acceleration"]) <= most * (1 + 1e-9) + 1e-7).all()


def assert_presses_within_limits(messages: int, each: int) -> None:
    """An arm that presses on a table, by torques: positions, speeds and torques."""
    start = begins("lwr", "bent", {"elbow": "elbow"}) | {"force": np.array([10.0])}
    done = fuzzed("lwr_with_table", PRESS, start, messages, each)
    robot = hoap3.load_robot("lwr")
    moving = done.states[done.states["mode"] == State.ACTIVE]
    assert (moving["q"] >= robot.lower).all()
    assert (moving["q"] <= robot.upper).all()
    assert (np.abs(moving["dq"]) <= robot.velocity).all()
    assert (np.abs(done.setpoints["values"]) <= robot.effort * (1 + 1e-9)).all()


def test_messages_of_every_kind_break_no_limit_and_are_counted_by_reason():
    assert_arm_keeps_limits(2000, 20)


@pytest.mark.long
def test_ten_thousand_messages_break_no_limit_and_are_counted_by_reason():
    assert_arm_keeps_limits(10_000, 100)


@pytest.mark.slow
def test_ten_thousand_messages_for_force_and_pose_break_no_limit_either():
    assert_presses_within_limits(10_000, 100)


def test_without_a_robot_that_follows_nothing_is_taken():
    it = steering()
    epoch = it.acquire(ME, 1, 0)["epoch"]
    assert not it.take(ME, message(1, epoch).dump(), 1, following=False)
    assert it.as_json()["refused"] == {"not_following": 1}


def test_a_stale_target_that_stops_makes_the_robot_stop_safely():
    target = {"kind": "live", "stale_after_s": 0.2, "when_stale": "stop"}
    config = load_controller_config("steered_ur5")[0].model_copy(deep=True)
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


@pytest.mark.parametrize("kind", ["frame_position", "frame_pose", "com"])
def test_a_range_that_holds_nothing_is_refused_before_anybody_steers(kind):
    swapped = {"lower_m": [-1.0, -1.0, 0.8], "upper_m": [1.0, 1.0, 0.2]}
    task = steered_task(kind, name="hand", frame="tool0" if kind != "com" else "base", live=swapped)
    with pytest.raises(ConfigError, match=r"upper_m\[2\]"):
        hoap3.simulate("ur5", law("ghc_velocity", [task]), duration=0.01)
