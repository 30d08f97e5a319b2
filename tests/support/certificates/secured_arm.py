"""UR5 with certificates, which follows a controller with a live target."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import hoap3
from hoap3.tools.services.connection import Connection
from support.certificates.laboratory import laboratory
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    endpoint,
    followed,
)
from support.pages.steered_arm import ROBOT, hand


@contextmanager
def secured_arm(folder: Path) -> Iterator[str]:
    """Where it listens, once it follows; its certificates, and everybody's, are in the folder."""
    laboratory(folder, ROBOT)
    at = endpoint().replace("tcp/", "tls/")
    with followed(
        at,
        (ROBOT, "steered_ur5"),
        robot=(*QUIET, *PATIENT, "--secure", folder / ROBOT),
        law=(*QUIET, "--secure", folder / "qp"),
    ):
        with hoap3.connect(ROBOT, at, secure=folder / "otto") as seen:
            for _ in range(3000):
                if seen.status()["mode"] == "active":
                    break
            else:
                raise AssertionError(seen.status())
        yield at


NEAR_M = 1e-3


def goes(robot: Connection, aim: list[float]) -> None:
    """Wait until the hand is somewhere."""
    until = time.monotonic() + PATIENCE_S
    for state in robot.states(PATIENCE_S):
        if np.linalg.norm(hand(state) - aim) < NEAR_M:
            return
        assert time.monotonic() < until, f"it is at {hand(state)}, not {aim}; mode {state.mode}"


def assert_stays(robot: Connection, place: np.ndarray) -> None:
    """For 300 ticks the hand is where it was, or is on its last way to there; it follows."""
    until = robot.state().tick + 300
    for state in robot.states():
        assert np.linalg.norm(hand(state) - place) < 2 * NEAR_M
        if state.tick > until:
            break
    assert robot.status()["mode"] == "active"


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    """Folder of the certificates of `secured`."""
    return tmp_path_factory.mktemp("lab") / "certs"


@pytest.fixture(scope="module")
def secured(certs) -> Iterator[str]:
    """Where the arm listens, for the tests of a module."""
    with secured_arm(certs) as at:
        yield at
