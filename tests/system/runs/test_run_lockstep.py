"""`hoap3 run --lockstep` and `hoap3 replay`: the same bytes every time, also between processes."""

from __future__ import annotations

import signal
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.command_bench import (
    QUIET,
    Command,
    Done,
    assert_at_rest,
    assert_no_traceback,
    assert_ran,
    controller,
    emulator,
    endpoint,
    events,
    following,
    hoap3,
    inside,
    on_path,
    tell,
    wait_for_mode,
)

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.logs.log_format import OF_OTHERS
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.services.simulate import simulate

DURATION, SEED = 1.5, 7  # with few joints, γ matters only where a second one sets in


def lockstep(folder: Path, *arguments: str) -> Done:
    words = ("run", "--lockstep", "--controller", "qp12", "--duration", str(DURATION), "--json")
    command = inside(*words, "--out", folder, *arguments)
    assert_ran(command)
    return command


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lockstep") / "first"


@pytest.fixture(scope="module")
def first(folder: Path) -> Done:
    return lockstep(folder, "--seed", str(SEED))


def rewritten(
    folder: Path,
    to: Path,
    records: Iterable[Record] | None = None,
    versions: dict[str, str] | None = None,
    **config: object,
) -> Path:
    """A copy of a controller's log, with other records or another config."""
    log = Log.open(folder, side="controller")
    content = {**yaml.safe_load(log.config), **config}
    attachments = {"config.yaml": yaml.safe_dump(content).encode()}
    about = {"attachments": attachments, "metadata": {"versions": versions or {}}}
    writer = LogWriter(to, robot=log.robot, side="controller", **about)
    with writer:
        for record in log.records() if records is None else records:
            writer.add(record)
    return to


def test_the_robot_is_the_one_that_the_controllers_config_names(tmp_path):
    words = ("run", "--lockstep", "--duration", "0.05", "--out", tmp_path / "log")
    assert_ran(inside(*words, "--controller", "clik_ur5"))
    assert Log.open(tmp_path / "log", side="robot").robot == "ur5"


def test_two_runs_give_the_same_bytes(first, folder, tmp_path):
    words = ("run", "--lockstep", "--controller", "qp12", "--duration", DURATION, "--json")
    second = hoap3(*words, "--seed", SEED, "--out", tmp_path / "second")  # in another process, too
    assert second.end() == 1, second.stderr  # too short to arrive
    hashes = first.json()["payload_sha256"]
    assert hashes == second.json()["payload_sha256"]
    for side in ("robot", "controller"):
        logs = [Log.open(path, side=side) for path in (folder, tmp_path / "second")]
        one, other = ([r for r in log.records() if r.kind not in OF_OTHERS] for log in logs)
        assert one == other
        assert payload_hash(Log.open(folder, side=side)) == hashes[side]


@pytest.mark.parametrize(
    "change", [["--seed", "8"], ["--seed", str(SEED), "--set", "controller.parameters.gamma=0.4"]]
)
def test_another_seed_or_gamma_gives_other_bytes(first, tmp_path, change):
    other = lockstep(tmp_path / "other", *change)
    before, after = first.json()["payload_sha256"], other.json()["payload_sha256"]
    assert before["robot"] != after["robot"]
    assert before["controller"] != after["controller"]


def test_every_tick_is_answered_and_none_is_late(first, folder):
    summary = first.json()
    ticks = round(DURATION * 1000)
    fit = summary["verdicts"]["deadlines"]
    assert (fit, summary["ticks"], summary["skipped"]) == ("pass", ticks, 0)
    assert summary["misses"] == dict.fromkeys(summary["misses"], 0)
    assert "rtt_us" not in summary  # all time is virtual
    assert summary["lockstep"]["wall_s"] > 0
    assert_at_rest(Log.open(folder, side="robot"))
    names = [name for name, _ in events(Log.open(folder, side="robot"))]
    assert names == ["STARTED", "GRANTED", "SAFE_STOP", "AT_REST", "ENDED"]


def test_simulate_gives_the_payloads_of_the_command(first, folder):
    simulation = simulate("hoap3", "qp12", duration=DURATION, seed=SEED)
    assert simulation.records == list(Log.open(folder, side="controller").records())
    states = Log.open(folder, side="robot").states()
    assert simulation.states.tobytes() == states.tobytes()


def test_a_run_is_repeated_bit_by_bit(first, folder):
    again = inside("replay", folder)
    assert again.code == 0
    assert "1500/1500" in again.stdout
    assert again.stderr == ""


