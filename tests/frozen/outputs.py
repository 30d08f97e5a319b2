"""Run a case under a revision, and compare the folders that two revisions left."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from .cases import Case, Step
from .difference import Difference
from .json_tree import compare_json
from .messages import compare_logs
from .revision import Revision

PATIENCE_S = 900.0
IGNORED = (
    ("*:*.machine.*", "describes the host"),
    ("*:*machine.load_1min", "describes the host"),
    ("*:*.wall_s", "elapsed time"),
    ("*:*.times_real_time", "elapsed time"),
    ("*:*payload_sha256.*", "hash of messages that are compared themselves"),
)
"""Values that differ from run to run; a key that is added or removed is a difference all the same."""


def run_case(case: Case, revision: Revision, folder: Path, logs: Path) -> None:
    """Run the commands of a case in an empty folder."""
    folder.mkdir(parents=True)
    background: list[subprocess.Popen[str]] = []
    try:
        for step in case.steps:
            words = [word.replace("{logs}", str(logs)) for word in step.words]
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
            process.terminate()
            process.communicate()


def write_output(step: Step, code: int, text: str, folder: Path) -> None:
    """Keep the exit code and the JSON object of a command."""
    try:
        content = json.loads(text)
    except ValueError:
        content = None
    output = {"exit": code, "json": content}
    (folder / f"{step.output}.json").write_text(json.dumps(output), encoding="utf-8")


def compare_folders(case: Case, old: tuple[Path, Path], new: tuple[Path, Path]) -> list[Difference]:
    """All differences of a case that are not ignored; each side is its folder and its tree."""
    found = []
    for difference in _compare_files(old, new):
        value = difference.kind == "changed"
        if not (
            value and any(fnmatchcase(difference.field, g) for g, _ in (*IGNORED, *case.ignored))
        ):
            found.append(difference)
    return found


def _compare_files(old: tuple[Path, Path], new: tuple[Path, Path]) -> Iterator[Difference]:
    names = {
        str(path.relative_to(side[0])): None
        for side in (old, new)
        for path in sorted(side[0].rglob("*"))
        if path.suffix in {".json", ".mcap"}
    }
    for name in names:
        one, other = old[0] / name, new[0] / name
        if not one.exists() or not other.exists():
            yield Difference(f"{name}:file", "removed" if one.exists() else "added")
        elif name.endswith(".mcap"):
            yield from compare_logs(one, other, f"{name}:")
        else:
            yield from compare_json(read_json(one, *old), read_json(other, *new), f"{name}:")


def read_json(path: Path, folder: Path, tree: Path) -> Any:
    """A JSON file in which paths of the case and of the revision are the same for both."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text.replace(str(folder), "<folder>").replace(str(tree), "<tree>"))
