"""What a machine does, what the doctor really calls, and this machine as a whole."""

from __future__ import annotations

import json
import os
import resource
import socket
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from doctor_machine import ADVICE, OK, PROBLEM, LateClock, machine

from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.tools.bench.doctor import checks, doctor, system
from hoap3.tools.bench.doctor.doctor import examine, run_doctor, verdict
from hoap3.tools.bench.doctor.system import Finding

CHECKS = (*doctor.LOOKS, *doctor.MEASURES)


class SteppingClock(VirtualClock):
    """Moves by `step` [ns] at every `every`-th reading."""

    def __init__(self, step: int, every: int = 1) -> None:
        super().__init__()
        self._step, self._every, self._readings = step, every, 0

    def now(self) -> int:
        self._readings += 1
        if self._readings % self._every == 0:
            self.advance(self._step)
        return super().now()


@pytest.mark.parametrize(
    ("step", "every", "level", "found"),
    [
        (50, 1, OK, "steps of 50 ns, 50 ns a reading"),
        (3000, 1, ADVICE, "3000 ns a reading"),
        (2000, 10, ADVICE, "steps of 2000 ns, 200 ns a reading"),
        (4_000_000, 100, PROBLEM, "steps of 4000000 ns"),
        (0, 1, PROBLEM, "stands still"),
        (-5, 1, PROBLEM, "goes back"),
    ],
)
def test_a_clock_is_judged_by_its_steps_and_its_cost(tmp_path, step, every, level, found):
    finding = checks.clock(machine(tmp_path, {}, clock=SteppingClock(step, every)))
    assert finding.level == level
    assert found in finding.found


@pytest.mark.parametrize(
    ("late", "level", "found"),
    [
        ([50_000], OK, "p50 50, p99 50, max 50 us; 0 of 301"),
        ([400_000], ADVICE, "p50 400"),
        ([50_000] * 29 + [1_050_000], ADVICE, "9 of 301"),
        ([50_000] * 4 + [1_050_000], PROBLEM, "ticks skipped"),
    ],
)
def test_wake_ups_are_judged_by_lateness_and_skipped_ticks(tmp_path, late, level, found):
    class Clock(LateClock):
        now = VirtualClock.now

    finding = checks.wake_up(machine(tmp_path, {}, clock=Clock(late)))
    assert finding.level == level, finding
    assert found in finding.found


def test_priority_is_tried_without_changing_ours():
    before = os.sched_getscheduler(0)
    assert system.fifo(1) in {None, "Operation not permitted"}
    assert system.fifo(1000) is not None
    assert os.sched_getscheduler(0) == before


def test_writing_is_measured_and_leaves_nothing_behind(tmp_path):
    assert system.write_speed(tmp_path, seconds=0.02) > 0
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError):
        system.write_speed(tmp_path / "missing", seconds=0.02)


def test_a_disk_that_hangs_is_not_waited_for(tmp_path, monkeypatch):
    answered = []
    monkeypatch.setattr(system.os, "fsync", lambda _: answered.append(pipe[0].recv(1)))
    pipe = socket.socketpair()
    try:
        assert system.write_speed(tmp_path, seconds=0.01, patience=0.05) == 0.0
        assert answered == []
    finally:
        for end in pipe:
            end.shutdown(socket.SHUT_RDWR)
            end.close()


def test_a_folder_for_logs_that_does_not_exist_yet_is_not_made(tmp_path):
    asked = []
    system = machine(tmp_path, {}, free=lambda folder: asked.append(folder) or 10**11)
    system = replace(system, logs=tmp_path / "a" / "b")
    assert checks.log_disk(system).level == OK
    assert asked == [tmp_path]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_a_problem(tmp_path):
    def refuse(_: Path) -> float:
        raise PermissionError(13, "Permission denied")

    finding = checks.log_disk(machine(tmp_path, {}, write_speed=refuse))
    assert finding.level == PROBLEM
    assert "Permission denied" in finding.found


