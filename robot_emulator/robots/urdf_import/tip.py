"""What a robot does whose file names no task: its tip moves a little, to where it can be.

The tip is the tool: a link called `tcp`, `tool0`, `tool`, `flange` or `ee`, or else the one with
the most joints above it; joints of a gripper do not count: sliders, mimic joints and their mimicked
joints at the end of a chain. A target is where the tip comes to when
joints above it turn a little, each away from its nearer limit: so there is a posture in which it is
there, all limits kept, even where the arm is stretched out, or has one joint only. All joints turn
together first; then one alone, from the base on. The first target is taken that a walker arrives
at that turns, at each step, the one joint that brings the tip nearest, and gives up at a limit: so
a controller that turns few joints, and knows no limits, comes there too.
"""

from __future__ import annotations

import re
from collections import Counter
from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import DefaultTask, RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.protocol.robot.urdf import UrdfStructure
from hoap3.robot_emulator.robots.urdf_import.figures import triple

TOOLS = ("tcp", "tool0", "tool", "flange", "ee")  # words in the names of tools, the likeliest first
SHARE_OF_ARM = 3  # joints of a chain for each of its arm, at most
GRIP_M = 0.12  # most travel of a finger that slides
SHARE_OF_REACH = 0.05  # of the chain's reach: far enough to be seen, near enough to be quick
SEEN_M = 0.01  # at least, however short the chain is
LEAST_MOVE_M = 1e-3  # a tip that moves less is none
MOST_TURN = 1.0  # rad: of each revolute joint
SHARE_OF_ROOM = 0.5  # of a joint's room to its farther limit that may be used
PARTS = 1000  # in which that is tried
STEPS = 400  # of the walker
STEP = 0.02  # rad or m, at most
NEAR_M = 5e-4
DIGITS = 6  # of the target [m]
ROUNDED = 1.001  # times as far as asked for: what rounding to these digits cannot spoil


def chains(structure: UrdfStructure) -> dict[str, tuple[str, ...]]:
    """By link, the moving joints above it, from the root on."""
    above: dict[str, tuple[str, ...]] = {structure.root: ()}
    waiting = list(structure.joints)
    while waiting:  # a joint may stand before the one that carries it
        later = []
        for joint in waiting:
            if joint.parent in above:
                own = (joint.name,) if joint.name in structure.moved else ()
                above[joint.child] = above[joint.parent] + own
            else:
                later.append(joint)
        waiting = later
    return above


def candidates(structure: UrdfStructure) -> list[str]:
    """Links that move, the likeliest tool first; ties as in the file."""
    above = chains(structure)
    grips = _gripper_joints(structure)
    arms = {link: _arm(joints, grips) for link, joints in above.items()}
    longest = max(map(len, arms.values()))
    firsts = [joints[len(arms[link])] for link, joints in above.items() if joints != arms[link]]
    carriers = {structure.moved[joint].parent for joint in firsts}

    def order(link: str) -> tuple[bool, int, bool, int, bool]:
        is_finger, rank = above[link] != arms[link], _tool_rank(link)
        is_named = rank < len(TOOLS) and not is_finger and 2 * len(above[link]) > longest
        return not is_named, -len(arms[link]), is_finger, rank, link not in carriers

    return sorted((link for link in structure.links if above[link]), key=order)


def _tool_rank(link: str) -> int:
    """Return the place among `TOOLS` of what a link's name says, or their number."""
    words = set(re.split(r"[^a-z0-9]+", re.sub(r"end_?effector|eef", "ee", link.lower())))
    return next((i for i, tool in enumerate(TOOLS) if tool in words), len(TOOLS))


def _gripper_joints(structure: UrdfStructure) -> set[str]:
    """Return joints of grippers: short sliders, mimic joints, and mimicked ones that branch."""
    moved, mimicked = structure.moved, {each.mimicked for each in structure.mimic_joints.values()}
    beside = Counter(joint.parent for joint in moved.values())
    return {
        name
        for name, joint in moved.items()
        if joint.mimic is not None
        or (name in mimicked and beside[joint.parent] > 1)
        or (joint.kind == "prismatic" and (joint.upper or 0.0) - (joint.lower or 0.0) <= GRIP_M)
    }


def _arm(joints: tuple[str, ...], grips: set[str]) -> tuple[str, ...]:
    """Return the joints of a chain without those of a gripper at its end, if an arm is left."""
    arm = max((i for i, name in enumerate(joints, 1) if name not in grips), default=0)
    return joints[:arm] if SHARE_OF_ARM * arm > len(joints) else joints


def default_task(robot: RobotDescription, tip: str | None = None) -> DefaultTask | None:
    """Return a small motion of the tip, as seen from the root; None where no tip can be moved.

    Args:
        robot: whose tip.
        tip: the link; None: the likeliest tool that can move far enough, else the one that moves
            furthest.

    Raises:
        ConfigError: the robot has no such link, or no joint moves its origin.
    """
    structure = robot.structure
    above = chains(structure)
    dynamics = Dynamics(robot)
    nearer: tuple[float, str, FloatArray] | None = None  # than it should be moved
    for link in candidates(structure):
        mimic_joints = structure.mimic_joints
        joints = [
            mimic_joints[name].mimicked if name in mimic_joints else name for name in above[link]
        ]
        if tip not in {None, link}:
            continue
        walker = _Tip(robot, dynamics, link, joints)
        move = walker.small_move()
        if move is None:
            continue
        length = float(np.linalg.norm(move))
        if length >= walker.far:
            return _task(robot, link, move)
        if nearer is None or length > nearer[0]:
            nearer = length, link, move
    if tip is not None and nearer is None:
        others = [link for link in candidates(structure) if link != tip]
        remedy = one_of(tip, others, "Links that joints move")
        raise ConfigError("--tip", "", tip, "is no link whose origin a joint moves", remedy)
    return None if nearer is None else _task(robot, *nearer[1:])


