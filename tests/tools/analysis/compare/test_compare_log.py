"""Open loop: all controllers answer the States of one log."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
from support.log_samples import describe, inputs, ticks, write
from typer.testing import CliRunner

from hoap3.protocol.errors import ConfigError, Hoap3Error, LogError, UsageError
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.compare.comparison import compare
from hoap3.tools.cli.measurements import compare as command
from hoap3.tools.logs.log import Log
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run import run_lockstep

pytestmark = pytest.mark.slow

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(command)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Folder of a third of a second of HOAP-3 with qp12."""
    folder = tmp_path_factory.mktemp("compare") / "run"
    emulator, controller = (
        load_emulator_config("hoap3", [])[0],
        load_controller_config("qp12_paper", [])[0],
    )
    run_lockstep(emulator, controller, 0.3, folder)
    return folder


@pytest.fixture(scope="module")
def made(run):
    names = ["qp12_paper", "qp12_paper@gamma=0", "pinv@ramp_s=0"]
    return compare(names, log=run, timing=False)


def test_the_logged_controller_answers_as_it_did(run, made):
    logged = Log.open(run, "robot").setpoints()
    assert np.array_equal(made.series[0].v, logged["v"])
    assert np.array_equal(made.series[0].status, logged["solver_status"])
    assert made.figures[0]["active_joints"]["mean"] == logged["active_joints"].mean()


def test_every_controller_sees_the_same_states(made):
    assert {len(each) for each in made.series} == {300}
    for each in made.series[1:]:
        assert np.array_equal(each.time_s, made.series[0].time_s)
        assert np.allclose(each.v, made.series[0].v, rtol=1e-12)  # the same task, the same State


def test_what_only_a_closed_loop_has_is_null(made):
    for each in made.as_json()["controllers"]:
        assert set(each["error"].values()) == set(each["path"].values()) == {None}
        assert each["v_difference"] is None
        assert each["success_rate"] is None
        assert each["control_effort"]["l1"] > 0.0
    facts = made.as_json()
    assert (facts["mode"], facts["seed"]) == ("open loop", None)
    assert facts["duration_s"] == pytest.approx(0.3)


def test_answers_to_the_same_state_are_compared(made):
    same, other, _ = (each["u_difference"] for each in made.figures)
    assert same == 0.0
    assert other == np.abs(made.series[1].inputs - made.series[0].inputs).max() > 0.01


def test_the_controllers_log_will_do_and_gives_the_same(run, made):
    names = ["qp12_paper", "qp12_paper@gamma=0", "pinv@ramp_s=0"]
    again = compare(names, log=run / "controller.mcap", timing=False)
    assert again.figures == made.figures


def test_two_open_loops_give_the_same_bytes(run, tmp_path):
    texts = []
    for name in ("a", "b"):
        words = ["qp12", "pinv", "--log", run, "--no-timing", "--out", tmp_path / name, "--json"]
        done = CliRunner().invoke(app, list(map(str, words)))
        assert done.exit_code == 1  # pinv drives a joint to its end
        assert json.loads(done.stdout)["log"] == str(run)
        texts.append([path.read_bytes() for path in sorted((tmp_path / name).iterdir())])
    assert texts[0] == texts[1]
    assert len(texts[0]) == 3


def test_times_are_measured_on_the_states_of_the_log(run):
    times = compare(["qp12", "pinv"], log=run)
    assert times.timing["blocks"] == 30
    assert {row["step_us"]["n"] for row in times.timing["rows"]} == {30 * 7}


def active(path, count=20, first=State.ACTIVE, broken=None):
    """Log of a small chain of joints that nobody shipped, all of it active."""
    state, records = State(2), inputs(describe(2))
    for record in ticks(2, count, extra=0):
        if record.kind == Kind.STATE:
            state.load(record.payload)
            state.mode = first
            if broken is not None:
                state.q[:] = state.reference[:] = broken
            records.append(Record(Kind.STATE, record.stamp, state.dump()))
    attached = {"description.json": describe(2).to_json(), "config.yaml": b"robot: sample\n"}
    write(path, records, attachments=attached)
    return path


def test_a_log_of_a_robot_that_a_controller_cannot_move_names_it(tmp_path):
    log = active(tmp_path / "robot.mcap")
    with pytest.raises(ConfigError) as caught:
        compare(["qp12", "pinv"], log=log)
    assert caught.value.file.endswith(("qp12", "qp12.yaml"))
    assert "'sample'" in str(caught.value)


def test_another_robots_log_is_compared_by_who_can_move_it(tmp_path):
    log = active(tmp_path / "robot.mcap")
    frames = "point=com,reference_frame=link_0,target_m=[0, 0, 0.1]"
    made = compare([f"qp12@{frames}", f"pinv@{frames}"], log=log, timing=False)
    assert made.facts["robot"] == "sample"
    assert made.figures[0]["answers"] == 20


@pytest.mark.parametrize("broken", [None, np.nan, np.inf, 1e300])
def test_whatever_stands_in_the_states_of_a_log_gives_files(tmp_path, broken):
    log = active(tmp_path / "robot.mcap", broken=broken)  # stamps are random in any case
    frames = "point=com,reference_frame=link_0,target_m=[0, 0, 0.1]"
    words = [f"qp12@{frames}", f"pinv@{frames}", "--log", log, "--out", tmp_path / "out"]
    done = CliRunner().invoke(app, list(map(str, words)))
    assert isinstance(done.exception, SystemExit | None), done.exception
    assert json.loads((tmp_path / "out" / "compare.json").read_text(encoding="utf-8"))
    assert "<svg" in (tmp_path / "out" / "compare.html").read_text(encoding="utf-8")


def test_a_log_without_motion_is_refused(tmp_path):
    log = active(tmp_path / "robot.mcap", first=State.IDLE)
    with pytest.raises(LogError, match=str(log)):
        compare(["qp12", "pinv"], log=log)


@pytest.mark.parametrize("content", [None, b"", b"not a log", b"\x89MCAP0\r\n" + bytes(50)])
def test_what_is_no_log_is_refused(tmp_path, content):
    file = tmp_path / "robot.mcap"
    if content is not None:
        file.write_bytes(content)
    for path in (file, tmp_path):
        with pytest.raises(LogError, match=str(path)):
            compare(["qp12", "pinv"], log=path)


@pytest.mark.parametrize(
    ("given", "name"), [({"duration": 1.0}, "--duration"), ({"seed": 0}, "--seed")]
)
def test_what_a_log_decides_cannot_be_asked_for(run, given, name):
    with pytest.raises(UsageError, match=name):
        compare(["qp12", "pinv"], log=run, **given)
    with pytest.raises(UsageError, match="--robot"):
        compare(["qp12", "pinv"], robot="hoap3", log=run)


FAILING = """
from hoap3.remote_controller.controllers.base import Controller


class Failing(Controller):
    def reset(self, state, last_command):
        self.resets = getattr(self, "resets", 0) + 1

    def step(self, state):
        if state.tick == 9:
            raise RuntimeError(f"after {self.resets} reset")
        return self.command
"""


def test_a_controller_that_fails_is_named_with_its_tick(run, tmp_path, monkeypatch):
    (tmp_path / "failing_nine.py").write_text(FAILING, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(Hoap3Error, match=r"^odd: .*tick 9.*after 1 reset"):
        compare(["qp12", "odd=failing_nine:Failing"], log=run)
