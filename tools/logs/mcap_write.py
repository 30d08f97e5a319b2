"""One MCAP file as it is written, in chunks that are cut when the caller says so.

The library's own `mcap.writer.Writer` can be told when to cut (`flush`), but takes 4 to 5 µs for
a message of ours, since it builds each record from a dozen small writes; lockstep runs ask for a
third of that. Here a message is one `struct.pack` and three appends, index entries are made with
numpy when a chunk is cut, and everything else is left to the library's record classes. The file
has all that the library's has: chunk and message indexes, statistics, summary, attachments,
metadata, and CRCs, also of the data section.
"""

from __future__ import annotations

import errno
import os
import struct
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from hoap3.protocol.errors import UsageError
from hoap3.tools.logs.files import lock_shared

BLOCK = 1 << 20  # bytes of a file that are summed up together
MAGIC = b"\x89MCAP0\r\n"
ZSTD_LEVEL = -1  # 0.4 µs a message, 1 µs on noise; level 3 takes 2.5 µs there to save 4 %
MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log, publish
MESSAGE_FIELDS = MESSAGE_HEAD.size - 9
_MESSAGE = int(Opcode.MESSAGE)
_LOG_TIME = np.arange(15, 23)  # its bytes in a message record
_INDEX_HEAD = struct.Struct("<BQHI")


class McapFile:
    """A new file. Nothing is left in this process once `cut` or `flush` has returned.

    Args:
        path: must not exist.
        profile, library: for the header.
        compress: chunks with zstd.

    Attributes:
        chunk: what has been gathered since the last cut.
        size: bytes in the file.

    Raises:
        UsageError: the file exists already, or cannot be made.
        OSError: a write failed, such as for want of space. The chunk at hand is lost then; the
            file ends behind the last one that was written, and more can be added.
    """

    def __init__(self, path: Path, profile: str, library: str, *, compress: bool = True) -> None:
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError as error:
            raise UsageError(f"{path}: exists already. Choose another place") from error
        except OSError as error:
            raise UsageError(
                f"{path}: cannot be made ({error.strerror}). Name a folder that can be written"
            ) from error
        lock_shared(self._fd)
        self.path = path
        self.size = 0
        self.chunk = bytearray()
        self._offsets: dict[int, list[int]] = {}  # of each channel's messages in the chunk
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL) if compress else None
        self._crc = 0
        self._pending: Any = RecordBuilder()
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._chunks: list[records.ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._pending.write(MAGIC)
        records.Header(profile, library).write(self._pending)

    def add(self, record: records.McapRecord) -> None:
        """Append a schema, a channel, metadata or an attachment."""
        self.cut()
        start = self.size + self._pending.count
        record.write(self._pending)
        length = self.size + self._pending.count - start
        match record:
            case records.Schema():
                self._schemas.append(record)
            case records.Channel():
                self._channels.append(record)
                self._offsets[record.id] = []
                self._counts[record.id] = 0
            case records.Metadata():
                index = records.MetadataIndex(start, length, record.name)
                self._metadata.append(index)
            case records.Attachment():
                self._attachments.append(
                    records.AttachmentIndex(
                        offset=start,
                        length=length,
                        log_time=record.log_time,
                        create_time=record.create_time,
                        data_size=len(record.data),
                        name=record.name,
                        media_type=record.media_type,
                    )
                )

    def message(
        self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes
    ) -> None:
        """Append a message to the chunk; stamps in ns, not negative; `sequence` below 2³²."""
        chunk = self.chunk
        self._offsets[channel].append(len(chunk))
        chunk += MESSAGE_HEAD.pack(
            _MESSAGE, MESSAGE_FIELDS + len(data), channel, sequence, log_time, publish_time
        )
        chunk += data

    def cut(self) -> None:
        """End the chunk and hand it to the operating system, where there is one."""
        if not self.chunk:
            return
        if not os.fstat(self._fd).st_nlink:
            raise FileNotFoundError(errno.ENOENT, f"{self.path} was deleted while it was written")
        self.flush()
        raw, self.chunk = self.chunk, bytearray()
        entries = {channel: _index(raw, at) for channel, at in self._offsets.items() if at}
        self._offsets = {channel: [] for channel in self._offsets}
        data = bytes(raw) if self._compressor is None else self._compressor.compress(raw)
        chunk = records.Chunk(
            compression="" if self._compressor is None else "zstd",
            data=data,
            message_start_time=min(int(found[:, 0].min()) for found in entries.values()),
            message_end_time=max(int(found[:, 0].max()) for found in entries.values()),
            uncompressed_crc=zlib.crc32(raw),
            uncompressed_size=len(raw),
        )
        start = self.size
        chunk.write(self._pending)
        length = self._pending.count
        offsets: dict[int, int] = {}
        for channel, found in entries.items():
            offsets[channel] = start + self._pending.count
            head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + found.nbytes, channel, found.nbytes)
            self._pending.write(head + found.tobytes())
        total = self._pending.count
        self.flush()
        for channel, found in entries.items():
            self._counts[channel] += len(found)
        self._chunks.append(
            records.ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=len(data),
                message_end_time=chunk.message_end_time,
                message_index_length=total - length,
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=len(raw),
            )
        )

    def flush(self) -> None:
        """Hand everything but the chunk at hand to the operating system."""
        data = self._pending.end()
        written = 0
        try:
            while written < len(data):
                written += os.write(self._fd, data[written:] if written else data)
        except OSError:
            os.ftruncate(self._fd, self.size)  # no half record
            os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def finish(self) -> None:
        """Cut the last chunk, write the summary and close the file."""
        try:
            self.cut()
            self.flush()
            records.DataEnd(self._crc).write(self._pending)
            self.flush()
            self._summarise()
            self.flush()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the file as it is, without what would tell a reader that it is whole.

        Once is enough, twice does no harm.
        """
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _summarise(self) -> None:
        start, builder = self.size, self._pending
        statistics = records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_start_time=min((index.message_start_time for index in self._chunks), default=0),
            message_end_time=max((index.message_end_time for index in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: tuple[tuple[Opcode, list[Any]], ...] = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        offsets: list[records.SummaryOffset] = []
        for opcode, group in groups:
            begin = builder.count
            for record in group:
                record.write(builder)
            if group:
                offsets.append(records.SummaryOffset(opcode, start + begin, builder.count - begin))
        offset_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        # the CRC covers the summary and the footer up to the CRC itself
        builder.write(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start))
        summary = builder.end()
        builder.write(summary + struct.pack("<I", zlib.crc32(summary)) + MAGIC)


def crc_before(stream: IO[bytes], end: int) -> int:
    """CRC of a file before `end`."""
    crc = 0
    stream.seek(0)
    for start in range(0, end, BLOCK):
        crc = zlib.crc32(stream.read(min(BLOCK, end - start)), crc)
    return crc


def _index(chunk: bytearray, offsets: list[int]) -> npt.NDArray[np.uint64]:
    """Log time and offset of the messages at `offsets`, (m, 2)."""
    entries = np.empty((len(offsets), 2), "<u8")
    entries[:, 1] = offsets
    places = entries[:, 1, None] + _LOG_TIME.astype("<u8")
    entries[:, 0] = np.frombuffer(chunk, np.uint8)[places].view("<u8")[:, 0]
    return entries
