"""Who is let into a session at all: Zenoh as an attacker sets it up, without our checks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hoap3.protocol.link.zenoh_session import zenoh


def doors(place: str, certs: Path, other: Path) -> dict[str, bool]:
    """Who gets a session at a robot with certificates.

    Args:
        place: `host:port`.
        certs: folder of its authority; `late`'s certificate has expired.
        other: folder of another authority.
    """
    ca = {"root_ca_certificate": str(certs / "ca.pem")}
    return {
        "an observer": _gets_in(f"tls/{place}", {**ca, **_shows(certs / "otto")}),
        "nobody's certificate": _gets_in(f"tls/{place}", ca),
        "another authority's": _gets_in(f"tls/{place}", {**ca, **_shows(other / "chief")}),
        "expired": _gets_in(f"tls/{place}", {**ca, **_shows(certs / "late")}),
        "in plain": _gets_in(f"tcp/{place}", {}),
    }


def _shows(directory: Path) -> dict[str, Any]:
    return {
        "enable_mtls": True,
        "connect_certificate": str(directory / "cert.pem"),
        "connect_private_key": str(directory / "key.pem"),
    }


def _gets_in(endpoint: str, tls: dict[str, Any]) -> bool:
    config = {
        "mode": "client",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "connect": {"endpoints": [endpoint], "timeout_ms": 3000, "exit_on_failure": True},
        "transport": {"link": {"tls": tls}},
    }
    try:
        zenoh.open(zenoh.Config.from_json5(json.dumps(config))).close()
    except zenoh.ZError:
        return False
    return True
