"""`python -m benchmarks.log_writers`: our MCAP writer beside those of mcap and foxglove-sdk."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import foxglove
import numpy as np
import typer
from foxglove.mcap import MCAPWriteOptions
from mcap.records import Channel, Schema
from mcap.writer import Writer

from benchmarks.command import main
from hoap3.tools.analysis.output import progress
from hoap3.tools.bench.case_runner import (
    Case,
    Report,
    reference,
    run_benchmark,
    silent,
    time_cases,
)
from hoap3.tools.bench.cycle import motion
from hoap3.tools.bench.show import numbers, show_table, words
from hoap3.tools.cli.options import AsJson
from hoap3.tools.logs.log_format import TOPICS
from hoap3.tools.logs.mcap_write import McapFile

MESSAGES = 500  # half a second at 1 kHz, after which a chunk is cut
CHUNK_BYTES = 1 << 19  # of foxglove-sdk: some half a second, too

Write = Callable[[bytes], object]
"""Appends one message to a file."""

Act = Callable[[], object]


def ours(path: Path, schema: str) -> tuple[Write, Act, Act]:
    """`McapFile`, what cuts a chunk, and what ends the file."""
    file = McapFile(path, "ros2", "benchmark")
    file.add(Schema(1, schema.encode(), "ros2msg", "hoap3_msgs/msg/State"))
    file.add(Channel(1, "state", "cdr", {}, 1))
    return lambda data: file.message(1, 0, 1, 1, data), file.cut, file.finish


def mcap(path: Path, schema: str) -> tuple[Write, Act, Act]:
    """`mcap.writer.Writer`, what cuts a chunk, and what ends the file."""
    writer = Writer(str(path), enable_data_crcs=True)
    writer.start("ros2", "benchmark")
    number = writer.register_schema("hoap3_msgs/msg/State", "ros2msg", schema.encode())
    channel = writer.register_channel("state", "cdr", number)
    return lambda data: writer.add_message(channel, 1, data, 1), writer.flush, writer.finish


def foxglove_sdk(path: Path, schema: str) -> tuple[Write, Act, Act]:
    """`foxglove.MCAPWriter`, which cuts chunks by their size alone."""
    context = foxglove.Context()
    described = foxglove.Schema(
        name="hoap3_msgs/msg/State", encoding="ros2msg", data=schema.encode()
    )
    writer = foxglove.open_mcap(
        path,
        context=context,
        writer_options=MCAPWriteOptions(
            compression_level=1, compression_threads=0, chunk_size=CHUNK_BYTES
        ),
    )
    channel = foxglove.Channel("state", message_encoding="cdr", schema=described, context=context)
    kept = channel, context  # a context closes its channels once it is garbage-collected
    return lambda data: kept[0].log(data, log_time=1), lambda: None, writer.close


def bench_log_writers(samples: int = 400, report: Report = silent) -> list[dict[str, Any]]:
    """Rows {writer, blocks, mean_us, p50_us, p99_us, times_hoap3, times_reference}, per message.

    A call appends the States of half a second of HOAP-3's circles, 500 messages, and cuts the
    chunk, as the observer does. Files are written to a temporary folder, compressed with zstd.
    """
    _, states = motion("hoap3", "qp12", 1.0, every=True)
    block = [state.dump() for state in states[:MESSAGES]]
    schema = next(each.schema_text for each in TOPICS if each.schema_name.endswith("/State"))
    with tempfile.TemporaryDirectory() as folder:
        cases, ends = [], []
        for make in (ours, mcap, foxglove_sdk):
            write, cut, finish = make(Path(folder) / f"{make.__name__}.mcap", schema)

            def call(write: Write = write, cut: Act = cut) -> None:
                for data in block:
                    write(data)
                cut()

            cases.append(Case(make.__name__, call, [()]))
            ends.append(finish)
        times = time_cases([*cases, reference()], samples, batches=False, report=report)
        for finish in ends:
            finish()
    return [
        {
            "writer": name,
            "blocks": taken.single.size,
            "mean_us": float(taken.single.mean()) / MESSAGES,
            **{
                f"p{part}_us": float(np.percentile(taken.single, part)) / MESSAGES
                for part in (50, 99)
            },
            "times_hoap3": float(taken.single.mean() / times["ours"].single.mean()),
            "times_reference": float(taken.single.mean() / times["reference"].single.mean()),
        }
        for name, taken in times.items()
        if name != "reference"
    ]


def show(measured: dict[str, Any]) -> None:
    """Print one row for each writer."""
    show_table(
        f"us per message, in blocks of {MESSAGES}",
        measured["rows"],
        lambda row: {
            **words(row, "writer", "blocks"),
            **numbers(row, ".2f", "mean_us", "p50_us", "p99_us", "times_hoap3", "times_reference"),
        },
        measured["machine"],
    )


def command(
    samples: Annotated[int, typer.Option(min=10, help="Blocks of 500 messages of each.")] = 400,
    as_json: AsJson = False,
) -> None:
    """Time MCAP writers on blocks of 500 States, each ended by a cut of the chunk."""
    run_benchmark(
        progress("log writers"),
        lambda meter: {"rows": bench_log_writers(samples, meter.part)},
        show,
        as_json=as_json,
    )


if __name__ == "__main__":
    main(command)
