"""`hoap3 verify` believes true logs, and finds what was changed in them, at its tick."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support import HOUSE
from support.command_bench import inside
from tampering import (
    ANSWERS,
    SETPOINT,
    STATE,
    assert_no_false_alarm,
    changed_field,
    changed_limit,
    changed_summary,
    config_of,
    dropped,
    find_change,
    ran,
    removed,
    rewrite,
    swapped,
)

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.robot_emulator.robots import load
from hoap3.tools.logs.log import Log
from hoap3.tools.verify import verify as verify_module
from hoap3.tools.verify.deadline_checker import COUNTED, Recount
from hoap3.tools.verify.forked import Forked
from hoap3.tools.verify.verify import verify

SIDES = "emulator", "controller"
QUICK = ("hoap3", "qp12_paper"), ("humanoid32", "pinv"), ("lwr", "osqp")
LATER = ("hoap3", "qp12"), ("hoap3", "pinv"), ("ur5", "qp12")
PAIRS = [*QUICK, *(pytest.param(*pair, marks=pytest.mark.slow) for pair in LATER)]


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("story") / "qp12", "--controller", "qp12", seconds=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "controller"), PAIRS)
def test_a_true_log_is_true(robot, controller, tmp_path):
    given = "--robot", robot, "--controller", controller
    assert_no_false_alarm(ran(tmp_path / "run", *given, seconds=0.5))


@pytest.mark.parametrize(
    "controller",
    ["qp12", *(pytest.param(name, marks=pytest.mark.slow) for name in ("pinv", "osqp"))],
)
def test_a_robot_that_all_but_rests_at_its_target_is_no_false_alarm(controller, tmp_path):
    robot = Robot(load("hoap3"))
    robot.place(robot.description.initial_position)
    place = robot.com_point(robot.description.default_task.reference)
    for number, away in enumerate((1e-12, 1e-9)):
        target = "controller.parameters.target_m=" + json.dumps((place + away).tolist())
        run = ran(tmp_path / str(number), "--controller", controller, sets=[target])

        assert verify(run).claims.by_tick() == []


@pytest.mark.slow
def test_late_and_lost_answers_are_counted_as_the_robot_did(tmp_path):
    slow = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=60"
    run = ran(tmp_path / "run", sets=slow, seconds=0.05)

    assert verify(run).claims.by_tick() == []
    assert Log.open(run, side="robot").states()["late"][-1] > 0


@pytest.mark.parametrize(
    ("rule", "delay"),
    [
        ("next_tick", 2),
        ("after_receipt", 0),
        pytest.param("next_tick", 0, marks=pytest.mark.slow),
        pytest.param("after_receipt", 2, marks=pytest.mark.slow),
    ],
)
def test_each_deadline_rule_is_recounted(rule, delay, tmp_path):
    settings = f"emulator.deadline={rule}", f"emulator.delay_ticks={delay}"

    assert verify(ran(tmp_path / "run", sets=settings)).claims.by_tick() == []


def test_answers_that_a_solver_gave_up_on_are_no_false_alarm(tmp_path):
    few = "controller.parameters.max_iterations=1", "controller.parameters.polish=false"
    run = ran(tmp_path / "run", "--controller", "osqp", sets=few)

    assert verify(run).claims.by_tick() == []


@pytest.mark.slow
def test_kinematics_from_the_reference_are_followed_or_not_judged(tmp_path):
    reference = "controller.parameters.kinematics_from=reference"
    for delay in (0, 3):
        run = ran(tmp_path / str(delay), sets=[reference, f"emulator.delay_ticks={delay}"])

        assert_no_false_alarm(run, "not verified" if delay else "true")


@pytest.mark.slow
def test_a_log_whose_first_files_are_gone_is_no_false_alarm(tmp_path):
    small = [f"{side}.log.{key}" for side in SIDES for key in ("file_mb=1", "cap_mb=2")]
    run = ran(tmp_path / "run", sets=small, seconds=5)
    for side in ("robot", "controller"):
        (run / f"{side}.mcap").unlink(missing_ok=True)

    assert not Log.open(run, side="controller").from_begin
    assert_no_false_alarm(run, "not verified")


def test_records_that_were_dropped_are_no_false_alarm(story, tmp_path):
    for side in ("controller", "robot"):
        assert_no_false_alarm(rewrite(story, side, tmp_path / side, dropped), "not verified")


@pytest.mark.slow
def test_a_long_log_is_verified_in_processes_with_the_same_result(
    story: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(story, damaged)
    (damaged / "robot.mcap").unlink()
    rewrite(story, "robot", damaged, removed(Kind.STATE, 100))
    found = {}
    for records in (0, 10**9):
        monkeypatch.setattr(verify_module, "PARALLEL_FROM", records)
        monkeypatch.setattr(verify_module, "processors", lambda: 2)
        both = [verify(path, repeat=True) for path in (story, damaged)]
        found[records] = [(each.as_json(), each.outcomes, each.not_repeated) for each in both]
    assert found[0] == found[10**9]
    assert [each["verdict"] for each, _, _ in found[0]] == ["true", "false"]


def test_a_process_that_ends_without_a_result_is_an_error() -> None:
    heard: list[str] = []

    def dies(say: Callable[[str], None]) -> None:
        say("begun")
        os._exit(3)

    with pytest.raises(LogError, match="exit code 3"):
        Forked([dies], 1).gather(heard.append)
    assert heard == ["begun"]


def test_a_process_that_ends_as_if_all_were_well_is_an_error_too() -> None:
    with pytest.raises(LogError, match="without a result"):
        Forked([lambda _: os._exit(0)], 1).gather(print)


def test_one_process_does_everything_in_turn() -> None:
    works = [lambda _, number=number: (number, os.getpid()) for number in range(3)]

    numbers, processes = zip(*Forked(works, 1).gather(print), strict=True)
    assert numbers == (0, 1, 2)
    assert len({*processes}) == 1
    assert os.getpid() not in processes


def test_progress_of_a_process_is_passed_on_while_an_earlier_one_still_runs() -> None:
    heard: list[str] = []
    first, other = os.pipe()

    def waits(_: Callable[[str], None]) -> str:
        return os.read(first, 1).decode()

    def reports(say: Callable[[str], None]) -> str:
        say("half")
        return "done"

    def release(text: str) -> None:
        heard.append(text)
        os.write(other, b"x")

    try:
        assert Forked([waits, reports], 2).gather(release) == ["x", "done"]
    finally:
        os.close(first)
        os.close(other)
    assert heard == ["half"]


@pytest.mark.slow
def test_logs_of_two_runs_are_not_passed_together(story, tmp_path):
    both = ran(tmp_path / "both", "--seed", "9")
    shutil.copy(story / "robot.mcap", both)

    assert verify(both).verdict == "not verified"


@pytest.mark.slow
def test_the_description_of_another_robot_is_found(story, tmp_path):
    both = ran(tmp_path / "both", sets=["emulator.plant.gravity=compensated"], seconds=0.5)
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
def test_a_summary_that_is_not_what_its_log_shows_is_found(side, path, to, story, tmp_path):
    found = verify(rewrite(story, side, tmp_path / "o", changed_summary(*path, to=to)), repeat=True)

    assert found.verdict == "false"
    assert all(one.claim.startswith("summary: ") for one in found.claims.by_tick())


LIMITS = ("lower", "upper", "velocity", "setpoint_acceleration_max", "brake_acceleration", "effort")


@pytest.mark.parametrize("places", [5, pytest.param(100, marks=pytest.mark.long)])
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_bound_that_is_another_in_one_log_is_found(side, places, story, tmp_path):
    joints = Log.open(story, side=side).description.joints
    known = [(n, key) for n, joint in enumerate(joints) for key in LIMITS if getattr(joint, key)]
    for number, (joint, key) in enumerate(random.Random(side).sample(known, places)):
        folder = tmp_path / str(number)
        rewrite(story, side, folder, changed_limit(joint, key))
        other = "robot" if side == "controller" else "controller"
        shutil.copy(story / f"{other}.mcap", folder)
        assert verify(folder).claims.counts["description in both logs"].false == 1, (key, joint)
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    "wrong",
    [
        *(f"qp12\nparameters:\n  {each}" for each in ("beta: [1]", "beta: .nan", "beta: yes")),
        "qp12\nparameters:\n  psi_scale: none",
        "my.own:Controller\nparameters: {}",
    ],
)
def test_a_parameter_or_controller_that_is_none_is_not_reckoned_with(wrong, story, tmp_path):
    config = f"controller: {wrong}\n".encode()

    found = verify(rewrite(story, "controller", tmp_path / "o", list, config))

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
def test_what_no_service_writes_is_one_error(kind, payload, story, tmp_path):
    def emptied(records: list[Record]) -> list[Record]:
        strange = [r._replace(payload=payload) if r.kind == kind else r for r in records]
        return [*strange, Record(kind, records[-1].stamp, payload)]

    done = inside("verify", rewrite(story, "controller", tmp_path / "o", emptied))

    assert done.code in {1, 2}
    assert "Traceback" not in done.stderr
    assert "no service of ours" in done.stderr


@pytest.mark.parametrize("wrong", ["long", "old"])
def test_what_a_robot_refuses_is_no_answer_in_the_recount(wrong):
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


HALF_PERIOD = 500_000
REMOVED = {
    "removed State": lambda n: removed(STATE, n),
    "removed answer": lambda n: removed(SETPOINT, n),
    "swapped States": lambda n: swapped(STATE, n),
}
CONTROLLERS = {
    **ANSWERS,
    **REMOVED,
    "swapped answers": lambda n: swapped(SETPOINT, n),
    "epoch": lambda n: changed_field(SETPOINT, n, "epoch", lambda epoch: epoch + 1),
    "stamp": lambda n: changed_field(SETPOINT, n, "stamp_state", lambda t: t + HALF_PERIOD),
}
MAY_STAY = {"q", "setpoint", "decision"}  # where the number is 0
ROBOTS = {
    **REMOVED,
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


KINDS = [
    *(("controller", kind, made) for kind, made in CONTROLLERS.items()),
    *(("robot", kind, made) for kind, made in ROBOTS.items()),
]


@pytest.mark.parametrize(("side", "kind", "made"), KINDS)
def test_what_is_changed_in_a_log_is_found(side, kind, made, story, tmp_path):
    for number in random.Random(kind).sample(range(10, 450), 5):
        assert find_change(made(number), story, side, number, tmp_path / str(number))


@pytest.mark.long
@pytest.mark.parametrize("pair", [("hoap3", "qp12"), ("ur5", "qp12"), ("hoap3", "qp12_paper")])
def test_each_kind_of_change_is_found_at_a_hundred_places(pair, tmp_path):
    run = ran(tmp_path / "run", "--robot", pair[0], "--controller", pair[1], seconds=0.5)
    for side, kind, made in KINDS:
        for number in random.Random(kind).sample(range(10, 450), 100):
            moves = find_change(made(number), run, side, number, tmp_path / "changed")
            assert moves or kind in MAY_STAY


def test_another_parameter_in_the_config_is_found(story, tmp_path):
    config = config_of(story).replace("beta: 46.0", "beta: 46.0001")

    path = rewrite(story, "controller", tmp_path / "o", list, config.encode())

    assert verify(path).claims.counts["required V rate"].first_false == 0


def test_logs_that_do_not_belong_together_are_found(story, tmp_path):
    folder = tmp_path / "both"
    rewrite(story, "controller", folder, changed_field(STATE, 30, "tau", lambda _: 1.0, joint=0))
    shutil.copy(story / "robot.mcap", folder)

    assert verify(folder).claims.counts["State in both logs"].first_false == 30


def test_a_log_without_config_is_not_passed(story, tmp_path):
    found = verify(rewrite(story, "controller", tmp_path / "o", list, b"# nothing\n"))

    assert found.verdict == "not verified"
    assert sum(found.claims.counts["certificate"].unverified.values()) == 500


def test_one_side_alone_is_not_passed(story):
    for side in ("robot", "controller"):
        assert_no_false_alarm(story / f"{side}.mcap", "not verified")


def test_a_log_that_is_cut_off_is_verified_as_far_as_it_goes(story, tmp_path):
    whole = (story / "controller.mcap").read_bytes()
    (tmp_path / "controller.mcap").write_bytes(whole[: len(whole) * 3 // 4])

    found = assert_no_false_alarm(tmp_path / "controller.mcap", "not verified")
    assert found.missing


def test_the_command_says_so_with_its_exit_code(story, tmp_path):
    assert inside("verify", story).code == 0
    false = rewrite(story, "controller", tmp_path / "o", CONTROLLERS["V"](20))
    done = inside("verify", false, "--json")
    assert done.code == 1
    assert json.loads(done.stdout)["claims"]["V"]["first_false"] == 20
    assert inside("verify", tmp_path / "nothing").code == 2


def test_no_kernel_no_solver_and_no_emulator_is_imported(story):
    code = (
        "import sys; from pathlib import Path; from hoap3.tools.verify.verify import verify;"
        "from hoap3.tools.verify.statements import BUILDERS, WITH_FREE_BASE, builder_of;"
        f"verify(Path({str(story)!r})); [builder_of(name, {{}}) for name in BUILDERS];"
        "[builder_of(name, {'base': 'free'}) for name in WITH_FREE_BASE];"
        "print([m for m in sys.modules if m.endswith('_kernels') or m in ('numba', 'daqp', 'osqp')"
        " or m.startswith('hoap3.robot_emulator')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_it_shares_no_text_with_what_it_judges():
    ours = {HOUSE / "tools" / "verify", HOUSE / "remote_controller" / "problems"}
    judged = [
        path
        for room in ("protocol", "robot_emulator", "remote_controller", "tools")
        for path in (HOUSE / room).rglob("*.py")
        if ours.isdisjoint(path.parents)
    ]
    theirs = {block for path in judged for block in _blocks(path)}
    shared = {path.name: _blocks(path) & theirs for folder in ours for path in folder.rglob("*.py")}
    assert {name: blocks for name, blocks in shared.items() if blocks} == {}


def test_every_registered_controller_has_a_builder():
    from hoap3.remote_controller.registry import find, registered
    from hoap3.tools.verify.statements import BUILDERS, WITH_FREE_BASE, builder_of

    assert BUILDERS.keys() == set(registered())
    free = {name for name in registered() if getattr(find(name), "stands_free", False)}
    assert free == WITH_FREE_BASE.keys()
    assert all(builder_of(name, {"base": "free"}) for name in registered())


def test_defaults_are_those_of_the_controllers():
    from hoap3.remote_controller.problems.qp12 import DEFAULTS
    from hoap3.remote_controller.registry import find
    from hoap3.tools.verify.statements import builder_of

    for name in ("qp12", "pinv", "osqp"):
        known = find(name).Parameters.model_fields
        for key, usual in {**DEFAULTS, **builder_of(name, {}).own}.items():
            first = usual[0] if isinstance(usual, tuple) else usual
            assert known[key].default == first, (name, key)


def _blocks(path: Path) -> set[tuple[str, ...]]:
    """Every six lines of a file that follow each other, blanks, comments and imports left out."""
    lines = [" ".join(line.split("#")[0].split()) for line in path.read_text("utf-8").splitlines()]
    lines = [line for line in lines if line and not line.startswith(("import ", "from "))]
    return {tuple(lines[at : at + 6]) for at in range(len(lines) - 5)}


def test_tables_are_read_alike_by_this_process_and_by_those_that_verify(
    story: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verify_module, "PARALLEL_FROM", 0)
    monkeypatch.setattr(verify_module, "processors", lambda: 2)
    logs = {side: Log.open(story, side=side).load() for side in ("robot", "controller")}

    verify(story, opened=logs)

    for log in logs.values():
        for kind in (Kind.STATE, Kind.SETPOINT, Kind.EVENT):
            stamps, rows = log.table(kind)
            assert len(stamps) == len(rows) == log.count(kind)


def test_why_a_process_cannot_read_the_log_is_not_lost(
    story: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise LogError("no room in /tmp")

    monkeypatch.setattr(verify_module, "PARALLEL_FROM", 0)
    monkeypatch.setattr(verify_module, "processors", lambda: 2)
    monkeypatch.setattr(verify_module, "check_robot", full)
    with pytest.raises(LogError, match="no room in /tmp"):
        verify(story)
