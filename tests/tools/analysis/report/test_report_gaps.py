"""What is not in a log is said in the report; what is no log of ours is one clear error."""

from __future__ import annotations

import json
import shutil

import pytest
import typer
from report_logs import active_log
from support.html_page import Page
from support.log_samples import MS, describe, write
from support.tick_story import SESSION, Story
from support.tick_story import START as STORY_START
from typer.testing import CliRunner

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.page import page, tiles, write_report
from hoap3.tools.analysis.verdicts import failed
from hoap3.tools.cli.logs import report
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.repair import repair

pytestmark = pytest.mark.slow

GOOD = {"tasks": [], "certifiable": 10, "certified": 10, "margin": None, "balance": None}
STATUS_NONE = Setpoint.schema.constants["STATUS_NONE"]


def motion(content) -> list[str]:
    """Names of the figures of the motion."""
    return [drawing.name for drawing in content.drawings["motion"]]


def said(content) -> str:
    """Everything that the report names as missing."""
    return " ".join(content.gaps)


def tile_names(content) -> set[str]:
    return {name for _, name, *_ in tiles(content)}


@pytest.fixture(scope="module")
def long_story(tmp_path_factory):
    return Story(1700).write(tmp_path_factory.mktemp("long"))


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_a_log_that_was_cut_off_is_shown_up_to_there(share, long_story, tmp_path):
    folder = shutil.copytree(long_story, tmp_path / "cut")
    for log in ("robot.mcap", "controller.mcap"):
        written = (folder / log).read_bytes()
        (folder / log).write_bytes(written[: int(share * len(written))])
    cut = read_content(folder)
    assert cut.gaps
    assert 400 * share < cut.tick_figures["ticks"] < 1700
    assert cut.motion.duration_s == pytest.approx(cut.ticks.duration_s, abs=2e-3)
    assert {"sole", "u"} <= set(motion(cut))


