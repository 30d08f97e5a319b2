"""`hoap3 verify` of robots that balance on their soles."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from tampering import SETPOINT, STATE, Change, changed_field, config_of, ran, rewrite

from hoap3.protocol.config.settings import parse_yaml
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

N, BASE = 21, 6
PAIRS = {
    "tsid": ("hoap3_standing_torque", "tsid_standing"),
    "ghc": ("hoap3_standing_torque", "ghc_standing"),
}
every_pair = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "ghc" else pytest.mark.slow) for name in PAIRS]
)


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The log of a pair, made once."""

    @cache
    def get(name: str) -> Path:
        robot, controller = PAIRS[name]
        folder = tmp_path_factory.mktemp("story") / "run"
        return ran(folder, "--robot", robot, "--controller", controller, seconds=0.05)

    return get


@every_pair
def test_a_true_log_has_nothing_false(name, story):
    found = verify(story(name))

    assert found.claims.by_tick() == []
    assert found.claims.counts["equations of motion"].checked == 50
    assert list(found.claims.counts["certificate"].unverified.values()) == [50]


CHANGES: dict[str, Change] = {
    "base": changed_field(STATE, 20, "base", lambda v: v + 1e-6, joint=7),
    "turn": changed_field(STATE, 20, "base", lambda v: v + 1e-6, joint=3),
    "q": changed_field(STATE, 20, "q", lambda v: v + 1e-6, joint=3),
    "dq": changed_field(STATE, 20, "dq", lambda v: v + 1e-6, joint=3),
    "v̇ of the base": changed_field(SETPOINT, 20, "decision", lambda v: v + 1e-5, joint=2),
    "v̇ of a joint": changed_field(SETPOINT, 20, "decision", lambda v: v + 1e-5, joint=BASE + 3),
    "τ": changed_field(SETPOINT, 20, "decision", lambda v: v + 1e-6, joint=BASE + N + 3),
    "w": changed_field(SETPOINT, 20, "decision", lambda v: v + 1e-6, joint=BASE + 2 * N + 4),
    "setpoint": changed_field(SETPOINT, 20, "values", lambda v: v + 1e-6, joint=3),
    "torque share": changed_field(SETPOINT, 20, "extra", lambda v: v + 1e-6, joint=0),
    "fallback": changed_field(SETPOINT, 20, "fallback", lambda v: v + 1),
}


@pytest.mark.parametrize("name", PAIRS)
def test_what_is_changed_is_found(name, story, tmp_path):
    for kind, change in CHANGES.items():
        path = rewrite(story(name), "controller", tmp_path / kind, change)

        assert verify(path).claims.false, kind


def lifted(records: list[Record]) -> list[Record]:
    """No State feels the left sole."""
    found = []
    for record in records:
        payload = record.payload
        if record.kind == STATE:
            state = State.allocate(**State.schema.lengths_in(payload))
            state.load(payload)
            state.contact[6:] = 0.0
            payload = state.dump()
        found.append(record._replace(payload=payload))
    return found


def test_nothing_is_certified_on_a_sole_that_carries_nothing(story, tmp_path):
    found = verify(rewrite(story("ghc"), "controller", tmp_path, lifted))

    assert found.claims.counts["certified: soles carry"].false == 50 - 10  # ms


@pytest.mark.parametrize(("key", "value"), [("friction", 1e-3), ("damping_per_s", 1e3)])
def test_other_contacts_in_the_config_are_found(key, value, story, tmp_path):
    config = parse_yaml(config_of(story("ghc")), "config")
    config["parameters"]["contacts"][key] = value
    text = json.dumps(config).encode()

    path = rewrite(story("ghc"), "controller", tmp_path, list, text)

    assert verify(path).claims.false
