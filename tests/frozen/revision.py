"""A revision that can run commands: its files, and the interpreter with its dependencies."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[2]
EXTRAS = "mujoco", "report"


@dataclass(frozen=True)
class Revision:
    """Files of a revision, and an interpreter.

    Attributes:
        name: as the user gave it, or ``current tree``.
        tree: root of the files.
        python: interpreter with the dependencies.
    """

    name: str
    tree: Path
    python: str

    def start(self, words: Sequence[str], folder: Path, **streams: Any) -> subprocess.Popen[str]:
        """Start a command in a folder; the first word is `hoap3`, or the path of a script."""
        if words[0] == "hoap3":
            module, _, name = project_of(self.tree)["scripts"]["hoap3"].partition(":")
            code = f"import sys; sys.argv[0] = 'hoap3'; from {module} import {name}; {name}()"
            command = [self.python, "-c", code, *words[1:]]
        else:
            command = [self.python, *words]
        return subprocess.Popen(
            command,
            cwd=folder,
            env={
                **os.environ,
                "PYTHONPATH": str(self.tree),
                "HOAP3_RUNTIME_DIR": str(runtime_directory()),
                "OMP_NUM_THREADS": "1",
            },
            stdin=subprocess.DEVNULL,
            text=True,
            **streams,
        )


def runtime_directory() -> Path:
    """A short path of our own, for sockets: robots of other people are not found there."""
    path = Path(tempfile.gettempdir()) / f"frozen-{os.getpid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    return path


def project_of(tree: Path) -> dict[str, Any]:
    """The table `project` of a revision's pyproject.toml."""
    content = tomllib.loads((tree / "pyproject.toml").read_text(encoding="utf-8"))
    project: dict[str, Any] = content["project"]
    return project


def dependencies_of(tree: Path) -> tuple[object, ...]:
    """All that decides which packages a revision is installed with."""
    project, constraints = project_of(tree), tree / "constraints.txt"
    pinned = constraints.read_text(encoding="utf-8") if constraints.exists() else ""
    return project["dependencies"], project["optional-dependencies"], pinned


@contextmanager
def checked_out(name: str) -> Iterator[Path]:
    """Files of a revision in a temporary worktree of git."""
    with tempfile.TemporaryDirectory(prefix="frozen-") as folder:
        tree = Path(folder).resolve() / "tree"
        git = ["git", "-C", str(HERE), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), name], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def interpreter_for(tree: Path, *, fresh: bool) -> str:
    """Interpreter for a checked-out revision: ours, or one with packages of its own beside it."""
    if not fresh and dependencies_of(tree) == dependencies_of(HERE):
        print(f"environment: {sys.executable}, as the current tree (same dependencies)")
        return sys.executable
    folder = tree.parent / "environment"
    print(f"environment: a new one in {folder}", flush=True)
    venv.create(folder, with_pip=True)
    python = str(folder / "bin" / "python")
    extras = [name for name in EXTRAS if name in project_of(tree)["optional-dependencies"]]
    words = ["install", "--quiet", "-e", f"{tree}[{','.join(extras)}]"]
    if (tree / "constraints.txt").exists():
        words += ["-c", str(tree / "constraints.txt")]
    subprocess.run([python, "-m", "pip", *words], check=True)
    return python
