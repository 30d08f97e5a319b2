"""Where it runs: as an ordinary user without a home, and beside packages of the same names."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from support.command_bench import Command, assert_no_traceback, hoap3, inside, on_path

pytestmark = pytest.mark.slow

NOBODY = 65534
MAY_READ = "+dac_read_search"  # as if the interpreter stood where everybody can read it
HOMELESS: dict[str, str | None] = {"HOME": None, "XDG_CACHE_HOME": None, "HOAP3_CACHE_DIR": None}
RUN = ("run", "--lockstep", "--duration", "0.2")


def as_nobody(
    *arguments: object, cwd: Path, environment: Mapping[str, str | None] = HOMELESS
) -> Command:
    """Run a command as an ordinary user; who is one already just loses the home."""
    words = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    rights = (f"--inh-caps={MAY_READ}", f"--ambient-caps={MAY_READ}")
    wrapper = (*words, *rights) if os.geteuid() == 0 else ()
    return hoap3(*arguments, wrapper=wrapper, environment=environment, cwd=cwd)


@pytest.fixture
def way() -> Iterator[Path]:
    """A folder that everybody can reach; pytest's own are for their owner alone."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.fixture
def read_only(way: Path) -> Path:
    folder = way / "read_only"
    folder.mkdir(mode=0o555)
    return folder


@pytest.fixture
def open_to_all(way: Path) -> Path:
    folder = way / "open"
    folder.mkdir()
    folder.chmod(0o777)
    return folder


def test_a_folder_that_may_not_be_written(read_only: Path) -> None:
    refused = as_nobody(*RUN, cwd=read_only)
    assert refused.end() == 2
    assert_no_traceback(refused)
    assert refused.stderr == (
        "error: settings: log.directory: Permission denied (found 'logs'). "
        "Name a new folder that can be written, or set log.record=false\n"
    )
    given = as_nobody(*RUN, "--out", read_only, cwd=read_only)
    assert given.end() == 2
    assert given.stderr.startswith(f"error: --out: Permission denied (found '{read_only}')")
    assert_no_traceback(given)


@pytest.mark.parametrize(
    "interpreted", ["1", pytest.param("0", marks=pytest.mark.long, id="compiled afresh")]
)
def test_an_ordinary_user_without_home_gets_the_same_bytes(
    read_only: Path, open_to_all: Path, tmp_path: Path, interpreted: str
) -> None:
    environment = {**HOMELESS, "NUMBA_DISABLE_JIT": interpreted}
    words = (*RUN, "--json", "--out")
    theirs = as_nobody(*words, open_to_all / "log", cwd=read_only, environment=environment)
    assert theirs.end() in {0, 1}, theirs.stderr  # it is too short to arrive
    assert_no_traceback(theirs)
    written = open_to_all / "log" / "robot.mcap"
    assert written.stat().st_uid == (NOBODY if os.geteuid() == 0 else os.geteuid())
    ours = inside(*words, tmp_path / "log")
    assert theirs.json()["payload_sha256"] == ours.json()["payload_sha256"]


def test_packages_called_like_our_rooms_do_not_matter(tmp_path: Path) -> None:
    for room in ("protocol", "remote_controller", "robot_emulator", "tools"):
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text("raise SystemExit('of somebody else')")
    out = tmp_path / "log"
    words = ("run", "--lockstep", "--duration", "0.1", "--json", "--out", out)
    done = hoap3(*words, environment=on_path(tmp_path))
    assert done.end() in {0, 1}, done.stderr  # it is too short to arrive
    assert_no_traceback(done)
    assert done.json()["ticks"] == 100