def test_a_robots_log_that_ends_before_the_motion_leaves_it_to_the_controllers(lockstep, tmp_path):
    folder = shutil.copytree(lockstep[0], tmp_path / "cut")
    written = (folder / "robot.mcap").read_bytes()
    (folder / "robot.mcap").write_bytes(written[: len(written) // 3])
    cut = read_content(folder)
    assert cut.as_json()["verdicts"]["deadlines"] == "not judged"
    assert cut.motion.side == "controller"
    assert len(cut.motion.v) == 500


def test_what_is_missing_stands_at_the_head_of_the_page(tmp_path):
    content = read_content(active_log(tmp_path, count=3, setpoint={"tick": 999}))
    named = Page(page(content)).root.all("div", "gaps")[0].text()
    assert content.gaps
    assert all(gap in named for gap in content.gaps)


def test_only_the_robots_log(story):
    content = read_content(story[0] / "robot.mcap")
    assert content.tick_figures["ticks"] == read_content(story[0]).tick_figures["ticks"]
    assert "u" in motion(content)


def test_only_the_controllers_log(lockstep):
    content = read_content(lockstep[0] / "controller.mcap")
    assert motion(content) == ["views", "sole", "path", "positions", "v", "psi", "u", "active"]
    assert content.drawings["time"] == []
    assert "success rate, raw" not in tile_names(content)
    assert content.as_json()["verdicts"]["deadlines"] == "not judged"


def test_a_damaged_log_of_one_side_does_not_hide_the_other(lockstep, tmp_path):
    folder = shutil.copytree(lockstep[0], tmp_path / "run")
    (folder / "robot.mcap").write_bytes(b"\x89MCAP0\r\n")
    content = read_content(folder)
    assert len(content.gaps) == len(set(content.gaps))
    assert len(content.motion.v) == 500


def test_without_a_stall_monitor_no_rate_outside_stalls_is_shown(tmp_path):
    content = read_content(active_log(tmp_path))
    assert not [tile for tile in tiles(content) if tile[1] == "outside stalls"]


def test_a_safe_stop_is_told_before_anything_else(tmp_path):
    forced = Event.schema.constants["REASON_MISSES"]
    stop = (Event.schema.constants["SAFE_STOP"], forced)
    content = read_content(active_log(tmp_path, events=(stop,)))
    assert content.as_json()["safe_stops"] == 1
    assert content.tick_figures["verdicts"]["deadlines"] == "fail"


def test_ticks_under_another_controller_are_counted(tmp_path):
    robot, _ = Story(100).records()
    _, controller = Story(60).records()
    for place, record in enumerate(robot):
        if record.kind == Kind.STATE:
            state = State.like(record.payload)
            state.load(record.payload)
            state.epoch += state.tick >= 60
            robot[place] = record._replace(payload=state.dump())
    about = {"attachments": {"description.json": describe(1).to_json()}}
    write(tmp_path / "robot.mcap", robot, **about)
    write(tmp_path / "controller.mcap", controller, side="controller", **about)
    assert "another controller in 40 of 100 ticks" in said(read_content(tmp_path, verify=False))
    (tmp_path / "one").mkdir()
    one = read_content(Story(60).write(tmp_path / "one"), verify=False)
    assert "another controller" not in said(one)


def test_a_robot_without_soles_has_a_path_and_no_polygon(tmp_path):
    content = read_content(active_log(tmp_path))
    assert "sole" not in said(content)
    (sole,) = [drawing for drawing in content.drawings["motion"] if drawing.name == "sole"]
    assert "support polygon" not in [key.text for key in sole.keys]


def test_a_controller_without_certificates_has_inputs_but_no_v(tmp_path):
    content = read_content(active_log(tmp_path, setpoint={"solver_status": STATUS_NONE}))
    assert motion(content) == ["views", "sole", "path", "positions", "u", "active"]
    assert "error at the end" not in tile_names(content)


def test_accelerations_are_shown_in_their_own_unit(tmp_path):
    content = read_content(active_log(tmp_path, setpoint={"command": Setpoint.ACCELERATION}))
    (inputs,) = [drawing for drawing in content.drawings["motion"] if drawing.name == "u"]
    assert "u [rad/s²]" in inputs.svg
    assert content.motion.inputs == pytest.approx(
        Log.open(content.sources.path, "robot").setpoints()["values"]
    )


def test_a_robot_that_nobody_commands_has_events_and_a_machine(tmp_path):
    content = read_content(active_log(tmp_path, state={"mode": 0}, events=((1, 0),)))
    read = Page(page(content))
    assert not read.figures()
    assert read.rows("events")[1][:2] == ["robot", "started"]


def test_a_log_recorded_from_outside_has_no_deadlines(tmp_path):
    content = read_content(active_log(tmp_path, metadata={"run": {"recorded": "true"}}))
    assert content.ticks is None
    assert "u" in motion(content)


@pytest.mark.parametrize("content", [None, b"", b"not a log", b"\x89MCAP0\r\n" * 9])
def test_what_is_no_log_of_ours_is_one_error(content, tmp_path):
    if content is not None:
        (tmp_path / "robot.mcap").write_bytes(content)
    for path in (tmp_path, tmp_path / "robot.mcap"):
        with pytest.raises(LogError, match=r"\w\.mcap") as caught:
            read_content(path)
        assert "\n" not in str(caught.value)


def test_a_page_that_cannot_be_written_is_an_error_that_names_it(story, tmp_path):
    with pytest.raises(UsageError, match=r"nowhere.*--out"):
        write_report(story[0], out=tmp_path / "nowhere" / "report.html")


@pytest.fixture
def command():
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(report)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_writes_the_page_and_prints_one_object(command, story, tmp_path):
    done = command(story[0], "--out", tmp_path / "page.html", "--json")
    figures = json.loads(done.stdout)
    unjudged = bool(figures["verified"]["unjudged"])
    assert done.exit_code == (unjudged or "fail" in figures["verdicts"].values())
    assert figures["report"] == str(tmp_path / "page.html")
    assert figures["verdicts"]["deadlines"] == "pass"
    assert figures["rtt_us"]["n"] == 600 - 2 - 7  # two skipped, seven lost
    assert Page((tmp_path / "page.html").read_text(encoding="utf-8")).figures()


def test_the_page_lies_beside_the_log_where_nothing_else_is_said(command, lockstep, tmp_path):
    folder = shutil.copytree(lockstep[0], tmp_path / "run")
    done = command(folder)
    assert done.exit_code == 1  # half a second is too short to arrive
    assert str(folder / "report.html") in done.stdout
    assert (folder / "report.html").is_file()
    again = command(folder / "controller.mcap")
    assert again.exit_code == 1


def cut(folder, log: str, share: float):
    """Lose the end of a file."""
    written = (folder / log).read_bytes()
    (folder / log).write_bytes(written[: int(share * len(written))])
    return folder


@pytest.mark.parametrize(("side", "lost"), [("robot", "deadlines"), ("controller", "task")])
def test_a_log_that_was_cut_off_is_a_finding(side, lost, command, lockstep, tmp_path):
    folder = cut(shutil.copytree(lockstep[0], tmp_path / "cut"), f"{side}.mcap", 0.8)
    done = command(folder, "--json")
    figures = json.loads(done.stdout)
    assert done.exit_code == 1
    assert list(figures["damaged"]) == [side]
    assert figures["verdicts"][lost] in {"not judged", "fail"}
    assert figures["verdicts"]["limits_and_balance"] == "fail"
    assert "damaged" in figures["limits_and_balance"]["reasons"]
    assert f"{side}.mcap" in done.stderr
    assert "record --repair" in done.stderr


def test_a_log_that_cannot_be_read_at_all_is_a_finding(command, lockstep, tmp_path):
    folder = cut(shutil.copytree(lockstep[0], tmp_path / "cut"), "controller.mcap", 1e-4)
    done = command(folder, "--json")
    figures = json.loads(done.stdout)
    assert done.exit_code == 1
    assert figures["task"]["reasons"] == ["damaged"]
    assert (list(figures["unreadable"]), figures["damaged"]) == (["controller"], {})
    assert figures["repairable"] == []
    assert "--repair" not in done.stderr


def test_a_repaired_log_is_still_a_finding_and_is_not_to_be_repaired_again(
    command, lockstep, tmp_path
):
    folder = cut(shutil.copytree(lockstep[0], tmp_path / "cut"), "robot.mcap", 0.8)
    assert json.loads(command(folder, "--json").stdout)["repairable"] == ["robot"]
    repaired = repair(folder / "robot.mcap").out
    done = command(repaired, "--json")
    assert done.exit_code == 1
    assert json.loads(done.stdout)["repairable"] == []
    assert "--repair" not in done.stderr


def test_answers_of_a_controller_that_cannot_be_repeated_are_a_finding(command, tmp_path):
    untold, unheard = tmp_path / "untold", tmp_path / "unheard"
    untold.mkdir()
    unheard.mkdir()
    folder = Story(300).write(untold)
    done = command(folder, "--json")
    figures = json.loads(done.stdout)
    assert done.exit_code == 1
    assert not failed({"task": figures["verdicts"]["task"]})
    assert figures["task"]["errors"] == []
    assert any("config" in part for part in figures["verified"]["unjudged"])
    assert "config" in done.stderr
    assert figures["damaged"] == {}
    alone = json.loads(command(Story(300).write(unheard, controller=False), "--json").stdout)
    assert alone["verdicts"]["task"] == "not judged"
    assert not failed(alone["verdicts"])


def test_an_unfit_run_is_a_finding(command, tmp_path):
    folder = active_log(tmp_path, setpoint={"epoch": 9})  # the robot refuses them all
    assert command(folder, "--out", tmp_path / "page.html").exit_code == 1


def summed_up(folder, *, at: int, **about):
    """A run of 300 ticks whose controller summed up at a tick, in a folder.

    Args:
        at: tick of the summary, on the controller's clock.
        about: metadata of the controller's log.
    """
    folder.mkdir()
    story = Story(300)
    _, records = story.records()
    payload = json.dumps({"session_id": SESSION, **GOOD}).encode()
    stamp = STORY_START + story.offset + at * MS
    records.append(Record(Kind.SUMMARY, stamp, payload))
    records.sort(key=lambda record: record.stamp)
    story.write(folder, controller=False)
    enclosed = {"description.json": describe(1).to_json()}
    write(folder / "controller.mcap", records, side="controller", attachments=enclosed, **about)
    return folder


def test_a_summary_of_a_controller_that_cannot_be_repeated_is_no_outcome(tmp_path):
    content = read_content(summed_up(tmp_path / "ended", at=400))
    assert content.judged["task"]["certified"] == 0
    assert not failed({"task": content.judged["verdicts"]["task"]})
    assert content.checked.unjudged


def test_a_recording_from_outside_that_is_cut_off_is_not_judged(tmp_path):
    folder = active_log(tmp_path, metadata={"run": {"recorded": "from outside"}})
    content = read_content(cut(folder, "robot.mcap", 0.999))
    assert list(content.sources.damaged) == ["robot"]
    assert set(content.judged["verdicts"].values()) == {"not judged"}
