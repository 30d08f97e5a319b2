"""No text, however long and of whatever characters, keeps a parser busy: time grows with length."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.arm3 import URDF, YAML, write

from hoap3.protocol.config.regular_file import open_regular
from hoap3.protocol.config.settings import LogSettings, parse, parse_yaml
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.robot.urdf import read_urdf
from hoap3.remote_controller.references.trajectories.motion_file import read_text
from hoap3.robot_emulator.robots import load

FEEDER = Path(__file__).with_name("hostile_text.py")


def feed(size: int, cpu_s: int) -> list[tuple[float, str, str]]:
    """CPU time [s], what was read, and what became of it; the slowest first."""
    fed = subprocess.run(
        [sys.executable, FEEDER, str(size), str(cpu_s)], capture_output=True, text=True, check=False
    )
    lines = fed.stdout.splitlines()
    assert fed.returncode == 0, f"{lines[-1:]}\n{fed.stderr}"
    rows = [line.split("\t") for line in lines]
    return sorted(((float(s), f"{who}: {text}", what) for who, text, s, what in rows), reverse=True)


@pytest.mark.slow
def test_every_parser_is_done_with_every_text() -> None:
    """About 3 s of CPU; a parser that is quadratic in the length would need minutes."""
    found = feed(1 << 15, 40)
    assert len(found) > 3000
    long = [row for row in found if "Error" in row[2] and int(row[2].split()[2]) > 1500]
    assert not long


@pytest.mark.long
def test_no_mebibyte_takes_a_second() -> None:
    found = feed(1 << 20, 900)
    print(*found[:20], sep="\n")
    assert found[0][0] < 1.0


@pytest.mark.parametrize("number", ["1" * 20_000 + "x", "1" * 65, "0." + "0" * 63])
def test_a_number_of_more_than_64_characters_is_refused(number: str) -> None:
    with pytest.raises(DescriptionError, match="64"):
        read_urdf(URDF.replace('mass value="2.0"', f'mass value="{number}"'))


@pytest.mark.parametrize("number", ["2.0", "2.", ".5", "+2e0", "2.0E-1", "0" * 60 + "2"])
def test_numbers_as_they_are_written_are_taken(number: str) -> None:
    read_urdf(URDF.replace('mass value="2.0"', f'mass value="{number}"'))


def test_a_long_name_is_refused_in_few_words() -> None:
    with pytest.raises(DescriptionError, match="128") as caught:
        read_urdf(URDF.replace('"tool"', f'"{"t" * 100_000}"'))
    assert len(str(caught.value)) < 300


def test_a_number_too_large_to_print_is_one_error() -> None:
    with pytest.raises(ConfigError, match=r"a\.yaml.*5002.*64"):
        parse_yaml("cap_mb: 0x" + "f" * 5000, "a.yaml")
    with pytest.raises(ConfigError, match=r"a\.yaml.*cap_mb"):
        parse(LogSettings, {"cap_mb": -(16**5000)}, "a.yaml")


def test_what_is_no_regular_file_is_not_opened(tmp_path: Path) -> None:
    """Opening a FIFO would wait for a writer for ever."""
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for name in ("fifo", "/dev/zero", "/dev/tty", "missing\\0", "../x" * 2000):
        robot = write(tmp_path, YAML.replace("urdf: arm3.urdf", f'urdf: "{name}"'))
        with pytest.raises(ConfigError, match="urdf: "):
            load(robot)
    with pytest.raises(ConfigError, match=rf"{fifo}.*FIFO"):
        read_text(fifo)
    with pytest.raises(ConfigError, match=r"/dev/zero.*device"):
        read_text(Path("/dev/zero"))
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
