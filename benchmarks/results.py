"""`python -m benchmarks.results`: run the commands of results.yaml and write their tables."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from benchmarks import qp_peers, sdp_backends
from benchmarks.command import main
from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.errors import Hoap3Error, UnknownNameError, UsageError
from hoap3.tools.analysis.numbers import number
from hoap3.tools.analysis.output import print_line, print_note
from hoap3.tools.bench.doctor.system import fifo
from hoap3.tools.machine.machine import machine_block, versions

Row = dict[str, Any]

CHECKOUT = Path(__file__).resolve().parents[1]
COMMANDS: Row = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
PROGRAMS = {"python": [sys.executable], "hoap3": [sys.executable, "-m", "hoap3.tools.cli.app"]}
RUN = "run.json"
BELOW = ("slopes", "left_out", "missing", "findings")  # keys of the JSON, shown below the tables
HEAD = """# Measured tables, {date}

Written by `python -m benchmarks.results`. Durations are in µs.
[Measuring](../../docs/guides/measuring.md) defines the columns; `reference` is a fixed workload in
Python and numpy. Exit code 1: the command measured, and reports findings or a failed verdict."""
TRIAL = "**Trial run with few samples (`--quick`): do not cite these figures.**"


def command(
    only: Annotated[
        list[str] | None, typer.Option(help=f"Run these of {', '.join(COMMANDS)}; default: all.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Quick forms: a trial run.")] = False,
    keep: Annotated[Path | None, typer.Option(help="Save each command's JSON in a folder.")] = None,
    source: Annotated[
        Path | None, typer.Option("--from", help="Run nothing: render a folder of --keep.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The page; default: benchmarks/results/YYYY-MM-DD.md.")
    ] = None,
) -> None:
    """Run benchmarks one by one and write their tables as one page; exit code 1 if any failed."""
    for name in only or ():
        if name not in COMMANDS:
            raise UnknownNameError("command", name, COMMANDS)
    if source and (quick or keep):
        raise UsageError("--from renders a saved run: drop --quick and --keep")
    with tempfile.TemporaryDirectory() as scratch:
        folder = source or keep or Path(scratch)
        run = _load(folder / RUN) if source else describe_run(quick=quick)
        page = out or Path(__file__).with_suffix("") / f"{run['begin'][:10]}.md"
        for path in [page] if source else [page, folder / RUN]:
            if path.exists():
                raise UsageError(f"{path} exists already: remove it, or change --out or --keep")
        saved = {path.stem for path in folder.glob("*.json")} if source else COMMANDS
        names = [name for name in COMMANDS if name in (only or saved)]
        if not source:
            _write(folder / RUN, json.dumps(run))
            for name in names:
                print_note(f"{name}: {COMMANDS[name]['command']}")
                ran = run_command(name, Path(scratch), quick=quick)
                _write(folder / f"{name}.json", json.dumps(ran))
            _write(folder / RUN, json.dumps({**run, "load": [*run["load"], os.getloadavg()]}))
        text, failed = render_page(folder, names)
    _write(page, text)
    print_line(str(page))
    if failed:
        raise Hoap3Error(f"failed: {', '.join(failed)}; {page} has the reasons")


def describe_run(*, quick: bool) -> Row:
    """Date, revision, machine and load before the first command."""
    git = ("git", "-C", str(CHECKOUT), "describe", "--always", "--dirty")
    revision = subprocess.run(git, stdout=subprocess.PIPE, text=True, check=False).stdout
    refused = fifo(RealtimeSettings().priority)
    peers = {*qp_peers.PACKAGES.values(), *sdp_backends.PACKAGES.values()}
    return {
        "begin": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "quick": quick,
        "revision": revision.strip() or "unknown",
        "realtime": f"SCHED_FIFO refused: {refused}" if refused else "SCHED_FIFO granted",
        "machine": {**machine_block(), "versions": versions(sorted(peers))},
        "load": [os.getloadavg()],
    }


def run_command(name: str, folder: Path, *, quick: bool) -> Row:
    """Run a command of `COMMANDS` in a folder; `output` is its JSON, or None if it failed."""
    options = COMMANDS[name].get("quick" if quick else "full", "")
    command = " ".join([COMMANDS[name]["command"], *options.split(), "--json"])
    first, *rest = shlex.split(command)
    paths = os.pathsep.join(filter(None, [str(CHECKOUT), os.environ.get("PYTHONPATH")]))
    env = {**os.environ, "PYTHONPATH": paths}
    begin = time.monotonic()
    done = subprocess.run(
        [*PROGRAMS[first], *rest], cwd=folder, env=env, capture_output=True, text=True, check=False
    )
    ran = {"command": command, "took_s": time.monotonic() - begin, "exit_code": done.returncode}
    try:
        output = json.loads(done.stdout) if done.returncode in {0, 1} else None
    except ValueError:
        output = None
    return {**ran, "stderr": done.stderr, "output": output}


def render_page(folder: Path, names: Collection[str]) -> tuple[str, list[str]]:
    """Page of the saved run in a folder, and the names of its commands that failed.

    Raises:
        UsageError: the run, or one of the commands, is not saved there.
    """
    parts, failed = [_head(_load(folder / RUN), COMMANDS.keys() - names)], []
    for name in names:
        ran = _load(folder / f"{name}.json")
        found, notes = ran["output"], ran["stderr"].splitlines()
        try:
            if found is None:
                raise Hoap3Error(notes[-1] if notes else "no JSON on standard output")
            parts += [render_table(ran, table) for table in COMMANDS[name]["tables"]]
            parts += [f"`{key}`: {_text(found[key])}." for key in BELOW if found.get(key)]
        except (Hoap3Error, KeyError, TypeError) as error:  # the others are shown all the same
            failed.append(name)
            told = f"`{ran['command']}` failed, exit code {ran['exit_code']}"
            why = str(error) if isinstance(error, Hoap3Error) else f"its JSON lacks {error}"
            parts.append(f"## {name}\n\n{told}:\n\n```text\n{why}\n```")
    return "\n\n".join(parts) + "\n", failed


def render_table(ran: Row, table: Row) -> str:
    """Render a table with its title, command and n.

    Raises:
        Hoap3Error: the JSON has no such rows, or a row no such key.
    """
    found, key = ran["output"], table.get("rows", "rows")
    rows = [found | row for row in (_value(found, key) if key else [found])]
    wanted = table.get("where", {}).items()
    rows = [row for row in rows if all(_value(row, key) in values for key, values in wanted)]
    if not rows:
        raise Hoap3Error(f"{table['title']}: the JSON has no such rows")
    counts = [_value(row, table.get("n", "samples")) for row in rows]
    n = " to ".join(dict.fromkeys(map(number, (min(counts), max(counts)))))
    told = f"`{ran['command']}`: n = {n}, {ran['took_s']:.0f} s, exit code {ran['exit_code']}."
    if "paper" in table:
        told += f" `paper`: {table['paper']}, mean on the authors' machine."
    rows = pivot(rows, *table["pivot"]) if "pivot" in table else rows
    columns = list(rows[0]) if "pivot" in table else table["columns"].split()
    header = [column.partition("=")[0].partition(":")[0] for column in columns]
    cells = [[_cell(row, column) for column in columns] for row in rows]
    return f"## {table['title']}\n\n{told}\n\n{_markdown(header, cells)}"


def pivot(rows: list[Row], line: str, column: str, cell: str) -> list[Row]:
    """One row for each value of `line`, with a key for each `column`, a template, of any row."""
    names = [line, *dict.fromkeys(column.format(**row) for row in rows)]
    lines: Row = {}
    for row in rows:
        made = lines.setdefault(row[line], dict.fromkeys(names) | {line: row[line]})
        made[column.format(**row)] = row[cell]
    return list(lines.values())


def _head(run: Row, absent: Collection[str]) -> str:
    machine, libraries = run["machine"], dict(run["machine"]["versions"])
    load = [" ".join(f"{x:.2f}" for x in each) for each in run["load"]] + ["unknown: interrupted"]
    facts = {
        "date": run["begin"],
        "revision": run["revision"],
        "CPU": machine["processor"] + (", virtual" if machine["virtual"] else ""),
        "cores": f"{machine['cores']}, affinity {machine['affinity']}",
        "kernel": f"{machine['kernel']} {machine['preemption']}, governor {machine['governor']}",
        "Python": libraries.pop("python"),
        "libraries": _text(libraries),
        "threads of BLAS": machine["blas_threads"],
        "real-time rights": run["realtime"],
        "load average at the start (1, 5, 15 min)": load[0],
        "load average at the end": load[1],
    }
    parts = [HEAD.format(date=run["begin"][:10])]
    parts += [TRIAL] * run["quick"] + [f"Not measured: {', '.join(sorted(absent))}."] * bool(absent)
    return "\n\n".join([*parts, _markdown(["machine", ""], list(map(list, facts.items())))])


def _value(row: Row, key: str) -> Any:
    """The value at a dotted key; None below None."""
    value: Any = row
    for name in key.split("."):
        if value is None:
            return None
        if name not in value:
            raise Hoap3Error(f"the JSON has no key {key!r}: correct benchmarks/results.yaml")
        value = value[name]
    return value


def _cell(row: Row, column: str) -> str:
    key, _, form = column.rpartition("=")[2].partition(":")
    value = _value(row, key)
    return format(value, form) if form and value is not None else _text(value)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(each)}" for name, each in value.items() if each)
    if isinstance(value, list):
        return "; ".join(map(_text, value))
    return value or "" if value is None or isinstance(value, str) else number(value)


def _markdown(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _load(path: Path) -> Row:
    try:
        loaded: Row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        remedy = "Name a folder that --keep wrote, and with --only what it has"
        raise UsageError(f"{path}: cannot be read ({error}). {remedy}") from error
    return loaded


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error


if __name__ == "__main__":
    main(command)
