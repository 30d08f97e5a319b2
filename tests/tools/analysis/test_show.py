"""What the summary of a run says to people."""

from __future__ import annotations

import pytest

from hoap3.tools.analysis.summary import final_error_words, show_summary
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.tools.services.run_statistics import RunStatistics


def in_unit(unit: str, error: float = 0.004) -> dict[str, object]:
    return {"task": "hand", "error": error, "unit": unit, "tolerance": 1.0, "within": True}


@pytest.mark.parametrize(
    ("errors", "unit"),
    [
        ([in_unit("m")], "m"),
        ([in_unit("m"), in_unit("m", 0.1)], "m"),
        ([in_unit("deg")], "rad"),
        ([in_unit("m"), in_unit("deg")], "m and rad"),
    ],
)
def test_the_final_error_has_the_unit_of_v_where_all_tasks_share_it(errors, unit):
    told = final_error_words({"final_error": 0.0123, "task": {"errors": errors}})
    assert told is not None
    assert "0.0123" in told
    assert (told == f"0.0123 {unit}") == (len({each["unit"] for each in errors}) == 1)
    assert unit in told


def test_a_service_that_heard_of_no_task_names_no_unit():
    told = final_error_words({"final_error": 0.0123, "task": {"errors": []}})
    assert told is not None
    assert not {"m", "rad", "deg"} & set(told.split())


@pytest.mark.parametrize("errors", [[], [in_unit("m")]])
@pytest.mark.parametrize("nothing", [0.0, None])
def test_a_controller_without_v_is_not_said_to_have_no_error(nothing, errors):
    assert final_error_words({"final_error": nothing, "task": {"errors": errors}}) is None


def test_the_summary_has_that_row(capsys):
    summary = RunStatistics(1_000_000, timing=False).figures()
    summary |= judge_run(summary, {}, None)
    summary |= {"log": None, "machine": {}, "transport": "none", "final_error": 0.0123}
    summary["task"]["errors"] = [in_unit("m") | {"judged": True, "note": ""}]
    show_summary(summary)
    assert "0.0123 m" in capsys.readouterr().out
