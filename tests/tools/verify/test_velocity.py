"""`hoap3 verify` on logs of clik, clik_sdp and ghc_velocity: true ones, and changed ones."""

from __future__ import annotations

import math
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from driven import driven
from support.command_bench import inside
from tampering import Change, changed_field, rewrite

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.pairs import PAIRS, POSTURES
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.checkers import checker_of
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs
from hoap3.tools.verify.verify import verify

STATE, SETPOINT = Kind.STATE, Kind.SETPOINT
UR5 = ("--robot", "ur5", "--set", "emulator.posture=outstretched")
RUNS = {
    "clik": (*UR5, "--controller", "clik_ur5"),
    "clik_sdp": (*UR5, "--controller", "clik_sdp_ur5"),
    "writing": (*UR5, "--controller", "clik_sdp_writing"),
    "ghc_velocity": ("--controller", "ghc_velocity"),
}
OURS = [
    (controller, robot)
    for controller, robots in PAIRS.items()
    if controller.startswith(("clik", "ghc_velocity"))
    for robot in robots
]
TICKS = 160


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The log of a run, made when it is first asked for."""
    made: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in made:
            made[name] = tmp_path_factory.mktemp("velocity") / name
            given = *RUNS[name], "--duration", str(TICKS / 1000)
            inside("run", "--lockstep", *given, "--out", made[name])
        return made[name]

    return of


def bigger(value: float) -> float:
    """By the least that must be found."""
    return value * (1.0 + 1e-6)


def field(name: str, to: Callable[[float], float] = bigger) -> Callable[[Path, int], Change]:
    """A number of an answer becomes another."""
    return lambda _, number: changed_field(SETPOINT, number, name, to)


def column(name: str, to: Callable[[float], float] = bigger) -> Callable[[Path, int], Change]:
    """A column of `extra` becomes another."""

    def made(run: Path, number: int) -> Change:
        session = next(iter(runs(Log.open(run, side="controller").records()))).session
        place = session["extra"].index(name)
        return changed_field(SETPOINT, number, "extra", to, joint=place)

    return made


EVERY: dict[str, Callable[[Path, int], Change]] = {
    "q": lambda _, number: changed_field(STATE, number, "q", bigger, joint=2),
    "setpoint": lambda _, number: changed_field(SETPOINT, number, "values", bigger, joint=2),
    "decision": lambda _, number: changed_field(SETPOINT, number, "decision", bigger, joint=2),
    "V": field("v"),
    "V rate": field("v_rate_predicted"),
    "required V rate": field("v_rate_required", lambda rate: bigger(rate) or 1e-6),
    "rho": field("rho", lambda rho: rho * (1.0 - 1e-6) if rho else 1e-6),
    "margin": field("margin", lambda margin: bigger(margin) + 1e-6),
    "residual": field("kkt_residual", lambda residual: residual + 1e-5),
}
CLIK = {
    **EVERY,
    "error": column("error_hand"),
    "beta": column("beta"),
    "beta_actual": column("beta_actual"),
    "gain of the hand": column("gain_hand_2"),
    "gain of the wrist": column("gain_wrist"),
    "gain in the array": lambda _, number: changed_field(
        SETPOINT, number, "gains", bigger, joint=1
    ),
    "task_rank": column("task_rank", lambda rank: rank - 1),
    "remainder": column("remainder", lambda r: r + 1e-9),
    "floor": column("floor", lambda floor: bigger(floor) or 1e-6),
    "certified": field("solver_status", lambda status: 1),
}
KINDS = {
    "clik": {**CLIK, "certified": field("solver_status", lambda _: 0)},
    "clik_sdp": {**CLIK, "a gain that is none": column("gain_hand_1", lambda _: math.nan)},
    # errors of some 1e-5 m: a gain that is 1e-6 larger moves no claim
    "writing": {**CLIK, "gain of the hand": column("gain_hand_2", lambda gain: 1.1 * gain)},
    "ghc_velocity": {
        **EVERY,
        "error": column("error_com"),
        "alpha": column("alpha_posture_foot"),
        "gain": lambda _, number: changed_field(SETPOINT, number, "gains", bigger, joint=0),
        "solver_status": field("solver_status", lambda status: 1 if status == 0 else 0),
    },
}
SETTINGS = {
    "clik": ["gain_per_s: 2.0 > gain_per_s: 2.00001", "- -0.3 > - -0.300001"],
    "clik_sdp": ["beta_per_s: 8.0 > beta_per_s: 8.01", "- -0.4 > - -0.400001"],
    "writing": ["half_width_m: 0.1 > half_width_m: 0.1001", "period_s: 4.0 > period_s: 4.001"],
    "ghc_velocity": [
        "gain_per_s: 10.0 > gain_per_s: 10.0001",
        "speed_rad_s: 1.0 > speed_rad_s: 0.01",
        "smoothing: 0.02 > smoothing: 0.9",
        "- com > - posture",
        "approach_s: 1.5 > approach_s: 1.50001",
    ],
}


def found_in(run: Path, folder: Path, change: Change, config: bytes | None = None) -> Claims:
    """What `verify` finds in the controller's log with a change in it."""
    return verify(rewrite(run, "controller", folder, change, config)).claims


