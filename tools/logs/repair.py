"""Make a whole log of one that was cut off, or has damaged chunks.

The result stands beside the original, as `<name>.repaired.mcap`, and the original is not touched.
"""

from __future__ import annotations

import shlex
import struct
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata

from hoap3.protocol import __version__
from hoap3.protocol.errors import Hoap3Error, LogError, UsageError
from hoap3.tools.logs.files import is_locked
from hoap3.tools.logs.log import NEVER_OURS, Log
from hoap3.tools.logs.log_format import CHANNELS, TOPICS, pack_gap
from hoap3.tools.logs.log_writer import topics
from hoap3.tools.logs.mcap_scan import Damage, McapScan
from hoap3.tools.logs.mcap_write import McapFile

REPAIRED = ".repaired.mcap"
LONGEST_NUMBER = 19  # digits, which fit into 64 bits


@dataclass(frozen=True)
class RepairReport:
    """What became of a log.

    Attributes:
        path: the log.
        out: the whole log; the same file where there was nothing to do.
        whole: it was whole already, and was left alone.
        messages: how many it holds, or how many could be saved.
        last_stamp: log time of the newest of them [ns], or None.
        dropped_bytes: what could not be read at its end.
        damaged: what could not be read before that, in words, or "".
        already: an earlier repair has made `out`; it was left alone.
        rebuilt: parts that were damaged but follow from the rest of the file, or "".
        doubts: damage outside its chunks that could not be repaired for certain, or "".
        others: messages on topics that are not ours, which were left out.
    """

    path: Path
    out: Path
    whole: bool
    messages: int
    last_stamp: int | None
    dropped_bytes: int
    damaged: str = ""
    already: bool = False
    rebuilt: str = ""
    doubts: str = ""
    others: int = 0

    def as_json(self) -> dict[str, Any]:
        """All of it."""
        return {**asdict(self), "path": str(self.path), "out": str(self.out)}

    def __str__(self) -> str:
        if self.whole:
            return f"{self.path}: is whole, {self.messages} messages; nothing was done"
        lost = "".join(f"; {each}" for each in (self.damaged, self.doubts) if each)
        if self.already:
            return f"{self.path}: already repaired, as {self.out}{lost}; {self._by_name}"
        until = "" if self.last_stamp is None else f", the last one at {self.last_stamp} ns"
        inside = f"; rebuilt: {self.rebuilt}" if self.rebuilt else ""
        inside += f"; {self.others} messages on other topics were left out" if self.others else ""
        if self.dropped_bytes:
            inside += f"; {self.dropped_bytes} bytes at the end could not be read"
        return f"{self.out}: {self.messages} messages saved{until}{inside}{lost}; {self._by_name}"

    @property
    def _by_name(self) -> str:
        """How to read the result: in its folder the original is read."""
        return f"name it by itself: `hoap3 report {shlex.quote(str(self.out))}`"


def repair_all(path: Path) -> tuple[list[RepairReport], list[str]]:
    """Repair each log in the folder of a run that is not repaired yet.

    Results of earlier repairs are not taken for logs.

    Returns:
        What became of each, and what is wrong with those that cannot be repaired.

    Raises:
        LogError: there is no log.
    """
    files = [file for file in sorted(path.glob("*.mcap")) if not file.name.endswith(REPAIRED)]
    if not files:
        raise LogError(f"{path}: holds no *.mcap. Name a log or the folder of a run")
    reports, wrong = [], []
    for file in files:
        try:
            reports.append(_left_alone(file) or _repaired_before(file) or _repaired(file))
        except UsageError as error:
            wrong.append(str(error))
    return reports, wrong


def repair(path: Path) -> RepairReport:
    """Write what can be read of a log beside it as a whole one; a whole one is left alone.

    Args:
        path: one file.

    Raises:
        LogError: not a log of ours, or nothing of it can be read.
        Hoap3Error: nothing can be read of it, since it is damaged.
        UsageError: the result exists already, or cannot be written, or the log is being written.
    """
    if path.is_dir():
        raise LogError(f"{path}: is a folder. Name the file to repair")
    try:
        return _left_alone(path) or _repaired(path)
    except LogError as error:
        doubts = "; ".join(McapScan.of(path).doubts)
        if not doubts:
            raise
        raise Hoap3Error(f"{path}: {doubts}, and nothing can be saved: {error}") from error


