"""What a log encloses has to be what its records say, and what the other side says."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.records import Attachment, Metadata
from support.command_bench import inside

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log_format import CHANNELS, pack_input, unpack_input
from hoap3.tools.logs.mcap_scan import McapScan
from hoap3.tools.logs.mcap_write import McapFile
from hoap3.tools.logs.repair import repair
from hoap3.tools.replay import replay
from hoap3.tools.verify.verify import verify

Change = Callable[[bytes], bytes]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "log"
    words = ("run", "--lockstep", "--robot", "ur5", "--duration", "0.2", "--out", folder)
    assert inside(*words).code in {0, 1}
    return folder


def rewrite(
    path: Path, change: Change, *, enclosed: tuple[str, ...], kinds: tuple[Kind, ...]
) -> None:
    """Change enclosed files and records of a log, with all of its CRCs."""
    scan = McapScan.of(path)
    messages = list(scan.messages())
    path.unlink()
    file = McapFile(path, scan.profile, "test")
    for name, facts in scan.metadata.items():
        file.add(Metadata(name, facts))
    for name, data in scan.attachments.items():
        file.add(Attachment(0, 0, name, "text/plain", change(data) if name in enclosed else data))
    for record in (*scan.schemas.values(), *scan.channels.values()):
        file.add(record)
    for channel, sequence, log, publish, data in messages:
        changed = data
        if channel == CHANNELS["inputs"]:
            given, repeated = unpack_input(data)
            if given.kind in kinds:
                record = Record(given.kind, given.stamp, change(given.payload))
                changed = pack_input(record, repeated=repeated)
        file.message(channel, sequence, log, publish, changed)
    file.finish()


def longer(data: bytes) -> bytes:
    """A link that is longer."""
    assert b"0.425" in data
    return data.replace(b"0.425", b"0.525")


DESCRIBED = ("description.json", "robot.urdf")


@pytest.mark.parametrize("side", ["robot", "controller"])
@pytest.mark.parametrize(
    ("enclosed", "kinds"),
    [
        (DESCRIBED, (Kind.DESCRIPTION,)),
        (DESCRIBED, ()),
        (("description.json",), ()),
        (("robot.urdf",), ()),
        ((), (Kind.DESCRIPTION,)),
    ],
)
def test_another_description_is_found(
    run: Path, tmp_path: Path, side: str, enclosed: tuple[str, ...], kinds: tuple[Kind, ...]
) -> None:
    shutil.copytree(run, tmp_path / "log")
    path = tmp_path / "log" / f"{side}.mcap"
    rewrite(path, longer, enclosed=enclosed, kinds=kinds)
    assert repair(path).whole  # each byte is as it was written
    found = verify(tmp_path / "log")
    assert found.verdict == "false"
    counts = found.claims.counts
    assert any(counts[name].false for name in counts if name.startswith("description"))
    report = replay(tmp_path / "log", [])
    assert report.contradictions
    assert not report.passed
    if len(kinds) + len(enclosed) < 3:  # a log contradicts itself
        assert verify(path).verdict == "false"


@pytest.mark.parametrize(("side", "other"), [("robot", "controller"), ("controller", "robot")])
@pytest.mark.parametrize("record", [False, True])
def test_another_config_is_found(
    run: Path, tmp_path: Path, side: str, other: str, record: bool
) -> None:
    """As the log encloses it, or as the other side was told."""
    shutil.copytree(run, tmp_path / "log")

    def change(data: bytes) -> bytes:
        return data.replace(b"record", b"recore")

    if record:
        path, enclosed, kinds = tmp_path / "log" / f"{other}.mcap", (), (Kind.CONFIG,)
    else:
        path, enclosed, kinds = tmp_path / "log" / f"{side}.mcap", ("config.yaml",), ()
    rewrite(path, change, enclosed=enclosed, kinds=kinds)
    found = verify(tmp_path / "log")
    assert found.claims.counts[f"config of the {side}"].false == 1


def test_an_unchanged_run_passes(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "log")
    for side in ("robot", "controller"):
        rewrite(tmp_path / "log" / f"{side}.mcap", bytes, enclosed=DESCRIBED, kinds=())
    assert verify(tmp_path / "log").verdict == "true"
    report = replay(tmp_path / "log", [])
    assert report.passed
    assert not report.contradictions
