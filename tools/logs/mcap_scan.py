"""Reads what is left of an MCAP file, however it ended and whatever is damaged in it.

The library's reader wants a whole file. This one needs nothing but the order of records in the
data section. It trusts no length that a file states, skips damaged chunks, and knows where the good
part ends. Where a record of a finished file is damaged, the index at its end tells where the next
chunk begins. Every CRC of a finished file is checked: of chunks, attachments, data and summary.

Files of other writers are read too: chunks of any compression that the library knows, messages
outside chunks, schemas and channels inside them, and any channel ids.

Memory and time are bounded by the size of the file: one chunk is unpacked at a time, and a file
whose chunks claim to unpack to far more than a log of ours is refused.
"""

from __future__ import annotations

import os
import struct
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import IO, Any

import lz4.frame
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from hoap3.protocol.config.regular_file import open_regular
from hoap3.protocol.errors import LogError
from hoap3.tools.logs.disk_rows import LogMessage, SortedRows
from hoap3.tools.logs.mcap_write import MAGIC, MESSAGE_FIELDS, MESSAGE_HEAD, crc_before

MAX_CHUNK = 1 << 26  # bytes that a chunk may unpack to; ours have 1 MiB and a record more
MAX_RECORD = 1 << 24  # bytes of an attachment, or of anything else that is kept in memory
MAX_ENCLOSED = 1 << 26  # bytes of all attachments and metadata together
MAX_RATIO = 128  # of what all chunks unpack to, and the file; 73 with 128 joints that never move
MESSAGE_BYTES = 16  # of the file for a message, at least: its entry in the index
SLACK_MESSAGES = 1 << 16  # beyond that
LATEST = (1 << 63) - 1  # time [ns] of a message: what int64 holds
LOOSE = b"\0loose"  # instead of a compression: messages that lie in no chunk
LOOSE_BYTES = 1 << 20  # of them that are read together
FINAL_FIELDS = 20  # bytes of a footer
_RECORD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI8s")  # with the mark behind it
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of compression
_PARSERS = {
    int(Opcode.HEADER): records.Header.read,
    int(Opcode.SCHEMA): records.Schema.read,
    int(Opcode.CHANNEL): records.Channel.read,
    int(Opcode.ATTACHMENT): records.Attachment.read,
    int(Opcode.METADATA): records.Metadata.read,
    int(Opcode.DATA_END): records.DataEnd.read,
    int(Opcode.STATISTICS): records.Statistics.read,
}

