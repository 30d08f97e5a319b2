"""The tasks of a shipped config of `clik_sdp`, as the plain loop takes them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.description import RobotDescription
from hoap3.remote_controller.config import read_config
from hoap3.remote_controller.controllers.velocity.clik import SdpParameters
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import registry
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import Array


class ConfiguredTasks:
    """The tasks of a config at any posture; they stand still.

    Args:
        name: of the config.
        robot: that it is for.
        posture: where to start; default: the robot's initial one.
        seen_from: by the name of a `frame_position` task, the frame that its target shall be
            relative to, instead of the config's; the target is the same place at the start.

    Attributes:
        robot: its description.
        sizes, weights: rows of each task, and w of each row.
        desired, delta: β̃ [1/s], δ.
        start: joint positions, (joints,) [rad].
        labels: names of the tasks.
        references: the frame that each task is relative to in the config, "" for none.
    """

    def __init__(
        self,
        name: str,
        robot: str,
        posture: str | None = None,
        seen_from: dict[str, str] | None = None,
    ) -> None:
        content, file = read_config(name)
        given: dict[str, Any] = copy.deepcopy(content["parameters"])
        self.robot: RobotDescription = load(robot)
        self.start = np.array(self.robot.postures[posture or self.robot.initial_posture])
        self._kinematics = Kinematics(self.robot)
        self.labels = [task["name"] for task in given["tasks"]]
        self.references = {
            task["name"]: str(task["parameters"].get("reference", "")) for task in given["tasks"]
        }
        for task in given["tasks"]:
            frame = (seen_from or {}).get(task["name"])
            if frame is not None:
                self._move(task["parameters"], frame)
        parameters = parse(SdpParameters, given, file)
        tasks = parameters.tasks or ()
        self._functions = [
            registry.build(task, self.robot, self._kinematics, file, f"parameters.tasks.{number}")
            for number, task in enumerate(tasks)
        ]
        self.sizes = [len(function.error) for function in self._functions]
        self.weights = np.repeat([task.weight for task in tasks], self.sizes)
        self.desired, self.delta = parameters.beta_per_s, parameters.delta

    def _move(self, parameters: dict[str, Any], frame: str) -> None:
        """Have a target be relative to another frame."""
        place, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, self.robot.n))
        before, after = (
            self._kinematics.frame_id(each) for each in (parameters["reference"], frame)
        )
        self._kinematics.update(self.start)
        self._kinematics.frame(before, after, place, turn, jacobian)
        target = np.array(parameters["target"]["position_m"], dtype=np.float64)
        parameters["target"]["position_m"] = (place + turn @ target).tolist()
        parameters["reference"] = frame

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Stacked Jacobian (n, joints) and errors σ* − σ (n,) at joint positions (joints,)."""
        self._kinematics.update(q)
        for function in self._functions:
            function.update(self._kinematics, 0.0)
        J = np.vstack([function.jacobian for function in self._functions])
        return J, -np.concatenate([function.error for function in self._functions])
