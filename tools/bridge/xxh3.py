"""XXH3-128 of texts of 129 bytes and more, which rmw_zenoh makes GIDs of.

The algorithm and its constants are those of the specification of xxHash
(https://github.com/Cyan4973/xxHash/blob/dev/doc/xxhash_spec.md), without a seed. It is slow here,
and asked once for each publisher.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

SHORTEST = 129  # shorter ones are hashed otherwise, and no token is as short
_MIDDLE = 240  # the longest that is hashed in one pass
_MASK = 2**64 - 1
_P32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
_P64 = (
    0x9E3779B185EBCA87,
    0xC2B2AE3D27D4EB4F,
    0x165667B19E3779F9,
    0x85EBCA77C2B2AE63,
    0x27D4EB2F165667C5,
)
_MIX = 0x165667919E3779F9
_SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671f"
    "cb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e"
    "2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
_STRIPE, _STEP = 64, 8
_STRIPES = (len(_SECRET) - _STRIPE) // _STEP  # of a block


def xxh3_128(text: bytes) -> bytes:
    """The hash, 16 bytes: its lower half first, each half little endian.

    Raises:
        ValueError: the text is shorter than `SHORTEST`.
    """
    if len(text) < SHORTEST:
        raise ValueError(f"{len(text)} bytes; {SHORTEST} at least are hashed here")
    return struct.pack("<QQ", *(_middle(text) if len(text) <= _MIDDLE else _long(text)))


def _word(text: bytes, at: int) -> int:
    return int.from_bytes(text[at : at + 8], "little")


def _fold(a: int, b: int) -> int:
    """Both halves of the product, by exclusive or."""
    product = a * b
    return (product & _MASK) ^ (product >> 64)


def _avalanche(value: int) -> int:
    value ^= value >> 37
    value = value * _MIX & _MASK
    return value ^ value >> 32


def _middle(text: bytes) -> tuple[int, int]:
    low, high = len(text) * _P64[0] & _MASK, 0

    def mix(at: int, secret: int) -> int:
        return _fold(
            _word(text, at) ^ _word(_SECRET, secret),
            _word(text, at + 8) ^ _word(_SECRET, secret + 8),
        )

    def both(first: int, second: int, secret: int) -> None:
        nonlocal low, high
        low = low + mix(first, secret) & _MASK
        low ^= _word(text, second) + _word(text, second + 8) & _MASK
        high = high + mix(second, secret + 16) & _MASK
        high ^= _word(text, first) + _word(text, first + 8) & _MASK

    for number in range(len(text) // 32):
        if number == 4:
            low, high = _avalanche(low), _avalanche(high)
        both(32 * number, 32 * number + 16, 32 * number if number < 4 else 32 * number - 125)
    if len(text) // 32 == 4:
        low, high = _avalanche(low), _avalanche(high)
    both(len(text) - 16, len(text) - 32, 103)
    mixed = low * _P64[0] + high * _P64[3] + len(text) * _P64[1] & _MASK
    return _avalanche(low + high & _MASK), -_avalanche(mixed) & _MASK


def _long(text: bytes) -> tuple[int, int]:
    lanes = [_P32[2], *_P64[:4], _P32[1], _P64[4], _P32[0]]

    def accumulate(at: int, secret: int) -> None:
        for lane in range(8):
            value = _word(text, at + 8 * lane)
            key = value ^ _word(_SECRET, secret + 8 * lane)
            lanes[lane ^ 1] = lanes[lane ^ 1] + value & _MASK
            lanes[lane] = lanes[lane] + (key & 0xFFFFFFFF) * (key >> 32) & _MASK

    last = (len(text) - 1) // _STRIPE  # whole stripes before the end
    for number in range(last):
        accumulate(_STRIPE * number, _STEP * (number % _STRIPES))
        if number % _STRIPES == _STRIPES - 1:
            for lane in range(8):
                value = lanes[lane] ^ lanes[lane] >> 47
                value ^= _word(_SECRET, len(_SECRET) - _STRIPE + 8 * lane)
                lanes[lane] = value * _P32[0] & _MASK
    accumulate(len(text) - _STRIPE, len(_SECRET) - _STRIPE - 7)
    return (
        _merged(lanes, 11, len(text) * _P64[0] & _MASK),
        _merged(lanes, len(_SECRET) - _STRIPE - 11, ~(len(text) * _P64[1]) & _MASK),
    )


def _merged(lanes: Sequence[int], secret: int, start: int) -> int:
    for pair in range(4):
        start += _fold(
            lanes[2 * pair] ^ _word(_SECRET, secret + 16 * pair),
            lanes[2 * pair + 1] ^ _word(_SECRET, secret + 16 * pair + 8),
        )
    return _avalanche(start & _MASK)
