"""The command line of the proofs: its result on standard output, its exit code, its pages."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
import typer
from support import HOUSE
from typer.testing import CliRunner

from . import __main__ as command
from .claims import Proof

SMALL = ("authority", "--requests", "1", "--crashes", "0", "--no-faults")
PAGES = ["CONTRIBUTING.md", "docs/internals/proofs.md"]


def prove(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tests.proofs", *words],
        cwd=HOUSE, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_json_is_on_standard_output_and_progress_is_not():
    done = prove(*SMALL, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["holds"] is True
    assert [claim["holds"] for claim in result["claims"]] == [True]
    assert result["faults"] == {"found": {}, "missed": []}


def test_a_proof_that_fails_ends_with_exit_code_1(monkeypatch):
    failed = Proof("authority")
    failed.note("a claim", False, "a story")
    monkeypatch.setattr(command, "prove_authority", lambda *_, **__: failed)
    assert CliRunner().invoke(command.app, SMALL).exit_code == 1


def test_an_unknown_subject_is_wrong_usage():
    assert prove("everything").returncode == 2


@pytest.mark.parametrize("page", PAGES)
def test_commands_of_the_pages_parse(page):
    text = (HOUSE / page).read_text(encoding="utf-8")
    shown = re.findall(r"python -m tests\.proofs ([^`#\n]+)", text)
    assert shown
    for words in shown:
        context = typer.main.get_command(command.app).make_context("proofs", words.split())
        assert context.params["subject"] in set(command.Subject)
