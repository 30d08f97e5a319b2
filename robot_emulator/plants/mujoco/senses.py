"""What is measured of a body in MuJoCo: encoders, base, contact forces, inertial sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.model import IMU, MujocoModel

MOST_COUNTS = 32767.0  # of an int16 encoder


class Encoders:
    """Positions as encoders show them, and their rate.

    Without noise and counts they show the joints themselves; with either, the rate is the change
    of what they show over a period, as a drive computes it.

    Args:
        n: joints.
        counts: per rad or m, (n,); None for an encoder without steps.
        noise: standard deviation of what is measured [rad or m].
        seed: of the noise.
    """

    def __init__(self, n: int, counts: FloatArray | None, noise: float, seed: int) -> None:
        self._counts, self._noise = counts, noise
        self._random = np.random.default_rng(seed)
        self._drawn, self._shown = np.zeros((2, n))
        self.ideal = counts is None and noise == 0.0

    def read(self, position: FloatArray, dt: float, q: FloatArray, dq: FloatArray) -> None:
        """Measure `position`, (n,), into q; and its rate since the last time into dq, both (n,)."""
        shown = self._shown
        if self._noise:
            self._random.standard_normal(out=self._drawn)
            np.multiply(self._drawn, self._noise, out=shown)
            shown += position
        else:
            np.copyto(shown, position)
        if self._counts is not None:
            shown *= self._counts
            np.rint(shown, out=shown)
            np.clip(shown, -MOST_COUNTS - 1.0, MOST_COUNTS, out=shown)
            shown /= self._counts
        np.subtract(shown, q, out=dq)
        dq /= dt
        np.copyto(q, shown)


class Senses:
    """Base, contact forces and inertial sensors, as docs/reference/wire.md has them.

    Contact forces and inertial sensors are those of the last integration steps, taken at the begin
    of each; forces are means over a period.

    Args:
        mujoco: the module.
        built, data: model, and its `MjData`.
        description: its wrench sensors feel their link and all that it carries.
        contacts, imus: frames that have sites.
    """

    def __init__(
        self,
        mujoco: Any,
        built: MujocoModel,
        data: Any,
        description: RobotDescription,
        contacts: tuple[str, ...],
        imus: tuple[str, ...],
    ) -> None:
        from hoap3.robot_emulator.plants.mujoco.contact_kernels import feel

        self._feel, self._constrain = feel, mujoco.mj_rnePostConstraint
        self._rotate = mujoco.mju_rotVecQuat
        self._model, self._data = built.model, data
        frames = (*contacts, *description.wrench_sensors)
        self._sites = np.array([built.site(frame) for frame in frames], np.intp)
        bodies, tree = built.model.nbody, built.model.body_rootid
        self._trees = np.array(tree, np.intp)
        self._about = np.zeros((bodies, 3))
        self._felt = np.zeros((len(frames), bodies), np.bool_)
        for row, site in enumerate(self._sites):
            body = int(built.model.site_bodyid[site])
            self._felt[row] = [
                each == body if row < len(contacts) else _carries(built.model, body, each)
                for each in range(bodies)
            ]
            self._felt[row, 0] = False
        self._places, self._axes = np.zeros((len(frames), 3)), np.zeros((len(frames), 9))
        self._wrenches = np.zeros(6 * len(frames))
        self._split = 6 * len(contacts)
        order = []
        for frame in imus:
            first = int(built.model.sensor(f"{IMU[0]} {frame}").adr[0])
            w, x, y, z = range(first, first + 4)
            order += [x, y, z, w]
            for kind in IMU[1:]:
                first = int(built.model.sensor(f"{kind} {frame}").adr[0])
                order += range(first, first + 3)
        self._imu = np.array(order, np.intp)
        self._free, self._base_q, self._base_v = built.free, built.base_q, built.base_v

    @property
    def feels(self) -> bool:
        """Whether there is anything that feels forces."""
        return bool(len(self._sites))

    def begin(self) -> None:
        """Forget the forces of the last period."""
        self._wrenches[:] = 0.0

    def feel(self, share: float) -> None:
        """Add `share` of the forces of the step that was just done."""
        data = self._data
        self._constrain(self._model, data)
        np.take(data.subtree_com, self._trees, axis=0, mode="clip", out=self._about)
        np.take(data.site_xpos, self._sites, axis=0, mode="clip", out=self._places)
        np.take(data.site_xmat, self._sites, axis=0, mode="clip", out=self._axes)
        self._feel(
            data.cfrc_ext,
            self._about,
            self._felt,
            self._places,
            self._axes,
            share,
            self._wrenches,
        )

    def read(
        self, base: FloatArray, contact: FloatArray, wrench: FloatArray, imu: FloatArray
    ) -> None:
        """Write the arrays of State; those that are empty stay so."""
        data = self._data
        contact[:] = self._wrenches[: self._split]
        wrench[:] = self._wrenches[self._split :]
        if imu.size:
            np.take(data.sensordata, self._imu, mode="clip", out=imu)
        if self._free and base.size:
            pose, rates = data.qpos[self._base_q], data.qvel[self._base_v]
            base[:3], base[3:6], base[6] = pose[:3], pose[4:7], pose[3]
            base[7:10] = rates[:3]
            self._rotate(base[10:13], rates[3:6], pose[3:7])


def _carries(model: Any, body: int, other: int) -> bool:
    """Whether a body is another one, or carries it."""
    while other > body:
        other = int(model.body_parentid[other])
    return other == body
