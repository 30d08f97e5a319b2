"""What torques do to a body in MuJoCo, contacts included, for the filter before them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.plants.mujoco.model import SERVOS, MujocoModel

ROUNDS = 3
ROUNDING = 1e-9  # of an effort: a torque that exceeds it by no more was meant to be it


class ContactTorques:
    """Forward dynamics by MuJoCo at the plant's state, and their inverse step by step.

    Contacts and a free base leave no closed form of the torques that joint accelerations need. With
    M̂ the inertia of the joints with the base let go, M_jj − M_jb·M_bb⁻¹·M_bj,

        τ ← τ + M̂·(ddq − ddq(τ))

    converges without overshoot: what touches can only lessen how joints answer torques, so R, their
    answer, has 0 ≤ R ≤ M̂⁻¹. Without contacts the first step is exact. Accelerations that closed
    chains forbid are approached as far as a few steps go.

    Args:
        mujoco, built, data: module, model, and the plant's `MjData`.
        effort: (n,) [N m or N].
        tau: of the motors as the plant measures it, (n,).
        compensated: the plant adds the torques that hold it.
    """

    def __init__(
        self,
        mujoco: Any,
        built: MujocoModel,
        data: Any,
        effort: FloatArray,
        tau: FloatArray,
        *,
        compensated: bool,
    ) -> None:
        self._forward, self._full = mujoco.mj_forward, mujoco.mj_fullM
        self._v_at, self._real, self._tau = built.v_at, data, tau
        self._model = copy.copy(built.model)
        self._model.opt.disableactuator = 1 << SERVOS
        self._data = mujoco.MjData(self._model)
        self._effort, self._compensated = np.array(effort), compensated
        n, dofs = len(effort), built.model.nv
        self._motors = np.arange(0, 2 * n, 2)
        self._mass = np.zeros((dofs, dofs))
        self._tied, self._free, self._base = built.ties.matrix, built.free, built.base_v
        self._found, self._torque, self._idle, self._none = np.zeros((4, n))

    def accelerations(self, command: FloatArray, dt: float, out: FloatArray) -> int:
        """Write what torques, (n,), would give, (n,) [rad/s² or m/s²]; see `TorqueModel`."""
        del dt
        self._here()
        self._answer(command, out)
        beyond = np.abs(command) > (1.0 + ROUNDING) * self._effort
        return int(np.argmax(beyond)) if beyond.any() else -1

    def torques(self, ddq: FloatArray, dt: float, out: FloatArray) -> int:
        """Write the command, (n,), that accelerations need; see `TorqueModel`."""
        del dt
        self._need(ddq, self._torque)
        np.clip(self._torque, -self._effort, self._effort, out=out)
        short = np.abs(self._torque) > (1.0 + ROUNDING) * self._effort
        return int(np.argmax(short)) if short.any() else -1

    def share(self, ddq: FloatArray, dt: float) -> float:
        """How much of accelerations, (n,), the efforts suffice for; see `TorqueModel`."""
        del dt
        self._need(self._none, self._idle)
        if (np.abs(self._idle) > self._effort).any():
            return -1.0
        self._need(ddq, self._torque)
        change = self._torque - self._idle
        room = np.where(change < 0.0, self._effort + self._idle, self._effort - self._idle)
        needs = np.abs(change)
        return float(np.min(room / np.maximum(needs, room), initial=1.0, where=needs > 0.0))

    def _here(self) -> None:
        """Be where the plant is."""
        real, data = self._real, self._data
        data.qpos[:], data.qvel[:] = real.qpos, real.qvel
        data.qacc_warmstart[:] = real.qacc_warmstart

    def _answer(self, command: FloatArray, out: FloatArray) -> None:
        self._data.ctrl[self._motors] = command
        self._forward(self._model, self._data)
        np.take(self._data.qacc, self._v_at, mode="clip", out=out)

    def _need(self, ddq: FloatArray, out: FloatArray) -> None:
        self._here()
        np.copyto(out, self._tau)
        if self._compensated:
            out -= self._real.qfrc_gravcomp[self._v_at]
        inertia: FloatArray | None = None
        for _ in range(ROUNDS):
            self._answer(out, self._found)
            if inertia is None:
                inertia = self._inertia()
            np.subtract(ddq, self._found, out=self._found)
            out += inertia @ self._found

    def _inertia(self) -> FloatArray:
        """M̂, (n, n)."""
        self._full(self._model, self._data, self._mass)
        joints = self._tied.T @ self._mass @ self._tied
        if not self._free:
            return np.asarray(joints)
        across, base = self._mass[self._base] @ self._tied, self._mass[self._base, self._base]
        return np.asarray(joints - across.T @ np.linalg.solve(base, across))
