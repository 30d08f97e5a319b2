"""`hoap3 verify` believes true logs, and finds what was changed in them, at its tick."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support import HOUSE
from support.command_bench import inside
from tampering import (
    Change,
    changed_field,
    changed_limit,
    changed_summary,
    removed,
    rewrite,
    swapped,
)

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.robot_emulator.robots import load
from hoap3.tools.logs.log import Log
from hoap3.tools.verify.deadline_checker import COUNTED, Recount
from hoap3.tools.verify.point_task import PointTask
from hoap3.tools.verify.verify import verify

GOLDEN = HOUSE / "tests" / "tools" / "logs" / "golden_v1"
SIDES = "emulator", "controller"
PAIRS = [
    ("hoap3", "qp12_paper"),
    ("humanoid32", "pinv"),
    ("lwr", "osqp"),
    *(
        pytest.param(*pair, marks=pytest.mark.slow)
        for pair in (("hoap3", "qp12"), ("hoap3", "pinv"), ("ur5", "qp12"))
    ),
]


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("story") / "qp12"
    words = ("run", "--lockstep", "--controller", "qp12", "--duration", "0.5")
    inside(*words, "--out", folder)
    return folder


@pytest.mark.parametrize(("robot", "controller"), PAIRS)
def test_a_true_log_is_true(robot: str, controller: str, tmp_path: Path) -> None:
    given = "--robot", robot, "--controller", controller, "--duration", "0.5"
    inside("run", "--lockstep", *given, "--out", tmp_path / "run")

    found = verify(tmp_path / "run")

    assert found.claims.by_tick() == []
    assert found.verdict == "true"


@pytest.mark.parametrize(
    "controller",
    ["qp12", *(pytest.param(name, marks=pytest.mark.slow) for name in ("pinv", "osqp"))],
)
def test_a_robot_that_all_but_rests_at_its_target_is_no_false_alarm(
    controller: str, tmp_path: Path
) -> None:
    description = load("hoap3")
    assert description.default_task is not None
    start = {"target_m": [0.0, 0.0, 0.0], "point": description.default_task.point}
    task = PointTask.of(description, start)
    assert task is not None
    place, _ = task.at(description.initial_position)
    for number, away in enumerate((1e-12, 1e-9)):
        target = "controller.parameters.target_m=" + json.dumps((place + away).tolist())
        given = "--controller", controller, "--duration", "0.1", *_sets(target)
        folder = tmp_path / str(number)
        inside("run", "--lockstep", *given, "--out", folder)

        assert verify(folder).claims.by_tick() == []


def test_late_and_lost_answers_are_counted_as_the_robot_did(tmp_path: Path) -> None:
    slow = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=60"
    inside("run", "--lockstep", "--duration", "0.05", "--out", tmp_path / "run", *_sets(*slow))

    found = verify(tmp_path / "run")

    assert found.claims.by_tick() == []
    assert Log.open(tmp_path / "run", side="robot").states()["late"][-1] > 0


@pytest.mark.parametrize(
    ("rule", "delay"),
    [
        ("next_tick", 2),
        ("after_receipt", 0),
        pytest.param("next_tick", 0, marks=pytest.mark.slow),
        pytest.param("after_receipt", 2, marks=pytest.mark.slow),
    ],
)
def test_each_deadline_rule_is_recounted(rule: str, delay: int, tmp_path: Path) -> None:
    settings = f"emulator.deadline={rule}", f"emulator.delay_ticks={delay}"
    inside("run", "--lockstep", "--duration", "0.1", "--out", tmp_path / "run", *_sets(*settings))

    assert verify(tmp_path / "run").claims.by_tick() == []


def test_answers_that_a_solver_gave_up_on_are_no_false_alarm(tmp_path: Path) -> None:
    few = "controller.parameters.max_iterations=1", "controller.parameters.polish=false"
    given = "--controller", "osqp", "--duration", "0.1", "--out", tmp_path / "run"
    inside("run", "--lockstep", *given, *_sets(*few))

    assert verify(tmp_path / "run").claims.by_tick() == []


def test_kinematics_from_the_reference_are_followed_or_not_judged(tmp_path: Path) -> None:
    for delay in (0, 3):
        settings = (
            "controller.parameters.kinematics_from=reference",
            f"emulator.delay_ticks={delay}",
        )
        folder = tmp_path / str(delay)
        inside("run", "--lockstep", "--duration", "0.1", "--out", folder, *_sets(*settings))

        found = verify(folder)

        assert found.claims.by_tick() == []
        assert found.verdict == ("not verified" if delay else "true")


def test_a_log_whose_first_files_are_gone_is_no_false_alarm(tmp_path: Path) -> None:
    small = [f"{side}.log.{key}" for side in SIDES for key in ("file_mb=1", "cap_mb=2")]
    inside("run", "--lockstep", "--duration", "5", "--out", tmp_path / "run", *_sets(*small))
    for side in ("robot", "controller"):
        first = tmp_path / "run" / f"{side}.mcap"
        first.unlink(missing_ok=True)

    found = verify(tmp_path / "run")

    assert not Log.open(tmp_path / "run", side="controller").from_begin
    assert found.claims.by_tick() == []
    assert found.verdict == "not verified"


def test_records_that_were_dropped_are_no_false_alarm(story: Path, tmp_path: Path) -> None:
    def dropped(records: list[Record]) -> list[Record]:
        at = len(records) // 2
        gap = Record(Kind.GAP, records[at].stamp, b'{"dropped": 21, "damaged_bytes": 0}')
        return [*records[:at], gap, *records[at + 21 :]]

    for side in ("controller", "robot"):
        found = verify(rewrite(story, side, tmp_path / side, dropped))
        assert found.claims.by_tick() == []
        assert found.verdict == "not verified"


def test_logs_of_two_runs_are_not_passed_together(story: Path, tmp_path: Path) -> None:
    both = tmp_path / "both"
    inside("run", "--lockstep", "--duration", "0.1", "--seed", "9", "--out", both)
    shutil.copy(story / "robot.mcap", both)

    found = verify(both)

    assert found.verdict == "not verified"


def test_the_description_of_another_robot_is_found(story: Path, tmp_path: Path) -> None:
    both = tmp_path / "both"
    other = "--set", "emulator.plant.gravity=compensated"
    inside("run", "--lockstep", "--duration", "0.5", "--out", both, *other)
    shutil.copy(story / "controller.mcap", both)

    found = verify(both).claims.counts["description in both logs"]

    assert (found.checked, found.false) == (1, 1)


@pytest.mark.parametrize(
    ("side", "path", "to"),
    [
        ("controller", ("tasks", 0, "error"), lambda _: 1e-5),
        ("controller", ("tasks", 0, "within"), lambda within: not within),
        ("controller", ("certified",), lambda certified: certified - 1),
        ("controller", ("answers",), lambda answers: answers + 1),
        ("robot", ("safe_stops",), lambda stops: stops + 1),
        ("robot", ("in_time",), lambda in_time: in_time - 1),
    ],
)
def test_a_summary_that_is_not_what_its_log_shows_is_found(
    side: str, path: tuple[str | int, ...], to: Any, story: Path, tmp_path: Path
) -> None:
    found = verify(rewrite(story, side, tmp_path / "o", changed_summary(*path, to=to)), repeat=True)

    assert found.verdict == "false"
    assert all(one.claim.startswith("summary: ") for one in found.claims.by_tick())


LIMITS = ("lower", "upper", "velocity", "setpoint_acceleration_max", "brake_acceleration", "effort")


@pytest.mark.parametrize("places", [5, pytest.param(100, marks=pytest.mark.long)])
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_bound_that_is_another_in_one_log_is_found(
    side: str, places: int, story: Path, tmp_path: Path
) -> None:
    joints = Log.open(story, side=side).description.joints
    known = [(n, key) for n, joint in enumerate(joints) for key in LIMITS if getattr(joint, key)]
    for number, (joint, key) in enumerate(random.Random(side).sample(known, places)):
        folder = tmp_path / str(number)
        rewrite(story, side, folder, changed_limit(joint, key))
        other = "robot" if side == "controller" else "controller"
        shutil.copy(story / f"{other}.mcap", folder)
        assert verify(folder).claims.counts["description in both logs"].false == 1, (key, joint)
        shutil.rmtree(folder)


@pytest.mark.parametrize("wrong", ["beta: [1]", "beta: .nan", "beta: yes", "psi_scale: none"])
def test_a_parameter_that_is_none_is_not_reckoned_with(
    wrong: str, story: Path, tmp_path: Path
) -> None:
    config = f"controller: qp12\nparameters:\n  {wrong}\n".encode()

    found = verify(rewrite(story, "controller", tmp_path / "o", lambda all_: all_, config))

    assert found.verdict == "not verified"
    assert found.claims.counts["certificate"].checked == 0


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (Kind.AUTHORITY, b"{}"),
        (Kind.SESSION, b"[]"),
        (Kind.SUMMARY, b"[" * 100_000 + b"]" * 100_000),
        (Kind.CHANGE, b"3"),
    ],
)
def test_what_no_service_writes_is_one_error(
    kind: Kind, payload: bytes, story: Path, tmp_path: Path
) -> None:
    def emptied(records: list[Record]) -> list[Record]:
        strange = [r._replace(payload=payload) if r.kind == kind else r for r in records]
        return [*strange, Record(kind, records[-1].stamp, payload)]

    done = inside("verify", rewrite(story, "controller", tmp_path / "o", emptied))

    assert done.code in {1, 2}
    assert "Traceback" not in done.stderr
    assert "no service of ours" in done.stderr


@pytest.mark.parametrize("wrong", ["long", "old"])
def test_what_a_robot_refuses_is_no_answer_in_the_recount(wrong: str) -> None:
    """Anybody may send it, so it may stand in any log."""
    recount = Recount(load("ur5"))
    state = State.allocate(**load("ur5").state_lengths)
    state.session_id, state.epoch, state.mode = 7, 1, State.ACTIVE
    recount.state(state.dump())
    state.mode = State.IDLE
    for state.tick in range(1, 1025 if wrong == "old" else 2):
        recount.state(state.dump())
    answer = Setpoint(6, 257 if wrong == "long" else 2)
    answer.session_id, answer.epoch = 7, 1
    recount.setpoint(0, answer.dump())
    recount.state(state.dump())
    counted = dict(zip(COUNTED, recount.found[-len(COUNTED) :], strict=True))
    assert (counted["rejected"], counted["duplicate"]) == (1, 0)


@pytest.mark.parametrize("run", ["qp12", "ghc", "clik_sdp"])
def test_nothing_in_a_log_of_version_1_is_false(run: str) -> None:
    found = verify(GOLDEN / run)

    assert found.claims.by_tick() == []
    assert found.verdict == "true"


def bigger(value: float) -> float:
    """By the least that must be found."""
    return value * (1.0 + 1e-6)


HALF_PERIOD = 500_000
STATE, SETPOINT = Kind.STATE, Kind.SETPOINT
CONTROLLERS = {
    "q": lambda n: changed_field(STATE, n, "q", bigger, joint=3),
    "setpoint": lambda n: changed_field(SETPOINT, n, "values", bigger, joint=4),
    "decision": lambda n: changed_field(SETPOINT, n, "decision", bigger, joint=4),
    "V": lambda n: changed_field(SETPOINT, n, "v", bigger),
    "V rate": lambda n: changed_field(SETPOINT, n, "v_rate_predicted", bigger),
    "required V rate": lambda n: changed_field(SETPOINT, n, "v_rate_required", bigger),
    "rho": lambda n: changed_field(SETPOINT, n, "rho", lambda rho: rho * (1 - 1e-6)),
    "margin": lambda n: changed_field(SETPOINT, n, "margin", bigger),
    "residual": lambda n: changed_field(SETPOINT, n, "kkt_residual", lambda r: r + 1e-5),
    "removed State": lambda n: removed(STATE, n),
    "removed answer": lambda n: removed(SETPOINT, n),
    "swapped States": lambda n: swapped(STATE, n),
    "swapped answers": lambda n: swapped(SETPOINT, n),
    "epoch": lambda n: changed_field(SETPOINT, n, "epoch", lambda epoch: epoch + 1),
    "stamp": lambda n: changed_field(SETPOINT, n, "stamp_state", lambda t: t + HALF_PERIOD),
}
MAY_STAY = {"q", "setpoint", "decision"}  # where the number is 0
ROBOTS = {
    "removed State": lambda n: removed(STATE, n),
    "removed answer": lambda n: removed(SETPOINT, n),
    "swapped States": lambda n: swapped(STATE, n),
    "lost": lambda n: changed_field(STATE, n, "lost", lambda count: count + 1),
    "epoch": lambda n: changed_field(STATE, n, "epoch", lambda epoch: epoch + 1),
    "stamp": lambda n: changed_field(STATE, n, "stamp_intended", lambda t: t + HALF_PERIOD),
    "published": lambda n: changed_field(STATE, n, "stamp_published", lambda t: t + HALF_PERIOD),
    "reference": lambda n: changed_field(STATE, n, "reference", lambda s: s + 0.05, joint=2),
    "rate": lambda n: changed_field(STATE, n, "reference_rate", lambda v: v + 1e-6, joint=2),
    "acceleration": lambda n: changed_field(
        STATE, n, "reference_acceleration", lambda a: a + 1e-3, joint=2
    ),
}


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_what_is_changed_in_a_controllers_log_is_found(
    kind: str, story: Path, tmp_path: Path
) -> None:
    for number in random.Random(kind).sample(range(10, 450), 5):
        _assert_found(
            CONTROLLERS[kind](number), story, "controller", number, tmp_path / str(number)
        )


@pytest.mark.parametrize("kind", ROBOTS)
def test_what_is_changed_in_a_robots_log_is_found(kind: str, story: Path, tmp_path: Path) -> None:
    for number in random.Random(kind).sample(range(10, 450), 5):
        _assert_found(ROBOTS[kind](number), story, "robot", number, tmp_path / str(number))


@pytest.mark.long
@pytest.mark.parametrize("pair", [("hoap3", "qp12"), ("ur5", "qp12"), ("hoap3", "qp12_paper")])
def test_each_kind_of_change_is_found_at_a_hundred_places(
    pair: tuple[str, str], tmp_path: Path
) -> None:
    given = "--robot", pair[0], "--controller", pair[1], "--duration", "0.5"
    inside("run", "--lockstep", *given, "--out", tmp_path / "run")
    for side, kinds in (("controller", CONTROLLERS), ("robot", ROBOTS)):
        for kind, made in kinds.items():
            for number in random.Random(kind).sample(range(10, 450), 100):
                folder = tmp_path / f"{side} {kind} {number}"
                change = made(number)
                if kind in {"q", "setpoint", "decision"} and not _moves(
                    change, tmp_path / "run", number
                ):
                    continue
                _assert_found(change, tmp_path / "run", side, number, folder)
                shutil.rmtree(folder)


def test_another_parameter_in_the_config_is_found(story: Path, tmp_path: Path) -> None:
    config = Log.open(story, side="controller").config.replace("beta: 46.0", "beta: 46.0001")

    path = rewrite(story, "controller", tmp_path / "o", lambda all_: all_, config.encode())

    assert verify(path).claims.counts["required V rate"].first_false == 0


def test_logs_that_do_not_belong_together_are_found(story: Path, tmp_path: Path) -> None:
    folder = tmp_path / "both"
    rewrite(story, "controller", folder, changed_field(STATE, 30, "tau", lambda _: 1.0, joint=0))
    shutil.copy(story / "robot.mcap", folder)

    assert verify(folder).claims.counts["State in both logs"].first_false == 30


def test_a_log_without_config_is_not_passed(story: Path, tmp_path: Path) -> None:
    path = rewrite(story, "controller", tmp_path / "o", lambda all_: all_, b"# nothing\n")

    found = verify(path)

    assert found.verdict == "not verified"
    assert sum(found.claims.counts["certificate"].unverified.values()) == 500


def test_one_side_alone_is_not_passed(story: Path) -> None:
    for side in ("robot", "controller"):
        found = verify(story / f"{side}.mcap")
        assert found.verdict == "not verified"
        assert found.claims.false == 0


def test_a_log_that_is_cut_off_is_verified_as_far_as_it_goes(story: Path, tmp_path: Path) -> None:
    whole = (story / "controller.mcap").read_bytes()
    (tmp_path / "controller.mcap").write_bytes(whole[: len(whole) * 3 // 4])

    found = verify(tmp_path / "controller.mcap")

    assert found.verdict == "not verified"
    assert found.missing
    assert found.claims.false == 0


def test_an_unknown_controller_is_not_passed(story: Path, tmp_path: Path) -> None:
    config = b"controller: my.own:Controller\nparameters: {}\n"
    path = rewrite(story, "controller", tmp_path / "o", lambda all_: all_, config)

    found = verify(path)

    assert found.verdict == "not verified"
    assert found.claims.counts["certificate"].checked == 0


def test_the_command_says_so_with_its_exit_code(story: Path, tmp_path: Path) -> None:
    assert inside("verify", story).code == 0
    false = rewrite(story, "controller", tmp_path / "o", CONTROLLERS["V"](20))
    done = inside("verify", false, "--json")
    assert done.code == 1
    assert json.loads(done.stdout)["claims"]["V"]["first_false"] == 20
    assert inside("verify", tmp_path / "nothing").code == 2


def test_no_kernel_no_solver_and_no_emulator_is_imported(story: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from hoap3.tools.verify.verify import verify;"
        f"verify(Path({str(story)!r}));"
        "print([m for m in sys.modules if m.endswith('_kernels') or m in ('numba', 'daqp', 'osqp')"
        " or m.startswith('hoap3.robot_emulator')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_it_shares_no_text_with_what_it_judges() -> None:
    ours = HOUSE / "tools" / "verify"
    judged = [
        path
        for room in ("protocol", "robot_emulator", "remote_controller", "tools")
        for path in (HOUSE / room).rglob("*.py")
        if ours not in path.parents
    ]
    theirs = {block for path in judged for block in _blocks(path)}
    shared = {path.name: _blocks(path) & theirs for path in ours.rglob("*.py")}
    assert {name: blocks for name, blocks in shared.items() if blocks} == {}


def test_the_deadline_checker_stays_short() -> None:
    text = (HOUSE / "tools" / "verify" / "deadline_checker.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 150


def test_every_registered_controller_has_a_checker() -> None:
    from hoap3.remote_controller.registry import registered
    from hoap3.tools.verify.checkers import FUNCTIONS, checker_of

    assert set(FUNCTIONS) == set(registered())
    assert all(checker_of(name) is not None for name in FUNCTIONS)


def test_defaults_are_those_of_the_controllers() -> None:
    from hoap3.remote_controller.registry import find
    from hoap3.tools.verify.controllers.lyapunov_descent import DEFAULTS

    for name in ("qp12", "pinv", "osqp"):
        known = find(name).Parameters.model_fields
        for key in DEFAULTS.keys() & known.keys():
            if key != "gamma" or name != "pinv":
                usual = DEFAULTS[key]
                first = usual[0] if isinstance(usual, tuple) else usual
                assert known[key].default == first, (name, key)


def _sets(*settings: str) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


def _blocks(path: Path) -> set[tuple[str, ...]]:
    """Every six lines of a file that follow each other, blanks, comments and imports left out."""
    lines = [" ".join(line.split("#")[0].split()) for line in path.read_text("utf-8").splitlines()]
    lines = [line for line in lines if line and not line.startswith(("import ", "from "))]
    return {tuple(lines[at : at + 6]) for at in range(len(lines) - 5)}


def _moves(change: Change, run: Path, number: int) -> bool:
    """Whether the change alters anything: a joint at zero stays there."""
    before: list[Record] = list(Log.open(run, side="controller").records())
    return change(list(before)) != before and number >= 0


def _assert_found(change: Change, run: Path, side: str, number: int, folder: Path) -> None:
    """The change is found, and the first tick that is named is that of the change, or beside it."""
    path = rewrite(run, side, folder, change)
    found = verify(path).claims
    assert found.false, number
    first = min(one.tick for one in found.by_tick())
    assert abs(first - number) <= 1, (number, found.by_tick()[:5])
