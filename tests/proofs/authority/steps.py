"""What can happen next: whoever asks, whatever is lost, late or out of order.

A message that is on its way may arrive at any later time, or never. So nothing has to be said of
what is lost: it does not arrive. Requests arrive also of clients that have ended, which may have
sent them before. Replies change nothing in the robot: a client may go by any grant that it was ever
sent, and `properties` looks at each of them in every world.

What the robot then does is the product's own code: `Authority` and `ClientTokens`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from hoap3.protocol.messages import Event, State
from hoap3.robot_emulator.authority import NO_TOKEN, RELEASED, Authority

from .world import DELETED, NAMES, TAKEN, Client, Look, World

GRACE = 1
LEASE = 2
LOOK_TICKS = 1
"""Ticks before a grant begins, between look-ups of its holder, and that one takes at most."""

_REASONS = Event.schema.constants
COMMAND, MISSES, LOST = (
    _REASONS[f"REASON_{name}"] for name in ("COMMAND", "MISSES", "HOLDER_LOST")
)
RESTART = "the robot starts again"
SAME_NAME = " while another robot uses the name"
"""Another robot may come and go at any time: so each request is looked at with and without it."""


class Step(NamedTuple):
    """Something that happens.

    Attributes:
        what: in words.
        after: the world then.
        requests, crashes: how many it takes, of those that there may be.
        told: the client that is sent a grant, or -1.
    """

    what: str
    after: World
    requests: int = 0
    crashes: int = 0
    told: int = -1


def steps(world: World, *, requests: bool, crashes: bool) -> Iterator[Step]:
    """All that can happen, where there may still be requests, or crashes."""
    if requests:
        yield from _requests(world)
    for i in range(len(world.clients)):
        yield from _of_client(world, i, requests=requests, crashes=crashes)
        yield from _of_token(world, i)
    yield from _of_robot(world)
    if crashes:
        yield Step(RESTART, _restart(world), crashes=1)


def _requests(world: World) -> Iterator[Step]:
    for i, name in enumerate(NAMES[: len(world.clients)]):
        yield _acquire(world, i)
        yield _acquire(world, i, unique=False)
        released = _dropped(world, i, RELEASED)
        if released.authority is not world.authority:
            yield Step(f"{name} releases", released, 1)
    stopped = world._replace(authority=world.authority.stop(COMMAND), must_recover=True)
    yield Step("somebody stops the robot", stopped, 1)
    recovered = world._replace(
        authority=world.authority.recover(0, GRACE),
        must_recover=world.must_recover and world.authority.mode != State.STOPPED,
    )
    yield Step("somebody recovers the robot", recovered, 1)


def _acquire(world: World, i: int, *, unique: bool = True) -> Step:
    name, known = NAMES[i], world.tokens()
    present = known.asks(name)
    after, refusal = world.authority.acquire(
        name, present=present, tick=0, from_tick=GRACE, lease=LEASE, unique=unique
    )
    if after.grant != world.authority.grant:
        world = world._replace(late=0)
    world = world.with_tokens(known)._replace(authority=after)
    if refusal == NO_TOKEN:
        world = _look_up(world, i)
    what = f"{name} asks for authority{'' if unique else SAME_NAME}"
    return Step(what, world, 1, told=-1 if refusal else i)


def _dropped(world: World, i: int, reason: int) -> World:
    """A client releases, or is lost."""
    held = world.holder() == i
    return world._replace(
        authority=world.authority.drop(NAMES[i], reason),
        late=0 if held else world.late,
        must_recover=world.must_recover or (held and reason == LOST),
    )


def _look_up(world: World, i: int) -> World:
    """The robot looks a client up, unless it does so already."""
    client = world.clients[i]
    if client.look is not None:
        return world
    return world.with_client(i, client._replace(look=Look(world.taken, client.token, 0)))


def _of_client(world: World, i: int, *, requests: bool, crashes: bool) -> Iterator[Step]:
    """A client ends, and its token after it; it may come back under its name, as a request does."""
    client, name = world.clients[i], NAMES[i]
    if client.alive:
        if crashes:
            yield Step(f"{name} crashes", world.with_client(i, client._replace(alive=False)), 0, 1)
        return
    if client.token:
        gone = client._replace(token=False, went=True)
        yield Step(f"the token of {name} goes", world.with_client(i, gone))
    if requests:
        back = client._replace(alive=True, token=True, came=client.came or not client.token)
        yield Step(f"{name} is back", world.with_client(i, back), 1)


def _of_token(world: World, i: int) -> Iterator[Step]:
    """What reaches the robot of a client's token."""
    client, name = world.clients[i], NAMES[i]
    if client.came:
        known = world.tokens()
        known.take(name, came=True)
        heard = world.with_client(i, client._replace(came=False)).with_tokens(known)
        late = 0 if world.holder() == i else world.late
        yield Step(f"the robot hears that {name} came", heard._replace(late=late))
    if client.went:
        known = world.tokens()
        vanished = known.take(name, came=False)
        heard = world.with_client(i, client._replace(went=False)).with_tokens(known)
        after = _dropped(heard, i, LOST) if vanished else heard
        yield Step(f"the robot hears that {name} went", after)
    look = client.look
    if look is not None:
        known = world.tokens()
        vanished = known.found(name, alive=look.found, taken=look.taken)
        heard = world.with_client(i, client._replace(look=None)).with_tokens(known)
        after = _dropped(heard, i, LOST) if vanished else heard
        yield Step(f"the robot learns that {name} was {'' if look.found else 'not '}there", after)


def _of_robot(world: World) -> Iterator[Step]:
    authority = world.authority
    if authority.mode == State.ACTIVE:
        missed = world._replace(authority=authority.stop(MISSES), must_recover=True)
        yield Step("too many answers are missing", missed)
    if authority.mode == State.STOPPING:
        yield Step("the robot is at rest", world._replace(authority=authority.come_to_rest()))
    if all(c.look is None or c.look.age < LOOK_TICKS for c in world.clients):
        yield Step("a tick", _tick(world))


def _tick(world: World) -> World:
    """One period, in the order of the robot's loop: look after the holder, begin a grant."""
    authority, holder = one_tick_on(world.authority), world.holder()
    late = world.late + 1 if holder >= 0 and not world.clients[holder].token else 0
    clients = tuple(
        c._replace(look=c.look._replace(age=c.look.age + 1)) if c.look else c for c in world.clients
    )
    world = world._replace(clients=clients, late=late)
    if authority.to_look_up(0) is not None:
        world = _look_up(world, holder)
        authority = authority.looked_up(0, LEASE)
    return world._replace(authority=authority.begin(0))


def one_tick_on(authority: Authority) -> Authority:
    """The same, told from the next tick."""
    grant = authority.grant
    if grant is not None:
        grant = replace(grant, from_tick=max(grant.from_tick - 1, 0))
    return replace(authority, grant=grant, look_tick=max(authority.look_tick - 1, 0))


def _restart(world: World) -> World:
    """A new process of the robot: it knows nothing, and hears of all tokens that are there."""
    clients = tuple(Client(c.alive, c.token, came=c.token) for c in world.clients)
    return World(Authority(), TAKEN, DELETED, clients, 0, False)
