"""`hoap3 verify` of controllers that command accelerations and torques."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import inside
from tampering import Change, changed_field, rewrite

from hoap3.protocol.robot import viability_bounds_reference as reference
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.registry import find
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.controllers.acceleration import bounds, joint_acceleration
from hoap3.tools.verify.verify import verify

STATE, SETPOINT = Kind.STATE, Kind.SETPOINT
Story = Callable[[str], Path]
ROBOTS = {
    "joint_acceleration": "hoap3",
    "tsid_baxter": "baxter",
    "tsid": "ur5",
    "ghc": "lwr_weightless",
    "ghc_torque": "lwr_weightless",
    "hqp": "lwr_weightless",
    "weighted": "lwr_weightless",
}


def ran(folder: Path, controller: str, *settings: str, seconds: float = 0.5) -> Path:
    """A run in lockstep with settings."""
    given = "--robot", ROBOTS[controller], "--controller", controller, "--duration", seconds
    sets = [word for setting in settings for word in ("--set", setting)]
    done = inside("run", "--lockstep", *given, "--out", folder, *sets)
    assert done.code in {0, 1}, done.stderr
    return folder


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    """The log of a controller by its config, made once."""
    found: dict[str, Path] = {}

    def get(controller: str) -> Path:
        if controller not in found:
            found[controller] = ran(tmp_path_factory.mktemp("story") / "run", controller)
        return found[controller]

    return get


@pytest.mark.parametrize("controller", ROBOTS)
def test_a_true_log_is_true(controller: str, story: Story) -> None:
    found = verify(story(controller))

    assert found.claims.by_tick() == []
    assert found.verdict == "true"


IN_BOUNDS = "controller.parameters.bounds."
SETTINGS = {
    "naive bounds": ("joint_acceleration", (f"{IN_BOUNDS}kind=naive",)),
    "no bounds": ("joint_acceleration", (f"{IN_BOUNDS}kind=none",)),
    "less acceleration": (
        "joint_acceleration",
        (f"{IN_BOUNDS}shrink=true", f"{IN_BOUNDS}acceleration_max=[1000]"),
    ),
    "lost answers": (
        "joint_acceleration",
        ("emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=600"),
    ),
    "a wall": (
        "joint_acceleration",
        ("controller.parameters.posture=null", f"controller.parameters.posture_rad={[-3.0] * 21}"),
    ),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_other_settings_raise_no_false_alarm(name: str, tmp_path: Path) -> None:
    controller, settings = SETTINGS[name]

    found = verify(ran(tmp_path / "run", controller, *settings, seconds=0.4))

    assert found.claims.by_tick() == []
    assert found.verdict == "true"


def bigger(value: float) -> float:
    """By the least that must be found."""
    return value * (1.0 + 1e-6)


CHANGES: dict[str, Callable[[int], Change]] = {
    "reference": lambda n: changed_field(STATE, n, "reference", bigger, joint=3),
    "setpoint": lambda n: changed_field(SETPOINT, n, "values", bigger, joint=3),
    "V": lambda n: changed_field(SETPOINT, n, "v", bigger),
    "V rate": lambda n: changed_field(SETPOINT, n, "v_rate_predicted", bigger),
    "required V rate": lambda n: changed_field(SETPOINT, n, "v_rate_required", lambda r: r + 1e-6),
    "rho": lambda n: changed_field(SETPOINT, n, "rho", lambda rho: rho * (1 - 1e-6)),
    "margin": lambda n: changed_field(SETPOINT, n, "margin", lambda m: m + 1e-6),
    "residual": lambda n: changed_field(SETPOINT, n, "kkt_residual", lambda r: r + 1e-6),
    "active joints": lambda n: changed_field(SETPOINT, n, "active_joints", lambda a: a + 1),
    "status": lambda n: changed_field(SETPOINT, n, "solver_status", lambda s: s + 1),
    "path": lambda n: changed_field(SETPOINT, n, "solver_path", lambda p: p + 1),
    "fallback": lambda n: changed_field(SETPOINT, n, "fallback", lambda f: f + 1),
    "q": lambda n: changed_field(STATE, n, "q", bigger, joint=3),
    "dq": lambda n: changed_field(STATE, n, "dq", lambda v: v + 1e-6, joint=3),
    "torque share": lambda n: changed_field(SETPOINT, n, "extra", bigger, joint=0),
    "error": lambda n: changed_field(SETPOINT, n, "extra", bigger, joint=1),
    "importance": lambda n: changed_field(SETPOINT, n, "extra", lambda a: a + 1e-6, joint=-1),
}


def applies(kind: str, controller: str) -> bool:
    """Whether a controller claims such a thing."""
    if controller == "joint_acceleration":  # which starts from the reference, and has no columns
        return kind not in {"q", "dq", "torque share", "error", "importance"}
    return kind != "reference"


@pytest.mark.parametrize("controller", ROBOTS)
@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_changed_is_found(kind: str, controller: str, story: Story, tmp_path: Path) -> None:
    if applies(kind, controller):
        _find_all(kind, controller, story(controller), 2, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("controller", ROBOTS)
@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_changed_is_found_at_a_hundred_places(
    kind: str, controller: str, story: Story, tmp_path: Path
) -> None:
    if applies(kind, controller):
        _find_all(kind, controller, story(controller), 100, tmp_path)


PARAMETERS = {
    "joint_acceleration": ("kp: 100.0", "kp: 100.0001"),
}


@pytest.mark.parametrize("controller", PARAMETERS)
def test_another_parameter_in_the_config_is_found(
    controller: str, story: Story, tmp_path: Path
) -> None:
    run, (old, new) = story(controller), PARAMETERS[controller]
    config = Log.open(run, side="controller").config
    assert old in config

    path = rewrite(
        run, "controller", tmp_path, lambda all_: all_, config.replace(old, new).encode()
    )

    assert verify(path).claims.false


@pytest.mark.parametrize("wrong", ["kp: .nan", "kp: yes", "posture: [1]", "bounds: {kind: some}"])
def test_a_parameter_that_is_none_is_not_reckoned_with(
    wrong: str, story: Story, tmp_path: Path
) -> None:
    config = f"controller: joint_acceleration\nparameters:\n  {wrong}\n".encode()

    found = verify(rewrite(story("joint_acceleration"), "controller", tmp_path, list, config))

    assert found.verdict == "not verified"
    assert found.claims.counts["certificate"].checked == 0


def test_bounds_are_those_that_their_meaning_gives() -> None:
    rng = np.random.default_rng(5)
    n, T = 4000, 0.002
    speed, up, down = (rng.uniform(low, 2 * low, n) for low in (1.0, 20.0, 20.0))
    found = bounds.Bounds(
        "viability", np.full(n, -1.0), np.full(n, 1.0), speed, up, down, up, T, 0.8, 0.0
    )
    room = 10.0 ** rng.uniform(-5.0, -1.5, n)  # of the upper limit
    fastest = np.minimum(speed, np.sqrt(2 * 0.8 * down * room))
    q, v = 1.0 - room, fastest * rng.uniform(0.97, 1.0, n)

    lower, upper = found.at(q, v)

    stops = reference.bounds(1.0 - q, q + 1.0, v, speed, up, 0.8 * down, T)
    held = (np.abs(stops[1]) < 0.7 * up) & (np.abs(stops[1]) < 0.7 * down)
    assert held.sum() > n / 10
    assert np.abs(upper - stops[1])[held].max() < 1e-9 * up.max()
    mirrored = found.at(-q, -v)[0]
    assert np.array_equal(replace(found, up=down, down=up).at(q, v)[1], -mirrored)
    assert (lower <= upper).all()


def test_defaults_are_those_of_the_controllers() -> None:
    tables = {"joint_acceleration": joint_acceleration.DEFAULTS}
    for name, table in tables.items():
        _assert_defaults(find(name).Parameters, table)


def _assert_defaults(model: type, table: dict) -> None:
    fields = model.model_fields
    for key, value in table.items():
        default = fields[key].default
        if isinstance(value, dict):
            _assert_defaults(type(default), value)
            assert {field: getattr(default, field) for field in value} == value
        else:
            assert default == value, key


def _find_all(kind: str, controller: str, run: Path, count: int, folder: Path) -> None:
    """A change is found at so many random places, unless it changes nothing there."""
    before: list[Record] = list(Log.open(run, side="controller").records())
    for number in random.Random(kind).sample(range(10, 450), count):
        change = CHANGES[kind](number)
        if change(list(before)) == before:
            continue
        path = rewrite(run, "controller", folder / str(number), change)
        found = verify(path).claims
        assert found.false, number
        first = min(one.tick for one in found.by_tick())
        assert abs(first - number) <= 1, (number, found.by_tick()[:5])
