"""What gymnasium's checker asks of an environment: its own where it is installed, else the like."""

from __future__ import annotations

import importlib.util
from itertools import combinations

import numpy as np

from hoap3 import Environment


def check_env(env: Environment) -> None:
    """Fail where the environment is none by gymnasium's rules."""
    if importlib.util.find_spec("gymnasium"):
        from gymnasium.utils.env_checker import check_env as theirs

        theirs(env, skip_render_check=True)
    check_plainly(env)


def check_plainly(env: Environment) -> None:
    """The same rules, of those that concern an environment of boxes without drawings."""
    first, info = env.reset(seed=123)
    assert isinstance(info, dict)
    draws = env.np_random.bit_generator.state
    second, _ = env.reset()
    again, _ = env.reset(seed=123)
    assert env.np_random.bit_generator.state == draws
    after, _ = env.reset()
    assert same(first, again)
    assert same(second, after)
    env.reset(seed=456)
    assert env.np_random.bit_generator.state != draws
    env.action_space.seed(123)
    action = env.action_space.sample()
    assert env.action_space.contains(action)
    given = []
    for _ in range(2):
        env.reset(seed=123)
        given.append(env.step(action))
    (one, *rest), (two, *others) = given
    assert same(one, two)
    assert rest == others
    assert [type(each) for each in rest] == [float, bool, bool, dict]
    assert rest[1:3] == [False, False]
    seen = [first, second, again, after, one, two, env.step(action)[0]]
    for observation in seen:
        assert env.observation_space.contains(observation)
    for left, right in combinations(seen, 2):
        assert not any(np.shares_memory(left[name], right[name]) for name in left)
    env.reset(options={})
    env.close()


def same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> bool:
    return left.keys() == right.keys() and all(
        left[name].tobytes() == right[name].tobytes() for name in left
    )
