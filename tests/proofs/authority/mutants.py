"""Faults planted into the product's own classes, one at a time: the search must find each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

from hoap3.protocol.link.client_tokens import ClientTokens
from hoap3.protocol.messages import State
from hoap3.remote_controller.claim import Claim
from hoap3.robot_emulator.authority import Authority, Grant

from .search import Found, search

_acquire, _drop, _stop = Authority.acquire, Authority.drop, Authority.stop
_recover, _begin, _rest = Authority.recover, Authority.begin, Authority.come_to_rest


class Mutant(NamedTuple):
    """A fault: what it is, which attribute of which class becomes what, and clients it takes."""

    what: str
    owner: type
    name: str
    planted: Any
    clients: int = 1


def _without_token(self: Authority, who: str, **given: Any) -> Any:
    return _acquire(self, who, **{**given, "present": True})


def _of_two_robots(self: Authority, who: str, **given: Any) -> Any:
    return _acquire(self, who, **{**given, "unique": True})


def _to_anybody(self: Authority, who: str, **given: Any) -> Any:
    after, refusal = _acquire(self, who, **given)
    if after.grant is None or not given["present"]:
        return after, refusal
    return replace(after, grant=replace(after.grant, holder=who)), ""


def _same_epoch(self: Authority, who: str, **given: Any) -> Any:
    after, refusal = _acquire(self, who, **given)
    if self.grant is None and after.grant is not None:
        after = replace(after, granted=1, grant=Grant(1, who, after.grant.from_tick))
    return after, refusal


def _by_anybody(self: Authority, who: str, reason: int) -> Authority:
    return _drop(self, self.grant.holder if self.grant else who, reason)


def _moves_on(self: Authority, who: str, _reason: int) -> Authority:
    held = self.grant is not None and self.grant.holder == who
    return replace(self, grant=None) if held else self


def _weakened(self: Authority, reason: int) -> Authority:
    return _stop(replace(self, stop_reason=0), reason)


def _unlatched(self: Authority) -> Authority:
    return replace(_rest(self), mode=State.IDLE, stop_reason=0)


def _recovered_for_later(self: Authority, tick: int, from_tick: int) -> Authority:
    return _recover(self, tick, from_tick + 1_000_000)


def _still_latched(self: Authority, tick: int, from_tick: int) -> Authority:
    return replace(_recover(self, tick, from_tick), mode=self.mode)


def _old_epoch(self: Authority, tick: int) -> Authority:
    after = _begin(self, tick)
    return after if after is self else replace(after, followed=max(after.followed - 1, 1))


def _unheard(_self: ClientTokens, _who: str, **_given: Any) -> bool:
    return False


def _impatient(self: Claim, session_id: int, _mode: int, epoch: int, from_tick: int) -> Claim:
    if session_id != self.session_id:
        return replace(self, stale=True)
    return self.doubt(epoch not in (0, self.epoch) or (epoch != self.epoch and from_tick == 0))


def _from_tick(self: Authority) -> int:
    return self.grant.from_tick if self.grant is not None else 0


MUTANTS = (
    Mutant("a grant without a token", Authority, "acquire", _without_token),
    Mutant("a grant while another robot uses the name", Authority, "acquire", _of_two_robots),
    Mutant("a grant beside another", Authority, "acquire", _to_anybody, 2),
    Mutant("an epoch that comes back", Authority, "acquire", _same_epoch),
    Mutant("a release by anybody", Authority, "drop", _by_anybody, 2),
    Mutant("no stop when the holder is lost", Authority, "drop", _moves_on),
    Mutant("a stop weakened by a release", Authority, "stop", _weakened),
    Mutant("no latch", Authority, "come_to_rest", _unlatched),
    Mutant("a recovery that never begins", Authority, "recover", _recovered_for_later),
    Mutant("a recovery that stays stopped", Authority, "recover", _still_latched),
    Mutant("a motion under an old epoch", Authority, "begin", _old_epoch),
    Mutant("no look-up of the holder", Authority, "to_look_up", lambda _self, _tick: None),
    Mutant("a look-up that nobody heeds", ClientTokens, "found", _unheard),
    Mutant("a grant of another session", Claim, "fits", lambda _self, _session_id: True),
    Mutant("a client that never gives up", Claim, "doubt", lambda self, _strange: self),
    Mutant("a client that gives up while another's motion ends", Claim, "update", _impatient),
    Mutant("a grant from tick 0 told as none", Authority, "told_from_tick", property(_from_tick)),
)
"""Faults; the last two were in the product before the search found them."""


@contextmanager
def planted(mutant: Mutant) -> Iterator[None]:
    """Have the product make a fault meanwhile."""
    before = vars(mutant.owner)[mutant.name]
    setattr(mutant.owner, mutant.name, mutant.planted)
    try:
        yield
    finally:
        setattr(mutant.owner, mutant.name, before)


def search_with(mutant: Mutant) -> Found:
    """Search a small world while the product makes a fault."""
    with planted(mutant):
        return search(mutant.clients, requests=4, crashes=1)
