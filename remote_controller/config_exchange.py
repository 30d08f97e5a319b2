"""The configurations that both sides give each other, for their logs alone: nothing reads them."""

from __future__ import annotations

import json

from hoap3.protocol.link.session_limits import MAX_CONFIG_BYTES
from hoap3.remote_controller.config import ControllerConfig
from hoap3.remote_controller.references.trajectories.motion_texts import without_texts


def own_config(config: ControllerConfig) -> bytes:
    """The settings of a controller as JSON for a robot's log; b"" where they are too long."""
    parameters = without_texts(config.parameters)
    raw = config.model_copy(update={"parameters": parameters}).model_dump_json().encode()
    return raw if len(raw) <= MAX_CONFIG_BYTES else b""


def is_config(raw: bytes) -> bool:
    """Whether it is a JSON object, and not too long."""
    if len(raw) > MAX_CONFIG_BYTES:
        return False
    try:
        found = json.loads(raw)
    except (ValueError, RecursionError):
        return False
    return isinstance(found, dict) and "error" not in found
