"""`benchmarks.log_writers` writes the same messages with every writer."""

import json
import subprocess
import sys

import pytest
from mcap.reader import make_reader

from benchmarks import log_writers


@pytest.mark.parametrize("make", [log_writers.ours, log_writers.mcap, log_writers.foxglove_sdk])
def test_writers_write_what_they_are_given(make, tmp_path):
    path = tmp_path / "a.mcap"
    write, cut, finish = make(path, "uint64 tick")
    for part in (b"\0\1\0\0" + bytes(8), b"\0\1\0\0" + bytes(range(8))):
        write(part)
        cut()
    finish()
    with path.open("rb") as stream:
        found = [message.data for _, _, message in make_reader(stream).iter_messages()]
    assert found == [b"\0\1\0\0" + bytes(8), b"\0\1\0\0" + bytes(range(8))]


@pytest.mark.slow
def test_the_command_compares_three_writers():
    words = [sys.executable, "-m", "benchmarks.log_writers", "--samples", "10", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    rows = json.loads(done.stdout)["rows"]
    assert [row["writer"] for row in rows] == ["ours", "mcap", "foxglove_sdk"]
    assert all(row["p50_us"] > 0 for row in rows)