@pytest.mark.slow
def test_the_cache_for_kernels_is_known_to_be_kept_or_not(tmp_path):
    code = "from hoap3.tools.bench.doctor.system import kernel_cache; print(*kernel_cache())"
    for folder, kept in ((tmp_path / "own", "True"), (Path("/proc/nowhere"), "False")):
        env = {**os.environ, "HOAP3_CACHE_DIR": str(folder)}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
        place, said = done.stdout.split()
        assert said == kept
        assert Path(place).is_relative_to(folder) == (kept == "True")


def test_the_verdict_is_that_of_the_worst_finding():
    findings = [Finding("a", level, "") for level in (OK, ADVICE, PROBLEM)]
    assert [verdict(findings[:n]) for n in range(4)] == ["pass", "pass", "warn", "fail"]


def test_this_machine_is_examined(tmp_path):
    findings = examine(logs=tmp_path)
    assert len({finding.name for finding in findings}) == len(CHECKS)
    for finding in findings:
        assert finding.found
        assert finding.level == OK or finding.remedy
    quick = examine(measure=False)
    assert [finding.name for finding in quick] == [finding.name for finding in findings][
        : len(quick)
    ]


AS_NOBODY = """
from hoap3.tools.bench.doctor.doctor import examine
from hoap3.tools.services.placement import measure_placement
import json
levels = {finding.name: finding.level for finding in examine(measure=False)}
print(json.dumps({"levels": levels, "placement": measure_placement(ticks=20)}))
"""


@pytest.mark.slow
def test_without_rights_everything_is_still_found_out():
    with tempfile.TemporaryDirectory() as folder:  # for claims, and open to everybody
        Path(folder).chmod(0o777)
        words = [sys.executable, "-c", AS_NOBODY]
        if os.geteuid() == 0:  # may still read, as if the interpreter stood where everybody can
            read = "+dac_read_search"
            words = [f"--inh-caps={read}", f"--ambient-caps={read}", *words]
            words = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", *words]
        env = {
            key: value for key, value in os.environ.items() if not key.startswith(("XDG", "HOAP3"))
        }
        env |= {"HOME": "/nonexistent", "TMPDIR": folder}
        limits = (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK)

        def less() -> None:
            for limit in limits:
                resource.setrlimit(limit, (0, 0))

        done = subprocess.run(
            words, capture_output=True, text=True, check=True, env=env, cwd=folder, preexec_fn=less
        )
    told = json.loads(done.stdout)
    assert told["levels"]["real-time priority"] == ADVICE
    assert told["levels"]["memory lock"] == ADVICE
    assert told["levels"]["kernel cache"] == ADVICE
    assert told["placement"]["measured"], told["placement"]
    assert "refused" in told["placement"]["rights"]


def diagnosis(level: str) -> dict:
    return {
        "verdict": verdict([Finding("a", level, "")]),
        "findings": [{"name": "a", "level": level, "found": "[b]", "remedy": "do [it]"}],
        "placement": {"measured": False, "why": "not asked for"},
        "machine": {},
    }


@pytest.mark.parametrize(("level", "code"), [(OK, 0), (ADVICE, 0), (PROBLEM, 1)])
def test_the_exit_code_is_one_where_there_is_a_problem(monkeypatch, capsys, level, code):
    monkeypatch.setattr(doctor, "diagnose", lambda **_: diagnosis(level))
    assert run_doctor(False) == code
    capsys.readouterr()
    assert run_doctor(True) == code
    assert json.loads(capsys.readouterr().out) == diagnosis(level)


@pytest.mark.slow
def test_people_read_standard_output_and_programs_one_object():
    code = "import hoap3.tools.bench.doctor.doctor as it, sys; sys.exit(it.run_doctor({}, False))"
    told, printed = (
        subprocess.run(
            [sys.executable, "-c", code.format(as_json)],
            capture_output=True,
            text=True,
            check=False,
        )
        for as_json in (False, True)
    )
    assert told.stderr == ""
    content = json.loads(printed.stdout)
    assert content.keys() == {"verdict", "findings", "placement", "machine"}
    assert content["machine"]["kernel"]
    for finding in content["findings"]:
        assert finding.keys() == {"name", "level", "found", "remedy"}
        assert finding["name"] in told.stdout
    assert told.returncode == printed.returncode == (content["verdict"] == "fail")