def moves(change: Change, run: Path) -> bool:
    """Whether it changes anything: a zero stays one."""
    before: list[Record] = list(Log.open(run, side="controller").records())
    return change(list(before)) != before


def assert_found(run: Path, name: str, kind: str, number: int, folder: Path) -> None:
    """It is found, and its tick, or the next, is the first that is named."""
    change = KINDS[name][kind](run, number)
    if not moves(change, run):
        return
    found = found_in(run, folder, change)
    assert found.false, (name, kind, number)
    first = min(one.tick for one in found.by_tick())
    assert abs(first - number) <= 1, (name, kind, number, found.by_tick()[:5])
    shutil.rmtree(folder)


@pytest.mark.parametrize("name", ["clik_sdp", "ghc_velocity"])
def test_a_true_log_is_true(name: str, logs: Callable[[str], Path]) -> None:
    found = verify(logs(name))

    assert found.claims.by_tick() == []
    assert found.verdict == "true"
    assert found.claims.counts["u"].checked >= TICKS


@pytest.mark.parametrize("name", ["clik_sdp", "ghc_velocity"])
def test_a_change_is_found(name: str, logs: Callable[[str], Path], tmp_path: Path) -> None:
    for kind in KINDS[name]:
        number = random.Random(name + kind).randrange(10, TICKS - 10)
        assert_found(logs(name), name, kind, number, tmp_path / kind)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_changes_are_found_wherever_they_are(
    name: str, logs: Callable[[str], Path], tmp_path: Path
) -> None:
    for kind in KINDS[name]:
        for number in random.Random(kind).sample(range(10, TICKS - 10), 4):
            assert_found(logs(name), name, kind, number, tmp_path / kind)


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_each_kind_of_change_is_found_at_a_hundred_places(
    name: str, logs: Callable[[str], Path], tmp_path: Path
) -> None:
    for kind in KINDS[name]:
        for number in random.Random(kind).sample(range(10, TICKS - 10), 100):
            assert_found(logs(name), name, kind, number, tmp_path / kind)


@pytest.mark.slow
def test_near_the_target_the_rounding_of_errors_is_no_false_alarm(tmp_path: Path) -> None:
    """There |e| is so small that what is known of a place is more than 1e-9 of it."""
    given = "--robot", "hoap3", "--controller", "clik_sdp", "--duration", "6"
    inside("run", "--lockstep", *given, "--out", tmp_path / "run")

    assert verify(tmp_path / "run").claims.by_tick() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "setting"), [(name, each) for name, all_ in SETTINGS.items() for each in all_]
)
def test_another_setting_in_the_config_is_found(
    name: str, setting: str, logs: Callable[[str], Path], tmp_path: Path
) -> None:
    run = logs(name)
    before, after = setting.split(" > ")
    text = Log.open(run, side="controller").config
    assert before in text, text

    found = found_in(run, tmp_path / "o", lambda all_: all_, text.replace(before, after).encode())

    assert found.false


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "robot"), OURS)
def test_the_log_of_each_shipped_config_is_true(
    controller: str, robot: str, tmp_path: Path
) -> None:
    posture = POSTURES.get((controller, robot))
    start = ("--set", f"emulator.posture={posture}") if posture else ()
    given = "--robot", robot, "--controller", controller, *start, "--duration", "1"
    inside("run", "--lockstep", *given, "--out", tmp_path / "run")

    found = verify(tmp_path / "run")

    assert found.claims.by_tick() == []
    assert found.verdict == "true"