def _repaired(path: Path) -> RepairReport:
    """Write what can be read of a log that is not whole."""
    if is_locked(path, unknown=False):  # else none could be repaired where locks are not known
        raise UsageError(f"{path}: is being written. Repair it once that has ended")
    log = Log.open(path)
    (scan,) = log.scans
    rebuilt = "; ".join([*scan.rebuilt, *_index_flaws(scan)])
    messages, others, last = 0, 0, None
    target = path.with_suffix(REPAIRED)
    file = McapFile(target, scan.profile, f"hoap3 {__version__}")
    dropped = scan.size - scan.end
    try:
        _copy_head(log, scan, file, dropped)
        for part in scan.parts():
            if isinstance(part, Damage):
                stamp = part.after or scan.begin or 0
                gap = pack_gap(part.size, stamp)
                file.message(CHANNELS["inputs"], 0, stamp, stamp, gap)
                continue
            for channel, sequence, log_time, publish_time, data in part:
                if not 1 <= channel <= len(TOPICS):
                    others += 1
                    continue
                file.message(channel, sequence, log_time, publish_time, data)
                messages, last = messages + 1, max(last or 0, log_time)
            file.cut()
        file.finish()
    except OSError as error:
        target.unlink(missing_ok=True)
        raise UsageError(
            f"{target}: cannot be written ({error.strerror}). Choose a place with more room"
        ) from error
    except BaseException:  # a half of it would stand in the way of the next try
        target.unlink(missing_ok=True)
        raise
    return RepairReport(
        path,
        target,
        whole=False,
        messages=messages,
        last_stamp=last,
        dropped_bytes=dropped,
        damaged=log.damages,
        rebuilt=rebuilt,
        doubts="; ".join(scan.doubts),
        others=others,
    )


def _left_alone(path: Path) -> RepairReport | None:
    """What there is to say of a log that is whole; None of any other.

    Raises:
        LogError: not a log of ours.
    """
    (scan,) = Log.open(path).scans
    if not scan.is_intact or _index_flaws(scan):
        return None
    count, last = _count(scan)
    return RepairReport(path, path, whole=True, messages=count, last_stamp=last, dropped_bytes=0)


def _repaired_before(path: Path) -> RepairReport | None:
    """What an earlier repair has made of a log; None where there is no whole result of one."""
    out = path.with_suffix(REPAIRED)
    if not out.is_file():
        return None
    try:
        log = Log.open(out)
        (scan,) = log.scans
    except LogError:
        return None
    facts = scan.metadata.get("repair")
    if facts is None or not scan.whole:
        return None
    dropped = _number(facts.get("dropped_bytes", ""))
    return RepairReport(
        path,
        out,
        False,
        *_count(scan),
        dropped_bytes=dropped,
        damaged=log.damages,
        already=True,
        doubts=facts.get("doubts", ""),
    )


def _count(scan: McapScan) -> tuple[int, int | None]:
    """How many messages there are, and the log time of the newest [ns]."""
    count, last = 0, None
    for message in scan.messages():
        count, last = count + 1, max(last or 0, message[2])
    return count, last


def _index_flaws(scan: McapScan) -> list[str]:
    """What is wrong with the indexes of a file, which other readers need and ours does not."""
    if not scan.is_intact:
        return []  # it is written again in any case
    with scan.path.open("rb") as stream:
        try:
            reader = make_reader(stream, validate_crcs=True)
            found = sum(1 for _ in reader.iter_messages(log_time_order=False))
        except (*NEVER_OURS, McapError, RuntimeError, EOFError, struct.error) as error:
            return [f"its index ({type(error).__name__})"]
    count = scan.counts[0]
    return [] if found == count else [f"its index, which has {found} of {count} messages"]


def _number(text: str) -> int:
    """A number of metadata, which nothing guards against damage; 0 where it is none."""
    return int(text) if text.isdecimal() and len(text) <= LONGEST_NUMBER else 0


def _copy_head(log: Log, scan: McapScan, file: McapFile, dropped: int) -> None:
    """Everything that stands before the messages, and what was lost behind them."""
    facts = {"dropped_bytes": str(dropped), "problem": scan.problem, "damaged": log.damages}
    facts["doubts"] = "; ".join(scan.doubts)
    for name, group in {**scan.metadata, "repair": facts}.items():
        if name != "end" or scan.whole:
            file.add(Metadata(name, group))
    clock = log.metadata.get("clock", {})
    logged, created = (_number(clock.get(key, "")) for key in ("monotonic_ns", "realtime_ns"))
    for name, data in scan.attachments.items():
        file.add(Attachment(created, logged, name, "application/octet-stream", data))
    known = topics(log.robot)  # instead of what is damaged
    schemas = {number: schema for number, (schema, _) in known.items()}
    channels = {number: channel for number, (_, channel) in known.items()}
    if not scan.ids:
        schemas, channels = schemas | scan.schemas, channels | scan.channels
    for record in (*schemas.values(), *channels.values()):
        file.add(record)
