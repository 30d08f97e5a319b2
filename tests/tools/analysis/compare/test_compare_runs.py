"""Real comparisons in closed loop: γ does what it says, and two runs give the same bytes."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from hoap3.protocol.errors import ConfigError, Hoap3Error, UnknownNameError, UsageError
from hoap3.tools.analysis.compare.comparison import compare
from hoap3.tools.analysis.compare.figures import WORDS, value
from hoap3.tools.cli.measurements import compare as command
from hoap3.tools.services.simulate import simulate

pytestmark = pytest.mark.slow

GAMMAS = [f"qp12_paper@gamma={gamma}" for gamma in ("0", "0.5", "0.99")]
FIVE = [*GAMMAS, "pinv=pinv@ramp_s=0", "osqp=osqp@ramp_s=0,adaptive_gamma=false"]
ALIKE = 0.003  # of V at the start; 0.0024 was measured over 20 s

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(command)


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """The five of the paper's comparison for 2 s, without times: JSON and folder."""
    folder = tmp_path_factory.mktemp("five") / "out"
    done = invoke(*FIVE, "--duration", "2", "--no-timing", "--json", "--out", folder)
    assert done.exit_code == 1, done.stderr  # pinv and osqp have cycles without certificate
    return json.loads(done.stdout), folder


def by_label(found):
    return {each["label"]: each for each in found["controllers"]}


def test_fewer_joints_are_active_the_greater_gamma_is(five):
    found = by_label(five[0])
    means = [
        found[f"qp12_paper@gamma={gamma}"]["active_joints"]["mean"]
        for gamma in ("0", "0.5", "0.99")
    ]
    assert means[0] > 2.0 * means[1]
    assert means[1] > means[2] >= 1.0
    assert found["pinv"]["active_joints"]["mean"] > 2.0 * means[1]


def test_v_falls_alike_however_many_joints_work(five):
    found = by_label(five[0])
    for each in found.values():
        assert each["v_difference"] <= ALIKE
        assert each["error"]["end"] < 0.15 * each["error"]["start"]
    assert found["qp12_paper@gamma=0"]["v_difference"] == 0.0
    assert found["osqp"]["v_difference"] == pytest.approx(
        found["qp12_paper@gamma=0.5"]["v_difference"], rel=1e-6
    )


def test_what_is_not_certified_is_a_finding(five):
    found = by_label(five[0])
    assert found["qp12_paper@gamma=0"]["certificates"]["certified"] == 2000
    assert found["pinv"]["certificates"]["uncertified"] > 0
    assert [each["verdicts"]["task"] for each in found.values()] == ["fail"] * 5  # too short
    findings = [each for each in five[0]["findings"] if "answers are" in each]
    labels = {each.split(":")[0] for each in findings}
    assert labels == {"pinv", "osqp"}


def test_two_runs_give_the_same_bytes(five, tmp_path):
    done = invoke(*FIVE, "--duration", "2", "--no-timing", "--out", tmp_path)
    assert done.exit_code == 1
    names = sorted(path.name for path in five[1].iterdir())
    assert names == ["compare.csv", "compare.html", "compare.json"]
    for name in names:
        assert (tmp_path / name).read_bytes() == (five[1] / name).read_bytes(), name


def test_standard_output_is_the_file_with_times_and_names(five):
    printed, folder = five
    written = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    names = [str(folder / name) for name in ("compare.json", "compare.csv", "compare.html")]
    assert printed == {**written, "timing": None, "files": names}


