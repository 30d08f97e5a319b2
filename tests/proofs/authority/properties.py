"""What must hold in every world, and from each to the next."""

from __future__ import annotations

from functools import cache

from hoap3.protocol.messages import State
from hoap3.remote_controller.claim import MOST_STRANGE_STATES, Claim
from hoap3.robot_emulator.authority import RELEASED, Authority

from .steps import (
    GRACE,
    LEASE,
    LOOK_TICKS,
    RESTART,
    SAME_NAME,
    Step,
    one_tick_on,
)
from .world import NAMES, UNSEEN, World

LATEST = LEASE + 2 * LOOK_TICKS
"""Ticks for which the holder's token may be gone: a lease, and the look-ups at either end of it."""

SESSION, OTHER = 2, 1
"""Of the robot now, and before it started again."""


def wrong_world(world: World) -> str:
    """What is wrong with a world, or ""."""
    if world.must_recover and world.authority.mode == State.ACTIVE:
        return "the robot moves before it was recovered"
    if world.late > LATEST:
        return f"a holder that is gone has authority for more than {LATEST} ticks"
    return ""


def wrong_step(before: World, step: Step) -> str:
    """What is wrong with a step, or "". Both worlds name their clients alike."""
    if step.what == RESTART:
        return ""
    old, new = before.authority.grant, step.after.authority.grant
    if step.told >= 0 and (new is None or new.holder != NAMES[step.told]):
        return "a client is sent a grant that it does not hold"
    if step.what.endswith(SAME_NAME) and (old, before.authority.mode) != (
        new,
        step.after.authority.mode,
    ):
        return "authority or motion changes as another robot uses the name"
    if old is new:
        return ""
    if old is not None and new is not None:
        if (old.epoch, old.holder) != (new.epoch, new.holder):
            return "authority passes on while somebody has it"
    elif new is not None:
        if before.clients[NAMES.index(new.holder)].seen == UNSEEN:
            return "a grant to a client whose token the robot does not see"
        if new.epoch <= max(before.authority.granted, before.authority.followed):
            return "an epoch comes back"
    elif old is not None:
        others = [name for name in NAMES if name != old.holder]
        if any(step.what == f"{name} releases" for name in others):
            return "a client releases what another holds"
    return ""


@cache
def wrong_authority(authority: Authority) -> str:
    """What is wrong with the robot's standing, whatever its clients were told, or ""."""
    return _wrong_robot(authority) or _wrong_claims(authority)


def _on(authority: Authority) -> Authority:
    """What comes once the robot is at rest, is recovered, and some ticks have passed."""
    if authority.mode == State.STOPPING:
        authority = authority.come_to_rest()
    if authority.mode == State.STOPPED:
        authority = authority.recover(0, GRACE)
    for _ in range(GRACE + 1):
        authority = one_tick_on(authority).begin(0)
    return authority


def _wrong_robot(authority: Authority) -> str:
    """Of the robot alone: whether it moves for its holder, and its grant leads somewhere."""
    grant, mode = authority.grant, authority.mode
    if mode == State.ACTIVE and (grant is None or authority.followed != grant.epoch):
        return "the robot moves for nobody that has authority"
    if mode in (State.IDLE, State.STOPPED) and authority.followed:
        return "the robot follows somebody at rest"
    later = _on(authority)
    if grant is None:
        return "the robot moves without a grant" if later.mode == State.ACTIVE else ""
    if later.mode != State.ACTIVE or later.followed != grant.epoch:
        return "a grant that can never become active"
    released = authority.drop(grant.holder, RELEASED)
    if released.grant is not None or released.mode == State.ACTIVE:
        return "a grant that cannot be released"
    return ""


def _wrong_claims(authority: Authority) -> str:
    """Of clients: the holder keeps its grant, and who goes by another one finds that out."""
    grant, over = authority.grant, _on(authority)
    if Claim(SESSION).fits(OTHER):
        return "a client goes by a grant of another session"
    for epoch in range(1, authority.granted + 1):
        claim = Claim(SESSION, epoch)
        if grant is not None and epoch == grant.epoch:
            if _heard(claim, SESSION, authority).stale:
                return "a client gives a grant up that is in force"
        elif not _heard(claim, SESSION, over).stale:
            return "a client never learns that its grant is over"
        if not _heard(Claim(OTHER, epoch), SESSION, authority).stale:
            return "a client never learns that the robot has started again"
    return ""


def _heard(claim: Claim, session: int, authority: Authority) -> Claim:
    """What a client makes of many States in a row of a robot that stands so."""
    for _ in range(MOST_STRANGE_STATES + 1):
        from_tick = authority.told_from_tick
        claim = claim.update(session, authority.mode, authority.followed, from_tick)
    return claim
