"""A file is replaced whole, or left as it was."""

from __future__ import annotations

import os

import pytest

from hoap3.tools.logs.files import whole_file


def test_it_replaces_what_was_there_at_the_end(tmp_path):
    target = tmp_path / "report.html"
    target.write_text("before")
    with whole_file(target) as draft:
        draft.write_text("after")
        assert target.read_text() == "before"
    assert target.read_text() == "after"
    assert os.listdir(tmp_path) == ["report.html"]


def test_what_fails_half_way_leaves_what_was_there_and_nothing_else(tmp_path):
    target = tmp_path / "report.html"
    target.write_text("before")
    with pytest.raises(OSError), whole_file(target) as draft:  # noqa: PT011, PT012
        draft.write_text("half")
        raise OSError
    assert target.read_text() == "before"
    assert os.listdir(tmp_path) == ["report.html"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.csv").write_text("before")
    (tmp_path / "link.csv").symlink_to("real.csv")
    with whole_file(tmp_path / "link.csv") as draft:
        draft.write_text("after")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text() == "after"


def test_what_is_no_ordinary_file_is_written_to(tmp_path):
    with whole_file(tmp_path.__class__(os.devnull)) as draft:
        assert str(draft) == os.devnull
