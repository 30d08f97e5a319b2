"""A CPU kept from falling asleep: the setting is made, and left as it was found."""

from __future__ import annotations

import pytest

from tools.awake import kept_awake, may_keep_awake


@pytest.fixture
def setting(tmp_path):
    path = tmp_path / "cpu3" / "power" / "pm_qos_resume_latency_us"
    path.parent.mkdir(parents=True)
    path.write_text("40\n")
    return path


def test_it_is_awake_for_so_long_and_what_was_set_before_comes_back(setting, tmp_path):
    with kept_awake(3, tmp_path) as refusal:
        assert refusal == ""
        assert setting.read_text() == "n/a"
    assert setting.read_text() == "40"


def test_it_comes_back_after_an_error_too(setting, tmp_path):
    with pytest.raises(RuntimeError), kept_awake(3, tmp_path):
        raise RuntimeError
    assert setting.read_text() == "40"


def test_of_two_that_overlap_the_last_leaves_what_the_first_found(setting, tmp_path):
    first, second = kept_awake(3, tmp_path), kept_awake(3, tmp_path)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    second.__exit__(None, None, None)
    assert setting.read_text() == "40"


def test_a_refusal_says_what_it_takes(tmp_path):
    with kept_awake(7, tmp_path) as refusal:
        assert "No such file" in refusal
        assert "takes root" in refusal


def test_it_can_be_asked_for_where_every_allowed_cpu_lets_us(monkeypatch, tmp_path):
    for cpu in (1, 3):
        path = tmp_path / f"cpu{cpu}" / "power" / "pm_qos_resume_latency_us"
        path.parent.mkdir(parents=True)
        path.write_text("0\n")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {1, 3})
    assert may_keep_awake(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {1, 2, 3})
    assert not may_keep_awake(tmp_path)
