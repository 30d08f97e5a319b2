"""Pushes of 20 ms at the trunk, in MuJoCo in lockstep, and what becomes of the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.pushes.capture import Array, Stance, impulse, room, room_by_torques
from hoap3.protocol.errors import UnknownNameError
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.remote_controller.controllers.acceleration.soles.settings import ContactSettings
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep

TRUNKS = {"hoap3_standing_torque": "pelvis", "humanoid32_standing": "chest"}
"""By emulator config, the link that is pushed."""
CONTROLLERS = {
    "hoap3_standing_torque": ("tsid_standing", "ghc_standing"),
    "humanoid32_standing": ("tsid_standing_humanoid", "ghc_standing_humanoid"),
}
"""By emulator config, the configs of controllers that are compared."""
DIRECTIONS_DEG = (0, 45, 90, 135, 180, 225, 270, 315)
WANTED = {0: 0.8, 1: 0.6}
"""Of the bound, by whether the direction is a diagonal."""

SETTLE_S, PUSH_S, AFTER_S = 1.5, 0.02, 3.0
SPEED, TILT_DEG, LIFT_M = 0.01, 5.0, 2e-3
"""Of the CoM [m/s]; of the trunk against how it stood before; of the origin of a sole."""
SUNK = 0.7  # of the CoM's height: a robot that far down has fallen
STEP = 0.1  # of the bound, between pushes that are tried
LEAST, MOST = 0.5, 1.4


def bench_pushes(
    robots: Sequence[str] = tuple(TRUNKS),
    controllers: Sequence[str] = (),
    directions: Sequence[int] = DIRECTIONS_DEG,
    report: Callable[[str], None] = lambda _: None,
    least: float = LEAST,
) -> list[dict[str, Any]]:
    """Find the greatest survived push in each direction.

    Args:
        robots: emulator configs of robots that stand free, of `TRUNKS`.
        controllers: of `CONTROLLERS`; none are all.
        directions: of the push, from the world's x [deg].
        report: takes what is done now.
        least: share of the bound that is tried first; smaller pushes are not.

    Returns:
        A row for each: `robot`, `controller`, `direction_deg`, `room_m` d, `bound_ns` m·√(g/z)·d,
        `torque_bound_ns` by the linear program, `survived_ns`, `share` of the lesser bound,
        and `wanted`, which share is asked for.

    Raises:
        UnknownNameError: there is no such robot or controller.
    """
    for robot in robots:
        if robot not in TRUNKS:
            raise UnknownNameError("robot that is pushed", robot, TRUNKS)
    known = {name: None for robot in robots for name in CONTROLLERS[robot]}
    for name in controllers:
        if name not in known:
            raise UnknownNameError("controller that is pushed", name, known)
    rows = []
    for robot in robots:
        for controller in CONTROLLERS[robot]:
            if controllers and controller not in controllers:
                continue
            stance = stance_of(robot, controller)
            for direction in directions:
                report(f"{robot}, {controller}, {direction} deg")
                rows.append(_row(robot, controller, stance, direction, least))
    return rows


def stance_of(robot: str, controller: str) -> Stance:
    """Where the robot stands when it is pushed."""
    lockstep = _lockstep(robot, controller, None)
    lockstep.run(SETTLE_S)
    given = load_controller_config(controller)[0].parameters["contacts"]
    contacts = ContactSettings.model_validate(given)
    plant, description = lockstep.robot.plant, lockstep.controller.description
    return Stance(
        description, plant.base.copy(), plant.q.copy(), contacts.friction, contacts.margin_m
    )


def survives(robot: str, controller: str, push_ns: float, angle: float) -> bool:
    """Whether the robot stands as before, `AFTER_S` after a push.

    Args:
        robot, controller: configs.
        push_ns: impulse [N s].
        angle: its direction, from the world's x [rad].
    """
    force = push_ns / PUSH_S * np.array([math.cos(angle), math.sin(angle), 0.0])
    push = {
        "frame": TRUNKS[robot],
        "at_s": SETTLE_S,
        "for_s": PUSH_S,
        "force_n": tuple(force.tolist()),
    }
    lockstep = _lockstep(robot, controller, push)
    plant: Any = lockstep.robot.plant
    soles = [sole.frame for sole in lockstep.controller.description.soles]
    height, upright = float(plant.balance.com()[2]), axis(plant, TRUNKS[robot])
    end, survived = SETTLE_S + PUSH_S + AFTER_S, False

    def over() -> bool:
        """Whether it lies on the ground, or has had its time; before it is told to brake."""
        nonlocal survived
        if plant.data.time < end - 1e-9:
            return float(plant.balance.com()[2]) < SUNK * height
        turned = math.acos(min(1.0, float(axis(plant, TRUNKS[robot]) @ upright)))
        survived = math.degrees(turned) < TILT_DEG and rests(plant, soles)
        return True

    lockstep.run(end + PUSH_S, over)
    return survived


def axis(plant: Any, link: str) -> Array:
    """The z axis of a link of a robot in MuJoCo, in the world, (3,)."""
    found: Array = plant.data.xmat[plant.model.body(link).id].reshape(3, 3)[:, 2].copy()
    return found


def rests(plant: Any, soles: Sequence[str]) -> bool:
    """Whether a robot in MuJoCo is at rest on all its soles.

    Args:
        plant: a `MujocoPlant` with a free base.
        soles: frames that must be down on the floor, at z = 0.
    """
    import mujoco

    model, data = plant.model, plant.data
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    speed = float(np.linalg.norm(data.subtree_linvel[plant.built.root]))
    lifted = max(abs(float(data.site_xpos[plant.built.site(sole)][2])) for sole in soles)
    carried = bool((plant.contact[2::6] > 0.0).all())
    return speed < SPEED and lifted < LIFT_M and carried


def _row(
    robot: str, controller: str, stance: Stance, direction: int, tried: float
) -> dict[str, Any]:
    angle = math.radians(direction)
    distance = room(stance, angle)
    bound = impulse(stance, distance)
    by_torques = impulse(stance, room_by_torques(stance, angle))
    least = min(bound, by_torques)
    share = greatest_share(lambda part: survives(robot, controller, part * least, angle), tried)
    return {
        "robot": robot,
        "controller": controller,
        "direction_deg": direction,
        "room_m": distance,
        "bound_ns": bound,
        "torque_bound_ns": by_torques,
        "survived_ns": share * least,
        "share": share,
        "wanted": WANTED[direction % 90 // 45],
    }


def greatest_share(survived: Callable[[float], bool], least: float = LEAST) -> float:
    """The share, in steps of `STEP`, up to which all from `least` on are survived; or 0."""
    found, tried = 0.0, least
    while tried <= MOST and survived(tried):
        found, tried = tried, round(tried + STEP, 9)
    return found


def _lockstep(robot: str, controller: str, push: dict[str, Any] | None) -> Lockstep:
    emulator: EmulatorConfig = load_emulator_config(robot, seed=0)[0]
    if push is not None:
        parameters = {**emulator.plant.parameters, "pushes": [push]}
        plant = emulator.plant.model_copy(update={"parameters": parameters})
        emulator = emulator.model_copy(update={"plant": plant})
    settings = load_controller_config(controller)[0]
    return Lockstep(emulator, settings, MemoryRecorder(), MemoryRecorder())
