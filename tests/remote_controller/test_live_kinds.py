"""Every kind of live target in every family of controllers: replayed to the bit, and verified."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.checked_answers import check_answers

import hoap3
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.config import build
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.service import describe
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Simulation

T = 1e-3
EVERY, STEP = 80, 30  # ticks: chunks are met before their end
SIZES = {"x": 0.005, "q": 0.01, "j": 0.01, "N": 3.0}
"""How far targets lie from the begin: places [m], rotation vectors [rad], joints, forces [N]."""


def posed(robot: str, q: Sequence[float], frame: str) -> np.ndarray:
    """Where a frame is, in the base frame, (7,): position and quaternion."""
    description = hoap3.load_robot(robot)
    kinematics = Kinematics(description)
    kinematics.update(np.array(q))
    frames = kinematics.frame_id(frame), kinematics.frame_id(description.base_frame)
    place, turn = np.zeros(3), np.zeros((3, 3))
    kinematics.frame(*frames, place, turn, np.zeros((6, description.n)))
    return np.hstack([place, Rotation.from_matrix(turn).as_quat()])


class Sender:
    """Steers all live targets of a controller in turn, by targets and chunks, with rates or not."""

    def __init__(self, begins: Mapping[str, np.ndarray], seed: int = 0) -> None:
        self.rng, self.begins = np.random.default_rng(seed), begins
        self.number = 0
        self.loop: ControllerLoop | None = None

    def __call__(self, loop: ControllerLoop) -> None:
        self.loop, tick = loop, loop.last_tick
        if not loop.epoch or tick % EVERY:
            return
        grant = loop.operate("acquire", "me")
        self.number += 1
        place = self.number % len(grant["targets"])
        target = grant["targets"][place]
        count = int(self.rng.choice([1, 20], p=[0.3, 0.7]))
        values, rates = self.points(target, count)
        moves = target["rates"] if self.number % 3 == 0 and count > 1 else 0
        made = Target(count, target["dimension"], rates=moves)
        made.values[:] = values.ravel()
        if moves:
            made.rates[:] = rates.ravel()
        made.number, made.target, made.tick_step = self.number, place, STEP
        made.first_tick = max(0, tick - 60)
        made.session_id, made.epoch = grant["session_id"], grant["epoch"]
        loop.steer("me", made.dump())

    def points(self, target: Mapping[str, Any], count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points near the begin that go on evenly, (p, d), and their rates."""
        begin, layout = self.begins[target["name"]], target["layout"]
        plain = sum(name not in {"qx", "qy", "qz", "qw"} for name in layout)
        kind = {"m": "x", "N": "N"}.get(target["unit"].split()[0].rstrip(","), "j")
        times = STEP * T * np.arange(count)[:, None]
        spread = SIZES[kind] * self.rng.normal(size=plain)
        speed = SIZES[kind] * self.rng.normal(size=plain)
        values, rates = begin[:plain] + spread + times * speed, np.tile(speed, (count, 1))
        if len(layout) > plain:
            omega = 0.1 * self.rng.normal(size=3)
            away = Rotation.from_rotvec(SIZES["q"] * self.rng.normal(size=3))
            turns = Rotation.from_rotvec(times * omega) * away * Rotation.from_quat(begin[plain:])
            values = np.hstack([values, turns.as_quat()])
            rates = np.hstack([rates, np.tile(omega, (count, 1))])
        return values, rates


def task(kind: str, name: str = "", gains: Any = None, **parameters: Any) -> dict[str, Any]:
    """An entry of `parameters.tasks`, or `parameters.task`."""
    named = {"name": name} if name else {}
    return {**named, "task": kind, **(gains or {}), "parameters": parameters}


