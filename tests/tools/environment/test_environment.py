"""A robot that is stepped from outside: the run's own engine, bit by bit, for any agent."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from itertools import combinations

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import hoap3
from hoap3 import ConfigError, Environment, UsageError
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind

KINDS = ("position", "acceleration", "torque")
every_kind = pytest.mark.parametrize("kind", KINDS)


def same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> bool:
    there, here = ({name: each.tobytes() for name, each in of.items()} for of in (left, right))
    return there == here


def states(env: Environment, actions: np.ndarray, seed: int | None = 0) -> list[bytes]:
    """Every State of an episode."""
    env.reset(seed=seed)
    found = [env.state.dump()]
    for action in actions:
        env.step(action)
        found.append(env.state.dump())
    return found


def wild(env: Environment, steps: int, seed: int = 1) -> np.ndarray:
    """Actions far outside what the robot can do."""
    low, high = env.action_space.low, env.action_space.high
    drawn = np.random.default_rng(seed).normal(size=(steps, env.description.n))
    return (low + high) / 2 + 3.0 * (high - low) * drawn


def test_it_is_the_robot_of_a_run_in_lockstep_byte_by_byte():
    run = hoap3.simulate("hoap3", "qp12", duration=0.2)
    told = [record.payload for record in run.records if record.kind == Kind.STATE]
    asked = run.states["mode"] == State.ACTIVE
    assert len(run.setpoints) == asked.sum() == 200
    got = states(Environment("hoap3"), run.setpoints["values"][:-1])
    assert got == told[:200]


@every_kind
def test_the_same_seed_and_actions_give_the_same_bytes(kind):
    env = Environment("lwr", command=kind, periods_per_step=5)
    actions = wild(env, 30)
    first = states(env, actions, seed=4)
    following = states(env, actions, seed=None)
    assert first == states(Environment("lwr", command=kind, periods_per_step=5), actions, seed=4)
    assert states(env, actions, seed=4) == first
    assert states(env, actions, seed=None) == following != first
    assert states(env, actions, seed=5) != first


@every_kind
def test_whatever_is_asked_for_the_robots_limits_hold_and_info_says_so(kind):
    env = Environment("lwr", command=kind)
    robot, held = env.description, 0
    env.reset(seed=0)
    for action in wild(env, 600):
        after, *_, info = env.step(action)
        held += info["interventions"]
        assert info["interventions"] == (info["held_back"] is not None)
        assert info["held_back"] in {None, *robot.joint_names}
        assert (after["reference"] >= robot.lower - 1e-9).all()
        assert (after["reference"] <= robot.upper + 1e-9).all()
        assert (np.abs(after["reference_rate"]) <= robot.velocity * (1 + 1e-9)).all()
        if kind == "torque":
            assert (np.abs(after["tau"]) <= robot.effort).all()
    assert held > 300
    assert np.abs(after["q"] - robot.initial_position).max() > 0.01


def test_what_keeps_the_limits_is_done_bit_by_bit_and_nothing_is_said():
    env = Environment("ur5")
    before, _ = env.reset(seed=0)
    for tick in range(1, 50):
        action = before["reference"] + 1e-4 * math.sin(0.05 * tick)
        before, *_, info = env.step(action)
        np.testing.assert_array_equal(before["reference"], action)
        assert (info["interventions"], info["held_back"]) == (0, None)
        assert (info["tick"], info["mode"]) == (tick, "active")
        assert info["time_s"] == pytest.approx(1e-3 * tick)
        assert (info["late"], info["lost"], info["rejected"]) == (0, 0, 0)


@every_kind
def test_an_action_is_held_for_all_periods_of_a_step(kind):
    slow = Environment("lwr", command=kind, periods_per_step=20)
    actions = 0.1 * wild(slow, 10)
    quick = Environment("lwr", command=kind)
    assert states(slow, actions) == states(quick, np.repeat(actions, 20, axis=0))[::20]
    assert slow.step_s == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("action", "key"),
    [
        (np.full(6, np.nan), "action.0"),
        ([0.0, 0.0, 0.0, math.inf, 0.0, 0.0], "action.3"),
        (np.zeros(5), "action"),
        (np.zeros((6, 1)), "action"),
        (0.0, "action"),
        (["a"] * 6, "action"),
        (None, "action"),
    ],
)
def test_an_action_that_is_none_is_refused_and_nothing_moves(action, key):
    env = Environment("ur5")
    env.reset(seed=0)
    env.step(env.description.initial_position)
    before = env.state.dump()
    with pytest.raises(ConfigError) as found:
        env.step(action)
    assert (found.value.file, found.value.key) == ("Environment.step", key)
    assert env.state.dump() == before
    env.step(env.description.initial_position.astype(np.float32))
    assert env.state.tick == 2


def test_reward_and_ends_are_the_users():
    seen = []

    def reward(step):
        seen.append(step)
        return -abs(step.after["q"][0])

    def arrived(step):
        return step.info["tick"] >= 6

    env = Environment("ur5", reward, arrived, periods_per_step=2)
    assert env.state is None
    with pytest.raises(UsageError):  # there is nothing to step yet
        env.step(env.description.initial_position)
    first, _ = env.reset(seed=0)
    action = env.description.initial_position + 0.01
    for tick in (2, 4, 6):
        after, value, terminated, truncated, info = env.step(action)
        assert (value, terminated, truncated) == (-abs(after["q"][0]), tick == 6, False)
        assert info["tick"] == tick
    assert same(seen[0].before, first)
    assert same(seen[1].before, seen[0].after)
    assert same(seen[2].after, after)
    np.testing.assert_array_equal(seen[0].action, action)
    with pytest.raises(UsageError):
        env.step(action)
    env.reset()
    env.step(action)
    cut = Environment("ur5", truncated=lambda step: True)
    cut.reset()
    assert cut.step(action)[2:4] == (False, True)


def test_an_episode_starts_where_it_is_told():
    env = Environment("hoap3")
    robot = env.description
    there = np.array(robot.postures["q0"])
    np.testing.assert_array_equal(env.reset(options={"posture": "q0"})[0]["q"], there)
    middle = np.random.default_rng(2).uniform(*robot.sampling_range)
    first, _ = env.reset(options={"q": middle})
    np.testing.assert_array_equal(first["q"], middle)
    np.testing.assert_array_equal(first["reference"], middle)
    assert not first["dq"].any()
    np.testing.assert_array_equal(env.reset()[0]["q"], robot.initial_position)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"options": {"posture": "q9"}}, "posture"),
        ({"options": {"q": np.zeros(3)}}, "options.q"),
        ({"options": {"q": np.full(6, np.nan)}}, "options.q.0"),
        ({"options": {"q": np.array([0, 0, 0, 0, 7.0, 0])}}, "options.q.4"),
        ({"options": {"q": np.zeros(6), "posture": "zero"}}, "options.q"),
        ({"options": {"posturr": "zero"}}, "options.posturr"),
        ({"seed": -1}, "seed"),
        ({"seed": 0.5}, "seed"),
    ],
)
def test_a_start_that_cannot_be_is_refused_and_the_episode_goes_on(arguments, key):
    env = Environment("ur5")
    env.reset(seed=0)
    with pytest.raises(ConfigError) as found:
        env.reset(**arguments)
    assert found.value.key == key
    env.step(env.description.initial_position)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"periods_per_step": 0}, "periods_per_step"),
        ({"periods_per_step": 2.0}, "periods_per_step"),
        ({"robot": {"robot": "hoap3", "postur": "q0"}}, "postur"),
        ({"robot": "hoap3", "command": "torque"}, "command"),
        ({"robot": hoap3.load_robot("hoap3")}, "robot"),
        ({"robot": None}, "robot"),
    ],
)
def test_settings_that_cannot_be_are_refused(arguments, key):
    with pytest.raises(ConfigError) as found:
        Environment(**arguments)
    assert found.value.key == key


def test_a_robots_config_is_a_path_or_text(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("robot: ur5\n")
    for named in (file, str(file)):
        assert Environment(named).description.name == "ur5"
    law = tmp_path / "law.yaml"
    law.write_text("controller: pinv\nrobot: ur5\n")
    assert len(hoap3.simulate(file, law, duration=0.01).setpoints) == 10


def test_several_in_one_process_do_not_know_of_each_other():
    envs = [Environment("lwr", command=kind) for kind in KINDS] + [Environment("ur5")]
    actions = [0.2 * wild(env, 40) for env in envs]
    alone = [states(env, each, seed=7) for env, each in zip(envs, actions, strict=True)]
    threads = threading.active_count()
    together = [[] for _ in envs]
    for env, found in zip(envs, together, strict=True):
        env.reset(seed=7)
        found.append(env.state.dump())
    for step in range(40):
        for env, each, found in zip(envs, actions, together, strict=True):
            env.step(each[step])
            found.append(env.state.dump())
    assert together == alone
    assert threading.active_count() == threads


def test_a_robot_that_follows_no_more_ends_the_episode():
    """As where every answer comes too late for its tick."""
    env = Environment({"robot": "ur5", "lockstep": {"compute_time_us": 1500}})
    env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated:
        _, _, terminated, truncated, info = env.step(env.description.initial_position)
        steps += 1
        assert not terminated
    assert info["mode"] in {"stopping", "stopped"}
    assert info["late"] + info["lost"] >= 20
    assert 20 <= steps <= 23


@pytest.mark.parametrize(
    "settings",
    [
        {"robot": "hoap3"},
        {"robot": "lwr", "command": "acceleration", "periods_per_step": 5},
        {"robot": "lwr", "command": "torque", "periods_per_step": 20},
        {"robot": {"robot": "ur5", "plant": {"kind": "mujoco"}}, "periods_per_step": 10},
    ],
    ids=lambda settings: str(settings["robot"]),
)
@pytest.mark.filterwarnings("ignore:.*Box:UserWarning")  # that its ranges are not ±1
def test_gymnasium_takes_it_for_an_environment(settings):
    check_env(Environment(**settings), skip_render_check=True)


def test_observations_share_no_memory_and_follow_the_seed_alone():
    env = Environment("ur5")
    first = [env.reset(seed=123)[0], env.reset()[0]]
    again = [env.reset(seed=123)[0], env.reset()[0]]
    assert all(same(*pair) for pair in zip(first, again, strict=True))
    seen = first + [env.step(env.description.initial_position)[0] for _ in range(2)]
    for left, right in combinations(seen, 2):
        assert not any(np.shares_memory(left[name], right[name]) for name in left)


@pytest.mark.slow
def test_without_gymnasium_the_error_names_the_extra():
    code = """if True:
        import sys
        sys.modules["gymnasium"] = None
        import hoap3
        try:
            hoap3.Environment
        except hoap3.NotInstalledError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'hoap3[gymnasium]'" in done.stdout


def test_actions_lie_between_what_the_robot_can():
    robot = hoap3.load_robot("lwr")
    ends = {
        "position": (robot.lower, robot.upper),
        "acceleration": (-robot.brake_acceleration, robot.brake_acceleration),
        "torque": (-robot.effort, robot.effort),
    }
    for kind, (low, high) in ends.items():
        space = Environment("lwr", command=kind).action_space
        np.testing.assert_array_equal(space.low, low)
        np.testing.assert_array_equal(space.high, high)


def test_the_senses_of_a_plant_are_observed():
    env = Environment({"robot": "ur5", "plant": {"kind": "mujoco", "parameters": {
        "imu_frames": ["tool0"]}}})  # fmt: skip
    first, _ = env.reset(seed=0)
    assert first["imu"].shape == env.observation_space["imu"].shape == (10,)
    assert "base" not in first