def test_another_gamma_is_found_at_its_first_tick(first, folder, tmp_path):
    config = yaml.safe_load(Log.open(folder, side="controller").config)
    config["parameters"]["gamma"] = 0.4
    other = simulate("hoap3", config, duration=DURATION, seed=SEED).setpoints
    tick = int(np.argmax(Log.open(folder, side="controller").setpoints() != other))
    assert 0 < tick < DURATION * 1000
    changed = inside("replay", folder, "--set", "parameters.gamma=0.4")
    assert changed.code == 1
    assert f"tick {tick}" in changed.stdout
    copy = rewritten(folder, tmp_path / "copy.mcap", **config)
    found = inside("replay", copy, "--json")
    assert found.code == 1
    assert found.json()["first_difference"] == tick
    assert tick <= found.json()["same"] < found.json()["setpoints"] == DURATION * 1000


def test_other_software_is_named_before_a_difference_and_before_an_error(first, folder, tmp_path):
    logged = Log.open(folder, side="controller").metadata["versions"]
    assert "source" in logged
    older = {**logged, "source": "0123456789ab", "numpy": "1.0"}
    same = inside("replay", rewritten(folder, tmp_path / "same.mcap", versions=older))
    assert same.code == 0
    config = yaml.safe_load(Log.open(folder, side="controller").config)
    config["parameters"]["gamma"] = 0.4
    other = rewritten(folder, tmp_path / "other.mcap", versions=older, **config)
    found = inside("replay", other)
    assert found.code == 1
    assert found.stdout.index("0123456789ab") < found.stdout.index("tick ")
    told = inside("replay", other, "--json").json()["software"]
    assert told["numpy"] == ["1.0", np.__version__]
    assert told.keys() == {"numpy", "source"}
    config["parameters"]["gamma"] = "much"
    wrong = rewritten(folder, tmp_path / "wrong.mcap", versions=older, **config)
    refused = inside("replay", wrong)
    assert refused.code == 2
    assert refused.stderr.index("0123456789ab") < refused.stderr.index("error:")


def test_a_tampered_setpoint_is_found_at_its_tick(first, folder, tmp_path):
    records = list(Log.open(folder, side="controller").records())
    at = [place for place, record in enumerate(records) if record.kind == Kind.SETPOINT][123]
    payload = bytearray(records[at].payload)
    payload[164 + 8 * 20] ^= 1  # the least bit of the last joint
    records[at] = Record(Kind.SETPOINT, records[at].stamp, bytes(payload))
    found = inside("replay", rewritten(folder, tmp_path / "copy.mcap", records), "--json")
    assert found.code == 1
    assert found.json()["first_difference"] == 123
    assert found.json()["field"].startswith("values[20]")
    assert found.json()["same"] == found.json()["setpoints"] - 1


def test_nothing_is_claimed_beyond_a_gap(first, folder, tmp_path):
    records, kept = list(Log.open(folder, side="controller").records()), []
    for record in records:
        if record.kind == Kind.STATE and State.scalars(record.payload, "tick") == (200,):
            kept.append(Record(Kind.GAP, record.stamp, b'{"dropped": 10}'))
        tick = State.scalars(record.payload, "tick")[0] if record.kind == Kind.STATE else 0
        if not 200 <= tick < 205:
            kept.append(record)
    report = inside("replay", rewritten(folder, tmp_path / "copy.mcap", kept))
    assert report.code == 1
    left = sum(record.kind == Kind.SETPOINT for record in kept) - 200
    for part in ("200/200", "tick 199", f"{left} setpoints"):
        assert part in report.stdout


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (Kind.SESSION, b"{}"),
        (Kind.SESSION, b"[]"),
        (Kind.SESSION, b"\xff"),
        (Kind.AUTHORITY, b'{"epoch": "x"}'),
        (Kind.DESCRIPTION, b"{}"),
        (Kind.STATE, b"short"),
        (Kind.SETPOINT, b"short"),
    ],
)
def test_records_that_no_service_has_written_are_refused(first, folder, tmp_path, kind, payload):
    records = [
        Record(kind, record.stamp, payload) if record.kind == kind else record
        for record in Log.open(folder, side="controller").records()
    ][:20]
    refused = inside("replay", rewritten(folder, tmp_path / "copy.mcap", records))
    assert refused.code == 2
    assert refused.stderr.splitlines()[-1].startswith("error: ")
    assert refused.stderr.count("error: ") == 1


def test_a_log_without_setpoints_proves_nothing(first, folder, tmp_path):
    assert inside("replay", rewritten(folder, tmp_path / "copy.mcap", [])).code == 1


@pytest.mark.slow
def test_code_is_not_run_on_the_word_of_a_log(first, folder, tmp_path):
    (tmp_path / "evil.py").write_text(
        "from pathlib import Path\n"
        "from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller as Evil\n"
        "Path(__file__).with_name('was_here').touch()\n"
    )
    copy = rewritten(folder, tmp_path / "copy.mcap", controller="evil:Evil")
    path = on_path(tmp_path)
    refused = hoap3("replay", copy, environment=path)
    assert refused.end() == 2
    assert "'evil:Evil'" in refused.stderr
    assert "--allow-code" in refused.stderr
    assert_no_traceback(refused)
    assert not (tmp_path / "was_here").exists()
    allowed = hoap3("replay", copy, "--allow-code", environment=path)
    assert allowed.end() == 0, allowed.stderr
    assert (tmp_path / "was_here").exists()


