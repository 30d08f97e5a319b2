"""Run a case under a revision, and compare the folders that two revisions left."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError

from .cases import Case, Step
from .difference import Difference
from .json_tree import compare_json
from .messages import compare_logs
from .realtime import end, free_port
from .revision import Revision
from .tables import compare_arrays, compare_csv

PATIENCE_S = 900.0
IGNORED = (
    ("*:*.machine.*", "describes the host"),
    ("*:*machine.load_1min", "describes the host"),
    ("*:*.wall_s", "elapsed time"),
    ("*:*.times_real_time", "elapsed time"),
    ("*:*payload_sha256.*", "hash of messages that are compared themselves"),
)
"""Values that differ from run to run. A key that is added or removed is a difference."""


def run_case(case: Case, revision: Revision, folder: Path, logs: Path) -> None:
    """Run the commands of a case in an empty folder."""
    folder.mkdir(parents=True)
    background: list[subprocess.Popen[str]] = []
    ports = free_port(), free_port()
    try:
        for step in case.steps:
            words = [filled(word, logs, ports) for word in step.words]
            errors = (folder / f"{step.output}.stderr").open("w")
            with errors:
                process = revision.start(words, folder, stdout=subprocess.PIPE, stderr=errors)
            if step.background:
                background.append(process)
                continue
            try:
                text = process.communicate(timeout=PATIENCE_S)[0]
            except subprocess.TimeoutExpired:
                process.kill()
                text = process.communicate()[0]
            write_output(step, process.returncode, text, folder)
    finally:
        for process in background:
            process.send_signal(signal.SIGINT)
            end(process)


def filled(word: str, logs: Path, ports: tuple[int, int]) -> str:
    """A word of a command with what is known only now."""
    names = {"{logs}": logs, "{port0}": ports[0], "{port1}": ports[1]}
    for name, value in names.items():
        word = word.replace(name, str(value))
    return word


def write_output(step: Step, code: int, text: str, folder: Path) -> None:
    """Keep the exit code and the JSON object of a command."""
    try:
        content = json.loads(text)
    except ValueError:
        content = None
        if code not in {0, 2} and not folder.parent.name.startswith("damaged"):
            raise RuntimeError(f"{step.output}: exit {code} without JSON: {text[-400:]}") from None
    output = {"exit": code, "json": content}
    (folder / f"{step.output}.json").write_text(json.dumps(output), encoding="utf-8")


def compare_folders(case: Case, old: tuple[Path, Path], new: tuple[Path, Path]) -> list[Difference]:
    """All differences of a case that are not ignored; each side is its folder and its tree."""
    return [each for each in _compare_files(old, new) if not is_ignored(each, case)]


def is_ignored(difference: Difference, case: Case) -> bool:
    """Whether a field differs from run to run."""
    globs = [glob for glob, _ in case.ignored]
    if difference.kind == "changed":
        globs += [glob for glob, _ in IGNORED]
    return any(fnmatchcase(difference.field, glob) for glob in globs)


def _compare_files(old: tuple[Path, Path], new: tuple[Path, Path]) -> Iterator[Difference]:
    paths = [path for folder, _ in (old, new) for path in sorted(folder.rglob("*"))]
    names = [
        str(path.relative_to(old[0] if path.is_relative_to(old[0]) else new[0]))
        for path in paths
        if path.suffix in {".json", *COMPARED}
    ]
    for name in dict.fromkeys(names):
        one, other = old[0] / name, new[0] / name
        if not one.exists() or not other.exists():
            yield Difference(f"{name}:file", "removed" if one.exists() else "added")
            continue
        try:
            if name.endswith(".json"):
                found = compare_json(read_json(one, *old), read_json(other, *new), f"{name}:")
            else:
                found = COMPARED[one.suffix](one, other, f"{name}:")
            yield from list(found)
        except (OSError, ValueError, McapError) as error:
            yield Difference(f"{name}:file", "changed", "", f"cannot be read: {error}")


COMPARED: dict[str, Callable[[Path, Path, str], Iterator[Difference]]] = {
    ".mcap": compare_logs,
    ".npz": compare_arrays,
    ".npy": compare_arrays,
    ".csv": compare_csv,
}
"""By suffix: what compares two files. Pages and pictures are not compared."""


def read_json(path: Path, folder: Path, tree: Path) -> Any:
    """A JSON file in which paths of the case and of the revision are the same for both."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text.replace(str(folder), "<folder>").replace(str(tree), "<tree>"))
