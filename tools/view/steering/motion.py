"""The targets that a page moves, and when they have to stop: no network and no clock in it.

While a page drags or drives a target, it sends a sign of life every 25 ms. Without one for 120 ms
these targets are held. A target whose pose was entered goes on, as one of a planner would, until
the page has been silent for 2 s or is closed: then it is held too, and the page steers no longer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.tools.picture.poses import Poses
from hoap3.tools.services.sent import check_limits
from hoap3.tools.view.picture.config_scene import Steered
from hoap3.tools.view.picture.frame import Frames, finite
from hoap3.tools.view.picture.targets import present
from hoap3.tools.view.steering.hold import (
    conjugate,
    multiplied,
    of_rotation_vector,
    rest_of,
    rotation_vector,
)

SILENT_S = 0.12  # without a sign of life, after which what moves is held
LEASE_S = 2.0  # and after which the page steers no longer
DRIVE_S = 0.15  # how long a velocity counts
LEAD_S = 0.5  # by how much a target that is driven may be ahead of the robot, at full speed


class Motion:
    """Targets that one page moves.

    What is known of the robot may become something else, such as other targets of a controller that
    begins anew. Whatever the page moved before then counts no longer.

    Args:
        frames: gives what is known of the robot.
        state: gives its newest State, or None.

    Attributes:
        asked: numbers of each target that was moved, as they were sent last.
    """

    def __init__(self, frames: Callable[[], Frames], state: Callable[[], State | None]) -> None:
        self._told, self._state = frames, state
        self._frames = frames()
        self._poses = Poses(self._frames.description)  # the frames' own show another State
        self._due: dict[str, list[float]] = {}
        self._moved: set[str] = set()  # since the last hold
        self._placed: set[str] = set()  # of these the pose was entered
        self._driven: dict[str, tuple[list[float], float]] = {}  # rates, and until when
        self._stepped = self._heard = 0.0
        self.asked: dict[str, list[float]] = {}

    @property
    def moves(self) -> bool:
        """Whether something may still move by the page's hand."""
        return bool(self._moved or self._driven)

    @property
    def waits(self) -> bool:
        """Whether something is still to be sent."""
        return bool(self._due)

    def begin(self, now_s: float) -> None:
        """A page steers from now on."""
        frames = self._told()
        if frames is not self._frames:
            self._frames, self._poses = frames, Poses(frames.description)
        self.forget_motion()
        self._placed.clear()
        self.asked.clear()
        self._heard = self._stepped = now_s

    def forget_motion(self) -> None:
        """Send nothing more; `hold` still knows entered poses, until a stop is confirmed."""
        self._due.clear()
        self._moved.clear()
        self._driven.clear()

    def beat(self, now_s: float) -> None:
        """The page lives."""
        self._heard = now_s

    def is_gone(self, now_s: float) -> bool:
        """Whether the page has been silent for so long that it steers no longer."""
        return now_s - self._heard > LEASE_S

    def drag(self, name: object, values: object, now_s: float) -> None:
        """Take where a target shall be.

        Raises:
            UsageError: no such target, or not its numbers.
        """
        self._moved.add(self._take(name, values))
        self._heard = now_s

    def place(self, name: object, values: object, now_s: float) -> None:
        """Accept an entered pose of a target, which it goes to without signs of life of the page.

        Raises:
            UsageError: no such target, or not its numbers.
            BadProblemError: they are outside its limits; names the number and the limits.
        """
        target = self._target(name)
        point = np.array([_numbers(values, target.dimension, "values")])
        check_limits(point, {**target.told, "name": target.name})
        name = self._take(name, values)
        self._moved.discard(name)
        self._placed.add(name)
        self._heard = now_s

    def drive(self, name: object, rates: object, now_s: float) -> None:
        """Take how fast a target shall move, for 150 ms: m/s, rad/s or rad/s of joints.

        Raises:
            UsageError: no such target, or not its rates.
        """
        target = self._target(name)
        wanted = _numbers(rates, target.rates, "values")
        speeds = target.told.get("speed")
        if isinstance(speeds, list) and len(speeds) == len(wanted):
            limits = zip(wanted, speeds, strict=True)
            wanted = [min(max(rate, -abs(most)), abs(most)) for rate, most in limits]
        self._placed.discard(target.name)
        if target.name not in self._driven:
            self.asked.pop(target.name, None)  # it begins where the robot is
            self._stepped = max(self._stepped, now_s)
        self._driven[target.name] = wanted, now_s + DRIVE_S
        self._heard = now_s

    def hold(self, *, placed: bool = False) -> None:
        """Bring to rest what is dragged or driven, and with `placed` also entered poses."""
        self._meet()
        names = self._moved | self._driven.keys()
        if placed:
            names |= self._placed
            self._placed.clear()
        self._moved.clear()
        self._driven.clear()
        self._due = {name: each for name, each in self._due.items() if name not in names}
        state = self._fitting()
        for target in self._frames.targets:
            if target.name in names and state is not None:
                rest = rest_of(target, state, self._poses, self.asked.get(target.name))
                if rest is not None:
                    self._send(target.name, rest)

    def step(self, now_s: float) -> dict[str, list[float]]:
        """What is to be sent now, by target; holds first where the page has fallen silent."""
        self._meet()
        over = any(until < now_s for _, until in self._driven.values())
        if self.moves and (over or now_s - self._heard > SILENT_S):
            self.hold()
        dt, self._stepped = max(now_s - self._stepped, 0.0), now_s
        state = self._fitting() if self._driven else None
        if state is not None:
            self._poses.update(state.reference, state.base)
            for name, (rates, _) in self._driven.items():
                self._advance(self._target(name), rates, min(dt, DRIVE_S), state)
        due, self._due = self._due, {}
        return due

    def _advance(self, target: Steered, rates: Sequence[float], dt: float, state: State) -> None:
        """Move a target on by its rates, from where it was asked to be, or from where it is."""
        here = present(target, self._poses, state.reference)
        if here is None:
            return
        start = self.asked.get(target.name, here)
        plain = {"frame_orientation": 0, "frame_pose": 3}.get(target.kind, len(here))
        ahead = [a + rate * dt for a, rate in zip(start[:plain], rates[:plain], strict=True)]
        ahead = [
            min(max(value, at - lead), at + lead)
            for value, at, lead in zip(ahead, here, self._leads(target), strict=False)
        ]
        if plain < len(here):
            now, before = np.array(here[plain:]), np.array(start[plain:])
            turn = np.array(rates[plain:]) * dt
            next_ = multiplied(of_rotation_vector(turn), before)
            away = float(np.linalg.norm(rotation_vector(multiplied(next_, conjugate(now)))))
            turned = next_ if away <= max(self._leads(target)[plain:]) else before
            ahead += (turned / np.linalg.norm(turned)).tolist()
        self._send(target.name, ahead)

    def _leads(self, target: Steered) -> list[float]:
        """How far each number may be ahead of where the robot is."""
        speeds = target.told.get("speed")
        if not isinstance(speeds, list):
            return [math.inf] * target.rates
        return [LEAD_S * abs(float(speed)) for speed in speeds]

    def _take(self, name: object, values: object) -> str:
        target = self._target(name)
        numbers = _numbers(values, target.dimension, "values")
        self._driven.pop(target.name, None)
        self._placed.discard(target.name)
        self._send(target.name, numbers)
        return target.name

    def _send(self, name: str, values: list[float]) -> None:
        self._due[name] = self.asked[name] = values

    def _meet(self) -> None:
        """Begin anew where the robot or its controller is another one than before."""
        if self._told() is not self._frames:
            self.begin(self._heard)

    def _target(self, name: object) -> Steered:
        self._meet()
        targets = self._frames.targets
        for target in targets:
            if target.name == name:
                return target
        known = ", ".join(target.name for target in targets) or "none"
        raise UsageError(f"no live target is called {name!r:.60}; there are {known}")

    def _fitting(self) -> State | None:
        """The newest State, if it is of the robot that is known, and says how that moves."""
        state = self._state()
        if state is None or not self._frames.fits(state):
            return None
        rate = state.reference_rate if state.reference_rate.size else state.dq
        return state if finite(state.reference, rate) else None


def _numbers(given: object, count: int, what: str) -> list[float]:
    """So many finite numbers.

    Raises:
        UsageError: they are not.
    """
    fits = isinstance(given, list) and len(given) == count
    if not isinstance(given, list) or not fits or not all(map(_finite, given)):
        raise UsageError(f"{what} must be {count} finite numbers (found {given!r:.60})")
    return [float(each) for each in given]


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9