TOOL = {"frame": "tool0"}
POSE = {"kind": "live", "name": "pose", "stale_after_s": 0.3, "when_stale": "return"}
UR5 = hoap3.load_robot("ur5")
START = np.array(UR5.initial_position)
AT = posed("ur5", START, "tool0")
BEGINS = {"pose": AT, "turn": AT[3:], "place": AT[:3], "joints": START}
ACCELERATED = {"robot": "ur5", "command": "acceleration"}
PRESSES = {"force": np.array([10.0]), "place": np.array([-0.5, -0.25, 0.48])}  # below the table
CASES: dict[str, tuple[Any, str, dict[str, Any], Mapping[str, np.ndarray]]] = {
    "ghc_velocity": (
        "ur5",
        "ghc_velocity",
        {
            "tasks": [task("frame_pose", "hand", **TOOL, target=POSE), task("posture", "rest")],
            "priorities": {"order": ["hand", "rest"]},
            "bounds": {"speed_rad_s": 1.5},
        },
        BEGINS,
    ),
    "clik": (
        "ur5",
        "clik",
        {
            "tasks": [
                task("frame_orientation", "axes", **TOOL, target={"kind": "live", "name": "turn"}),
                task("frame_position", "tip", **TOOL, target={"kind": "live", "name": "place"}),
            ],
            "bounds": {"acceleration_rad_s2": 200.0},
        },
        BEGINS,
    ),
    "stable_qp": ("ur5", "stable_qp", {"task": task("frame_pose", **TOOL, target=POSE)}, BEGINS),
    "stable_qp of a sum": (
        "ur5",
        "stable_qp",
        {
            "task": task(
                "weighted_sum",
                terms=[
                    task("frame_orientation", **TOOL, target={"kind": "live", "name": "turn"}),
                    task("posture", target={"kind": "live", "name": "joints"}),
                ],
            )
        },
        BEGINS,
    ),
    "ghc": (
        ACCELERATED,
        "ghc",
        {
            "tasks": [
                task("frame_position", "tip", **TOOL, target={"kind": "live", "name": "place"}),
                task("posture", "rest", target={"kind": "live", "name": "joints"}),
            ],
            "priorities": {"order": ["tip", "rest"]},
        },
        BEGINS,
    ),
    "hqp": (
        ACCELERATED,
        "hqp",
        {
            "tasks": [task("frame_pose", "hand", **TOOL, target=POSE), task("posture", "rest")],
            "priorities": {"order": ["hand", "rest"]},
        },
        BEGINS,
    ),
    "weighted": (
        ACCELERATED,
        "weighted",
        {
            "tasks": [
                task("frame_orientation", "axes", **TOOL, target={"kind": "live", "name": "turn"}),
                task("frame_position", "tip", **TOOL, target={"kind": "live", "name": "place"}),
            ],
            "priorities": {"weights": {"axes": 1.0, "tip": 1.0}},
        },
        BEGINS,
    ),
    "tsid": (ACCELERATED, "tsid", {"tasks": [task("frame_pose", **TOOL, target=POSE)]}, BEGINS),
    "force": (
        "lwr_with_table",
        "ghc",
        {
            "tasks": [
                task(
                    "wrench",
                    "hand",
                    {"kp": 30.0, "kd": 20.0},
                    frame="ee",
                    target={"kind": "live", "name": "place"},
                    normal=[0.0, 0.0, 1.0],
                    force_n=10.0,
                    wrench_target={"kind": "live", "name": "force", "rate_n_s": 50.0},
                ),
                task("posture", "rest", {"kp": 30.0, "kd": 20.0}, posture="bent"),
            ],
            "priorities": {"order": ["hand", "rest"]},
        },
        PRESSES,
    ),
}
QUICK = {"stable_qp"}


def marked() -> list[Any]:
    """All cases; those that are not quick are slow."""
    slow = pytest.mark.slow
    return [pytest.param(each, marks=() if each in QUICK else slow) for each in CASES]


def steered(case: str, seconds: float) -> tuple[Simulation, dict[str, Any], ControllerLoop]:
    """A run, its controller's settings, and its loop."""
    robot, controller, parameters, begins = CASES[case]
    sender = Sender(begins)
    law = {"controller": controller, "parameters": parameters}
    done = hoap3.simulate(robot, law, seconds, steer=sender)
    assert sender.loop is not None
    return done, law, sender.loop


def verified(records: list[Record], law: Mapping[str, Any]) -> dict[str, Any]:
    """What is recomputed of the answers."""
    return check_answers(records, law["controller"], law["parameters"]).as_json()


def changed(records: list[Record], which: int, size: float) -> list[Record]:
    """The same with the first number of each point for a target a little greater."""
    found = list(records)
    for at, record in enumerate(records):
        if record.kind == Kind.TARGET and Target.scalars(record.payload, "target") == (which,):
            target = Target.like(record.payload)
            target.load(record.payload)
            target.values[:: target.dimension] += size
            found[at] = record._replace(payload=target.dump())
    return found


