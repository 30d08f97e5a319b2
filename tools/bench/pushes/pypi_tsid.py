"""PyPI's `tsid` with the model, tasks, gains and weights of one of our configs, to be pushed, too.

It is a peer of the bench and no controller for anything else: it certifies nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.pinocchio_model import one_coordinate_each
from hoap3.remote_controller.controllers.acceleration import tsid_settings
from hoap3.remote_controller.controllers.acceleration.soles.outlines import GRAVITY, drawn_in
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.model.free_dynamics import BASE, POSE_OF_BASE
from hoap3.remote_controller.references.postures import posture_of
from hoap3.remote_controller.references.settings import target_of
from hoap3.remote_controller.tasks.accelerations.position_reference import PositionReference
from hoap3.remote_controller.tasks.com import ComTask
from hoap3.remote_controller.tasks.registry import labels_of

FORCE_WEIGHT = 1e-9
"""Of the corners' forces, squared [N²], beside 1 for the tasks' accelerations."""
INSIDE = 2.0**-0.5
"""Of μ: their pyramid of friction has the slope that it is given, ours lies within the cone."""
MOST_WEIGHTS = 100.0  # that a sole may carry
TURNS = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])


class PypiTsid(Controller):
    """`InverseDynamicsFormulationAccForce` with eiquadprog, soles as contacts of six rows.

    It knows tasks of the centre of mass, orientations that stay as they are, and the posture.
    Torques keep the efforts; other bounds of joints there are none. Viscous friction of the joints,
    which it does not know, is added. Where it has no answer the last torques stay, and `fallback`
    is 1.
    """

    Parameters = tsid_settings.Parameters
    commands = ("torque",)

    @classmethod
    def configured(cls, description: RobotDescription, parameters: Any, file: str) -> Self:
        """One for a robot."""
        return cls(description, parameters, file)

    def __init__(self, description: RobotDescription, parameters: Any, file: str) -> None:
        import pinocchio as pin
        import tsid.tsid_pywrap as library  # of 1.7.1 the package itself is empty

        super().__init__(description, parameters)
        self._pin, self._library, self._folder = pin, library, Path(file).parent
        self._given = parameters
        model = pin.buildModelFromXML(one_coordinate_each(description), pin.JointModelFreeFlyer())
        joints = [model.joints[model.getJointId(name)].idx_v for name in description.joint_names]
        self._order = np.array(joints) - BASE
        model.armature[joints] = description.armature
        self._robot = library.RobotWrapper(model, library.RootJointType.FLOATING_BASE_SYSTEM, False)
        self._damping = np.array(model.damping)[BASE:]
        self._q, self._v = np.zeros(model.nq), np.zeros(model.nv)
        self._tau = np.zeros(description.n)
        self._kept: list[Any] = []  # what they refer to
        self._moving: list[Callable[[float], None]] = []

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Pose the problem where the robot is."""
        del last_command
        library, given = self._library, self._given
        self._kept, self._moving = [], []
        self._take(state)
        self._problem = library.InverseDynamicsFormulationAccForce("", self._robot, False)
        self._problem.computeProblemData(0.0, self._q, self._v)
        weights = given.priorities.weights
        for label, task in zip(labels_of(given.tasks), given.tasks, strict=True):
            made = self._com(task, state.tick) if task.task == "com" else self._turn(task)
            self._add(made, task.both, weights.get(label, 1.0))
        self._add(self._posture(), given.posture.both, given.posture.weight)
        self._stand()
        efforts = library.TaskActuationBounds("efforts", self._robot)
        most = self._theirs(self.description.effort)
        efforts.setBounds(-most, most)
        self._kept.append(efforts)
        self._problem.addActuationTask(efforts, 1.0, 0, 0.0)
        self._solver = library.SolverHQuadProgFast("")
        self._solver.resize(self._problem.nVar, self._problem.nEq, self._problem.nIn)

    def step(self, state: State) -> Setpoint:
        """Torques for one period."""
        command, time = self.command, state.tick * self.description.period_s
        self._take(state)
        for move in self._moving:
            move(time)
        found = self._solver.solve(self._problem.computeProblemData(time, self._q, self._v))
        command.fallback = int(found.status != 0)
        if not command.fallback:
            self._tau[:] = self._problem.getActuatorForces(found)
        tau = (self._tau + self._damping * self._v[BASE:])[self._order]
        most = self.description.effort
        np.clip(tau, -most, most, out=command.values)
        return command

    def _take(self, state: State) -> None:
        """Take a State: q with the base's pose, v with its twist in its own axes."""
        turn = state.base[3:7] / np.linalg.norm(state.base[3:7])
        R = self._pin.Quaternion(turn).matrix()
        self._q[:3], self._q[3:POSE_OF_BASE] = state.base[:3], turn
        self._v[:3], self._v[3:BASE] = R.T @ state.base[7:10], R.T @ state.base[10:13]
        self._q[POSE_OF_BASE:], self._v[BASE:] = self._theirs(state.q), self._theirs(state.dq)

    def _theirs(self, ours: FloatArray) -> FloatArray:
        """From the order on the wire to that of their joints."""
        found = np.zeros(len(ours))
        found[self._order] = ours
        return found

    def _placement(self, frame: str) -> Any:
        number = self._robot.model().getFrameId(frame)
        return self._robot.framePosition(self._problem.data(), number)

    def _add(self, task: Any, gains: tuple[float, float], weight: float) -> None:
        kp, kd = gains
        task.setKp(np.full(len(task.Kp), kp))
        task.setKd(np.full(len(task.Kd), kd))
        self._kept.append(task)
        self._problem.addMotionTask(task, weight, 1, 0.0)

    def _com(self, task: Any, tick: int) -> Any:
        """Of the centre of mass, to a target given in a frame as it stands now."""
        own = ComTask.Parameters.model_validate(task.parameters)
        frame, period = self._placement(own.frame), self.description.period_s
        made, out = self._library.TaskComEquality("com", self._robot), np.zeros((3, 3))
        target = target_of(own.target, self._folder)
        origin, axes = np.array(frame.translation), np.array(frame.rotation, order="C")
        place = PositionReference(target, origin, axes, period, out)
        present = np.array(self._robot.com(self._problem.data()))
        place.start(present, tick * period, (tick + 1) * period)
        sample = self._library.TrajectorySample(3)
        writes = sample.value, sample.derivative, sample.second_derivative

        def move(time: float) -> None:
            place.update(time, time + period)
            for write, row in zip(writes, out, strict=True):
                write(row)
            made.setReference(sample)

        self._moving.append(move)
        return made

    def _turn(self, task: Any) -> Any:
        """Of a frame that shall stay turned as it is."""
        frame = task.parameters["frame"]
        made = self._library.TaskSE3Equality("turn", self._robot, frame)
        made.setMask(TURNS)
        sample, present = self._library.TrajectorySample(12, 6), self._placement(frame)
        sample.value(np.concatenate([present.translation, present.rotation.flatten(order="F")]))
        made.setReference(sample)
        return made

    def _posture(self) -> Any:
        """Of the joints."""
        given = self._given.posture
        wanted = posture_of(self.description, given.posture, given.posture_rad, "posture")
        made = self._library.TaskJointPosture("posture", self._robot)
        sample = self._library.TrajectorySample(len(wanted))
        sample.value(self._theirs(np.asarray(wanted)))
        made.setReference(sample)
        return made

    def _stand(self) -> None:
        """Have the soles rest, and press with forces at their corners, less the margin."""
        given = self._given.contacts
        weight = self._pin.computeTotalMass(self._robot.model()) * GRAVITY
        for sole in self.description.soles:
            corners = drawn_in(sole.polygon, given.margin_m)
            points = np.vstack([corners.T, np.zeros(len(corners))])
            limits = given.least_share * weight, MOST_WEIGHTS * weight
            made = self._library.Contact6d(
                sole.frame,
                self._robot,
                sole.frame,
                points,
                np.array([0.0, 0.0, 1.0]),
                given.friction * INSIDE,
                *limits,
            )
            made.setKp(np.zeros(BASE))
            made.setKd(np.full(BASE, given.damping_per_s))
            made.setReference(self._placement(sole.frame))
            self._kept.append(made)
            self._problem.addRigidContact(made, FORCE_WEIGHT)
