"""Messages of the wire, valid ones and such that are wrong in one of all the ways that they can be.

Two of three changes leave size and header as they are, so that they reach the later checks.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Mapping, Sequence

from wire_rules import ARRAYS, HEADER, MOST_OF_SETPOINT, SCALARS, VERSIONS

WORDS = (0, 1, 2, 3, 1023, 1024, 1025, 2**31 - 1, 2**31, 2**32 - 1)
LONGS = (*WORDS, 2**32, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
REALS = (0.0, -0.0, 1.0, -1.0, 5e-324, 2.2e-308, 1.8e308 / 10, -1e300, float("inf"), -float("inf"))
REALS += (float("nan"), -float("nan"), struct.unpack("<d", b"\x01\0\0\0\0\0\xf0\x7f")[0])
LENGTHS = (0, 1, 2, 3, 4, 7, 128, 255, 256, 257, 511, 512, 513, 1023, 1024)


def pack(kind: str, scalars: Sequence[float], arrays: Mapping[str, Sequence[float]]) -> bytes:
    """A message: scalars in their order, its version first; arrays that are not given are empty."""
    out = bytearray(HEADER + struct.pack(SCALARS[kind], *scalars))
    for name in ARRAYS[kind]:
        elements = arrays.get(name, ())
        out += bytes(-len(out) % 4) + struct.pack("<I", len(elements))
        if elements:
            out += bytes(-(len(out) - 4) % 8) + struct.pack(f"<{len(elements)}d", *elements)
    return bytes(out)


def some_scalars(draw: random.Random, kind: str) -> list[float]:
    """Scalars of a message, any that its types take."""
    given: list[float] = []
    for code in SCALARS[kind][1:]:
        match code:
            case "I":
                given.append(draw.choice(WORDS))
            case "Q":
                given.append(draw.choice(LONGS))
            case "q":
                given.append(
                    draw.choice(LONGS) - 2**63 if draw.random() < 0.5 else draw.getrandbits(62)
                )
            case _:
                given.append(draw.choice(REALS))
    given[0] = VERSIONS[kind]
    return given


def broken(draw: random.Random, kind: str, payload: bytes) -> bytes:
    """The same with a wrong size, header, version or length, or with some bits that are others."""
    out = bytearray(payload)
    match draw.randrange(9):
        case 0:
            del out[draw.randrange(len(out) + 1) :]
        case 1:
            out += draw.randbytes(draw.choice((1, 4, 8, 100)))
        case 2:
            at = draw.randrange(len(out))
            del out[at : at + draw.choice((1, 4, 8))]
        case 3 | 4:
            out[draw.randrange(4)] ^= 1 << draw.randrange(8)
        case 5 | 6:
            struct.pack_into("<I", out, 4, draw.choice([*WORDS, VERSIONS[kind] + 256]))
        case 7 if ARRAYS[kind]:
            length = draw.choice([*LENGTHS, 1025, 2**31, 2**32 - 1])
            struct.pack_into("<I", out, 4 + struct.calcsize(SCALARS[kind]), length)
        case _:
            for _ in range(draw.choice((1, 2, 8))):
                out[draw.randrange(len(out))] ^= 1 << draw.randrange(8)
    return bytes(out)


def setpoint(
    draw: random.Random, *, session: int, tick: int, epoch: int, command: int, n: int
) -> bytes:
    """An answer to a tick, valid or not."""
    scalars = some_scalars(draw, "Setpoint")
    scalars[1:5] = command, session, tick, epoch
    values = [draw.uniform(-3.0, 3.0) for _ in range(n)]
    arrays = {"values": values, "extra": (1.0, 2.0)}
    match draw.randrange(15):
        case 0:
            scalars[1] = draw.choice(WORDS)
        case 1:
            scalars[2] = draw.choice(LONGS)
        case 2:
            scalars[3] = draw.choice(LONGS)
        case 3:
            scalars[3] = max(
                0, tick + draw.choice((1, 2, 100, -1, -500, -1023, -1024, -1025, -2048))
            )
        case 4:
            scalars[4] = draw.choice(LONGS)
        case 5 | 6:
            values[draw.randrange(n)] = draw.choice(REALS)
        case 7:
            name = draw.choice(ARRAYS["Setpoint"][1:])
            most = MOST_OF_SETPOINT[name]
            length = draw.choice([each for each in LENGTHS if each <= most] + [most, most + 1])
            arrays[name] = [draw.choice(REALS)] * length
        case 8:
            arrays["values"] = [0.5] * draw.choice((0, n - 1, n + 1, 1024))
        case 9 | 10 | 11:
            return broken(draw, "Setpoint", pack("Setpoint", scalars, arrays))
        case _:
            pass  # valid, if its tick asks
    return pack("Setpoint", scalars, arrays)


def any_message(draw: random.Random, kind: str) -> bytes:
    """A message of a kind, two of three times a valid one."""
    arrays = {
        name: [draw.choice(REALS)] * draw.choice((0, 1, 3, 6, 13, draw.choice((*LENGTHS, 1025))))
        for name in ARRAYS[kind]
    }
    payload = pack(kind, some_scalars(draw, kind), arrays)
    return payload if draw.random() < 0.67 else broken(draw, kind, payload)


def target(  # noqa: PLR0912 - one case for each way to be wrong
    draw: random.Random,
    *,
    session: int,
    epoch: int,
    number: int,
    tick: int,
    plain: Sequence[int],
    turns: Sequence[bool],
) -> bytes:
    """A target or a chunk from about now on, valid or not."""
    which = draw.randrange(len(plain))
    count = draw.choice((1, 1, 2, 3, 5, 9))
    step = draw.choice((1, 20, 50, 200))
    pace = draw.choice((0.0, 1e-7, 1e-5, 1e-3, 0.1)) * step
    first = max(0, tick + draw.choice((-50, 0, 1, 2, 30, 500)))
    place = [draw.uniform(-0.5, 0.5) for _ in range(plain[which])]
    move = [draw.uniform(-1.0, 1.0) * pace for _ in place]
    wobble = draw.choice((0.0, 0.0, 1e-3, 0.1))
    values: list[float] = []
    for point in range(count):
        values += [
            min(max(x + v * point + draw.uniform(-1.0, 1.0) * wobble * pace, -0.99), 0.99)
            for x, v in zip(place, move, strict=True)
        ]
        if turns[which]:
            half = 0.02 * draw.random()
            values += [0.0, (half * half + 0.0) ** 0.5, 0.0, (1.0 - half * half) ** 0.5]
    wide, rates_wide = plain[which] + 4 * turns[which], plain[which] + 3 * turns[which]
    period = 1e-3
    rates: list[float] = []
    if draw.random() < 0.3:
        for _ in range(count):
            rates += [v / (step * period) for v in move] + [0.0] * (3 * turns[which])
    scalars = [2, which, number, count, wide, step, session, epoch, first]
    match draw.randrange(18):
        case 0:
            scalars[1] = draw.choice([each for each in WORDS if each >= len(plain)])
        case 1:
            scalars[2] = draw.choice((0, 1, max(number - 1, 0), max(number - 100, 0)))
        case 2:
            scalars[3] = draw.choice(WORDS)
        case 3:
            scalars[4] = draw.choice(WORDS)
        case 4:
            scalars[5] = draw.choice((0, 2**32 - 1, 2**31))
        case 5:
            scalars[6] = draw.choice(LONGS)
        case 6:
            scalars[7] = draw.choice((0, epoch - 1, epoch + 1, 2**64 - 1))
        case 7:
            scalars[8] = draw.choice(LONGS)
        case 8:
            scalars[8] = max(0, tick - draw.choice((1, 100, 5000)) - step * count)
        case 9:
            values[draw.randrange(len(values))] = draw.choice(REALS)
        case 10 if rates:
            rates[draw.randrange(len(rates))] = draw.choice(REALS)
        case 11:
            rates += [0.0] * draw.choice((1, rates_wide, 3))
        case 12:
            values[draw.randrange(plain[which])] = draw.choice((-1.5, 1.01, 1e9, -1e300))
        case 13 if turns[which]:
            angle = draw.choice((0.1, 0.9, 1.2, 3.0))  # half of it, against half of within_rad
            values[-4:] = [0.0, (1.0 - (1 - angle / 3.2) ** 2) ** 0.5, 0.0, 1 - angle / 3.2]
        case 14 if turns[which]:
            values[-1] *= draw.choice((0.99, 1.01, 0.0, -2.0))
        case 15 | 16:
            return broken(
                draw, "Target", pack("Target", scalars, {"values": values, "rates": rates})
            )
        case _:
            pass
    return pack("Target", scalars, {"values": values, "rates": rates})
