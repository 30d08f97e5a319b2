"""`hoap3 latency`: measured for real, with ordinary processes, and again from its own logs."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import typer
from support.log_samples import describe, write
from support.tick_story import START, Story
from typer.testing import CliRunner

from hoap3.protocol.errors import Hoap3Error, LogError, UsageError
from hoap3.protocol.messages import Setpoint, State
from hoap3.tools.analysis.cycles import NEVER
from hoap3.tools.analysis.ticks import TickTable
from hoap3.tools.bench.latency import latency as measuring
from hoap3.tools.bench.latency.echo import Exchanges
from hoap3.tools.bench.latency.latency import (
    WARM_UP,
    Plan,
    analyse_log,
    compare,
    measure_latency,
    show_latency,
)
from hoap3.tools.cli.measurements import latency
from hoap3.tools.machine.loopback_links import LINKS
from hoap3.tools.services.configs import load_emulator_config
from hoap3.tools.services.messages import LiveFigures, LoopEvent

pytestmark = pytest.mark.slow

US = 1_000
PROMISED = {
    "verdicts", "ticks", "skipped", "misses", "misses_outside_stalls", "host_stalls",
    "success_rate", "echo_rtt_us", "rtt_ratio", "rtt_us", "wakeup_us", "jitter_us", "stages_us",
    "worst", "guilty_stage", "guilty", "final_error", "machine", "log",
}  # fmt: skip


def plan(**changes):
    emulator, _ = load_emulator_config("hoap3", [], realtime=False)
    return Plan(emulator, **{"blocks": 1, "ticks": 100, "realtime": False, **changes})


def command(*words):
    app = typer.Typer()
    app.command()(latency)
    return CliRunner().invoke(app, list(map(str, words)))


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """One block, and where its log is."""
    folder = tmp_path_factory.mktemp("latency") / "logs"
    told = []
    found = measure_latency(plan(ticks=150, out=folder), told.append)
    return found, folder, told


def test_a_measurement_has_every_promised_figure(measured):
    found, folder, said = measured
    assert found.keys() >= PROMISED
    assert json.loads(json.dumps(found)) == found
    told = {"reference_rate": 21, "reference_acceleration": 21, "followed": 1}
    assert found["bytes"] == {"state": State(21, **told).size, "setpoint": Setpoint(21).size}
    assert (found["link"], found["warm_up_ticks"], found["period_us"]) == ("tcp", WARM_UP, 1000.0)
    assert found["log"] == str(folder)
    assert len(said) == 1
    assert 0 < found["echo_rtt_us"]["n"] <= 150


@pytest.fixture
def made_up(monkeypatch):
    """Blocks of the link and of the echo cost nothing: they are made up, and noted in order.

    The link's first ticks are those of a robot that waits to be granted.
    """
    order = []

    def run(emulator, law, duration, folder, news, *, links, should_stop):
        news(LiveFigures({}))
        order.append("link")
        news(LoopEvent("granted", "granted", routine=True))
        folder.mkdir(parents=True)
        story = Story(round(duration * 1000), len(order))
        story.lengths["outbound"] += 10.0 * len(order)
        story.write(folder)
        return {"realtime": [], "log_lost": []}

    class Echo:
        def __init__(self, order_of_block, *_):
            self.ticks = order_of_block["ticks"]

        def close(self):
            pass

        def begin(self):
            order.append("echo")

        def result(self):
            stamps = START + np.arange(self.ticks) * 1000 * US + 500 * US
            return Exchanges(stamps, stamps, stamps + 20 * US)

    monkeypatch.setattr("hoap3.tools.bench.latency.latency.run_realtime", run)
    monkeypatch.setattr("hoap3.tools.bench.latency.latency.BareEcho", Echo)
    return order


def test_the_echo_begins_with_the_motion_and_the_ratio_is_the_median_over_the_blocks(made_up):
    found = measure_latency(plan(blocks=5))
    assert made_up == ["link", "echo"] * 5
    ratios = [block["rtt_p50_us"] / 20 for block in found["blocks"]]
    assert [block["ratio"] for block in found["blocks"]] == pytest.approx(ratios)
    assert ratios == sorted(set(ratios))
    assert found["rtt_ratio"] == pytest.approx(ratios[2])
    assert found["ticks"] == 500


def test_an_interruption_leaves_the_blocks_that_were_complete(made_up):
    found = measure_latency(plan(blocks=5), should_stop=lambda: made_up.count("link") > 2)
    assert made_up == ["link", "echo"] * 3
    assert len(found["blocks"]) == 2
    assert found["ticks"] == 200


def test_the_null_controllers_stages_make_up_the_round_trip(measured):
    found, folder, _ = measured
    assert 0 < found["ticks"] <= 150
    assert found["ticks"] + found["skipped"] <= 150
    assert found["rtt_us"]["n"] <= found["ticks"]
    table = TickTable.from_run(folder / "block0")
    answered = ~np.isnan(table.stage("rtt"))
    assert answered.any()
    assert not np.isnan(table.stage("solve")[answered]).any()
    assert not table.stage("unaccounted")[answered].any()


def test_the_same_figures_come_from_its_log(measured):
    found, folder, _ = measured
    again = analyse_log(folder / "block0")
    assert again["ticks"] + again["skipped"] == found["ticks"] + found["skipped"] + WARM_UP
    assert again.keys() >= PROMISED
    assert again["echo_rtt_us"] is None
    assert again["rtt_ratio"] is None
    assert again["warm_up_ticks"] == 0
    assert again["machine"]["kernel"] == found["machine"]["kernel"]


def test_people_and_programs_are_told_the_same(measured, capsys):
    found, folder, _ = measured
    show_latency(found)
    printed = capsys.readouterr().out
    assert f"{found['rtt_ratio']:.2f}" in printed
    assert found["verdicts"]["deadlines"] in printed
    done = command("--log", folder / "block0", "--json")
    assert done.exit_code in {0, 1}
    assert (done.exit_code == 1) == (json.loads(done.stdout)["verdicts"]["deadlines"] == "fail")
    assert json.loads(done.stdout) == json.loads(json.dumps(analyse_log(folder / "block0")))


@pytest.mark.long
@pytest.mark.parametrize("link", LINKS)
def test_every_link_is_measured(link):
    found = measure_latency(plan(link=link))
    assert found["link"] == link
    assert found["rtt_us"]["n"] > 0
    assert found["rtt_ratio"] > 0


def test_with_certificates_the_round_trips_in_plain_stand_beside(tmp_path):
    found = measure_latency(plan(link="tls", out=tmp_path / "logs"))
    assert found["transport"].startswith("zenoh over tls")
    assert found["rtt_us"]["n"] > 0
    assert found["plain_rtt_us"]["n"] > 0
    assert {path.name for path in (tmp_path / "logs").iterdir()} == {"plain0", "block0"}


@pytest.mark.parametrize(("lost", "code"), [(0, 0), (60, 1)])
def test_the_exit_code_is_the_verdict(tmp_path, lost, code):
    Story(500, vanished=set(range(0, 8 * lost, 8))).write(tmp_path)
    done = command("--log", tmp_path)
    assert done.exit_code == code


def test_a_log_that_was_cut_off_is_not_called_fit(tmp_path):
    Story(500).write(tmp_path)
    file = tmp_path / "robot.mcap"
    assert analyse_log(tmp_path)["verdicts"]["deadlines"] == "pass"
    file.write_bytes(file.read_bytes()[:-100])
    found = analyse_log(tmp_path)
    assert found["missing"]
    assert found["verdicts"]["deadlines"] == "not judged"


def test_a_log_that_is_lost_in_a_block_ends_the_measurement(monkeypatch):
    lost = {"log_lost": ["the robot's log is not whole: No space left on device"]}
    monkeypatch.setattr(measuring, "run_realtime", lambda *_, **__: lost)
    with pytest.raises(Hoap3Error, match="No space left"):
        measure_latency(plan())


def test_a_log_tells_of_its_worst_ticks(tmp_path, capsys):
    Story(500, stalls=[]).slow("encode", [100, 300], 1500.0).write(tmp_path)
    found = analyse_log(tmp_path)
    assert found["guilty"] == {"encode": 2}
    assert found["guilty_stage"] == "encode"
    show_latency(found)
    printed = capsys.readouterr().out
    assert "encode 2" in printed
    assert "encode 1500" in printed


def test_an_interrupted_measurement_without_a_block_is_an_error():
    with pytest.raises(Hoap3Error):
        measure_latency(plan(), should_stop=lambda: True)


def test_two_measurements_do_not_share_a_cpu(monkeypatch):
    monkeypatch.setattr("hoap3.tools.services.placement.claim_cpus", lambda *_: [])
    with pytest.raises(UsageError, match="CPU"):
        measure_latency(plan(realtime=True))


def test_a_robot_that_never_moved_has_no_latency(tmp_path):
    robot, _ = Story(1).records()
    at_rest = [record for record in robot if record.kind != 1 or record is robot[-1]]
    about = {"attachments": {"description.json": describe(1).to_json()}}
    write(tmp_path / "robot.mcap", at_rest, **about)
    with pytest.raises(LogError, match=str(tmp_path)):
        analyse_log(tmp_path)


def test_a_block_without_answers_has_no_ratio(tmp_path):
    table = TickTable.from_run(Story(100).write(tmp_path))
    stamps = np.arange(100) * 1000 * US
    silent = Exchanges(stamps, stamps, np.full(100, NEVER))
    echo = Exchanges(stamps, stamps, stamps + 20 * US)
    found = compare([table, table], [silent, echo])
    assert found["blocks"][0]["ratio"] is None
    assert found["rtt_ratio"] == found["blocks"][1]["ratio"]
    assert math.isclose(found["rtt_ratio"], np.sort(table.stage("rtt"))[49] / (20 * US))
