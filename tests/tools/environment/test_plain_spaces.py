"""Spaces and base of environments where gymnasium is not installed."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from hoap3.tools.environment.spaces import PlainBox, PlainDict, PlainEnv

LOW, HIGH = np.array([-1.0, 2.0, -np.inf]), np.array([1.0, 2.5, np.inf])


def test_a_box_has_what_it_draws_and_nothing_outside():
    box = PlainBox(LOW, HIGH)
    drawn = np.array([box.sample() for _ in range(1000)])
    assert all(each in box for each in drawn)
    np.testing.assert_allclose(drawn[:, :2].min(axis=0), LOW[:2], atol=0.02)
    np.testing.assert_allclose(drawn[:, :2].max(axis=0), HIGH[:2], atol=0.02)
    assert 0.9 < drawn[:, 2].std() < 1.1
    for wrong in (np.array([0.0, 2.1]), np.array([1.1, 2.1, 0.0]), np.array([np.nan, 2.1, 0.0])):
        assert wrong not in box
    assert np.array(["a", "b", "c"]) not in box


def test_a_seed_makes_it_draw_the_same():
    box = PlainBox(LOW, HIGH)
    box.seed(3)
    first = box.sample()
    assert not np.array_equal(box.sample(), first)
    box.seed(3)
    np.testing.assert_array_equal(box.sample(), first)


def test_a_dict_has_one_array_for_each_name():
    space = PlainDict({"a": PlainBox(LOW[:2], HIGH[:2]), "b": PlainBox(LOW[2:], HIGH[2:])})
    inside = {"a": np.array([0.0, 2.2]), "b": np.array([7.0])}
    assert inside in space
    assert "a" in space
    assert {**inside, "c": inside["b"]} not in space
    assert {"a": inside["a"]} not in space
    assert {**inside, "a": np.zeros(2)} not in space
    assert (list(space), len(space), space["b"].shape) == (["a", "b"], 2, (1,))


def test_a_seed_makes_the_base_draw_the_same():
    with PlainEnv() as env:
        env.reset(seed=3)
        first = env.np_random.random()
        env.reset()
        assert env.np_random.random() != first
        env.reset(seed=3)
        assert env.np_random.random() == first
        assert env.unwrapped is env
        assert isinstance(PlainEnv().np_random, np.random.Generator)


@pytest.mark.slow
def test_without_gymnasium_the_states_are_the_same():
    code = """if True:
        import sys
        {block}
        import hashlib, hoap3
        env = hoap3.Environment("ur5", periods_per_step=5)
        env.reset(seed=3)
        env.reset()
        env.step(env.description.initial_position + 0.1)
        print(hashlib.sha256(env.state.dump()).hexdigest())
    """
    blocked, free = (
        subprocess.run(
            [sys.executable, "-c", code.format(block=block)],
            capture_output=True, text=True, check=True,
        ).stdout
        for block in ("sys.modules['gymnasium'] = None", "")
    )  # fmt: skip
    assert blocked == free
