"""Controllers with different tasks are said to have them, and are not measured by V."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from hoap3.tools.analysis.compare.comparison import compare
from hoap3.tools.analysis.compare.page import page
from hoap3.tools.cli.measurements import compare as command

pytestmark = pytest.mark.slow

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(command)
LINE = (
    "com_tracking: another task than stable_qp; V and the time to 1 % of the start cannot be "
    "compared"
)
# It begins at the target of stable_qp, so V is the same at the start.
ROUND = "{kind: circle, center_m: [0, 0.025, 0.2869], radius_m: 0.01, period_s: 8, approach_s: 0}"


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tasks")
    words = ["stable_qp", "qp12_bounded", "com_tracking", "--duration", "0.05", "--no-timing"]
    return CliRunner().invoke(app, [*words, "--out", str(folder)]), folder


def test_one_line_says_whose_task_differs(told):
    done, folder = told
    found = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    assert all("task fail" in finding for finding in found["findings"])  # it is no finding itself
    assert LINE in done.stdout.splitlines()
    assert LINE in (folder / "compare.html").read_text(encoding="utf-8")


def test_what_would_compare_them_is_null_for_them_alone(told):
    found = json.loads((told[1] / "compare.json").read_text(encoding="utf-8"))
    assert found["other_tasks"] == ["com_tracking"]
    first, same, other = found["controllers"]
    assert first["v_difference"] == 0.0
    assert same["v_difference"] is not None
    assert other["v_difference"] is other["error"]["settled_s"] is None
    assert other["error"]["integral"] is not None  # its own, in its own unit


@pytest.mark.parametrize(
    ("pair", "others"),
    [
        (("qp12", "qp12@gamma=0"), []),
        (("qp12", "stable_qp"), []),  # neither names its task as the other does: V is the same
        (("qp12", "qp12@target_m=[0.02,0.02,0.28]"), ["qp12@target_m=[0.02,0.02,0.28]"]),
        (("qp12", "obstacle"), ["obstacle"]),
        (("stable_qp_hoap3", f"round=stable_qp_hoap3@task.parameters.target={ROUND}"), ["round"]),
    ],
)
def test_tasks_are_told_apart_by_name_or_by_v_at_the_start(pair, others):
    made = compare(pair, duration=0.02, timing=False)
    assert made.other_tasks == others
    assert bool(made.notes) == bool(others)
    assert ("another task" in page(made)) == bool(others)


def test_answers_to_the_same_states_need_no_such_note(tmp_path):
    from hoap3.tools.services.configs import load_controller_config, load_emulator_config
    from hoap3.tools.services.run import run_lockstep

    emulator, law = load_emulator_config("hoap3", [])[0], load_controller_config("qp12", [])[0]
    run_lockstep(emulator, law, 0.02, tmp_path / "run")
    made = compare(["qp12", "obstacle"], log=tmp_path / "run", timing=False)
    assert made.other_tasks == made.notes == []
