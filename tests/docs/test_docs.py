"""README.md and the pages of docs/: what they show runs, and their links lead somewhere."""

from __future__ import annotations

import pytest
from pages import NAMES, Block, anchors, blocks, links, page, path_of, spans
from story import Story, check, hoap3, subcommands
from support.property_suites import run
from support.urdfs.vendor_arm import vendor_folder

from hoap3.protocol.errors import Hoap3Error

STORIES = [name for name in NAMES if name not in {"README.md", "wire.md", "troubleshooting.md"}]
LONG = {"controllers.md", "extending.md", "measuring.md"}
"""Pages that take long, and whose commands and figures other tests look at, too."""
TOLD = [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in STORIES]
KNOWN = {"", "file", "fragment", "parsed only", "not run", "exits", "prints"}
PLACEHOLDERS = {"emulator …": "emulator hoap3", "controller …": "controller qp12", "PATH": "hoap3"}


@pytest.mark.slow
@pytest.mark.parametrize("name", TOLD)
def test_what_a_page_shows_works_word_for_word(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if name == "robots.md":
        vendor_folder(tmp_path)
    story = Story(tmp_path)
    for block in blocks(name):
        story.play(block)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "file"),
    [  # tests/tools/new runs each suite, too
        ("extending.md", "test_posture.py"),
        pytest.param("plants.md", "test_springs.py", marks=pytest.mark.long),
        pytest.param("robots.md", "test_bench_arm.py", marks=pytest.mark.long),
    ],
)
def test_what_a_page_has_written_passes_the_property_suite(page, file, tmp_path):
    Story(tmp_path).write_files(page)
    found = run(tmp_path, file)
    assert found.code == 0, found.said
    assert "passed" in found.said


@pytest.mark.parametrize("name", STORIES)
def test_comments_before_blocks_are_known(name):
    for block in blocks(name):
        assert block.word in KNOWN, block.line


def readme(word: str) -> Block:
    (block,) = [block for block in blocks("README.md") if block.word == word]
    return block


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
    folder = path_of(name).parent.resolve()
    for link in links(name):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = (folder / path).resolve() if path else folder / name
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.name), link
