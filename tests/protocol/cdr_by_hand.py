"""A CDR writer of its own, with `struct` only, and the messages typed off the `.msg` files."""

from __future__ import annotations

import struct
from pathlib import Path

GOLDEN = Path(__file__).parent / "golden"

FIELDS = {
    "State": (
        ("wire_version", "I"),
        ("mode", "I"),
        ("session_id", "Q"),
        ("tick", "Q"),
        ("epoch", "Q"),
        ("epoch_from_tick", "Q"),
        ("stamp_intended", "q"),
        ("stamp_actual", "q"),
        ("stamp_published", "q"),
        ("stamp_sent_previous", "q"),
        ("skipped", "Q"),
        ("late", "Q"),
        ("lost", "Q"),
        ("duplicate", "Q"),
        ("out_of_order", "Q"),
        ("rejected", "Q"),
        ("success_rate", "d"),
        ("q", "d[]"),
        ("dq", "d[]"),
        ("tau", "d[]"),
        ("reference", "d[]"),
        ("wrench", "d[]"),
        ("reference_rate", "d[]"),
        ("reference_acceleration", "d[]"),
        ("followed", "d[]"),
        ("base", "d[]"),
        ("contact", "d[]"),
        ("imu", "d[]"),
    ),
    "Setpoint": (
        ("wire_version", "I"),
        ("command", "I"),
        ("session_id", "Q"),
        ("tick", "Q"),
        ("epoch", "Q"),
        ("stamp_state", "q"),
        ("stamp_received", "q"),
        ("stamp_decoded", "q"),
        ("stamp_kinematics", "q"),
        ("stamp_solved", "q"),
        ("stamp_encoded", "q"),
        ("stamp_sent_previous", "q"),
        ("v", "d"),
        ("v_rate_required", "d"),
        ("v_rate_predicted", "d"),
        ("rho", "d"),
        ("margin", "d"),
        ("kkt_residual", "d"),
        ("active_joints", "I"),
        ("solver_status", "I"),
        ("solver_path", "I"),
        ("fallback", "I"),
        ("values", "d[]"),
        ("extra", "d[]"),
        ("decision", "d[]"),
        ("slacks", "d[]"),
        ("gains", "d[]"),
        ("next", "d[]"),
    ),
    "Target": (
        ("wire_version", "I"),
        ("target", "I"),
        ("number", "I"),
        ("points", "I"),
        ("dimension", "I"),
        ("tick_step", "I"),
        ("session_id", "Q"),
        ("epoch", "Q"),
        ("first_tick", "Q"),
        ("values", "d[]"),
        ("rates", "d[]"),
    ),
    "Event": (
        ("wire_version", "I"),
        ("kind", "I"),
        ("session_id", "Q"),
        ("tick", "Q"),
        ("stamp", "q"),
        ("detail", "q"),
    ),
}

_STATE = {
    "wire_version": 2,
    "mode": 2,
    "session_id": 0x0123456789ABCDEF,
    "tick": 1234567,
    "epoch": 3,
    "epoch_from_tick": 1234000,
    "stamp_intended": 1_000_000_000_000,
    "stamp_actual": 1_000_000_012_345,
    "stamp_published": 1_000_000_045_678,
    "stamp_sent_previous": -7,
    "skipped": 11,
    "late": 12,
    "lost": 13,
    "duplicate": 14,
    "out_of_order": 15,
    "rejected": 2**64 - 1,
    "success_rate": 0.97,
    "q": (0.1, -0.2),
    "dq": (1.5, -2.5),
    "tau": (3.25, -4.75),
    "reference": (0.125, -0.25),
    "wrench": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    "reference_rate": (0.5, -0.625),
    "reference_acceleration": (7.5, -8.5),
    "followed": (1234566.0,),
    "base": (),
    "contact": (),
    "imu": (),
}
_SETPOINT = {
    "wire_version": 2,
    "command": 1,
    "session_id": 0xFEDCBA9876543210,
    "tick": 7654321,
    "epoch": 4,
    "stamp_state": 100,
    "stamp_received": 101,
    "stamp_decoded": 102,
    "stamp_kinematics": 103,
    "stamp_solved": 104,
    "stamp_encoded": 105,
    "stamp_sent_previous": -106,
    "v": 0.5,
    "v_rate_required": -0.75,
    "v_rate_predicted": -0.875,
    "rho": 1.0,
    "margin": 1e-9,
    "kkt_residual": 1e-15,
    "active_joints": 5,
    "solver_status": 6,
    "solver_path": 7,
    "fallback": 8,
    "values": (0.1, -0.2, 0.3),
    "extra": (46.0,),
    "decision": (0.75, -0.5, 0.25),
    "slacks": (),
    "gains": (10.0, 20.0),
    "next": (),
}
EXAMPLES = {
    "state": ("State", _STATE),
    "state_without_sensors": ("State", {**_STATE, "wrench": ()}),
    "state_of_a_free_base": (
        "State",
        {
            **_STATE,
            "base": tuple(range(13)),
            "contact": tuple(range(20, 32)),
            "imu": tuple(range(40, 50)),
        },
    ),
    "setpoint": ("Setpoint", _SETPOINT),
    "setpoint_without_extras": ("Setpoint", {**_SETPOINT, "extra": ()}),
    "setpoint_with_all_arrays": (
        "Setpoint",
        {**_SETPOINT, "slacks": (1e-3,), "next": tuple(range(100, 106))},
    ),
    "target": (
        "Target",
        {
            "wire_version": 2,
            "target": 1,
            "number": 17,
            "points": 2,
            "dimension": 3,
            "tick_step": 50,
            "session_id": 0x0123456789ABCDEF,
            "epoch": 5,
            "first_tick": 1234600,
            "values": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
            "rates": (),
        },
    ),
    "target_with_rates": (
        "Target",
        {
            "wire_version": 2,
            "target": 0,
            "number": 8,
            "points": 1,
            "dimension": 3,
            "tick_step": 1,
            "session_id": 42,
            "epoch": 6,
            "first_tick": 7,
            "values": (0.1, 0.2, 0.3),
            "rates": (1.5, 2.5, 3.5),
        },
    ),
    "event": (
        "Event",
        {
            "wire_version": 1,
            "kind": 6,
            "session_id": 42,
            "tick": 1000,
            "stamp": 1_000_000_000_000,
            "detail": -1,
        },
    ),
}
"""By name of the golden file: type of the message, and its values; no two fields are alike."""


def write(kind: str, values: dict) -> bytes:
    """Plain CDR, little endian: each field at its natural alignment behind the header."""
    body = bytearray()

    def put(code: str, value: float) -> None:
        item = struct.pack("<" + code, value)
        body.extend(bytes(-len(body) % len(item)))
        body.extend(item)

    for name, code in FIELDS[kind]:
        if code.endswith("[]"):
            put("I", len(values[name]))
            for element in values[name]:
                put(code[0], element)
        else:
            put(code, values[name])
    return b"\x00\x01\x00\x00" + bytes(body)


def golden(name: str) -> bytes:
    """Bytes of a golden file: hexadecimal, sixteen a line."""
    return bytes.fromhex((GOLDEN / f"{name}.hex").read_text(encoding="ascii"))