@pytest.mark.slow
@pytest.mark.parametrize("case", marked())
def test_targets_are_taken_replayed_to_the_bit_and_verified(case):
    seconds = 1.5 if case == "force" else 0.8  # until it touches
    done, law, loop = steered(case, seconds)
    assert loop.steering.taken >= 7, loop.steering.refused
    assert (done.states["mode"][: round(seconds / T)] != State.STOPPED).all()
    assert replay_records(done.records, load_controller_config(law)[0]).identical
    found = verified(done.records, law)
    assert (found["false"], found["unverified"]) == (0, 0), found
    for which in range(len(done.controller.live)):
        assert verified(changed(done.records, which, 1e-4), law)["false"] > 0


def built(kind: str, level: str, **parameters: Any) -> Any:
    """The live targets of a controller with one such task."""
    law: dict[str, Any] = {"controller": "stable_qp", "parameters": {}}
    if level == "velocity":
        law["parameters"]["task"] = task(kind, **parameters)
    else:
        law["controller"] = "ghc"
        law["parameters"]["tasks"] = [task(kind, "one", **parameters)]
        law["parameters"]["priorities"] = {"order": ["one"]}
    arm = ACCELERATED if level == "acceleration" else "ur5"
    robot = load_emulator_config("lwr_with_table" if kind == "wrench" else arm, seed=0)[0]
    return build(load_controller_config(law)[0], describe(robot)).live


LIVE = {"kind": "live"}
STANDING = "hoap3_standing_torque"
XYZ, TURN = ["x", "y", "z"], ["qx", "qy", "qz", "qw"]


@pytest.mark.parametrize("level", ["velocity", "acceleration"])
@pytest.mark.parametrize(
    ("kind", "parameters", "layout", "rates"),
    [
        ("frame_position", {**TOOL, "target": LIVE}, XYZ, 3),
        ("frame_orientation", {**TOOL, "target": LIVE}, TURN, 3),
        ("frame_pose", {**TOOL, "target": LIVE}, XYZ + TURN, 6),
        ("frame_pose", {**TOOL, "target": LIVE, "rotation_rad": [0.0, 0.0, 0.0]}, XYZ, 3),
        ("posture", {"target": LIVE}, [*UR5.joint_names], 6),
        ("posture", {"target": LIVE, "joints": [UR5.joint_names[2]]}, [UR5.joint_names[2]], 1),
    ],
)
def test_each_task_says_what_its_messages_hold(level, kind, parameters, layout, rates):
    (live,) = built(kind, level, **parameters)
    told = live.as_json()
    assert (told["layout"], told["dimension"], told["rates"]) == (layout, len(layout), rates)
    assert len(told["speed"]) == rates


def test_a_posture_has_the_unit_of_its_joints():
    (live,) = built("posture", "velocity", target=LIVE)
    assert live.as_json()["unit"] == "rad"


def test_a_wrench_says_its_directions_and_keeps_its_own_bounds():
    axes = {"axes": ["z", "rx"], "wrench": [10.0, 0.0], "sensor": "ee", "frame": "ee"}
    (live,) = built("wrench", "acceleration", **axes, wrench_target={**LIVE, "rate_n_s": 5.0})
    told = live.as_json()
    assert (told["layout"], told["speed"]) == (["z", "rx"], [5.0, 2.0])


