"""What the numbers of a live target are: plain ones, and an orientation behind them, or none."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray

UNIT = 1e-3  # how far from 1 the length of a quaternion may be
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


class Space:
    """Plain numbers, and where it `turns`, a unit quaternion (x, y, z, w) behind them.

    A state, (3, numbers), is where a target is, its velocity and its acceleration; those of an
    orientation are ω and dω/dt in the axes that it is given in, and a 0 behind them. Coordinates,
    (3, dimension), are the same with the rotation vector from an anchor and its derivatives: where
    the state is the anchor itself, that is 0, ω and dω/dt.

    Args:
        plain: how many plain numbers.
        turns: whether an orientation stands behind them.

    Attributes:
        numbers: of a point.
        dimension: degrees of freedom; numbers of a velocity.
    """

    def __init__(self, plain: int, *, turns: bool = False) -> None:
        from hoap3.remote_controller.references.live import turn_kernels as kernels

        self._kernels = kernels
        self.plain, self.turns = plain, turns
        self.numbers, self.dimension = plain + 4 * turns, plain + 3 * turns
        self.place = plain if turns else -1
        self._identity = np.zeros(self.numbers)
        self._identity[plain:] = IDENTITY[: 4 * turns]
        self._work = np.zeros((3, self.dimension))

    def coordinates(self, anchor: FloatArray, state: FloatArray) -> FloatArray:
        """A state as seen from a point, (numbers,): of both ways round to it the shorter one."""
        if not self.turns:
            return state
        found = np.zeros((3, self.dimension))
        found[:, : self.plain] = state[:, : self.plain]
        self._kernels.to_vector(anchor[self.plain :], state, self.plain, found)
        return found

    def state(self, anchor: FloatArray, coordinates: FloatArray, out: FloatArray) -> None:
        """Write the state that coordinates say."""
        out[:, : self.plain] = coordinates[:, : self.plain]
        if self.turns:
            self._kernels.from_vector(anchor[self.plain :], coordinates, self.plain, out)

    def point(self, present: FloatArray) -> FloatArray:
        """The point, (numbers,), of what a task reads, (dimension,), with a rotation vector."""
        state = np.zeros((3, self.numbers))
        self._work[:] = 0.0
        self._work[0] = present
        self.state(self._identity, self._work, state)
        found: FloatArray = state[0].copy()
        return found

    def give(self, state: FloatArray, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write what a task aims at, (dimension,), with a rotation vector, and its rate."""
        found = self.coordinates(self._identity, state)
        position_out[:], velocity_out[:] = found[0], found[1]

    def unit(self, points: FloatArray) -> bool:
        """Whether the quaternions of points, (p, numbers), have length 1, nearly."""
        lengths = np.linalg.norm(points[:, self.plain :], axis=1)
        return not self.turns or bool((np.abs(lengths - 1.0) <= UNIT).all())

    def curve(self, points: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and rates as a curve through them takes these, (p, numbers) each.

        Quaternions have length 1, each the one of the two that is nearer to that before; their
        rates are ½ω ⊗ q.

        Args:
            points: (p, numbers).
            rates: (p, dimension), or empty.
        """
        if not self.turns:
            return points, rates
        found, plain = points.copy(), self.plain
        q = found[:, plain:]
        q /= np.linalg.norm(q, axis=1)[:, None]
        sides = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(sides)[:, None]
        if not rates.size:
            return found, np.zeros((0, self.numbers))
        speeds, omega = np.zeros_like(found), rates[:, plain:]
        speeds[:, :plain] = rates[:, :plain]
        speeds[:, plain:-1] = 0.5 * (q[:, 3:] * omega + np.cross(omega, q[:, :3]))
        speeds[:, -1] = -0.5 * (omega * q[:, :3]).sum(1)
        return found, speeds

    def look(self, curve: FloatArray) -> None:
        """Make of a curve's position and its derivatives, (4, numbers), a state and its jerk."""
        if self.turns:
            self._kernels.normalise(curve, self.plain)

    def within(self, points: FloatArray, around: FloatArray, most_rad: float) -> bool:
        """Whether no orientation of points is further than an angle from another, (4,)."""
        cosines = np.abs(points[:, self.plain :] @ around) if self.turns else np.ones(1)
        lengths = np.linalg.norm(points[:, self.plain :], axis=1) if self.turns else 1.0
        return bool((cosines >= np.cos(0.5 * most_rad) * lengths).all())
