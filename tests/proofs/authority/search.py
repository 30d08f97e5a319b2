"""Every world that the first one can lead to, the nearest first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from .properties import wrong_authority, wrong_step, wrong_world
from .steps import Step, steps
from .world import World, canonical, first_world

Progress = Callable[[int], None]


class Left(NamedTuple):
    """How many requests and crashes there may still be."""

    requests: int
    crashes: int


Node = tuple[World, Left]


@dataclass(frozen=True)
class Found:
    """What a search came to.

    Attributes:
        worlds: how many there are, up to the names of clients.
        transitions: how many steps were looked at.
        depth: steps to the farthest world.
        wrong: what does not hold, or "".
        story: the steps that lead there.
    """

    worlds: int
    transitions: int
    depth: int
    wrong: str = ""
    story: tuple[str, ...] = ()


def search(
    clients: int = 3, requests: int = 6, crashes: int = 2, progress: Progress | None = None
) -> Found:
    """Look at every world that can come to be, until something does not hold.

    A world that was reached with as many requests and crashes to come, or more, is not looked at
    again: nothing new can come of it.

    Args:
        clients: how many there are.
        requests: how many the robot serves, of any of them.
        crashes: of clients, and of the robot.
        progress: is told now and then how many worlds were found.
    """
    wrong_authority.cache_clear()
    first = canonical(first_world(clients)), Left(requests, crashes)
    reached: dict[World, tuple[Left, ...]] = {first[0]: (first[1],)}
    origins: dict[Node, tuple[Node, str]] = {}
    layer, transitions, depth = [first], 0, 0
    while layer:
        following: list[Node] = []
        for node in layer:
            world, left = node
            for step in steps(world, requests=left.requests > 0, crashes=left.crashes > 0):
                transitions += 1
                rest = Left(left.requests - step.requests, left.crashes - step.crashes)
                after = canonical(step.after)
                wrong = wrong_step(world, step)
                known = reached.get(after, ())
                if not wrong and any(_as_much(more, rest) for more in known):
                    continue
                wrong = wrong or _wrong(after, step)
                if wrong:
                    story = (*_story(origins, node), step.what)
                    return Found(len(reached), transitions, depth + 1, wrong, story)
                reached[after] = (*(less for less in known if not _as_much(rest, less)), rest)
                origins[after, rest] = node, step.what
                following.append((after, rest))
        if progress is not None:
            progress(len(reached))
        layer, depth = following, depth + 1 if following else depth
    return Found(len(reached), transitions, depth)


def _wrong(after: World, step: Step) -> str:
    return wrong_world(after) or wrong_authority(step.after.authority)


def _as_much(more: Left, less: Left) -> bool:
    return more.requests >= less.requests and more.crashes >= less.crashes


def _story(origins: dict[Node, tuple[Node, str]], node: Node) -> tuple[str, ...]:
    """What happened up to a node; clients have the names of the world in which it happened."""
    told: list[str] = []
    while node in origins:
        node, what = origins[node]
        told.append(what)
    return tuple(reversed(told))
