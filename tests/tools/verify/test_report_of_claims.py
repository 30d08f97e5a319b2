"""A report says what of its logs is true."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.command_bench import inside
from support.html_page import Page
from tampering import changed_field, ran, rewrite

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.page import page


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of qp12 in lockstep."""
    return ran(tmp_path_factory.mktemp("story") / "run")


@pytest.mark.slow
def test_a_true_log_is_called_so_with_its_counts(story):
    content = read_content(story)
    assert content.as_json()["verified"]["verdict"] == "true"
    assert "true" in Page(page(content)).by_id("checked").text()


@pytest.mark.slow
def test_a_false_claim_stands_above_everything_else(story, tmp_path):
    change = changed_field(Kind.SETPOINT, 20, "v", lambda v: v * (1 + 1e-6))
    content = read_content(rewrite(story, "controller", tmp_path / "o", change))
    assert content.as_json()["verified"]["false"] >= 1
    assert content.as_json()["gaps"][0] == content.checked.gaps[0]
    assert "tick 20" in content.checked.gaps[0]
    assert inside("report", tmp_path / "o").code == 1


@pytest.mark.slow
def test_a_log_that_cannot_be_recomputed_says_why(story, tmp_path):
    def emptied(records):
        return [r._replace(payload=b"{}") if r.kind == Kind.AUTHORITY else r for r in records]

    content = read_content(rewrite(story, "controller", tmp_path / "o", emptied))
    assert content.checked.found is None
    assert content.checked.why in Page(page(content)).by_id("checked").text()
