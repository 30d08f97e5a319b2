"""Controllers of users: verified by the `problem_type` that they name, or told apart from false."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.command_bench import inside
from tampering import SETPOINT, changed_field, config_of, ran, rewrite

import hoap3
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.new.package import render
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import NOTHING, check_engagements
from hoap3.tools.verify.verify import verify

TICK = 50
OTHERS = """
from hoap3.protocol.config.changeable import CHANGEABLE

class ChangedController(OwnController):
    class Parameters(OwnController.Parameters):
        gain_per_s: float = Field(2.0, gt=0, json_schema_extra=CHANGEABLE)


class NoneController(OwnController):
    problem_type = None


class RaisingProblems(PostureProblems):
    def state_problem(self, setpoint):
        raise RuntimeError("not today")


class RaisingController(OwnController):
    problem_type = RaisingProblems


class ExitingProblems(PostureProblems):
    def state_problem(self, setpoint):
        raise SystemExit(0)


class ExitingController(OwnController):
    problem_type = ExitingProblems


class EmptyProblems(PostureProblems):
    def state_problem(self, setpoint):
        return Statement("answered", (), setpoint["values"], 0.0 * setpoint["values"])


class EmptyController(OwnController):
    problem_type = EmptyProblems
"""
PLANTED: dict[str, tuple[str, Callable[[float], float]]] = {
    "optimum": ("decision", lambda u: 0.999 * u),
    "rows": ("decision", lambda _: 0.6),
    "V": ("v", lambda v: v * (1.0 + 1e-6)),
}
"""The claim that finds it, the field and what becomes of it."""


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A run of the controller that `hoap3 new` writes, named by a dotted path."""
    folder, path = tmp_path_factory.mktemp("own"), list(sys.path)
    files = render("controller", "own")
    (folder / "own.py").write_text(files["src/own.py"] + OTHERS, encoding="utf-8")
    config = files["own.yaml"].replace("controller: own", "controller: own:OwnController")
    (folder / "own.yaml").write_text(config, encoding="utf-8")
    yield ran(folder / "run", "--controller", folder / "own.yaml")
    sys.path[:] = path
    sys.modules.pop("own", None)


def named(story: Path, controller: str, out: Path) -> Path:
    """The controller's log, in which it has another name."""
    config = config_of(story).replace("own:OwnController", controller)
    return rewrite(story, "controller", out, list, config.encode())


def reasons(path: Path, *, allow_code: bool) -> set[str]:
    """Why its certificates are not verified; nothing is false."""
    found = verify(path, allow_code=allow_code)
    assert found.verdict == "not verified"
    assert not found.claims.false
    unverified = found.claims.counts["certificate"].unverified
    assert sum(unverified.values()) == 100
    return set(unverified)


def test_a_controller_with_a_problem_type_is_verified(story):
    found = verify(story, allow_code=True)

    assert found.verdict == "true"
    assert found.claims.counts["optimum"].checked == 100


@pytest.mark.parametrize("claim", PLANTED)
def test_what_is_wrong_is_found_in_its_cycle(claim, story, tmp_path):
    field, to = PLANTED[claim]
    joint = {"joint": 4} if field == "decision" else {}
    change = changed_field(SETPOINT, TICK, field, to, **joint)

    found = verify(rewrite(story, "controller", tmp_path / "o", change), allow_code=True)

    assert found.verdict == "false"
    assert found.claims.counts[claim].first_false == TICK
    assert {each.tick for each in found.claims.by_tick()} == {TICK}


def test_without_permission_the_reason_names_the_option(story):
    (reason,) = reasons(story, allow_code=False)

    assert "own:OwnController" in reason
    assert "--allow-code" in reason


@pytest.mark.parametrize(
    ("controller", "told"),
    [
        ("own:NoneController", ("names no problem_type",)),
        ("own:RaisingController", ("RuntimeError: not today", "own.py, line ")),
        ("own:ExitingController", ("SystemExit", "own.py, line ")),
        ("own:EmptyController", (NOTHING,)),
        ("own:Absent", ("cannot be imported",)),
        ("not_installed", ("no controller is called",)),
    ],
)
def test_what_cannot_be_verified_has_its_reason(controller, told, story, tmp_path):
    (reason,) = reasons(named(story, controller, tmp_path), allow_code=True)

    assert all(text in reason for text in told), reason


def test_exit_codes_tell_not_verified_from_false(story, tmp_path):
    unverified = named(story, "own:NoneController", tmp_path / "none")
    planted = changed_field(SETPOINT, TICK, "v", PLANTED["V"][1])
    false = rewrite(story, "controller", tmp_path / "false", planted)
    for path, verdict, codes in ((unverified, "not verified", (1, 0)), (false, "false", (1, 1))):
        for options, code in zip(((), ("--allow-unverified",)), codes, strict=True):
            done = inside("verify", path, "--allow-code", *options)
            assert done.code == code, done.stdout
            assert done.stdout.startswith(f"{verdict}: ")
    assert "not verified: certificate, 100 times: " in inside("verify", unverified).stdout


def test_a_changed_number_is_followed(story):
    law = {"controller": "own:ChangedController", "parameters": {"posture": "q0_arms_forward"}}

    def steer(loop: ControllerLoop) -> None:
        if loop.last_tick == TICK // 2:
            loop.change(b'{"gain_per_s": 1.0, "over_s": 0.02}')

    records: list[Record] = hoap3.simulate("hoap3", law, duration=0.1, steer=steer).records
    claims = Claims()

    check_engagements(records, law["controller"], law["parameters"], claims, allow_code=True)

    assert Kind.CHANGE in {record.kind for record in records}
    assert claims.by_tick() == []
    assert claims.counts["optimum"].checked == 100


def test_answers_to_a_robot_with_a_delay_are_not_verified(story):
    law = {"controller": "own:OwnController", "parameters": {"posture": "q0_arms_forward"}}
    robot = {"robot": "hoap3", "delay_ticks": 2}
    records: list[Record] = hoap3.simulate(robot, law, duration=0.05).records
    claims = Claims()

    check_engagements(records, law["controller"], law["parameters"], claims, allow_code=True)

    assert not claims.checked
    assert claims.unverifiable == 50
