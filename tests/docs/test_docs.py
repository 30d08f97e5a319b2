"""README.md and docs/*.md say what is so: their commands run, their tables are the code's."""

from __future__ import annotations

import re

import pytest
from pages import HOUSE, NAMES, Block, anchors, blocks, links, page, prose, spans, table
from story import Story, check, hoap3, subcommands
from support.property_suites import run
from support.urdfs.vendor_arm import vendor_folder

from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.messages import Setpoint
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.robots.yaml_file import DefaultTaskEntry, JointEntry, RobotFile, SoleEntry
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS
from hoap3.tools.logs.log_format import TOPICS
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.services.run_statistics import RunStatistics

STORIES = [
    "tutorial.md",
    "examples.md",
    "choosing.md",
    "concepts.md",
    "configuration.md",
    "writing_a_controller.md",
    "writing_a_task.md",
    "writing_a_constraint.md",
    "new_robot.md",
    "robots.md",
    "limits.md",
    "jerk.md",
    "priorities.md",
    "gains.md",
    "trajectories.md",
    "steering.md",
    "contact.md",
    "plants.md",
    "environment.md",
    "two_machines.md",
    "services.md",
    "soak.md",
    "security.md",
    "logs.md",
    "latency.md",
    "report.md",
    "compare.md",
    "bridges.md",
]
KNOWN = {"", "file", "parsed only", "not run", "exits", "needs", "prints"}
PLACEHOLDERS = {"emulator …": "emulator hoap3", "controller …": "controller qp12", "PATH": "hoap3"}


@pytest.mark.slow
@pytest.mark.parametrize("name", STORIES)
def test_what_a_page_shows_works_word_for_word(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if name == "new_robot.md":
        vendor_folder(tmp_path)
    story = Story(tmp_path)
    for block in blocks(name):
        if block.word == "needs":
            story.write_files(block.rest)
        story.play(block)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "file"),
    [
        ("writing_a_controller.md", "test_posture.py"),
        ("writing_a_task.md", "test_reach.py"),
        ("writing_a_constraint.md", "test_height.py"),
        ("plants.md", "test_springs.py"),
        ("new_robot.md", "test_bench_arm.py"),
    ],
)
def test_what_a_page_has_written_passes_the_property_suite(page, file, tmp_path):
    Story(tmp_path).write_files(page)
    found = run(tmp_path, file)
    assert found.code == 0, found.said
    assert "passed" in found.said


@pytest.mark.parametrize("name", STORIES)
def test_what_is_left_out_gives_a_reason(name):
    for block in blocks(name):
        assert block.word in KNOWN, block.line
        if block.word in {"parsed only", "not run"}:
            assert len(block.rest.split()) >= 3, block.line


def readme(word: str) -> Block:
    (block,) = [block for block in blocks("README.md") if block.word == word]
    return block


def test_the_readme_shows_two_commands_and_the_second_is_the_one_that_ci_runs():
    assert [b.word for b in blocks("README.md") if b.language == "sh"] == [
        "run command",
        "test command",
    ]
    assert "<!-- test command -->" in (HOUSE / ".ci" / "run").read_text(encoding="utf-8")
    assert readme("test command").text.startswith("python3 -m venv ")


def test_the_readmes_run_ends_with_verdicts_and_a_log(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (_, _, command) = readme("run command").text.strip().split(" && ")
    assert command == ".venv/bin/hoap3 run"
    code = hoap3(["hoap3", "run", "--no-realtime", "--duration", "0.2"])
    printed = capsys.readouterr().out
    assert code in {0, 1}  # how fit this machine is now, is another matter
    assert "deadlines" in printed
    assert {path.name for path in tmp_path.glob("logs/*/*")} == {"robot.mcap", "controller.mcap"}


def test_the_readmes_python_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = [block for block in blocks("README.md") if block.language == "python"]
    story = Story(tmp_path)
    story.play(example)


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_the_text_parse(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for span in spans(name):
        if not span.startswith("hoap3 "):
            continue
        command = span
        for word, example in PLACEHOLDERS.items():
            command = command.replace(word, example)
        try:
            check(command)
        except Hoap3Error as error:
            pytest.fail(f"{name}: `{span}`: {error}")


@pytest.mark.parametrize("command", sorted(subcommands()))
def test_every_command_is_shown_somewhere(command):
    assert any(f"hoap3 {command}" in page(name) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name):
    folder = (HOUSE if name == "README.md" else HOUSE / "docs").resolve()
    for link in links(name):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = (folder / path).resolve() if path else folder / name
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.name), link


def test_every_page_is_reached_from_the_readme():
    reached = {link.removeprefix("docs/") for link in links("README.md")}
    assert {name for name in NAMES if name != "README.md"} <= reached


def test_concepts_define_every_figure_of_a_summary():
    text = prose("concepts.md")
    summary = RunStatistics(1_000_000).summary()
    names = [*summary, *summary["misses"], *summary["success_rate"], *summary["stages_us"]]
    names += [*machine_block(), "transport", "log", "lockstep.wall_s", "payload_sha256"]
    for name in names:
        assert re.search(rf"`(\w+\.)*{re.escape(name)}(\.\w+)*`", text), name


def test_concepts_define_every_rejection_and_every_certificate():
    text = prose("concepts.md")
    scalars = list(Setpoint.schema.scalars)
    certificate = scalars[scalars.index("v") :]
    for name in (*REJECTION_KINDS, *certificate):
        assert f"`{name}`" in text, name
    statuses = {n: v for n, v in Setpoint.schema.constants.items() if n.startswith("STATUS_")}
    rows = [r for r in text.splitlines() if re.match(r"\| \d \| [a-z ]+ \|", r)]
    listed = {row.split("|")[2].strip(): int(row.split("|")[1]) for row in rows}
    ours = {name[7:].lower().replace("_", " "): value for name, value in statuses.items()}
    assert listed == ours


def test_the_keys_of_a_robot_file_are_those_that_are_read():
    written = [
        key
        for row in table("new_robot.md", "Keys of robot.yaml")
        for key in re.findall(r"`([\w.]+)`", row["key"])
    ]
    read = [*RobotFile.model_fields]
    read += [f"joints.{name}" for name in JointEntry.model_fields]
    read += [f"soles.{name}" for name in SoleEntry.model_fields]
    read += [f"default_task.{name}" for name in DefaultTaskEntry.model_fields]
    assert sorted(written) == sorted(read)


def test_logs_name_every_topic_and_every_input():
    text = prose("logs.md")
    for topic in TOPICS:
        assert f"| `/robots/<name>/{topic.leaf}` | `{topic.schema_name}` |" in text
    logged = {Kind.STATE, Kind.SETPOINT, Kind.EVENT, Kind.TARGET}
    for kind in set(Kind) - logged:
        assert f"`{kind.name.lower()}`" in text