def test_the_csv_has_every_figure_of_the_json(five):
    lines = (five[1] / "compare.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].split(",") == ["label", "unit", *(word.key for word in WORDS)]
    for line, each in zip(lines[1:], five[0]["controllers"], strict=True):
        cells = dict(zip(lines[0].split(","), line.split(","), strict=True))
        for word in WORDS:
            given = value(each, word.key)
            assert cells[word.key] == ("" if given is None else str(given))


def test_each_controller_does_what_it_does_alone():
    made = compare(["pinv", "qp12_paper@gamma=0.1"], duration=0.2, seed=3, timing=False)
    alone = simulate("hoap3", {"controller": "qp12", "parameters": {"gamma": 0.1}}, 0.2, seed=3)
    v = alone.setpoints["v"]
    assert np.array_equal(made.series[1].v, v)
    found = made.figures[1]
    assert found["error"]["end"] == np.sqrt(2.0 * v[-1])
    assert found["active_joints"]["mean"] == alone.setpoints["active_joints"].mean()
    assert found["answers"] == len(v)


def test_a_comparison_without_findings_ends_with_0_and_has_its_times_apart(tmp_path):
    near = "qp12=qp12@tolerance_m=0.1", "few=qp12@gamma=0.9,tolerance_m=0.1"
    done = invoke(*near, "--duration", "0.1", "--out", tmp_path, "--json")
    assert done.exit_code == 0
    printed = json.loads(done.stdout)
    written = json.loads((tmp_path / "timing.json").read_text(encoding="utf-8"))
    assert printed["timing"] == written
    assert [row["label"] for row in written["rows"]] == ["qp12", "few"]
    assert written["rows"][0]["times_first"] == 1.0
    for row in written["rows"]:
        assert row["step_us"]["n"] > 0
        assert 0.0 < row["step_us"]["p50"] <= row["step_us"]["p99"] <= row["step_us"]["max"]
    for name in ("compare.json", "compare.html", "compare.csv"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert "step_us" not in text
        assert written["machine"]["kernel"] not in text


def test_no_earlier_comparison_is_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("qp12@tolerance_m=0.1", "qp12@tolerance_m=0.1", "--duration", "0.01", "--no-timing")
    for number in (1, 2):
        done = invoke(*words)
        assert done.exit_code == 0
        folders = {path.parent for path in (tmp_path / "compared").glob("*/compare.json")}
        assert len(folders) == number
    newest = max(folders, key=lambda folder: folder.stat().st_mtime_ns).relative_to(tmp_path)
    assert f"{newest}/compare.json" in done.stdout  # it is told where they are
    before = (newest / "compare.json").read_bytes()
    again = invoke("qp12", "pinv", "--duration", "0.01", "--out", newest)
    assert isinstance(again.exception, ConfigError)
    assert "compare.json" in str(again.exception)
    assert (newest / "compare.json").read_bytes() == before


def refused(error, *words):
    done = invoke(*words)
    assert isinstance(done.exception, error), done.stderr
    assert isinstance(done.exception, UsageError)  # which ends with exit code 2
    return str(done.exception)


def test_wrong_usage_is_one_clear_error_before_anything_is_written(tmp_path):
    out = tmp_path / "out"
    refused(UsageError, "qp12", "--out", out)
    assert "'pinv'" in refused(UnknownNameError, "qp12", "pimv", "--out", out)
    assert "gamma" in refused(ConfigError, "qp12", "qp12@gamma=7", "--out", out)
    assert "hoap3" in refused(UnknownNameError, "qp12", "pinv", "--robot", "hoap", "--out", out)
    for option in ("--duration=0", "--duration=nan", "--seed=-1"):
        assert invoke("qp12", "pinv", option, "--out", out).exit_code == 2
    assert not out.exists()


def test_a_controller_that_the_robot_cannot_have_is_named(tmp_path):
    message = refused(
        ConfigError, "qp12", "qp12@point=com,reference_frame=nose", "--out", tmp_path / "out"
    )
    assert message.startswith("qp12@point=com,reference_frame=nose: parameters.reference_frame")


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    done = invoke("qp12", "pinv", "--out", tmp_path / "file" / "out")
    assert isinstance(done.exception, ConfigError)
    assert "file/out" in str(done.exception)
    assert "in lockstep" not in done.stderr


FAILING = """
from hoap3.remote_controller.controllers.base import VelocityController


class Failing(VelocityController):
    def velocity(self, state):
        if state.tick == 7:
            raise RuntimeError("seven")
        return state.q * 0.0
"""


def test_a_controller_that_fails_is_told_from_the_others(tmp_path, monkeypatch):
    (tmp_path / "failing_seven.py").write_text(FAILING, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(Hoap3Error, match=r"^odd: .*tick 7.*seven") as caught:
        compare(["qp12", "odd=failing_seven:Failing"], duration=0.1)
    assert not isinstance(caught.value, UsageError)


def test_a_robot_that_stops_safely_is_a_finding(tmp_path):
    robot = tmp_path / "slow.yaml"
    robot.write_text("robot: hoap3\nlockstep: {compute_time_us: 1500}\n", encoding="utf-8")
    made = compare(["qp12", "pinv"], robot=str(robot), duration=0.1, timing=False)
    assert re.search("^qp12.* 20 ", made.findings[0])
    assert made.figures[0]["success_rate"] == 0.0