def _task(robot: RobotDescription, link: str, move: FloatArray) -> DefaultTask:
    x, y, z = np.round(move, DIGITS).tolist()
    return DefaultTask(point=link, reference=robot.structure.root, move_m=(x, y, z))


class _Tip:
    """A link, and how the joints with a setpoint that are above it move it.

    Args:
        robot, dynamics: what it belongs to.
        link: the tip.
        joints: above it, from the root on.
    """

    def __init__(
        self, robot: RobotDescription, dynamics: Dynamics, link: str, joints: list[str]
    ) -> None:
        self._dynamics = dynamics
        self._carrier, self._placed = dynamics.carrier(link)
        self._movers = dynamics.movers(link)
        self._joints = [robot.joint_names.index(name) for name in dict.fromkeys(joints)]
        self._start = np.array(robot.initial_position)
        self._lower, self._upper = np.array(robot.lower), np.array(robot.upper)
        self.far = ROUNDED * max(SEEN_M, SHARE_OF_REACH * reach(robot, link))
        moved = robot.structure.moved
        slides = [moved[name].kind == "prismatic" for name in robot.joint_names]
        self._most = np.where(slides, self.far, MOST_TURN)
        self._here = self.place(self._start)

    def small_move(self) -> FloatArray | None:
        """Return one of length `far` that the walker arrives at, else the best there is, (3,) [m].

        None where joints do not move it.
        """
        best = np.zeros(3)
        for turn in self._turns():
            move, longest = self._move(turn), float(np.linalg.norm(best))
            if (length := float(np.linalg.norm(move))) >= self.far and self._arrives(move):
                return move
            if length > longest and longest < self.far:
                best = move
        return best if np.linalg.norm(best) >= LEAST_MOVE_M else None

    def place(self, q: FloatArray) -> FloatArray:
        """Where it is, as seen from the root, (3,) [m]."""
        self._dynamics.place(q, np.zeros(self._dynamics.n))
        rotation, origin = self._dynamics.placement(self._carrier)
        return np.asarray(origin + rotation @ self._placed[:, 3])

    def jacobian(self, place: FloatArray) -> FloatArray:
        """How it moves with the joints where `place` has put them, (3, n)."""
        dynamics = self._dynamics
        columns = dynamics.joint_jacobian[:, dynamics.robot.order] * self._movers
        full = columns[:3] + np.cross(columns[3:], place, axis=0)
        if dynamics.mimic_joints is None:
            return np.asarray(full)
        out = np.zeros((3, dynamics.n))
        dynamics.mimic_joints.columns(full, out)
        return out

    def _turns(self) -> list[FloatArray]:
        """How far the joints may turn: all of them, and then each alone, (n,) each."""
        up, down = self._upper - self._start, self._start - self._lower
        most = np.minimum(self._most, SHARE_OF_ROOM * np.maximum(up, down))
        most *= np.where(up >= down, 1.0, -1.0)
        alone = [most * (np.arange(len(most)) == joint) for joint in self._joints]
        return [np.sum(alone, axis=0), *alone]

    def _move(self, turn: FloatArray) -> FloatArray:
        """How it moves with the first part of a turn that is enough, else at most, (3,) [m]."""
        move = np.zeros(3)
        for part in np.linspace(0.0, 1.0, PARTS + 1)[1:]:
            further = self.place(self._start + part * turn) - self._here
            move = max(move, further, key=np.linalg.norm)
            if np.linalg.norm(move) >= self.far:
                break
        return move

    def _arrives(self, move: FloatArray) -> bool:
        """Whether the walker comes there."""
        q, target = self._start.copy(), self._here + move
        for _ in range(STEPS):
            place = self.place(q)
            error = target - place
            if np.linalg.norm(error) < NEAR_M:
                return True
            jacobian = self.jacobian(place)
            gain = error @ jacobian
            joint = int(np.abs(gain).argmax())
            if not gain[joint]:
                return False
            step = gain[joint] / (jacobian[:, joint] @ jacobian[:, joint])
            q[joint] += np.clip(step, -STEP, STEP)
            if not self._lower[joint] <= q[joint] <= self._upper[joint]:
                return False
        return False


def reach(robot: RobotDescription, link: str) -> float:
    """Return the length of the chain from its first moving joint to a link [m].

    That is the distance along the origins of its joints, and the travel of its prismatic joints.
    """
    offsets = {
        str(joint.get("name")): triple(joint.find("origin"), "xyz", "URDF", 0.0)
        for joint in ET.fromstring(robot.urdf).findall("joint")  # noqa: S314 - checked before
    }
    carrier = {joint.child: joint for joint in robot.structure.joints}
    length = passed = 0.0
    while link in carrier:
        joint = carrier[link]
        if joint.name in robot.structure.moved:
            if joint.kind == "prismatic":
                passed += (joint.upper or 0.0) - (joint.lower or 0.0)
            length = passed
        passed += float(np.linalg.norm(offsets[joint.name]))
        link = joint.parent
    return length
