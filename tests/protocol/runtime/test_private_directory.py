"""Directories of one user alone: where others had a hand in, they are not used."""

from __future__ import annotations

import os
import stat

import pytest

from hoap3.protocol.runtime import private_directory
from hoap3.protocol.runtime.private_directory import is_private, runtime_directory


def test_a_missing_directory_is_made_for_its_owner_alone(tmp_path):
    place = tmp_path / "a" / "b"
    assert is_private(place)
    assert stat.S_IMODE(place.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o707])
def test_one_that_others_may_enter_is_not_private(tmp_path, mode):
    place = tmp_path / "open"
    place.mkdir()
    place.chmod(mode)
    assert not is_private(place)


def test_a_link_or_a_file_is_not_private(tmp_path):
    (tmp_path / "real").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    (tmp_path / "file").write_text("")
    assert is_private(tmp_path / "real")
    assert not is_private(tmp_path / "link")
    assert not is_private(tmp_path / "file")


def test_the_named_directory_is_used_or_none(tmp_path, monkeypatch):
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path / "own"))
    assert runtime_directory() == tmp_path / "own"
    (tmp_path / "own").chmod(0o777)
    assert runtime_directory() is None


def test_a_session_of_the_same_user_comes_first(tmp_path, monkeypatch):
    monkeypatch.delenv("HOAP3_RUNTIME_DIR")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert runtime_directory() == tmp_path / "hoap3"
    monkeypatch.setattr(private_directory, "_owner", lambda _: os.geteuid() + 1)
    assert runtime_directory() != tmp_path / "hoap3"
