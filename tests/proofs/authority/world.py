"""A robot, its clients and all that is on its way between them, as one value.

Time is told from the present tick, epochs by their order, and numbers of samples by what comparing
them says: states that differ in nothing that any step looks at are one. So are those that differ in
the names of clients.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

from hoap3.protocol.link.client_tokens import ClientTokens
from hoap3.protocol.messages import Event
from hoap3.robot_emulator.authority import Authority

NAMES = "abcd"
UNSEEN = -1
LATCHED = Event.schema.constants["REASON_COMMAND"]
DELETED, TAKEN = 1, 2
"""Samples in a canonical world: as many, and no more, as comparisons need."""


class Look(NamedTuple):
    """A look-up of a client's token that is on its way.

    Attributes:
        taken: samples that were taken when it began.
        found: whether the token was there.
        age: ticks since.
    """

    taken: int
    found: bool
    age: int


class Client(NamedTuple):
    """One client, what is on its way from it, and what the robot knows of it.

    What it was told is not noted: it may go by any grant that it ever got, at any time.

    Attributes:
        alive: whether its process runs.
        token: whether the network holds its liveliness token.
        came, went: samples of it that may still reach the robot.
        seen: when the robot saw the token last, as `ClientTokens` counts; `UNSEEN`.
        asked: whether it asked for authority, as `ClientTokens` has it; of the holder alone, as
            nothing comes of it for others, and who asks again is noted again.
        look: the robot's look-up of it, or None.
    """

    alive: bool = True
    token: bool = True
    came: bool = True
    went: bool = False
    seen: int = UNSEEN
    asked: bool = False
    look: Look | None = None


class World(NamedTuple):
    """Everything.

    Attributes:
        authority: of the robot; its tick is 0.
        taken, deleted: as `ClientTokens` has them.
        clients: named "a", "b", ….
        late: ticks for which the holder's token has been gone, since the last news of it.
        must_recover: whether the robot may not move before somebody recovers it.
    """

    authority: Authority
    taken: int
    deleted: int
    clients: tuple[Client, ...]
    late: int
    must_recover: bool

    def holder(self) -> int:
        """Place of the client that has authority, or -1."""
        grant = self.authority.grant
        return NAMES.index(grant.holder) if grant is not None else -1

    def tokens(self) -> ClientTokens:
        """The product's own bookkeeping, as it stands."""
        known = ClientTokens()
        for name, client in zip(NAMES, self.clients, strict=False):
            if client.seen != UNSEEN:
                known.seen[name] = client.seen
            if client.asked:
                known.asked[name] = 0
        known.taken, known.deleted = self.taken, self.deleted
        return known

    def with_tokens(self, known: ClientTokens) -> World:
        """The same after the bookkeeping has gone on."""
        clients = tuple(
            client._replace(seen=known.seen.get(name, UNSEEN), asked=name in known.asked)
            for name, client in zip(NAMES, self.clients, strict=False)
        )
        return self._replace(clients=clients, taken=known.taken, deleted=known.deleted)

    def with_client(self, i: int, client: Client) -> World:
        """The same, but for one client."""
        return self._replace(clients=(*self.clients[:i], client, *self.clients[i + 1 :]))


def first_world(clients: int) -> World:
    """The robot has just started, and no token has been seen yet."""
    return World(Authority(), TAKEN, DELETED, (Client(),) * clients, 0, False)


def canonical(world: World) -> World:
    """The one value that stands for all worlds in which the same can happen."""
    holder = world.holder()
    deleted = world.deleted
    clients = [_client(c, deleted, i == holder) for i, c in enumerate(world.clients)]
    order = sorted(range(len(clients)), key=lambda i: (i != holder, _signature(clients[i])))
    return World(
        _plain(world.authority, NAMES[order.index(holder)] if holder >= 0 else ""),
        TAKEN,
        DELETED,
        tuple(clients[i] for i in order),
        world.late,
        world.must_recover,
    )


@cache
def _client(client: Client, deleted: int, holds: bool) -> Client:
    """One of them, with what comparisons of numbers of samples say, instead of the numbers.

    Only two are ever made: of the last end that was heard of with the begin of a look-up that found
    a token, and of when a token was seen with the begin of one that did not.
    """
    look = client.look
    seen = UNSEEN if client.seen == UNSEEN else 0
    if look is not None and look.found:
        look = look._replace(taken=DELETED if deleted <= look.taken else 0)
    elif look is not None:
        seen = TAKEN if client.seen > look.taken else seen
        look = look._replace(taken=DELETED)
    return client._replace(seen=seen, look=look, asked=client.asked and holds)


@cache
def _signature(client: Client) -> tuple[object, ...]:
    return (*client[:6], client.look or ())


@cache
def _plain(authority: Authority, holder: str) -> Authority:
    """With epochs by their order, where 0 stays, and another name of the holder.

    Of reasons that latch one stands for all, and without a holder nobody is looked up.
    """
    grant = authority.grant
    epochs = {0, authority.granted, authority.followed, grant.epoch if grant else 0}
    rank = {epoch: place for place, epoch in enumerate(sorted(epochs))}
    return replace(
        authority,
        stop_reason=LATCHED if authority.latched else authority.stop_reason,
        look_tick=authority.look_tick if grant else 0,
        granted=rank[authority.granted],
        followed=rank[authority.followed],
        grant=grant and replace(grant, epoch=rank[grant.epoch], holder=holder),
    )
