"""Robots that take accelerations or torques, from grant to safe stop, on virtual time."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import Bench
from support.strong_arms import changed, small

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import CommandKind
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe

KINDS: tuple[CommandKind, ...] = ("acceleration", "torque")


def bench(kind: CommandKind, **config: object) -> Bench:
    made = Bench(description=small(kind, "compensated"), **config)
    made.link.ask("acquire", "me")
    return made


def push(made: Bench, ddq: float) -> None:
    """From now on, setpoints that accelerate the shoulder so much."""
    wanted = np.array([ddq, 0.0, 0.0])
    made.values[:] = wanted
    if made.kind == "torque":
        dynamics = Dynamics(made.description.model_copy(update={"gravity": "none"}))
        dynamics.inverse(made.description.initial_position, np.zeros(3), wanted, made.values)


@pytest.mark.parametrize("kind", KINDS)
def test_setpoints_accelerate_it(kind: CommandKind):
    made = bench(kind)
    push(made, 2.0)
    state = made.run(200)
    assert state.mode == State.ACTIVE
    assert state.dq[0] == pytest.approx(0.4, rel=0.05)
    assert made.robot.validator.rejected == 0
    np.testing.assert_array_equal(state.reference, state.q)


@pytest.mark.parametrize("kind", KINDS)
def test_silence_is_held_then_braked_then_a_safe_stop_until_recovered(kind: CommandKind):
    made = bench(kind, hold_ticks=7, misses_to_stop=20)
    push(made, 10.0)
    moving = made.run(100)
    made.fate = lambda tick, answer: []
    held = made.run(8)  # one more setpoint was on its way
    assert held.dq[0] > moving.dq[0] + 0.06
    braked = made.run(10)
    assert braked.dq[0] < held.dq[0]
    assert braked.mode == State.ACTIVE
    stopped = made.run(200)
    assert stopped.mode == State.STOPPED
    np.testing.assert_array_equal(stopped.dq, 0.0)
    assert [name for name, *_ in made.events()].count("SAFE_STOP") == 1
    resting = made.run(300)
    np.testing.assert_array_equal(resting.q, stopped.q)
    made.fate = lambda tick, answer: [(1000, answer)]
    made.values[:] = 0.0
    made.link.ask("recover", "me")
    made.run(1)
    made.link.ask("acquire", "me")
    going = made.run(50)
    assert going.mode == State.ACTIVE
    np.testing.assert_allclose(going.q, stopped.q, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_before_anybody_commands_it_the_brakes_are_on(kind: CommandKind):
    made = Bench(description=small(kind, "full"))
    state = made.run(100)
    assert state.mode == State.IDLE
    np.testing.assert_array_equal(state.q, made.description.initial_position)
    np.testing.assert_array_equal(state.dq, 0.0)
    assert np.abs(state.tau).max() > 1.0  # what gravity asks of them


def test_efforts_that_do_not_suffice_are_an_event_and_a_count():
    made = Bench(description=changed(small("torque", "full"), effort=(20.0, 0.5, 20.0)))
    made.link.ask("acquire", "me")
    made.run(1500)
    told = [(name, detail) for name, _, detail in made.events() if name == "TORQUE_LIMITED"]
    assert told[0] == ("TORQUE_LIMITED", 1)
    counted = made.robot.summary()["torque_limited"]
    assert isinstance(counted, int)
    assert counted > 10 * len(told)  # the event tells when it begins


@pytest.mark.slow
@pytest.mark.parametrize("word", ["stop", "release"])
def test_a_stop_for_which_efforts_do_not_suffice_is_left_to_the_brakes(word: str):
    arm = load("baxter_left_arm")
    weak = changed(arm, effort=tuple(0.1 * joint.effort for joint in arm.joints))
    made = Bench(description=weak.model_copy(update={"command_kinds": ("torque",)}))
    made.link.ask("acquire", "me")
    falling = made.run(300)
    assert np.abs(falling.dq).max() > 0.1
    made.link.ask(word, "me")
    stopped = made.run(4000)
    assert stopped.mode == (State.STOPPED if word == "stop" else State.IDLE)
    np.testing.assert_array_equal(stopped.dq, 0.0)
    told = [name for name, *_ in made.events()]
    assert told.index("TORQUE_LIMITED") < told.index("AT_REST")
    np.testing.assert_array_equal(made.run(100).q, stopped.q)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robot": "hoap3", "command": "torque"}, "command: .*position"),
        ({"robot": "ur5", "command": "torque", "plant": {"servo": "lag"}}, "servo: .*torque"),
        (
            {"robot": "ur5", "command": "acceleration", "loss_policy": "extrapolate"},
            "loss_policy: .*acceleration",
        ),
    ],
)
def test_settings_of_another_body_are_refused_by_name(settings: dict[str, object], message: str):
    config = parse(EmulatorConfig, settings, "file.yaml")
    with pytest.raises(ConfigError, match=message):
        describe(config, "file.yaml")


def test_the_description_says_what_the_running_robot_takes():
    config = parse(EmulatorConfig, {"robot": "ur5", "command": "torque"}, "file.yaml")
    assert describe(config, "file.yaml").command_kinds == ("torque",)
    gravity = parse(
        EmulatorConfig, {"robot": "ur5", "plant": {"gravity": "compensated"}}, "file.yaml"
    )
    assert describe(gravity, "file.yaml").gravity == "compensated"