@pytest.mark.parametrize(
    ("kind", "parameters", "key"),
    [
        ("frame_orientation", {"target": LIVE, "rotation_rad": [0.0, 0.0, 0.1]}, "target"),
        ("frame_orientation", {"target": LIVE, "turn_s": 1.0}, "turn_s"),
        ("frame_orientation", {"target": {**LIVE, "within_rad": 4.0}}, "within_rad"),
        ("frame_orientation", {"target": {"kind": "point"}}, "kind"),
        ("frame_pose", {"target": LIVE, "turn_s": 1.0}, "turn_s"),
        ("frame_pose", {"target": {**LIVE, "jerk_rad_s3": 0.0}}, "jerk_rad_s3"),
        ("frame_pose", {"target": {**LIVE, "when_stale": "explode"}}, "when_stale"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_key(kind, parameters, key):
    with pytest.raises(ConfigError, match=key):
        built(kind, "velocity", **TOOL, **parameters)


def test_a_range_of_a_wrench_has_as_many_numbers_as_directions():
    pressed = {"frame": "ee", "normal": [0.0, 0.0, 1.0], "force_n": 10.0}
    with pytest.raises(ConfigError, match="upper"):
        built("wrench", "acceleration", **pressed, wrench_target={**LIVE, "upper": [1.0, 2.0]})


def test_two_live_targets_of_one_wrench_need_names():
    pressed = {"frame": "ee", "normal": [0.0, 0.0, 1.0], "force_n": 10.0, "target": LIVE}
    with pytest.raises(ConfigError, match="target"):
        built("wrench", "acceleration", **pressed, wrench_target=LIVE)
    named = {**LIVE, "name": "force"}
    assert len(built("wrench", "acceleration", **pressed, wrench_target=named)) == 2


@pytest.mark.parametrize("kind", ["frame_orientation", "frame_pose"])
def test_with_a_free_base_orientations_are_steered_against_a_frame_alone(kind):
    config = load_controller_config("ghc_standing")[0].model_copy(deep=True)
    tasks, robot = config.parameters["tasks"], describe(load_emulator_config(STANDING, seed=0)[0])
    tasks[1] = task(kind, "upright", frame="head", target=LIVE)
    with pytest.raises(ConfigError, match="reference"):
        build(config, robot)
    tasks[1]["parameters"]["reference"] = "pelvis"
    assert len(build(config, robot).live) == 1


def sent_once(values: np.ndarray, at: int = 50) -> Callable[[ControllerLoop], None]:
    """Sends one target."""

    def steer(loop: ControllerLoop) -> None:
        if loop.last_tick == at:
            grant = loop.operate("acquire", "me")
            made = Target(1, values.size)
            made.number, made.epoch, made.session_id = 1, grant["epoch"], grant["session_id"]
            made.values[:] = values
            loop.steer("me", made.dump())

    return steer


@pytest.mark.parametrize("policy", ["hold", "return", "stop"])
def test_a_stale_pose_is_held_or_left_for_the_begin_or_stops_the_robot(policy):
    aim = AT.copy()
    aim[3:] = (Rotation.from_rotvec([0.0, 0.0, 0.2]) * Rotation.from_quat(AT[3:])).as_quat()
    aim[:3] += 0.02
    target = {**POSE, "stale_after_s": 1.0, "when_stale": policy, "speed_rad_s": 1.0}
    law = {
        "controller": "stable_qp",
        "parameters": {
            "task": task("frame_pose", **TOOL, target=target),
            "psi": {"form": "exponential", "eta_per_s": 20.0},
        },
    }
    done = hoap3.simulate("ur5", law, 2.5, steer=sent_once(aim))
    halted = np.isin(done.states["mode"], [State.STOPPING, State.STOPPED])
    stopping = done.states["tick"][halted & (done.states["tick"] < round(2.5 / T))]
    ended = done.states["q"][round(2.4 / T)]
    found = posed("ur5", ended, "tool0")
    wanted = AT if policy == "return" else aim
    turned = Rotation.from_quat(found[3:]) * Rotation.from_quat(wanted[3:]).inv()
    assert np.linalg.norm(found[:3] - wanted[:3]) < 1e-3
    assert turned.magnitude() < 1e-3
    assert (1050 < stopping[0] < 1150) if policy == "stop" else not stopping.size
    assert replay_records(done.records, load_controller_config(law)[0]).identical


@pytest.mark.slow
def test_a_steered_force_is_pressed_with_and_changes_no_faster_than_its_rate():
    law = {
        "controller": "ghc",
        "parameters": {
            "tasks": [
                task(
                    "wrench",
                    "hand",
                    {"kp": 30.0, "kd": 20.0},
                    frame="ee",
                    target={"kind": "point", "position_m": [-0.5, -0.25, 0.48]},
                    normal=[0.0, 0.0, 1.0],
                    force_n=10.0,
                    wrench_target={"kind": "live", "rate_n_s": 10.0},
                ),
                task("posture", "rest", {"kp": 30.0, "kd": 20.0}, posture="bent"),
            ],
            "priorities": {"order": ["hand", "rest"]},
        },
    }
    steer = sent_once(np.array([18.0]), at=2000)
    done = hoap3.simulate("lwr_with_table", law, 5.0, steer=steer)
    column = done.controller.extra_names.index("force_hand")
    felt = done.setpoints["extra"][:, column]
    assert felt[1990] == pytest.approx(10.0, abs=0.7)
    assert felt[2400] < 10.0 + 10.0 * 0.4 + 0.7  # still on its way
    assert felt[4900] == pytest.approx(18.0, abs=0.7)
