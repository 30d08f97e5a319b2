"""A revision that can run commands: its files, and the interpreter with its dependencies."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
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
                "HOAP3_RUNTIME_DIR": str(runtime_directory(folder)),
                "OMP_NUM_THREADS": "1",
            },
            stdin=subprocess.DEVNULL,
            text=True,
            **streams,
        )


def runtime_directory(folder: Path | None = None) -> Path:
    """Return the directory for sockets: of commands in one folder, or the one that has them all.

    Its path is short, and nothing in it is found from another folder: a robot would ask those of
    the same name for their status, which is in their logs.
    """
    path = Path(tempfile.gettempdir()) / f"frozen-{os.getpid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    if folder is not None:
        path /= sha256(str(folder).encode()).hexdigest()[:12]
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
    """Files of a revision in a worktree of git that is removed afterwards."""
    git = "git", "-C", str(HERE)
    commit = subprocess.run(
        [*git, "rev-parse", "--verify", f"{name}^{{commit}}"],
        check=True, capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip
    with reserved_folder(commit) as folder:
        tree = folder / "tree"
        remove_worktree(tree)  # of a run that was killed
        subprocess.run(
            [*git, "worktree", "add", "--quiet", "--force", "--detach", str(tree), commit],
            check=True,
        )
        try:
            yield tree
        finally:
            remove_worktree(tree)


@contextmanager
def reserved_folder(commit: str) -> Iterator[Path]:
    """A folder of a commit that nobody else uses: the same each time, if possible.

    numba finds compiled kernels by the path of their source, so another path costs minutes.
    """
    folder = Path.home() / ".cache" / "hoap3-frozen" / commit
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("another comparison uses this revision: kernels are compiled again", flush=True)
            with tempfile.TemporaryDirectory(prefix="frozen-") as other:
                yield Path(other).resolve()
        else:
            yield folder


def remove_worktree(tree: Path) -> None:
    """Remove a worktree and what git knows of it."""
    command = ["git", "-C", str(HERE), "worktree", "remove", "--force", "--force", str(tree)]
    subprocess.run(command, check=False, capture_output=True)
    shutil.rmtree(tree, ignore_errors=True)  # a folder that git does not know


def interpreter_for(tree: Path, *, fresh: bool) -> str:
    """Interpreter for a checked-out revision: ours, or one with packages of its own beside it."""
    if not fresh and dependencies_of(tree) == dependencies_of(HERE):
        print(f"environment: {sys.executable}, as the current tree (same dependencies)")
        return sys.executable
    folder = tree.parent / "environment"
    print(f"environment: a new one in {folder}", flush=True)
    venv.create(folder, with_pip=True, clear=True)
    python = str(folder / "bin" / "python")
    extras = [name for name in EXTRAS if name in project_of(tree)["optional-dependencies"]]
    words = ["install", "--quiet", "-e", f"{tree}[{','.join(extras)}]"]
    if (tree / "constraints.txt").exists():
        words += ["-c", str(tree / "constraints.txt")]
    subprocess.run([python, "-m", "pip", *words], check=True)
    return python
