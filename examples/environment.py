"""A policy learns on the robot of a lockstep run: gains of a PD law, by random search.

    python examples/environment.py

The arm takes torques, 100 times a second, from wherever an episode puts it, and shall come to its
start posture soon, and stay. `hoap3.Environment` is a `gymnasium.Env`, so any
agent can take the place of `search`.
"""

from __future__ import annotations

import argparse

import numpy as np

import hoap3
from hoap3.tools.environment.environment import Transition

ROBOT = {"robot": "ur5", "command": "torque", "plant": {"gravity": "compensated"}}
PERIODS_PER_STEP = 10  # an action is held for 10 ms
DURATION_S = 1.5
AWAY_RAD = 0.3  # how far the joints are put at most


def make_env() -> hoap3.Environment:
    """The arm, with a reward of its own."""
    goal = hoap3.load_robot("ur5").initial_position

    def reward(step: Transition) -> float:
        """Minus the squared error over time [rad² s]: nearer and sooner is better."""
        return -1e-3 * PERIODS_PER_STEP * float(np.sum((step.after["q"] - goal) ** 2))

    def truncated(step: Transition) -> bool:
        return bool(step.info["time_s"] > DURATION_S - 1e-9)

    return hoap3.Environment(ROBOT, reward, truncated=truncated, periods_per_step=PERIODS_PER_STEP)


def episode(env: hoap3.Environment, gains: np.ndarray, seed: int) -> float:
    """Sum of the rewards of one episode.

    Args:
        env: of `make_env`.
        gains: kp [1/rad] and kd [s/rad], (2,), as shares of each joint's effort.
        seed: of where the arm starts.
    """
    robot = env.description
    goal = robot.initial_position
    start = goal + np.random.default_rng(seed).uniform(-AWAY_RAD, AWAY_RAD, robot.n)
    seen, _ = env.reset(seed=seed, options={"q": start})
    total, over = 0.0, False
    while not over:
        share = gains[0] * (goal - seen["q"]) - gains[1] * seen["dq"]
        seen, reward, terminated, truncated, _ = env.step(robot.effort * np.clip(share, -1, 1))
        total, over = total + reward, terminated or truncated
    return total


def search(tries: int, episodes: int = 2, seed: int = 0) -> list[tuple[np.ndarray, float]]:
    """Every better pair of gains and its mean return, in the order in which they were found."""
    env, rng = make_env(), np.random.default_rng(seed)
    best = np.array([0.1, 0.01])
    found = [(best, np.mean([episode(env, best, each) for each in range(episodes)]))]
    for _ in range(tries):
        gains = best * np.exp(rng.normal(0.0, 0.7, 2))
        value = np.mean([episode(env, gains, each) for each in range(episodes)])
        if value > found[-1][1]:
            best = gains
            found.append((gains, value))
    return found


def main() -> None:
    """Search, and say what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for gains, value in search(given.tries, seed=given.seed):
        print(f"kp {gains[0]:6.3f} 1/rad, kd {gains[1]:6.3f} s/rad: return {value:8.4f}")


if __name__ == "__main__":
    main()
