"""`hoap3 verify` on logs of clik, clik_sdp and ghc_velocity: true ones, and changed ones."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from driven import recorded
from support.checked_answers import check_answers
from tampering import (
    ANSWERS,
    SETPOINT,
    STATE,
    Change,
    assert_no_false_alarm,
    bigger,
    changed_field,
    config_of,
    find_change,
    ran,
    rewrite,
)

from hoap3.remote_controller.pairs import PAIRS, POSTURES
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import runs
from hoap3.tools.verify.verify import verify

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

    @cache
    def of(name: str) -> Path:
        folder = tmp_path_factory.mktemp("velocity") / name
        return ran(folder, *RUNS[name], seconds=TICKS / 1000)

    return of


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
    **{kind: lambda _, number, made=made: made(number) for kind, made in ANSWERS.items()},
    "q": lambda _, number: changed_field(STATE, number, "q", bigger, joint=2),
    "setpoint": lambda _, number: changed_field(SETPOINT, number, "values", bigger, joint=2),
    "decision": lambda _, number: changed_field(SETPOINT, number, "decision", bigger, joint=2),
    "margin": field("margin", lambda margin: bigger(margin) + 1e-6),
}
CLIK = {
    **EVERY,
    "error": column("error_hand"),
    "beta": column("beta"),
    "beta_actual": column("beta_actual"),
    "gain of the hand": column("gain_hand_2"),
    "gain of the wrist": column("gain_wrist"),
    "gain in the array": lambda _, n: changed_field(SETPOINT, n, "gains", bigger, joint=1),
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


def find_changes(run: Path, name: str, kind: str, count: int, folder: Path) -> None:
    """Each of so many is found at its tick, or the next."""
    for number in random.Random(name + kind).sample(range(10, TICKS - 10), count):
        find_change(KINDS[name][kind](run, number), run, "controller", number, folder)


@pytest.mark.parametrize("name", ["clik_sdp", "ghc_velocity"])
def test_a_true_log_is_true(name, logs):
    found = assert_no_false_alarm(logs(name))
    assert found.claims.counts["V"].checked >= TICKS


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clik_sdp", "ghc_velocity"])
def test_a_change_is_found(name, logs, tmp_path):
    for kind in KINDS[name]:
        find_changes(logs(name), name, kind, 1, tmp_path / kind)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_changes_are_found_wherever_they_are(name, logs, tmp_path):
    for kind in KINDS[name]:
        find_changes(logs(name), name, kind, 4, tmp_path / kind)


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_each_kind_of_change_is_found_at_a_hundred_places(name, logs, tmp_path):
    for kind in KINDS[name]:
        find_changes(logs(name), name, kind, 100, tmp_path / kind)


@pytest.mark.slow
def test_near_the_target_the_rounding_of_errors_is_no_false_alarm(tmp_path):
    """There |e| is so small that what is known of a place is more than 1e-9 of it."""
    run = ran(tmp_path / "run", "--controller", "clik_sdp", seconds=6)

    assert verify(run).claims.by_tick() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "setting"), [(name, each) for name, all_ in SETTINGS.items() for each in all_]
)
def test_another_setting_in_the_config_is_found(name, setting, logs, tmp_path):
    run = logs(name)
    before, after = setting.split(" > ")
    text = config_of(run)
    assert before in text, text
    config = text.replace(before, after).encode()

    assert verify(rewrite(run, "controller", tmp_path / "o", list, config)).claims.false


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "robot"), OURS)
def test_the_log_of_each_shipped_config_is_true(controller, robot, tmp_path):
    posture = POSTURES.get((controller, robot))
    start = ("--set", f"emulator.posture={posture}") if posture else ()
    given = "--robot", robot, "--controller", controller, *start
    assert_no_false_alarm(ran(tmp_path / "run", *given, seconds=1))


CHANGED = [
    ("clik_sdp", "damping=0.05"),
    ("clik_sdp", "kinematics_from=reference"),
    ("clik_sdp", "integrate_from=measured"),
    ("clik_sdp", "budget=2"),
    ("clik_sdp", "beta_per_s=900000"),
    ("writing", "damping=0.05"),
    ("writing", "bounds.speed_rad_s=0.5"),
    ("clik", "damping=0.1"),
    ("ghc_velocity", "smoothing=0.0"),
    ("ghc_velocity", "kinematics_from=reference"),
    ("ghc_velocity", "bounds.speed_rad_s=0.02"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "setting"), CHANGED)
def test_settings_that_users_change_are_no_false_alarm(name, setting, tmp_path):
    sets = [f"controller.parameters.{setting}"]
    assert_no_false_alarm(ran(tmp_path / "run", *RUNS[name], sets=sets, seconds=0.5))


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_late_answers_and_delays_are_no_false_alarm(name, tmp_path):
    late = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=200"
    for setting, verdict in ((late, "true"), (("emulator.delay_ticks=2",), "not verified")):
        run = ran(tmp_path / setting[0], *RUNS[name], sets=setting, seconds=0.2)
        assert_no_false_alarm(run, verdict)


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
def test_a_setting_that_is_none_is_not_reckoned_with(wrong, logs, tmp_path):
    config = f"controller: clik_sdp\nparameters: {{{wrong}}}\n".encode()

    found = verify(rewrite(logs("clik_sdp"), "controller", tmp_path / "o", list, config))

    assert found.verdict == "not verified"
    assert sum(found.claims.counts["certificate"].unverified.values()) == TICKS


def judged(config: str, robot: str, ticks: int, **given: object) -> Claims:
    """What is found of a controller that a made-up robot drives."""
    records, parameters = recorded(config, robot, ticks, **given)
    known = "ghc_velocity", "clik_sdp", "clik"
    name = next(name for name in known if config.startswith(name))
    return check_answers(records, name, parameters)


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
def test_lost_answers_unseen_states_and_noise_are_no_false_alarm(config, robot, posture, seed):
    given = {"lost": 0.1, "unseen": 0.05, "noise": 1e-4, "pauses": (50, 200), "seed": seed}

    found = judged(config, robot, 400, posture=posture, **given)

    assert found.by_tick() == []
    assert found.unverifiable == 0