CHANGED = [
    ("clik_sdp", "damping=0.05", "true"),
    ("clik_sdp", "kinematics_from=reference", "true"),
    ("clik_sdp", "integrate_from=measured", "true"),
    ("clik_sdp", "budget=2", "true"),
    ("clik_sdp", "beta_per_s=900000", "true"),
    ("writing", "damping=0.05", "true"),
    ("writing", "bounds.speed_rad_s=0.5", "true"),
    ("clik", "damping=0.1", "true"),
    ("ghc_velocity", "smoothing=0.0", "true"),
    ("ghc_velocity", "kinematics_from=reference", "true"),
    ("ghc_velocity", "bounds.speed_rad_s=0.02", "true"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "setting", "verdict"), CHANGED)
def test_settings_that_users_change_are_no_false_alarm(
    name: str, setting: str, verdict: str, tmp_path: Path
) -> None:
    changed = "--set", f"controller.parameters.{setting}", "--duration", "0.5"
    inside("run", "--lockstep", *RUNS[name], *changed, "--out", tmp_path / "run")

    found = verify(tmp_path / "run")

    assert found.claims.by_tick() == []
    assert found.verdict == verdict


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_late_answers_and_delays_are_no_false_alarm(name: str, tmp_path: Path) -> None:
    late = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=200"
    for setting, verdict in ((late, "true"), (("emulator.delay_ticks=2",), "not verified")):
        sets = [word for each in setting for word in ("--set", each)]
        folder = tmp_path / setting[0]
        inside("run", "--lockstep", *RUNS[name], *sets, "--duration", "0.2", "--out", folder)

        found = verify(folder)

        assert found.claims.by_tick() == []
        assert found.verdict == verdict


@pytest.mark.parametrize(
    "wrong",
    [
        "tasks: 3",
        "tasks: [3]",
        "tasks: [{task: none}]",
        "tasks: [{task: com, weight: .nan}]",
        "damping: yes",
        "bounds: {speed_rad_s: fast}",
    ],
)
def test_a_setting_that_is_none_is_not_reckoned_with(
    wrong: str, logs: Callable[[str], Path], tmp_path: Path
) -> None:
    config = f"controller: clik_sdp\nparameters: {{{wrong}}}\n".encode()

    found = verify(rewrite(logs("clik_sdp"), "controller", tmp_path / "o", list, config))

    assert found.verdict == "not verified"
    assert sum(found.claims.counts["certificate"].unverified.values()) == TICKS


def judged(config: str, robot: str, ticks: int, **given: object) -> Claims:
    """What is found of a controller that a made-up robot drives."""
    run, parameters = driven(config, robot, ticks, **given)
    claims = Claims()
    known = "ghc_velocity", "clik_sdp", "clik"
    check = checker_of(next(name for name in known if config.startswith(name)))
    assert check is not None
    check(run, parameters, claims)
    return claims


PRIORITIES = {
    "order": ["com", "foot", "posture"],
    "timeline": [
        {"at_s": 0.02, "over_s": 0.01, "set": [["foot", "posture", 1.0]]},
        {"at_s": 0.05, "remove": "foot"},
        {"at_s": 0.07, "insert": "foot", "over_s": 0.02},
    ],
}
LIVE = {
    15: {"set": [["com", "posture", 0.5]], "over_s": 0.004},
    41: {"order": ["posture", "com"]},
    110: {"remove": ["posture"], "over_s": 0.01},
    131: {"set": [["com", "foot", 0.25]]},
}


def test_priorities_that_change_while_it_runs_are_followed() -> None:
    given = {"changes": LIVE, "pauses": (60, 61, 62), "priorities": PRIORITIES, "noise": 1e-6}

    found = judged("ghc_velocity", "hoap3", 150, **given)

    assert found.by_tick() == []
    assert found.unverifiable == 0
    assert found.counts["alpha"].checked == 147 * 9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("config", "robot", "posture"),
    [
        ("clik_ur5", "ur5", "outstretched"),
        ("clik_sdp_ur5", "ur5", "outstretched"),
        ("clik_sdp_writing", "ur5", "outstretched"),
        ("clik_sdp_hoap3", "hoap3", None),
        ("ghc_velocity", "hoap3", None),
    ],
)
def test_lost_answers_unseen_states_and_noise_are_no_false_alarm(
    config: str, robot: str, posture: str | None, seed: int
) -> None:
    given = {"lost": 0.1, "unseen": 0.05, "noise": 1e-4, "pauses": (50, 200), "seed": seed}

    found = judged(config, robot, 400, posture=posture, **given)

    assert found.by_tick() == []
    assert found.unverifiable == 0