McapMessage = LogMessage


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk stands in the file, how its messages are packed, and their log times [ns]."""

    start: int
    length: int
    unpacked: int
    crc: int
    compression: bytes
    first: int = 0
    last: int = 0


@dataclass(frozen=True)
class Damage:
    """A stretch of a file that cannot be read.

    Attributes:
        start, size: where it stands [bytes].
        after: log time of the newest message before it [ns], None where there is none.
        before: log time of the oldest message behind it [ns], None where there is none.
    """

    start: int
    size: int
    after: int | None = None
    before: int | None = None


@dataclass
class McapScan:
    """What can be read of a file.

    Attributes:
        size: of the file.
        end: of its last whole record; what follows is lost.
        whole: the file was finished, and nothing is missing at its end.
        begin: log time of the oldest message [ns], None where there is none.
        problem: why it is not whole.
        profile: from the header.
        channels: by id.
        schemas: by id.
        metadata, attachments: by name, the last one of each.
        logs: every group `log` of the metadata; a file that was merged has several.
        ids: our number of each channel, where messages get one; 0 for those of no topic of ours.
        moved: another tool has written it: schemas lie in chunks, or messages in none.
        rebuilt: what is damaged outside the chunks, but follows from the rest of the file.
        doubts: what is damaged there and cannot be restored for certain.
        counts: messages in the chunks, and what the statistics of the file count, or None.
    """

    path: Path
    size: int
    end: int = len(MAGIC)
    whole: bool = False
    problem: str = ""
    begin: int | None = None
    profile: str = ""
    channels: dict[int, records.Channel] = field(default_factory=dict)
    schemas: dict[int, records.Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    logs: list[dict[str, str]] = field(default_factory=list)
    ids: dict[int, int] = field(default_factory=dict)
    moved: bool = False
    rebuilt: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    counts: tuple[int, int | None] = 0, None
    _parts: list[_Chunk | Damage] = field(default_factory=list)
    _sorted: SortedRows | None = None
    _data_end: tuple[int, int] | None = None
    _unsummed: bool = False
    _skipped: bool = False
    _unpacked: int = 0
    _enclosed: int = 0

    @classmethod
    def of(cls, path: Path, *, verify: bool = True) -> McapScan:
        """Scan a file.

        Args:
            path: of the file.
            verify: its chunks, too; without, it takes some milliseconds for each GB, and what is
                damaged in one is found when it is read: `damages` does not know of it.

        Raises:
            LogError: missing, empty, not MCAP, it cannot be read, or it claims to hold more than a
                log of its size can.
        """
        try:
            with open_regular(path) as stream:
                scan = cls(path, os.fstat(stream.fileno()).st_size)
                if stream.read(len(MAGIC)) != MAGIC and not _ends_well(stream, scan.size):
                    what = "is not an MCAP file" if scan.size else "is empty"
                    raise LogError(f"{path}: {what}. Name a log that `hoap3` has written")
                scan._walk(stream)
                if scan._unsummed and scan.whole:
                    scan.rebuilt.append("its summary")
                if verify or not scan.channels:  # which may lie in the chunks
                    scan._verify(stream)
                if verify and scan.whole:
                    scan._check_sums(stream)
        except OSError as error:
            raise LogError(
                f"{path}: cannot be read ({error.strerror}). Name a log, or the folder of a run"
            ) from error
        return scan

    @property
    def is_intact(self) -> bool:
        """Whether the file is whole and no damage was found."""
        return self.whole and not (self.damages or self.doubts or self.rebuilt)

    @property
    def has_messages(self) -> bool:
        """Whether anything may hold messages."""
        return bool(self._parts)

    @property
    def damages(self) -> list[Damage]:
        """What cannot be read before `end`, in file order."""
        return [part for part in self._parts if isinstance(part, Damage)]

    def messages(self) -> Iterator[McapMessage]:
        """Every message that can be read, in file order.

        Raises:
            LogError: the file has changed since it was scanned.
        """
        return chain.from_iterable(part for part in self.parts() if not isinstance(part, Damage))

    @property
    def part_count(self) -> int:
        """How many parts `parts` gives."""
        if self._sorted is not None:
            return len(self.damages) + len(self._sorted.spans)
        return len(self._parts)

    def parts(self) -> Iterator[Iterator[McapMessage] | Damage]:
        """The same, chunk by chunk, and what is damaged between them.

        Damage of a reordered file comes first, since the times of what is lost are not known. Each
        chunk is to be used before the next part is asked for.
        """
        if self._sorted is not None:
            yield from self.damages
            yield from self._sorted.parts()
            return
        with open_regular(self.path) as stream:
            for part in self._parts:
                yield part if isinstance(part, Damage) else self._unpack(part, stream)

    @property
    def spans(self) -> list[tuple[int, int]]:
        """Log times [ns] of the oldest and the newest message of each chunk, as the file says."""
        if self._sorted is not None:
            return self._sorted.spans
        return [(chunk.first, chunk.last) for chunk in self._chunks()]

    def chunk(self, place: int) -> list[McapMessage]:
        """The messages of one chunk.

        Raises:
            LogError: it is damaged.
        """
        if self._sorted is not None:
            return list(self._sorted.parts()[place])
        with open_regular(self.path) as stream:
            return list(self._unpack(self._chunks()[place], stream))

    def sort(self, rank: Callable[[int, bytes], int], ordered: frozenset[int]) -> None:
        """Put messages in the order of their log times, if another tool has reordered them.

        Args:
            rank: of a message among those with its log time, by channel and data.
            ordered: channels whose log times rise in a file that was not reordered.
        """
        stamps = np.fromiter((m[2] for m in self.messages() if m[0] in ordered), np.int64)
        if (np.diff(stamps) < 0).any():
            self._sorted = SortedRows(self.messages(), rank)

    def _chunks(self) -> list[_Chunk]:
        return [part for part in self._parts if isinstance(part, _Chunk)]

    def _verify(self, stream: IO[bytes]) -> None:
        """Read every chunk once; neighbours that are damaged become one damage."""
        parts: list[_Chunk | Damage] = []
        newest: int | None = None
        left = room = self.size // MESSAGE_BYTES + SLACK_MESSAGES
        for part in self._parts:
            stamps: list[int] | None = None
            if isinstance(part, _Chunk):
                with suppress(LogError):
                    found = islice(self._unpack(part, stream), left + 1)
                    stamps = [message[2] for message in found]
            if stamps is None:
                start, end = _extent(part)
                if parts and isinstance(parts[-1], Damage):
                    start = parts.pop().start
                parts.append(Damage(start, end - start, newest))
                continue
            if len(stamps) > left:
                raise LogError(self._too_much("messages"))
            left -= len(stamps)
            if stamps:
                if parts and isinstance(parts[-1], Damage):
                    parts[-1] = replace(parts[-1], before=min(stamps))
                newest = max(newest or 0, *stamps)
                self.begin = min(stamps) if self.begin is None else self.begin
            parts.append(part)
        if not self.whole and parts and isinstance(parts[-1], Damage):
            self.end = parts.pop().start  # nothing good comes behind it: the file ends there
            self.problem = f"a damaged chunk at byte {self.end}"
        self._parts = parts
        self.counts = room - left, self.counts[1]

    def _check_sums(self, stream: IO[bytes]) -> None:
        """Check the CRC of the data section, and the number of messages."""
        held, stated = self.counts
        if self.damages or self.doubts:
            return
        if not self.rebuilt and stated not in {None, held}:
            self.doubts.append(f"it holds {held} messages, but its statistics count {stated}")
        if self._data_end is None:
            self.doubts.append("the record that ends its data section is damaged")
            return
        end, crc = self._data_end
        if crc and crc_before(stream, end) != crc:
            self.doubts.append(
                "something outside its chunks is damaged: its header, metadata, schemas, "
                "channels, message indexes, or the end of its data section"
            )
        elif self._skipped and not self.rebuilt:
            self.rebuilt.append("the record that ends its data section")

    def _walk(self, stream: IO[bytes]) -> None:
        chunks, starts = self._indexed(stream)
        tried = 0
        seen: set[int] = set()  # where records were read: each once, so that the time is linear
        stopped = self.end, ""
        while not self.whole:
            if self.end in seen:  # from here on, an earlier walk has taken all that there is
                self.end, self.problem = stopped
            else:
                seen.add(self.end)
                stream.seek(self.end)
                self.problem = self._next(stream)
                if not self.problem:
                    continue
                stopped, self._skipped = (self.end, self.problem), True
            if self._parts:  # go back to the first chunk that was not found, if there is one
                tried = max(tried, _extent(self._parts[-1])[1] - 1)
            place = bisect_right(starts, tried)
            if place == len(starts):
                return
            self.end = tried = starts[place]
        found = {_extent(part)[0] for part in self._parts}
        lost = [Damage(at, end - at) for at, end in pairwise(chunks) if at not in found]
        self._parts = sorted([*self._parts, *lost], key=_extent)

    def _indexed(self, stream: IO[bytes]) -> tuple[list[int], list[int]]:
        """Where the summary says that chunks and itself begin; the same with all that it names.

        In rising order; nothing if it is damaged.
        """
        size = self.size
        if size < len(MAGIC) + _FOOTER.size:
            return [], []
        stream.seek(size - _FOOTER.size)
        opcode, length, start, _, crc, mark = _FOOTER.unpack(stream.read(_FOOTER.size))
        end = size - _FOOTER.size
        self._unsummed = (opcode, length) != (Opcode.FOOTER, FINAL_FIELDS) or start > end
        if self._unsummed or mark != MAGIC or end - start > MAX_ENCLOSED or not start:
            return [], []
        stream.seek(start)
        summary = stream.read(end - start + _FOOTER.size)
        if crc and zlib.crc32(summary[: -len(MAGIC) - 4]) != crc:
            self._unsummed = True
            return [], []
        chunks, others, at = {start}, set[int](), 0
        while at + _RECORD.size <= end - start:
            opcode, length = _RECORD.unpack_from(summary, at)
            at += _RECORD.size
            if opcode == Opcode.CHUNK_INDEX and length >= 24:
                chunks.add(struct.unpack_from("<Q", summary, at + 16)[0])  # behind the time range
            elif opcode in {Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX} and length >= 8:
                others.add(struct.unpack_from("<Q", summary, at)[0])
            at += length
        all_of_it = [place for place in chunks | others if len(MAGIC) <= place <= start]
        return sorted(chunks.intersection(all_of_it)), sorted(all_of_it)

    def _next(self, stream: IO[bytes]) -> str:
        """Take the record at `end`; what is wrong with it, or ""."""
        head = stream.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return f"it ends behind byte {self.end}, unfinished"
        opcode, length = _RECORD.unpack(head)
        start = self.end + _RECORD.size
        if self.end == len(MAGIC) and opcode != Opcode.HEADER:
            return f"its first record, at byte {self.end}, is not a header"
        if not opcode or start + length > self.size:
            return f"it ends inside a record that begins at byte {self.end}"
        if opcode == Opcode.MESSAGE:
            return self._take_loose(stream)
        if opcode == Opcode.FOOTER:
            stream.seek(start + length)
            if stream.read(len(MAGIC) + 1) != MAGIC:
                self.end = start + length
                return "the mark at its end is missing"
            self.whole, self.end = True, self.size
            return ""
        try:
            self._take(opcode, start, length, stream)
        except (McapError, ValueError, struct.error) as error:
            return f"a damaged record at byte {self.end} ({error!r:.60})"
        self.end = start + length
        return ""

    def _take(self, opcode: int, start: int, length: int, stream: IO[bytes]) -> None:
        if opcode == Opcode.CHUNK:
            self._take_chunk(_read_chunk(start, length, stream))
        parser = _PARSERS.get(opcode)
        if parser is None:
            return
        self._enclosed += length
        if length > MAX_RECORD or self._enclosed > MAX_ENCLOSED:
            raise ValueError(f"{length} bytes are too many")
        raw = stream.read(length)
        match parser(ReadDataStream(BytesIO(raw))):
            case records.Header(profile=profile):
                self.profile = profile
            case records.Channel() | records.Schema() as record:
                self._define(record)
            case records.Metadata(name=name, metadata=facts):
                self.metadata[name] = facts
                if name == "log":
                    self.logs.append(facts)
            case records.Attachment(name=name, data=data):
                self.attachments[name] = data
                crc = int.from_bytes(raw[-4:], "little")
                if crc and crc != zlib.crc32(raw[:-4]):
                    self.doubts.append(f"the enclosed {name} is damaged")
            case records.DataEnd(data_section_crc=crc):
                self._data_end = self._data_end or (start - _RECORD.size, crc)
            case records.Statistics(message_count=count):
                self.counts = self.counts[0], count

    def _take_chunk(self, chunk: _Chunk) -> None:
        if chunk.unpacked <= MAX_CHUNK:  # others are damaged, and are not unpacked
            self._unpacked += chunk.unpacked
        if self._unpacked > MAX_CHUNK + MAX_RATIO * self.size:
            raise LogError(self._too_much("bytes"))
        self._parts.append(chunk)

    def _define(self, record: records.Channel | records.Schema) -> None:
        """Take a channel or a schema; the copies in an intact summary replace those before it."""
        group: dict[int, Any] = (
            self.channels if isinstance(record, records.Channel) else self.schemas
        )
        if not self._unsummed or record.id not in group:
            group[record.id] = record

    def _take_loose(self, stream: IO[bytes]) -> str:
        """Take the messages at `end` that lie in no chunk, some of them together."""
        begin, first, last, stop = self.end, LATEST, 0, self.end + LOOSE_BYTES
        while self.end < stop:
            stream.seek(self.end)
            head = stream.read(MESSAGE_HEAD.size)
            if len(head) < MESSAGE_HEAD.size or head[0] != Opcode.MESSAGE:
                break
            _, length, _, _, log, _ = MESSAGE_HEAD.unpack(head)
            if length < MESSAGE_FIELDS or self.end + _RECORD.size + length > self.size:
                break
            self.end += _RECORD.size + length
            first, last = min(first, log), max(last, log)
        if self.end == begin:
            return f"a damaged message at byte {begin}"
        size, self.moved = self.end - begin, True
        start = begin + _RECORD.size
        self._parts.append(_Chunk(start, size - _RECORD.size, size, 0, LOOSE, first, last))
        return ""

    def _unpack(self, chunk: _Chunk, stream: IO[bytes]) -> Iterator[McapMessage]:
        raw, at, head, ids = self._read(chunk, stream), 0, MESSAGE_HEAD.size, self.ids
        size = len(raw)
        unpack, wanted = MESSAGE_HEAD.unpack_from, int(Opcode.MESSAGE)
        raw += bytes(head)  # so that the last record can be read as a message, whatever it is
        while at < size:
            opcode, length, channel, sequence, log, publish = unpack(raw, at)
            begin, at = at, at + 9 + length
            if at > size:
                raise self._damaged(chunk)
            if opcode != wanted:
                self._take_inside(opcode, raw[begin + _RECORD.size : at], chunk)
                continue
            if length < MESSAGE_FIELDS or log > LATEST or publish > LATEST:
                raise self._damaged(chunk)
            if ids:
                channel = ids.get(channel, 0)
            yield channel, sequence, log, publish, raw[begin + head : at]

    def _take_inside(self, opcode: int, raw: bytes, chunk: _Chunk) -> None:
        """Take a schema or a channel that lies in a chunk; other records are for other readers."""
        if not opcode:
            raise self._damaged(chunk)
        if opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
            self.moved = True
            try:
                self._define(_PARSERS[opcode](ReadDataStream(BytesIO(raw))))
            except (McapError, ValueError, struct.error) as error:
                raise self._damaged(chunk) from error

    def _read(self, chunk: _Chunk, stream: IO[bytes]) -> bytes:
        if chunk.compression == LOOSE:
            stream.seek(chunk.start - _RECORD.size)
            return stream.read(chunk.unpacked)
        packed = chunk.length - _CHUNK_HEAD.size - len(chunk.compression) - 8
        if chunk.unpacked > MAX_CHUNK or packed > MAX_CHUNK + MAX_RECORD:
            raise self._damaged(chunk)
        stream.seek(chunk.start + _CHUNK_HEAD.size + len(chunk.compression) + 8)
        data = stream.read(packed)
        try:
            data = _unpacked(data, chunk)
        except (zstandard.ZstdError, RuntimeError, ValueError, EOFError) as error:
            raise self._damaged(chunk) from error
        if len(data) != chunk.unpacked or (chunk.crc and zlib.crc32(data) != chunk.crc):
            raise self._damaged(chunk)
        return data

    def _damaged(self, chunk: _Chunk) -> LogError:
        return LogError(
            f"{self.path}: the chunk at byte {chunk.start - _RECORD.size} is damaged, and was not "
            "when it was read first. Wait until nothing writes to the log"
        )

    def _too_much(self, what: str) -> str:
        return (
            f"{self.path}: its chunks unpack to more {what} than a log of {self.size} bytes holds. "
            "No service of ours has written it; do not read it"
        )


def _extent(part: _Chunk | Damage) -> tuple[int, int]:
    """First byte of a part, and the one behind its last."""
    if isinstance(part, Damage):
        return part.start, part.start + part.size
    return part.start - _RECORD.size, part.start + part.length


def _ends_well(stream: IO[bytes], size: int) -> bool:
    """Whether a file ends as an MCAP file does."""
    stream.seek(max(size - len(MAGIC), 0))
    return size > 2 * len(MAGIC) and stream.read(len(MAGIC)) == MAGIC


def _unpacked(data: bytes, chunk: _Chunk) -> bytes:
    """The content of a chunk, of the size that it states.

    Raises:
        ValueError, RuntimeError, EOFError, ZstdError: it is damaged.
    """
    if chunk.compression == b"zstd":
        if zstandard.frame_content_size(data) not in {-1, chunk.unpacked}:
            raise ValueError("another size")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=chunk.unpacked)
    if chunk.compression == b"lz4":
        lz4_frame = lz4.frame.LZ4FrameDecompressor()
        return bytes(lz4_frame.decompress(data, max_length=chunk.unpacked))
    if chunk.compression:
        raise ValueError("a compression that is not known")
    return data


def _read_chunk(start: int, length: int, stream: IO[bytes]) -> _Chunk:
    """Read what stands before the messages.

    Raises:
        struct.error, ValueError: the lengths do not agree with each other.
    """
    first, last, unpacked, crc, size = _CHUNK_HEAD.unpack(stream.read(_CHUNK_HEAD.size))
    compression = stream.read(min(size, 16))
    (packed,) = struct.unpack("<Q", stream.read(8))
    if len(compression) != size or packed != length - _CHUNK_HEAD.size - size - 8:
        raise ValueError("lengths that do not agree")
    return _Chunk(start, length, unpacked, crc, compression, first, last)
