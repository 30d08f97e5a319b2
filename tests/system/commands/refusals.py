"""How commands refuse what users get wrong: one line, exit code 2, and no standard output."""

from __future__ import annotations

from pathlib import Path

from support.command_bench import Done, inside


def refusal(done: Done, *words: str, code: int = 2) -> str:
    """The one line of a refusal, which has all these words."""
    assert done.code == code, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    assert lines[-1] == errors[0]
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in errors[0], errors[0]
    return errors[0]


def written(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def checked(text: str, *words: object) -> Done:
    """What `hoap3 config check` with these words makes of a config."""
    return inside("config", "check", written(Path(), text), *words)
