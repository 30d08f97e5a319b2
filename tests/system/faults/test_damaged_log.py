"""A log with a damaged chunk: what each command makes of it, and that none passes it as whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from support.command_bench import inside

from hoap3.tools.logs.log import Log


def test_commands_skip_a_damaged_chunk_and_say_so(tmp_path: Path) -> None:
    folder = tmp_path / "log"
    run = inside("run", "--lockstep", "--duration", 2, "--out", folder, "--json")
    assert run.json()["ticks"] > 1900
    path = folder / "controller.mcap"
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[2]
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(content)
    log = Log.open(path)
    ticks = log.states()["tick"]
    last = int(ticks[np.argmax(np.diff(ticks))])

    out = tmp_path / "out.csv"
    exported = inside("export", path, "--to", out)
    assert exported.code == 1
    rows = exported.stdout.removeprefix(f"{out}: ").partition(" rows; ")
    assert rows[2].startswith(f"{len(ticks)} states, {len(log.setpoints())} setpoints; without ")
    assert int(rows[0]) >= len(ticks)  # a Setpoint at an edge of the gap may have no State
    assert "no record is left between" in exported.stderr

    again = inside("replay", path, "--json")
    assert again.json()["gap"] == last
    assert again.json()["identical"]
    assert "no record is left between" in again.json()["missing"]

    mended = inside("record", "--repair", path, "--json").json()
    assert mended["dropped_bytes"] == 0
    assert "no record is left between" in mended["damaged"]
    assert np.array_equal(Log.open(mended["out"]).states()["tick"], ticks)
    assert inside("replay", mended["out"], "--json").json()["gap"] == last
    assert inside("export", mended["out"], "--to", out).code == 1
