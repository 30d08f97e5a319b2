"""Reads an MCAP file from its begin to the last whole record, however it ended.

The library's reader wants a whole file. This one needs nothing but the order of records in the
data section, trusts no length that a file states, and knows where the good part ends.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import IO

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from protocol.errors import LogError
from tools.mcap_write import MAGIC, MESSAGE_FIELDS, MESSAGE_HEAD

MAX_CHUNK = 1 << 28  # of what a chunk may unpack to
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of compression
_PARSERS = {
    int(Opcode.HEADER): records.Header.read,
    int(Opcode.SCHEMA): records.Schema.read,
    int(Opcode.CHANNEL): records.Channel.read,
    int(Opcode.ATTACHMENT): records.Attachment.read,
    int(Opcode.METADATA): records.Metadata.read,
}

McapMessage = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns], data."""


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk stands in the file, and how its messages are packed."""

    start: int
    length: int
    unpacked: int
    crc: int
    compression: bytes


@dataclass
class McapScan:
    """What can be read of a file.

    Attributes:
        size: of the file.
        end: of its last whole record; what follows is lost.
        whole: the file was finished, and nothing is missing at its end.
        problem: why it is not whole.
        profile: from the header.
        channels: by id.
        schemas: by id.
        metadata, attachments: by name, the last one of each.
    """

    path: Path
    size: int
    end: int = len(MAGIC)
    whole: bool = False
    problem: str = ""
    profile: str = ""
    channels: dict[int, records.Channel] = field(default_factory=dict)
    schemas: dict[int, records.Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    _chunks: list[_Chunk] = field(default_factory=list)

    @classmethod
    def of(cls, path: Path) -> McapScan:
        """Scan a file. Chunks of one that is not whole are verified, and end it where they fail.

        Raises:
            LogError: missing, empty, not MCAP, or it cannot be read.
        """
        try:
            with path.open("rb") as stream:
                scan = cls(path, os.fstat(stream.fileno()).st_size)
                if stream.read(len(MAGIC)) != MAGIC:
                    what = "is not an MCAP file" if scan.size else "is empty"
                    raise LogError(f"{path}: {what}. Name a log that `hoap3` has written")
                scan._walk(stream)
                if not scan.whole:
                    scan.verify()
        except OSError as error:
            raise LogError(
                f"{path}: cannot be read ({error.strerror}). Name a log, or the folder of a run"
            ) from error
        return scan

    def messages(self) -> Iterator[McapMessage]:
        """Every message, in file order.

        Raises:
            LogError: a chunk of a finished file is damaged.
        """
        return chain.from_iterable(self.chunks())

    def chunks(self) -> Iterator[Iterator[McapMessage]]:
        """The same, chunk by chunk; each is to be used before the next is asked for."""
        with self.path.open("rb") as stream:
            for chunk in self._chunks:
                yield self._unpack(chunk, stream)

    def verify(self) -> None:
        """Check every chunk; the first damaged one is taken for the end of the file."""
        with self.path.open("rb") as stream:
            for place, chunk in enumerate(self._chunks):
                try:
                    for _ in self._unpack(chunk, stream):
                        pass
                except LogError:
                    self.whole, self.end = False, chunk.start - _RECORD.size
                    self.problem = f"a damaged chunk at byte {self.end}"
                    del self._chunks[place:]
                    return

    def _walk(self, stream: IO[bytes]) -> None:
        while True:
            head = stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                self.problem = f"it ends behind byte {self.end}, unfinished"
                return
            opcode, length = _RECORD.unpack(head)
            start = self.end + _RECORD.size
            if not opcode or start + length > self.size:
                self.problem = f"it ends inside a record that begins at byte {self.end}"
                return
            try:
                self._take(opcode, start, length, stream)
            except (McapError, ValueError, struct.error) as error:
                self.problem = f"a damaged record at byte {self.end} ({error!r:.60})"
                return
            self.end = start + length
            if opcode == Opcode.FOOTER:
                self.whole = stream.read() == MAGIC
                self.problem = "" if self.whole else "the mark at its end is missing"
                self.end = self.size if self.whole else self.end
                return
            stream.seek(self.end)

    def _take(self, opcode: int, start: int, length: int, stream: IO[bytes]) -> None:
        if opcode == Opcode.CHUNK:
            self._chunks.append(_read_chunk(start, length, stream))
            return
        parser = _PARSERS.get(opcode)
        if parser is None:
            stream.seek(length, os.SEEK_CUR)
            return
        match parser(ReadDataStream(BytesIO(stream.read(length)))):
            case records.Header(profile=profile):
                self.profile = profile
            case records.Channel() as channel:
                self.channels[channel.id] = channel
            case records.Schema() as schema:
                self.schemas[schema.id] = schema
            case records.Metadata(name=name, metadata=facts):
                self.metadata[name] = facts
            case records.Attachment(name=name, data=data):
                self.attachments[name] = data

    def _unpack(self, chunk: _Chunk, stream: IO[bytes]) -> Iterator[McapMessage]:
        raw, at, head = self._read(chunk, stream), 0, MESSAGE_HEAD.size
        while at < len(raw):
            if at + head > len(raw):
                raise self._damaged(chunk)
            opcode, length, channel, sequence, log, publish = MESSAGE_HEAD.unpack_from(raw, at)
            start, at = at + head, at + 9 + length
            if opcode != Opcode.MESSAGE or length < MESSAGE_FIELDS or at > len(raw):
                raise self._damaged(chunk)
            yield channel, sequence, log, publish, raw[start:at]

    def _read(self, chunk: _Chunk, stream: IO[bytes]) -> bytes:
        stream.seek(chunk.start + _CHUNK_HEAD.size + len(chunk.compression) + 8)
        data = stream.read(chunk.length - _CHUNK_HEAD.size - len(chunk.compression) - 8)
        if chunk.unpacked > MAX_CHUNK:
            raise self._damaged(chunk)
        if chunk.compression == b"zstd":
            try:
                if zstandard.frame_content_size(data) != chunk.unpacked:
                    raise self._damaged(chunk)
                data = zstandard.ZstdDecompressor().decompress(data)
            except zstandard.ZstdError as error:
                raise self._damaged(chunk) from error
        elif chunk.compression:
            raise self._damaged(chunk)
        if len(data) != chunk.unpacked or (chunk.crc and zlib.crc32(data) != chunk.crc):
            raise self._damaged(chunk)
        return data

    def _damaged(self, chunk: _Chunk) -> LogError:
        return LogError(
            f"{self.path}: the chunk at byte {chunk.start - _RECORD.size} is damaged. "
            "`hoap3 record --repair` saves what stands before it"
        )


def _read_chunk(start: int, length: int, stream: IO[bytes]) -> _Chunk:
    """Read what stands before the messages.

    Raises:
        struct.error, ValueError: the lengths do not agree with each other.
    """
    _, _, unpacked, crc, size = _CHUNK_HEAD.unpack(stream.read(_CHUNK_HEAD.size))
    compression = stream.read(min(size, 16))
    (packed,) = struct.unpack("<Q", stream.read(8))
    if len(compression) != size or packed != length - _CHUNK_HEAD.size - size - 8:
        raise ValueError("lengths that do not agree")
    return _Chunk(start, length, unpacked, crc, compression)
