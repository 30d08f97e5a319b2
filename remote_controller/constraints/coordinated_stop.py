"""Whether a robot can stop in time: margins along a stop in which all joints brake together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.constraint import OUTSIDE, Constraint
from hoap3.remote_controller.model.kinematics import Kinematics

STOP_RESERVE = 1e-4  # m: how far below 0 a margin may be between two looks
STILL = 1e-9  # rad/s² or m/s²: what a joint that may not move brakes with
MOST_LOOKS = 24  # at postures of one stop; a stop that needs more is taken for unsafe
LONGEST_S = 1e3  # of a stop: what takes longer is none


class CoordinatedStop:
    """Looks along q(s) = q + s·Δ, s in [0, 1], the way on which joints come to rest.

    All brake together, in a straight line, at the braking limit a of one: in
    t = max |q̇_i|/a_i, rounded up to whole periods, so Δ = q̇·t/2.

    **How near looks must be.** No joint changes a margin faster than R, the greatest distance of a
    point of the robot from an axis [m/rad], or 1 if prismatic. So along s a margin changes by no
    more than L = Σ R|Δ_i|, and bends by no more than c = L²/R, and for the distance of two bodies
    by L²/d more, d being that of their cores at the limit. Between two looks h apart, with margins
    m and m', it is

        no less than (m + m' − Lh)/2, for it cannot fall faster, and
        no less than min(m, m') − ch²/8, for a curve is no further below its chord; where the
            margin is the least of several, the chord of each is above 0.

    An interval for which neither suffices is halved. At looks a margin must be ≥ 0, and between
    them ≥ −0.1 mm; one that is outside already may not become less. Where none is nearer to its
    limit than L, nothing is looked at. Where one is, joints must come to rest within their ranges,
    too, for the stop is no such stop if one of them has to brake harder.

    Args:
        constraints: all; margins are those of the `conditional` ones.
        description: of the robot.
        kinematics: another one than that of the rows; moved.
        brake: (n,) what joints brake with [rad/s² or m/s²].
        period_s: T [s].
        least, greatest: (n,) ranges that joints keep besides [rad or m].

    Attributes:
        looks: at postures, in the last stop.
    """

    def __init__(
        self,
        constraints: Sequence[Constraint],
        description: RobotDescription,
        kinematics: Kinematics,
        brake: FloatArray,
        period_s: float,
        least: FloatArray | float = -np.inf,
        greatest: FloatArray | float = np.inf,
    ) -> None:
        self._kinematics, self._period_s = kinematics, period_s
        self._brake = np.maximum(brake, STILL)
        self._constraints = [each for each in constraints if each.guarantee == "conditional"]
        self._least, self._greatest = np.zeros((2, description.n))
        self._least[:], self._greatest[:] = least, greatest
        for each in constraints:
            if each.least is not None and each.greatest is not None:
                np.maximum(self._least, each.least, out=self._least)
                np.minimum(self._greatest, each.greatest, out=self._greatest)
        kinds = {joint.name: joint.kind for joint in description.structure.joints}
        mimic_joints = kinematics.mimic_joints
        names = (*description.joint_names, *(mimic_joints.names if mimic_joints else ()))
        slides = np.array([kinds[name] == "prismatic" for name in names])
        robot = reach(kinematics)
        reaches = [each.reach or robot for each in self._constraints]
        self._per_joint = np.array([np.where(slides, 1.0, each) for each in reaches])
        self._per_joint.shape = len(reaches), len(names)
        if mimic_joints is not None:  # |Δ| of a mimic joint is |ratio| times its mimicked joint's
            self._per_joint = self._per_joint @ np.abs(mimic_joints.matrix)
        self._bends = np.array(
            [
                1.0 / most + each.sharpness
                for most, each in zip(reaches, self._constraints, strict=True)
            ]
        )
        sizes = [each.margins.size for each in self._constraints]
        self._ends = np.cumsum([0, *sizes])
        self._floor, self._now = np.zeros((2, self._ends[-1]))
        self._margins = np.zeros((MOST_LOOKS, self._ends[-1]))
        self._way, self._at = np.zeros((2, description.n))
        self._most, self._bent, self._q = np.zeros(0), np.zeros(0), np.zeros(0)
        self._whose = np.repeat(np.arange(len(sizes)), sizes)
        self.looks = 0

    def is_safe(self, q: FloatArray, dq: FloatArray, q_now: FloatArray) -> bool:
        """Whether every margin stays on its side, all the way from a state to rest.

        Args:
            q, dq: (n,) positions and velocities that the stop begins with.
            q_now: (n,) that the constraints were last updated for.
        """
        self.looks = 0
        if not self._constraints:
            return True
        time = self._duration(dq)
        if not time <= LONGEST_S:
            return False
        np.multiply(dq, 0.5 * time, out=self._way)
        most = self._per_joint @ np.abs(self._way)
        first = self._per_joint @ np.abs(q - q_now)
        for place, constraint in enumerate(self._constraints):
            self._now[self._ends[place] : self._ends[place + 1]] = constraint.margins
        np.minimum(self._now, 0.0, out=self._floor)
        self._floor += OUTSIDE
        self._floor[np.isneginf(self._floor)] = 0.0  # of a margin that nobody knows
        if np.all(self._now - (most + first)[self._whose] >= self._floor):
            return True
        rest = q + self._way
        if np.any(rest < np.minimum(self._least, q) + OUTSIDE) or np.any(
            rest > np.maximum(self._greatest, q) - OUTSIDE
        ):
            return False
        self._q = q
        self._most, self._bent = most[self._whose], (self._bends * most**2)[self._whose]
        begin = self._look(0.0)
        if begin < 0:
            return False
        if np.all(self._margins[begin] - self._most >= self._floor):
            return True
        end = self._look(1.0)
        return end >= 0 and self._between(0.0, begin, 1.0, end)

    def accelerations(self, dq: FloatArray, out: FloatArray) -> None:
        """Write q̈ with which a stop from velocities dq begins, (n,); nan where it has no end."""
        time = self._duration(dq)
        brake = -1.0 / max(time, self._period_s) if time <= LONGEST_S else math.nan
        np.multiply(dq, brake, out=out)

    def _duration(self, dq: FloatArray) -> float:
        """How long all joints brake, in whole periods [s]."""
        time = float(np.max(np.abs(dq) / self._brake))
        if not time <= LONGEST_S:
            return math.inf
        return math.ceil(time / self._period_s - 1e-9) * self._period_s

    def _between(self, start: float, begin: int, stop: float, end: int) -> bool:
        """Whether nothing is lost between two looks, by further ones where need be."""
        h, m, n = stop - start, self._margins[begin], self._margins[end]
        far = 0.5 * (m + n - self._most * h) >= self._floor
        below = np.minimum(m, n) - self._bent * (h * h / 8.0)
        if np.all(far | (below >= np.minimum(self._floor, -STOP_RESERVE))):
            return True
        middle = 0.5 * (start + stop)
        found = self._look(middle)
        if found < 0:
            return False
        return self._between(start, begin, middle, found) and self._between(
            middle, found, stop, end
        )

    def _look(self, s: float) -> int:
        """Where the margins at q + s·Δ stand; −1 where one is on the wrong side."""
        if self.looks == MOST_LOOKS:
            return -1
        np.multiply(self._way, s, out=self._at)
        np.add(self._at, self._q, out=self._at)
        self._kinematics.update(self._at)
        found = self._margins[self.looks]
        for place, constraint in enumerate(self._constraints):
            part = found[self._ends[place] : self._ends[place + 1]]
            constraint.margins_at(self._kinematics, part)
        self.looks += 1
        return self.looks - 1 if np.all(found >= self._floor) else -1


def reach(kinematics: Kinematics) -> float:
    """What is further apart than any two frames or centres of mass of links come to be [m].

    It is the sum of the two longest ways outwards from any joint.
    """
    model = kinematics.robot.model
    count = len(model.parents)
    ways: list[list[float]] = [[0.0, 0.0] for _ in range(count)]
    for joint in range(count):
        ways[joint].append(float(np.linalg.norm(model.inertias[joint].lever)))
    for frame in model.frames:
        ways[frame.parentJoint].append(float(np.linalg.norm(frame.placement.translation)))
    longest = 0.0
    for joint in range(count - 1, -1, -1):
        first, second = sorted(ways[joint])[-2:]
        longest = max(longest, first + second)
        if joint > 0:
            mount = float(np.linalg.norm(model.jointPlacements[joint].translation))
            ways[model.parents[joint]].append(mount + second + _slide(model, joint))
    return longest


def _slide(model: object, joint: int) -> float:
    """How far a prismatic joint may move out [m]; 0 of others."""
    at = model.joints[joint]  # type: ignore[attr-defined]
    if "Prismatic" not in at.shortname() and at.shortname()[:-1] != "JointModelP":
        return 0.0
    ends = model.lowerPositionLimit[at.idx_q], model.upperPositionLimit[at.idx_q]  # type: ignore[attr-defined]
    return float(max(abs(ends[0]), abs(ends[1])))
