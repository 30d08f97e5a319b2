"""How a robot in MuJoCo stands: its centre of mass, zero-moment point, soles."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.plants.mujoco.model import MujocoModel


class Balance:
    """Watches every period, and tells at the end.

    Args:
        mujoco, built, data: module, model, and its `MjData`.
        description: of the robot.
        soles: frames that can stand; the first is the one that figures are told in.
        felt: frames whose contact forces State has.
    """

    def __init__(
        self,
        mujoco: Any,
        built: MujocoModel,
        data: Any,
        description: RobotDescription,
        soles: tuple[str, ...],
        felt: tuple[str, ...],
    ) -> None:
        self._mujoco, self._built, self._data = mujoco, built, data
        self._description, self._soles = description, soles
        self._sites = np.array([built.site(sole) for sole in soles], np.intp)
        self._upright = np.ones(len(soles))
        self._axes = np.zeros((len(soles), 9))
        self._carried = [(sole, 6 * felt.index(sole) + 2) for sole in soles if sole in felt]
        self._normal = np.array([place for _, place in self._carried], np.intp)
        self._off, self._lifted = np.zeros((2, len(self._carried)))
        self._root_mass, self._root_com = 0.0, np.zeros(3)
        if not built.free and built.urdf:
            held = build_model(description.model_copy(update={"urdf": built.urdf}))
            self._root_mass, self._root_com = held.root_mass, held.root_com

    def look(self, contact: FloatArray) -> None:
        """Note how far the soles are tilted, and which of them nothing carries.

        Args:
            contact: as State has it.
        """
        np.less_equal(contact[self._normal], 0.0, out=self._lifted)
        self._off += self._lifted
        np.take(self._data.site_xmat, self._sites, axis=0, mode="clip", out=self._axes)
        np.minimum(self._upright, self._axes[:, 8], out=self._upright)

    def com(self) -> FloatArray:
        """Centre of mass of the whole robot in the world, (3,) [m], as of the last step's begin."""
        trees = self._built.trees
        masses = self._built.model.body_subtreemass[trees]
        weighed = masses @ self._data.subtree_com[trees] + self._root_mass * self._root_com
        return np.asarray(weighed / (masses.sum() + self._root_mass))

    def com_in_sole(self) -> FloatArray:
        """The same seen from the first sole, in its axes, (3,) [m]."""
        place, axes = self._frame(0)
        return np.asarray(axes.T @ (self.com() - place))

    def summary(self, q: FloatArray) -> dict[str, Any]:
        """Figures at the end, in the first sole's frame where there is one.

        Args:
            q: what the encoders show, (n,).
        """
        self._mujoco.mj_forward(self._built.model, self._data)
        com = self.com()
        told: dict[str, Any] = {"com_world_m": com.tolist()}
        if not self._soles:
            return told
        place, axes = self._frame(0)
        told["frame"] = self._soles[0]
        told["com_m"] = self.com_in_sole().tolist()
        told["com_by_model_m"] = build_model(self._description).com_in(self._soles[0], q).tolist()
        point = self.zmp()
        told["zmp_m"] = None if point is None else (axes.T @ (point - place))[:2].tolist()
        tilts = np.degrees(np.arccos(np.clip(self._upright, -1.0, 1.0)))
        told["periods_off_the_ground"] = {
            sole: int(count) for (sole, _), count in zip(self._carried, self._off, strict=True)
        }
        told["largest_tilt_deg"] = dict(zip(self._soles, tilts.tolist(), strict=True))
        return told

    def zmp(self) -> FloatArray | None:
        """Point on the first sole's plane about which the ground's forces turn only upright, (3,).

        None where nothing carries the robot.
        """
        data, model = self._data, self._built.model
        self._mujoco.mj_rnePostConstraint(model, data)
        place, axes = self._frame(0)
        force, moment = np.zeros(3), np.zeros(3)
        for body in np.flatnonzero(np.isin(model.body_rootid, self._built.trees)):
            whole = data.cfrc_ext[body] if self._built.free else data.cfrc_int[body]
            if self._built.free or model.body_parentid[body] == 0:
                about = data.subtree_com[model.body_rootid[body]]
                force += whole[3:]
                moment += whole[:3] + np.cross(about - place, whole[3:])
        if not self._built.free:
            weight = -self._root_mass * model.opt.gravity
            force += weight
            moment += np.cross(self._root_com - place, weight)
        normal = axes[:, 2]
        if not normal @ force > 0.0:
            return None
        return np.asarray(place + np.cross(normal, moment) / (normal @ force))

    def _frame(self, sole: int) -> tuple[FloatArray, FloatArray]:
        site = self._sites[sole]
        return self._data.site_xpos[site], self._data.site_xmat[site].reshape(3, 3)
