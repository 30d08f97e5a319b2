"""`hoap3 verify` of robots that balance on their soles."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from tampering import (
    ANSWERS,
    SETPOINT,
    STATE,
    Change,
    assert_no_false_alarm,
    changed_field,
    config_of,
    ran,
    rewrite,
)

from hoap3.protocol.config.settings import parse_yaml
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

N, BASE = 21, 6
CONFIGS = Path(__file__).parents[3] / "remote_controller" / "configs"
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
def test_a_true_log_is_verified_as_a_whole(name, story):
    counts = assert_no_false_alarm(story(name)).claims.counts

    assert counts["equations of motion"].checked == counts["optimum"].checked == 50


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
    "status": changed_field(SETPOINT, 20, "solver_status", lambda v: v + 1),
    "active joints": changed_field(SETPOINT, 20, "active_joints", lambda v: v + 1),
    "error": changed_field(SETPOINT, 20, "extra", lambda v: v + 1e-6, joint=1),
    "importance": changed_field(SETPOINT, 20, "extra", lambda v: v + 1e-6, joint=4),
    **{name: ANSWERS[name](20) for name in ("V", "rho", "margin", "residual")},
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


OTHERS: list[tuple[str, str, object]] = [
    ("ghc", "contacts.friction", 1e-3),
    ("ghc", "contacts.damping_per_s", 1e3),
    ("ghc", "contacts.least_share", 0.49),
    ("ghc", "tasks.0.kp", 36.1),
    ("ghc", "tasks.2.kd", 12.0),
    ("ghc", "w_r", 1.01e-4),
    ("tsid", "tasks.1.kp", 101.0),
    ("tsid", "posture.weight", 1.01e-5),
    ("tsid", "priorities.weights", {"upright": -1e-3}),
]


@pytest.mark.parametrize(("name", "key", "value"), OTHERS, ids=[f"{n} {k}" for n, k, _ in OTHERS])
def test_other_numbers_in_the_config_are_found(name, key, value, story, tmp_path):
    config = parse_yaml(config_of(story(name)), "config")
    *path, last = key.split(".")
    inner = config["parameters"]
    for part in path:
        inner = inner[int(part)] if part.isdigit() else inner[part]
    inner[last] = value

    changed = rewrite(story(name), "controller", tmp_path, list, json.dumps(config).encode())

    assert verify(changed).claims.false


UNREAD: dict[str, tuple[str, dict[str, object], str]] = {
    "user's task": ("ghc", {"tasks": [{"task": "own:Reach"}]}, "--allow-code"),
    "wrench": ("ghc", {"tasks": [{"task": "wrench", "parameters": {}}]}, "a wrench"),
    "small w_r": ("ghc", {"w_r": 0.9e-6}, "w_r"),
    "goal": ("tsid", {"tasks": None, "goal": {"position_m": [0.0, 0.0, 0.5]}}, "the goal"),
}


@pytest.mark.parametrize("kind", UNREAD)
def test_mechanics_are_verified_without_the_tasks(kind, story, tmp_path):
    name, changes, reason = UNREAD[kind]
    config = parse_yaml(config_of(story(name)), "config")
    config["parameters"].update(changes)
    path = rewrite(story(name), "controller", tmp_path, list, json.dumps(config).encode())

    counts = verify(path).claims.counts

    assert counts["equations of motion"].checked == counts["friction cones"].checked == 50
    assert reason in next(iter(counts["tasks and optimum"].unverified))


def test_what_stands_in_for_the_optimum_is_verified(tmp_path):
    """Torques that are too small: the robot sinks, and its soles leave the ground."""
    robot, controller = PAIRS["tsid"]
    weak = "controller.parameters.bounds.torque_max=[0.6]"
    names = "--robot", robot, "--controller", controller
    run = ran(tmp_path / "run", *names, sets=[weak], seconds=0.4)

    claims = verify(run / "controller.mcap").claims

    assert claims.by_tick() == []
    assert claims.counts["optimum"].checked > claims.counts["certified: solved"].checked > 0
    assert claims.counts["braking"].checked > 0
    assert claims.counts["fallback: least violation"].unverified


@pytest.mark.parametrize(
    ("name", "changes", "optima"),
    [
        ("hqp", {}, 0),
        ("weighted", {"priorities": {"weights": {"upright": 0.01, "posture": 1e-4}}}, 50),
    ],
)
def test_other_controllers_of_a_free_base_are_verified(name, changes, optima, tmp_path):
    robot, controller = PAIRS["ghc"]
    config = parse_yaml((CONFIGS / f"{controller}.yaml").read_text("utf-8"), "config")
    config["controller"] = name
    config["parameters"].update(changes)
    path = tmp_path / "config.yaml"
    path.write_text(json.dumps(config), "utf-8")
    run = ran(tmp_path / "run", "--robot", robot, "--controller", path, seconds=0.05)

    counts = verify(run).claims.counts

    assert not any(count.false for count in counts.values())
    assert counts["equations of motion"].checked == counts["margin"].checked == 50
    assert counts["optimum"].checked == optima
