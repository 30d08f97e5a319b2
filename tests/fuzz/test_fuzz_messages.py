"""Mutated messages: the product and a validator of its own agree about every one of them.

By default some thousands; with `-m long` a million together, each reason 1,000 times or more.
"""

from __future__ import annotations

import random
from collections import Counter

import numpy as np
import pytest
from fuzzing import amount, bounded
from wire_mutations import any_message, setpoint, target
from wire_rules import SetpointRules, TargetRules, fault, numbers, read

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, Message, Setpoint, State, Target
from hoap3.remote_controller.references.live.live import Live, Turning
from hoap3.remote_controller.references.live.live_plan import Bounds
from hoap3.remote_controller.steering import REFUSALS, Steering
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS, SetpointValidator

MESSAGES: dict[str, type[Message]] = {
    "State": State,
    "Setpoint": Setpoint,
    "Event": Event,
    "Target": Target,
}
OF_SIZE_OR_HEADER = {"size", "layout", "wire_version", "malformed"}
N, SESSION, PERIOD_S = 3, 7, 1e-3
OFTEN = 1000  # how often the long run must come to each outcome


def tell(what: str, outcomes: Counter[str], expected: tuple[str, ...], count: int) -> None:
    """Print how often each outcome came up, and check that all of them did, and often enough."""
    deep = sum(outcomes.values()) - sum(outcomes[each] for each in OF_SIZE_OR_HEADER)
    print(f"{what}: {count} payloads, {deep / count:.1%} pass size and header: {dict(outcomes)}")
    assert deep >= 0.5 * count
    least = OFTEN if count >= 100_000 else 1
    rare = {each: outcomes[each] for each in expected if outcomes[each] < least}
    assert not rare


@pytest.mark.parametrize("kind", MESSAGES)
@amount(200, 25_000)
def test_each_message_is_read_as_its_bytes_say(kind: str, count: int) -> None:
    draw, outcomes = random.Random(f"{kind} {count}"), Counter[str]()
    message, kept = MESSAGES[kind], None
    with bounded():
        for _ in range(count):
            payload = any_message(draw, kind)
            due = fault(kind, payload)
            try:
                found = message.like(payload)
                found.load(payload)
                told = ""
            except WireError as error:
                told = error.kind
            assert told == due, payload.hex()
            outcomes[due] += 1
            if kept is not None:
                _stays_or_is(kept, payload, due)
            if not due:
                kept = found
                _holds(kind, found, payload)
    tell(kind, outcomes, ("", *(OF_SIZE_OR_HEADER - {"malformed"})), count)


def _holds(kind: str, found: Message, payload: bytes) -> None:
    """Every field is what an independent reader finds, and the bytes are the same again."""
    read_again = read(kind, payload)
    assert read_again is not None
    scalars, arrays = read_again
    given = [getattr(found, name) for name in found.schema.scalars]
    assert np.array_equal(np.array(given, float), np.array(scalars, float), equal_nan=True)
    for name, array in arrays.items():
        assert np.array_equal(getattr(found, name), numbers(payload, array), equal_nan=True)
    assert found.dump() == payload
    assert found.scalars(payload, "wire_version") == scalars[:1]


def _stays_or_is(kept: Message, payload: bytes, due: str) -> None:
    """A buffer takes what fits, and is unchanged by all else."""
    before = kept.dump()
    try:
        kept.load(payload)
    except WireError:
        assert kept.dump() == before
    else:
        assert not due
        assert kept.dump() == payload


