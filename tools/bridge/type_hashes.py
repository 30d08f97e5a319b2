"""Hashes of ROS 2 message types, RIHS01, from their `.msg` texts.

Two sides of ROS 2 talk about a topic only where both hash its type alike. The hash is the SHA-256
of the type's description as JSON, in the one form that REP 2016 (https://reps.openrobotics.org/rep-2016/)
and rosidl lay down: keys in a fixed order, a blank behind each comma and colon, no default values,
and behind the type those that it uses, by name.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from typing import Any

_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8,
    "uint64": 9, "float32": 10, "float64": 11, "char": 13, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
"""Of `type_description_interfaces/msg/FieldType`."""
_NESTED = 1
_UNBOUNDED = 144  # is added to the id of what a sequence without a bound is of
_FIELD = re.compile(r"(?P<type>[\w/]+)(?P<sequence>\[\])?\s+(?P<name>[a-z]\w*)$")
_CONSTANT = re.compile(r"\w+\s+[A-Z]\w*\s*=")
_RULE = re.compile(r"^=+\nMSG: (?P<name>\S+)\n", re.MULTILINE)


def type_hash(name: str, text: str) -> str:
    """The RIHS01 hash of a message type.

    Args:
        name: as `sensor_msgs/msg/JointState`.
        text: its `ros2msg` schema: its `.msg`, and behind a line of `=` each type that it uses.
            Numbers, strings, other types, and sequences of them without a bound are known.

    Raises:
        ValueError: a field of another kind, or a type that the schema does not hold.
    """
    first, *rest = _RULE.split(text)
    bodies = {name: first}
    bodies.update({_full(other): body for other, body in zip(rest[::2], rest[1::2], strict=True)})
    described = {each: _describe(each, body) for each, body in bodies.items()}
    used = sorted(_used(name, described) - {name})
    whole = {
        "type_description": described[name],
        "referenced_type_descriptions": [described[each] for each in used],
    }
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


def dds_name(name: str) -> str:
    """A type as DDS and rmw_zenoh name it: `sensor_msgs::msg::dds_::JointState_`."""
    package, kind, leaf = name.split("/")
    return f"{package}::{kind}::dds_::{leaf}_"


def _full(name: str) -> str:
    """`std_msgs/Header` as `std_msgs/msg/Header`."""
    package, leaf = name.partition("/")[0], name.rpartition("/")[2]
    return f"{package}/msg/{leaf}"


def _describe(name: str, body: str) -> dict[str, Any]:
    return {"type_name": name, "fields": list(_fields(name, body))}


def _fields(name: str, body: str) -> Iterator[dict[str, Any]]:
    for line in body.splitlines():
        text = line.partition("#")[0].strip()
        if not text or _CONSTANT.match(text):
            continue
        field = _FIELD.match(text)
        if field is None:
            raise ValueError(f"{name}: a field that is not understood: {text!r}")
        kind = field["type"]
        yield {
            "name": field["name"],
            "type": {
                "type_id": _IDS.get(kind, _NESTED) + (_UNBOUNDED if field["sequence"] else 0),
                "capacity": 0,
                "string_capacity": 0,
                "nested_type_name": "" if kind in _IDS else _full(kind),
            },
        }


def _used(name: str, described: dict[str, dict[str, Any]]) -> set[str]:
    """A type, and all that it uses."""
    if name not in described:
        raise ValueError(f"the schema does not hold {name}")
    found = {name}
    for field in described[name]["fields"]:
        if nested := field["type"]["nested_type_name"]:
            found |= _used(nested, described)
    return found