@pytest.mark.slow
def test_code_in_the_current_folder_is_found_where_it_may_run(first, folder, tmp_path, monkeypatch):
    source = "from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller as Near\n"
    (tmp_path / "near_law.py").write_text(source)
    copy = rewritten(folder, tmp_path / "copy.mcap", controller="near_law:Near")
    monkeypatch.chdir(tmp_path)
    assert hoap3("replay", copy).end() == 2
    allowed = hoap3("replay", copy, "--allow-code")
    assert allowed.end() == 0, allowed.stderr


def test_the_robots_log_cannot_be_replayed(first, folder):
    assert inside("replay", folder / "robot.mcap").code == 2


@pytest.mark.parametrize("record", ["true", "false"])
def test_a_controller_that_tells_nothing_fails_the_run(tmp_path, monkeypatch, record):
    monkeypatch.setattr(ControllerLoop, "sum_up", lambda _: None)
    words = ("run", "--lockstep", "--duration", "0.05", "--json", "--out", tmp_path / "log")
    done = inside(*words, "--set", f"emulator.log.record={record}")
    summary = done.json()
    assert done.code == 1
    assert summary["verdicts"].pop("deadlines") == "pass"
    assert summary["verdicts"].keys() == {"task", "limits_and_balance"}
    for key, verdict in summary["verdicts"].items():
        assert verdict == "fail"
        assert summary[key]["reasons"] == ["not_told_by_controller"]


PAIR_SEED = 5


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lockstep") / "log"


@pytest.fixture(scope="module")
def pair(apart: Path) -> tuple[Command, Command]:
    """A robot and its controller that have run for a second of virtual time."""
    at = endpoint()
    words = ("hoap3", "--lockstep", "--duration", "1", "--set", f"seed={PAIR_SEED}", "--out", apart)
    with emulator(*words, at=at) as robot, controller("qp12", "--out", apart, at=at) as law:
        assert robot.end() == 0, robot.stderr
        law.wait_for("is gone")
        assert law.end(signal.SIGTERM) == 0, law.stderr
        assert_no_traceback(robot)
        assert_no_traceback(law)
    return robot, law


def test_every_tick_is_answered_in_virtual_time(pair, apart):
    log = Log.open(apart, side="robot")
    assert len(log.setpoints()) == 1000
    last = log.states()[-1]
    assert last["late"] == last["lost"] == last["skipped"] == last["rejected"] == 0
    assert_at_rest(log)


def test_the_controllers_log_is_repeated_bit_by_bit(pair, apart):
    again = inside("replay", apart)
    assert again.code == 0
    assert "1000/1000" in again.stdout


def test_setpoints_are_those_of_one_process(pair, apart):
    """All of every payload is: time is virtual, and the session is named by the seed."""
    alone = simulate("hoap3", "qp12", duration=1.0, seed=PAIR_SEED)
    together = Log.open(apart, side="controller").setpoints()
    assert together.dtype == alone.setpoints.dtype
    for name in Setpoint.schema.scalars | dict.fromkeys(Setpoint.schema.arrays):
        assert np.array_equal(together[name], alone.setpoints[name]), name
    assert together.tobytes() == alone.setpoints.tobytes()


def test_states_are_those_of_one_process(pair, apart):
    alone = simulate("hoap3", "qp12", duration=1.0, seed=PAIR_SEED)
    assert Log.open(apart, side="robot").states().tobytes() == alone.states.tobytes()


@pytest.mark.long
def test_a_robot_without_end_waits_for_the_next_controller(tmp_path):
    """A holder that leaves is noticed while its answer is waited for, however it leaves."""
    at, out = endpoint(), tmp_path / "robot"
    with emulator("hoap3", "--lockstep", "--out", out, at=at) as robot:
        for number, mode in ((signal.SIGTERM, "idle"), (signal.SIGKILL, "stopped")):
            with following("qp12", *QUIET, at=at) as law:
                assert law.end(number) == (0 if number == signal.SIGTERM else -number)
            stood = wait_for_mode(mode, at)["tick"]
            assert tell("status", at)["tick"] == stood  # and time with it
        assert tell("recover", at)["recovered"]
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) == 1  # there was a safe stop
        assert_no_traceback(robot)
    log = Log.open(out, side="robot")
    kinds = [event for event in events(log) if event[0] in {"GRANTED", "RELEASED", "HOLDER_LOST"}]
    assert kinds == [("GRANTED", 1), ("RELEASED", 1), ("GRANTED", 2), ("HOLDER_LOST", 2)]
    assert_at_rest(log)
