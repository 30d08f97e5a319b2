"""Mutated robots: URDF, a robot's YAML file, a vendor's URDF, a description from the network."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from fuzzing import (
    Findings,
    amount,
    corpus,
    mutate_bytes,
    mutate_text,
    mutate_tree,
)

from hoap3.protocol.answers import parse_description
from hoap3.protocol.errors import UrdfWarning
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.urdf import read_urdf
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

URDFS, ROBOTS = corpus("urdf"), corpus("robots")
DESCRIPTION = corpus("descriptions")[0]
ARM = (URDFS[0], ROBOTS[0])

Decoder = Callable[[bytes], object]


def _urdf(folder: Path) -> Decoder:
    return lambda data: read_urdf(data.decode(errors="replace"))


def _robot(folder: Path) -> Decoder:
    """A robot whose URDF is mutated, and its model, as controllers build it."""
    (folder / "robot.yaml").write_bytes(ARM[1])

    def decode(data: bytes) -> None:
        (folder / "arm.urdf").write_bytes(data)
        build_model(load(folder / "robot.yaml"))

    return decode


def _vendors(folder: Path) -> Decoder:
    def decode(data: bytes) -> None:
        path = folder / "vendor.urdf"
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UrdfWarning)
            import_robot(path)

    return decode


def mutated(draw: random.Random, files: list[bytes]) -> bytes:
    """Other bytes, or other words and lines."""
    data = draw.choice(files)
    if draw.random() < 0.4:
        return mutate_bytes(draw, data, files)
    return mutate_text(draw, data.decode()).encode(errors="replace")


@pytest.mark.parametrize("decoder", [_urdf, _robot, _vendors])
@amount(20)
def test_a_urdf_is_taken_or_refused(
    decoder: Callable[[Path], Decoder],
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, decode = random.Random(f"{decoder.__name__} {count}"), decoder(tmp_path)
    files = URDFS if decoder is not _robot else [ARM[0]]
    for data in files:
        decode(data)
    for _ in range(count):
        findings.judge(decode, mutated(draw, files))
    findings.check(count)


@amount(20)
def test_a_robots_yaml_file_is_taken_or_refused(
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, path = random.Random(count), tmp_path / "robot.yaml"
    (tmp_path / "arm.urdf").write_bytes(ARM[0])

    def decode(data: bytes) -> None:
        path.write_bytes(data)
        load(path)

    for data in ROBOTS:
        decode(data)
    for _ in range(count):
        data = draw.choice(ROBOTS)
        if draw.random() < 0.6:
            tree = mutate_tree(draw, yaml.safe_load(data))
            data = yaml.safe_dump(tree, sort_keys=False).encode(errors="replace")
        else:
            data = mutated(draw, ROBOTS)
        findings.judge(decode, data)
    findings.check(count)


@amount(20)
def test_a_description_from_the_network_is_taken_or_refused(
    count: int,
    findings: Findings,
) -> None:
    draw, tree = random.Random(count), yaml.safe_load(DESCRIPTION)

    def decode(data: bytes) -> None:
        build_model(parse_description(data, "arm"))

    decode(DESCRIPTION)
    for _ in range(count):
        if draw.random() < 0.7:
            data = as_json(mutate_tree(draw, tree))
        else:
            data = mutate_bytes(draw, DESCRIPTION)
        findings.judge(decode, data)
    findings.check(count)


def as_json(tree: object) -> bytes:
    """As a stranger may write it, with numbers that JSON has none of."""
    import json

    return json.dumps(tree).encode()
