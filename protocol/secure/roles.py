"""Roles of the secure profile, and what the holder of each may do with a robot.

Everybody whom a robot lists may read: its messages, what it and its controller answer, and who is
there. What else a role may do stands in `RIGHTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

Role = Literal["robot", "controller", "operator", "observer", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)

READS = ("description", "config", "status")
"""What everybody may ask a robot,"""

READS_CONTROLLER = ("about", "show", "tasks")
"""and its controller."""


@dataclass(frozen=True)
class Rights:
    """What a role may do besides reading.

    Attributes:
        ask: verbs that it may ask of the robot.
        control: verbs that it may ask of the robot's controller.
        puts: what it may publish, each on a key that ends in its name.
        answers: whether it may answer for the controller.
    """

    ask: tuple[str, ...] = ()
    control: tuple[str, ...] = ()
    puts: tuple[str, ...] = ()
    answers: bool = False


RIGHTS: dict[Role, Rights] = {
    "robot": Rights(),  # of another robot: none here
    "controller": Rights(
        ask=("acquire", "release"), puts=("setpoint", "sampled/setpoint"), answers=True
    ),
    "operator": Rights(ask=("stop",), control=("acquire", "change", "release"), puts=("targets",)),
    "observer": Rights(),
    "admin": Rights(ask=("recover", "release", "stop")),
}


def may_ask(role: Role, verb: str) -> bool:
    """Whether a role may ask something of a robot."""
    return verb in READS or verb in RIGHTS[role].ask


def roles_that_ask(verb: str, *, controller: bool = False) -> list[Role]:
    """Roles that may ask something of a robot, or of its controller, besides reading."""
    return [
        role
        for role, rights in RIGHTS.items()
        if verb in (rights.control if controller else rights.ask)
    ]