@pytest.mark.parametrize("delayed", [False, True])
@amount(800, 350_000)
def test_a_robot_refuses_setpoints_for_the_reason_that_is_due(delayed: bool, count: int) -> None:
    draw, outcomes = random.Random(f"{delayed} {count}"), Counter[str]()
    validator = SetpointValidator(N, SESSION, Setpoint.POSITION, delayed=delayed)
    rules = SetpointRules(N, SESSION, Setpoint.POSITION)
    before = dict.fromkeys(("duplicate", "conflicting", "out_of_order"), 0)
    tick, epoch, last = 0, 1, b""
    with bounded():
        for _ in range(count):
            if draw.random() < 0.3:
                tick += 1 if draw.random() < 0.99 else draw.choice((1, 100, 1024, 1500))
                epoch += draw.random() < 0.002
                if draw.random() < 0.9:
                    validator.ask(tick, epoch, 10**6 * tick)
                    rules.asked[tick] = epoch
                rules.asked.pop(tick - 5000, None)
                rules.answers.pop(tick - 5000, None)
            asks = max(0, tick - draw.choice((0, 0, 0, 0, 0, 1, 2, 30, 1023, 1024, 1500)))
            sent = rules.asked.get(asks, epoch)
            payload = setpoint(
                draw, session=SESSION, tick=asks, epoch=sent, command=Setpoint.POSITION, n=N
            )
            if draw.random() < 0.1:
                payload = last  # once more
            last = payload
            due = rules.judge(payload, tick)
            told = validator.accept(10**6 * tick, payload, tick)
            counts = {name: getattr(validator, name) for name in before}
            risen = {name for name, value in counts.items() if value > before[name]}
            before = counts
            if told is None:
                told = next(
                    (n for n in ("conflicting", "out_of_order", *risen) if n in risen), "accepted"
                )
            assert told == due, payload.hex()
            outcomes[due] += 1
            if due == "accepted" and not delayed:
                assert validator.setpoint.dump() == payload
    assert validator.rejections == {each: outcomes[each] for each in REJECTION_KINDS}
    expected = (*REJECTION_KINDS, "accepted", "duplicate", "conflicting", "out_of_order")
    tell("setpoints", outcomes, expected, count)


def _steering() -> tuple[Steering, TargetRules]:
    """One target of three numbers, and one that turns behind them; what is due of both."""
    bounds = Bounds(0.25, 1.0, 20.0)
    turning = Turning(Bounds(0.5, 2.0, 40.0), np.zeros(3), 1.5)
    live = [
        Live("hand", "m", bounds, np.full(3, -1.0), np.full(3, 1.0), 1.0, "return"),
        Live("pose", "m", bounds, np.full(3, -1.0), np.full(3, 1.0), turning=turning),
    ]
    for each in live:
        each.start(np.zeros(each.dimension), 0.0)
    rules = TargetRules(SESSION, PERIOD_S, (3, 3), (False, True), -1.0, 1.0, 1.5, (0.25, 1.0, 20.0))
    return Steering(live, SESSION, PERIOD_S), rules


@amount(500, 150_000)
def test_a_controller_refuses_targets_for_the_reason_that_is_due(count: int) -> None:
    draw, outcomes = random.Random(f"targets {count}"), Counter[str]()
    steering, rules = _steering()
    tick = number = 0
    with bounded():
        for place in range(count):
            if place % 200 == 0:
                steering.release("me")
                rules.operator, rules.newest = "me", 0
                number, rules.epoch = 0, steering.acquire("me", 1, tick)["epoch"]
            tick += draw.choice((0, 1, 5))
            number += draw.choice((0, 1, 1, 1))
            who, following = draw.choice(("me",) * 30 + ("you", "")), draw.random() < 0.97
            payload = target(
                draw,
                session=SESSION,
                epoch=rules.epoch,
                number=number,
                tick=tick,
                plain=rules.plain,
                turns=rules.turns,
            )
            due = rules.judge(who, payload, tick, following=following)
            before = dict(steering.refused)
            taken = steering.take(who, payload, tick, following=following)
            told = [name for name in REFUSALS if steering.refused[name] > before[name]]
            assert len(told) == (not taken)
            assert (told or [""])[0] in due, (due, told, payload.hex())
            outcomes[(told or ["taken"])[0]] += 1
    tell("targets", outcomes, (*REFUSALS, "taken"), count)
