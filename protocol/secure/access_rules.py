"""The secure profile as Zenoh's access control: rules by the name in the peer's certificate.

Zenoh looks at each message that a peer sends to the robot or would get from it, and drops what no
rule allows. A rule allows keys that lie within its own: a client's keys end in `<name>.<session>`,
so a name stands for all sessions of one certificate, and never for a longer name, because names
have no dot. No rule allows `*` in the place of a verb, nor a key of version 1 of the wire.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hoap3.protocol.secure.roles import READS, READS_CONTROLLER, RIGHTS, Role

Rule = dict[str, Any]

MESSAGES = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
]
READABLE = (
    "state/2",
    "events",
    "setpoint/**",
    "targets/*",
    "sampled/state/2",
    "sampled/setpoint/*",
)


def robot_rules(robot: str, roles: Mapping[str, Role]) -> dict[str, Any]:
    """Zenoh's `access_control` of a robot.

    Args:
        robot: its name.
        roles: of those whom it lets in, by the common name of their certificates.
    """
    rules = {name: list(_rules(robot, name, role)) for name, role in roles.items()}
    return _control(rules)


def client_rules(robot: str) -> dict[str, Any]:
    """Zenoh's `access_control` of a client: nothing counts that another robot's certificate sends.

    Args:
        robot: the robot's name; "" where the client asks who is there.
    """
    if not robot:
        return {"enabled": False}
    return _control({robot: [_rule(robot, "all", ["ingress", "egress"], MESSAGES, ["**"])]})


def _control(rules: Mapping[str, list[Rule]]) -> dict[str, Any]:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for each in rules.values() for rule in each],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in rules],
        "policies": [
            {"rules": [rule["id"] for rule in each], "subjects": [name]}
            for name, each in rules.items()
        ],
    }


def _rules(robot: str, name: str, role: Role) -> Iterator[Rule]:
    """What one name may send to a robot, and be sent by it."""
    root, mine, rights = f"robots/{robot}", f"{name}.$*", RIGHTS[role]
    into = ["ingress"]
    readable = [f"{root}/{leaf}" for leaf in READABLE]
    yield _rule(name, "read", into, ["declare_subscriber"], readable)
    tokens = [f"{root}/{leaf}" for leaf in ("alive", "session/*", "clients/*")]
    looks = ["declare_liveliness_subscriber", "liveliness_query"]
    yield _rule(name, "look", into, looks, ["robots/*/alive", "robots/*/session/*", *tokens])
    yield _rule(name, "be", into, ["liveliness_token"], [f"{root}/clients/{mine}"])
    verbs = [f"ask/{verb}" for verb in (*READS, *rights.ask)]
    verbs += [f"control/{verb}" for verb in (*READS_CONTROLLER, *rights.control)]
    yield _rule(name, "ask", into, ["query"], [f"{root}/{verb}/{mine}" for verb in verbs])
    if rights.puts:
        yield _rule(name, "put", into, ["put"], [f"{root}/{leaf}/{mine}" for leaf in rights.puts])
    if rights.answers:
        answers = ["declare_queryable", "reply"]
        yield _rule(name, "answer", into, answers, [f"{root}/control/**"])
    yield _rule(name, "hear", ["egress"], MESSAGES, [f"{root}/**"])


def _rule(name: str, what: str, flows: list[str], messages: list[str], keys: list[str]) -> Rule:
    return {
        "id": f"{name} {what}",
        "permission": "allow",
        "flows": flows,
        "messages": messages,
        "key_exprs": keys,
    }
