"""Old runs go by age and by size; what is written now, and what is not ours, stays."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.config.settings import LogSettings
from hoap3.tools.logs.files import LockedFolder, is_locked
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.logs.pruning import DAY_S, prune
from hoap3.tools.services.services import run_folder

NOW = 1_800_000_000.0
MB = 1_000_000


def make_run(base: Path, name: str, *, days: float, size: int = 10) -> Path:
    """A run that ended so long ago, of so many bytes."""
    folder = base / name
    folder.mkdir(parents=True)
    (folder / "robot.mcap").write_bytes(bytes(size))
    os.utime(folder / "robot.mcap", (NOW - days * DAY_S,) * 2)
    return folder


def left(base: Path) -> list[str]:
    return sorted(path.name for path in base.iterdir())


def test_by_age(tmp_path: Path) -> None:
    make_run(tmp_path, "20260101-120000", days=31)
    make_run(tmp_path, "20260101-120000-2", days=30.01)
    make_run(tmp_path, "20260131-120000", days=29.99)
    found = prune(tmp_path, now=NOW, keep_days=30)
    assert left(tmp_path) == ["20260131-120000"]
    assert (len(found.runs), found.size, found.kept) == (2, 20, [])
    assert str(found)


def test_by_size_the_oldest_go_first(tmp_path: Path) -> None:
    for day in range(1, 6):
        make_run(tmp_path, f"2026010{day}-120000", days=10 - day, size=MB)
    prune(tmp_path, now=NOW, keep_mb=3)
    assert left(tmp_path) == [f"2026010{day}-120000" for day in (3, 4, 5)]


@settings(max_examples=25)  # each makes folders
@given(
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 5)), max_size=8),
    st.one_of(st.none(), st.integers(1, 40)),
    st.one_of(st.none(), st.integers(1, 12)),
)
def test_what_stays_keeps_both_limits_and_is_the_newest(
    tmp_path_factory: pytest.TempPathFactory,
    runs: list[tuple[int, int]],
    keep_days: int | None,
    keep_mb: int | None,
) -> None:
    base = tmp_path_factory.mktemp("logs")
    unit = 1000  # bytes, in place of a MB
    for place, (days, size) in enumerate(runs):
        make_run(base, f"20260101-12000{place}", days=days, size=size * unit)
    scale = None if keep_mb is None else keep_mb * unit / MB
    prune(base, now=NOW, keep_days=keep_days, keep_mb=scale)
    stay = {int(name[-1]) for name in left(base)}
    if keep_days is not None:
        assert all(runs[place][0] <= keep_days for place in stay)
    if keep_mb is not None:
        assert sum(runs[place][1] for place in stay) <= keep_mb
    ages = [days for days, _ in runs]
    for gone in set(range(len(runs))) - stay:
        younger = sum(size for days, size in runs if days <= ages[gone])
        assert (keep_days is not None and ages[gone] > keep_days) or (
            keep_mb is not None and younger > keep_mb
        )


def test_by_default_nothing_goes(tmp_path: Path) -> None:
    make_run(tmp_path, "20200101-120000", days=3000)
    assert str(prune(tmp_path, now=NOW)) == ""
    assert left(tmp_path) == ["20200101-120000"]


def test_what_is_not_ours_stays(tmp_path: Path) -> None:
    make_run(tmp_path, "calibration", days=100)
    report = make_run(tmp_path, "20260101-120000", days=100) / "report.html"
    report.touch()
    elsewhere = make_run(tmp_path / "far", "20260102-120000", days=100)
    (tmp_path / "20260103-120000").symlink_to(elsewhere)
    (tmp_path / "20260104-120000").mkdir()
    prune(tmp_path, now=NOW, keep_days=1)
    assert left(tmp_path) == [
        "20260101-120000",
        "20260103-120000",
        "20260104-120000",
        "calibration",
        "far",
    ]
    assert [path.name for path in report.parent.iterdir()] == ["report.html"]
    assert (elsewhere / "robot.mcap").exists()


def test_a_log_that_is_being_written_stays_until_its_writer_is_gone(tmp_path: Path) -> None:
    folder = tmp_path / "20260101-120000"
    folder.mkdir()
    writer = LogWriter(folder, robot="sample", side="robot", attachments={}, metadata={})
    for record in inputs(describe(1)) + ticks(1, 3):
        writer.add(record)
    later = NOW + 1e6 * DAY_S
    assert prune(tmp_path, now=later, keep_days=1).runs == []
    writer.close()
    assert prune(tmp_path, now=later, keep_days=1).runs == [folder]


def test_between_two_files_of_a_log_its_folder_is_locked(tmp_path: Path) -> None:
    held = LockedFolder(tmp_path)
    assert is_locked(tmp_path)
    held.free()
    held.free()
    assert not is_locked(tmp_path)


def test_a_killed_writer_locks_nothing(tmp_path: Path) -> None:
    log = tmp_path / "robot.mcap"
    code = (
        "import os, sys; from hoap3.tools.logs.files import lock_shared\n"
        "fd = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY); lock_shared(fd)\n"
        "print(flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", code, str(log)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert is_locked(log)
        child.kill()
    assert not is_locked(log)
    assert not is_locked(tmp_path / "none")


def test_what_cannot_be_deleted_is_said_and_the_rest_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = make_run(tmp_path, "20260101-120000", days=9)
    make_run(tmp_path, "20260102-120000", days=8)
    really = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path.parent == stuck:
            raise PermissionError(13, "Permission denied", str(path))
        really(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    found = prune(tmp_path, now=NOW, keep_days=1)
    assert left(tmp_path) == ["20260101-120000"]
    assert len(found.kept) == 1
    assert str(stuck) in str(found)


def test_a_run_that_begins_prunes_those_before_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(make_run(tmp_path, "20200101-120000", days=0), inputs(describe(1)), side="controller")
    for path in (tmp_path / "20200101-120000").iterdir():
        os.utime(path, (0, 0))
    folder = run_folder(LogSettings(directory=str(tmp_path), keep_days=1))
    assert folder is not None
    assert list(tmp_path.iterdir()) == [folder]
    assert str(tmp_path) in capsys.readouterr().err
