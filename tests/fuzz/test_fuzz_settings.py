"""Mutated YAML and `--set`: settings, or an error of ours that names what is wrong."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import yaml
from fuzzing import (
    WORDS,
    Findings,
    amount,
    corpus,
    mutate_bytes,
    mutate_text,
    mutate_tree,
)

from hoap3.protocol.config.user_code import user_code
from hoap3.tools.services.configs import (
    load_controller_config,
    load_emulator_config,
    split_overrides,
)
from hoap3.tools.services.settings import checked

CONTROLLERS, EMULATORS = corpus("controllers"), corpus("emulators")
SETS = b"".join(corpus("set")).decode().splitlines()
BUILT = 25  # one of so many is built for its robot, as `hoap3 config check` does


def mutated(draw: random.Random, data: bytes, others: list[bytes]) -> bytes:
    """Other bytes, other words, or other values at the same places."""
    match draw.randrange(3):
        case 0:
            return mutate_bytes(draw, data, others)
        case 1:
            return mutate_text(draw, data.decode()).encode(errors="replace")
        case _:
            tree = mutate_tree(draw, yaml.safe_load(data))
            return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode(
                errors="replace"
            )


@pytest.mark.parametrize("side", ["controller", "emulator"])
@amount(15, 5000)
def test_a_config_is_taken_or_refused(
    side: str,
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, path = random.Random(f"{side} {count}"), tmp_path / "mutated.yaml"
    files, read = {
        "controller": (CONTROLLERS, load_controller_config),
        "emulator": (EMULATORS, load_emulator_config),
    }[side]

    def decode(data: bytes) -> None:
        path.write_bytes(data)
        with user_code(allowed=False):
            read(str(path), [], realtime=draw.random() < 0.5)

    for data in files:
        decode(data)  # valid, and all that is imported for it is
    for _ in range(count):
        findings.judge(decode, mutated(draw, draw.choice(files), files))
    findings.check(count)


@pytest.mark.parametrize(
    "count",
    [
        pytest.param(12, marks=pytest.mark.slow),
        pytest.param(10_000 // BUILT, marks=pytest.mark.long),
    ],
)
def test_a_config_that_is_taken_is_built_or_refused(
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, path = random.Random(count), tmp_path / "mutated.yaml"
    files = [*CONTROLLERS, *EMULATORS]

    def decode(data: bytes) -> None:
        path.write_bytes(data)
        with user_code(allowed=False):
            checked(str(path), [])

    for data in files:
        decode(data)  # kernels are compiled here
    for _ in range(count):
        data = draw.choice(files)
        tree = mutate_tree(draw, yaml.safe_load(data))
        findings.judge(decode, yaml.safe_dump(tree, sort_keys=False).encode(errors="replace"))
    findings.check(count)


@amount(40)
def test_an_override_is_taken_or_refused(
    count: int,
    findings: Findings,
) -> None:
    draw = random.Random(count)

    def decode(text: str) -> None:
        overrides = text.split("\n")
        realtime = draw.random() < 0.5
        with user_code(allowed=False):
            for side in split_overrides([f"emulator.{each}" for each in overrides]):
                load_emulator_config("lwr_with_table", side, realtime=realtime)
            load_controller_config(
                draw.choice(("stable_qp", "ghc_velocity")), overrides, realtime=realtime
            )

    def one() -> str:
        key, _, value = draw.choice(SETS).partition("=")
        match draw.randrange(6):
            case 0:
                return f"{key}={draw.choice(WORDS)}"
            case 1:
                return mutate_text(draw, f"{key}={value}")
            case 2:
                return f"{key}.{draw.choice(('0', '-1', 'a', '', '99'))}={value}"
            case 3:
                return f"{key.rpartition('.')[0]}={draw.choice(SETS).partition('=')[2]}"
            case 4:
                return mutate_bytes(draw, f"{key}={value}".encode()).decode(errors="replace")
            case _:
                return f"{key}={value}"

    for _ in range(count):
        findings.judge(decode, "\n".join(one() for _ in range(draw.choice((1, 1, 2, 4)))))
    findings.check(count)
