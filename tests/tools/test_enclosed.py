"""What a log encloses has to be what its records say, and what the other side says."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.records import Attachment, Metadata
from support.command_bench import assert_ran, inside

from hoap3.protocol.config.settings import parse
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.config import ControllerConfig
from hoap3.tools.analysis.replay import replay
from hoap3.tools.logs.log_format import CHANNELS, pack_input, unpack_input
from hoap3.tools.logs.mcap_scan import McapScan
from hoap3.tools.logs.mcap_write import McapFile
from hoap3.tools.logs.motion_files import reopened
from hoap3.tools.logs.repair import repair
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

Change = Callable[[bytes], bytes]


@pytest.fixture
def log(run: Path, tmp_path: Path) -> Path:
    """A copy of the run, to be changed."""
    return shutil.copytree(run, tmp_path / "log")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "log"
    assert_ran(inside("run", "--lockstep", "--robot", "ur5", "--duration", "0.2", "--out", folder))
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
def test_another_description_is_found(log, side, enclosed, kinds):
    path = log / f"{side}.mcap"
    rewrite(path, longer, enclosed=enclosed, kinds=kinds)
    assert repair(path).whole  # each byte is as it was written
    found = verify(log)
    assert found.verdict == "false"
    counts = found.claims.counts
    assert any(counts[name].false for name in counts if name.startswith("description"))
    report = replay(log, [])
    assert report.contradictions
    assert not report.passed
    if len(kinds) + len(enclosed) < 3:  # a log contradicts itself
        assert verify(path).verdict == "false"


@pytest.mark.parametrize(("side", "other"), [("robot", "controller"), ("controller", "robot")])
@pytest.mark.parametrize("record", [False, True])
def test_another_config_is_found(log, side, other, record):
    """As the log encloses it, or as the other side was told."""

    def change(data: bytes) -> bytes:
        return data.replace(b"record", b"recore")

    path = log / f"{other if record else side}.mcap"
    enclosed, kinds = ((), (Kind.CONFIG,)) if record else (("config.yaml",), ())
    rewrite(path, change, enclosed=enclosed, kinds=kinds)
    found = verify(log)
    assert found.claims.counts[f"config of the {side}"].false == 1


def test_an_unchanged_run_passes(log):
    for side in ("robot", "controller"):
        rewrite(log / f"{side}.mcap", bytes, enclosed=DESCRIBED, kinds=())
    assert verify(log).verdict == "true"
    report = replay(log, [])
    assert report.passed
    assert not report.contradictions


def test_settings_of_recording_by_another_version_do_not_hinder_a_replay():
    recorded = {"controller": "qp12", "parameters": {}, "log": {"of_another_version": 10}}
    assert parse(ControllerConfig, reopened(recorded, {}), "a log").controller == "qp12"
