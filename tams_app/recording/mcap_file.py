"""An MCAP file of all that is logged in a context of the SDK; its memory does not grow.

The SDK keeps the index of each chunk that it makes until the file ends, about 1 kB for 25 channels.
So it hands over records without chunks; we make those, and the disk keeps the indexes.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

from foxglove import Context, open_mcap
from foxglove.mcap import MCAPWriteOptions

from tams_app.errors import LogError
from tams_app.recording.disk import LogFile, ScratchFile
from tams_app.recording.mcap_chunks import Chunks

CHUNK_BYTES = 1024 * 1024


class McapFile:
    """Chunks are written whole, with their message indexes, so that a kill leaves whole ones.

    Use it from one thread at a time: the SDK keeps the GIL while it waits for its own lock, and
    our part needs the GIL to take a record, so two threads would wait for each other for ever.
    """

    def __init__(self, path: Path, context: Context, profile: str) -> None:
        """Create the file; LogError if it or its folder cannot be used."""
        self._indexes = ScratchFile(path.parent)
        try:
            self._file = LogFile(path)
        except LogError:
            self._indexes.close()
            raise
        self._offset = 0
        self._checksum = 0
        self._closed = False
        self._chunks = Chunks()
        head = bytearray()  # of the file, in no chunk
        self._inlet = _Inlet(head.extend)
        self._mcap = open_mcap(
            self._inlet,
            context=context,
            writer_options=MCAPWriteOptions(
                use_chunks=False,
                profile=profile,
                disable_seeking=True,
                emit_statistics=False,  # the summary is ours
                emit_summary_offsets=False,
                repeat_channels=False,
                repeat_schemas=False,
                calculate_data_section_crc=False,
            ),
        )
        self._mcap.flush()
        self._write(bytes(head))
        self._inlet.receive = self._chunks.receive

    @property
    def chunk_is_full(self) -> bool:
        """Whether what waits is as much as a chunk should hold: time to `flush`."""
        return self._chunks.waiting_bytes >= CHUNK_BYTES

    @property
    def size_bytes(self) -> int:
        return self._offset

    def flush(self) -> None:
        """Finish the chunk and hand it to the system; LogError if the disk refused."""
        self._finish_chunk()
        self._file.check()

    def close(self) -> None:
        """Finish the file, or cut it after its last whole chunk; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self._finish_chunk()
        self._inlet.receive = _ignore  # the SDK's own end of the file
        self._mcap.close()
        try:
            indexes = self._indexes.read()
        except OSError as error:
            self._file.fail(error)
        else:
            self._write(self._chunks.ending(self._offset, self._checksum, indexes))
        self._indexes.close()
        self._file.close()  # of an error the owner has learned from `flush`

    def _finish_chunk(self) -> None:
        self._mcap.flush()
        if (finished := self._chunks.finish(self._offset)) is None:
            return
        self._write(finished.data)
        try:
            self._indexes.write(finished.index)
        except OSError as error:
            self._file.fail(error)

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._offset += len(data)
        self._checksum = zlib.crc32(data, self._checksum)


class _Inlet:
    """The file as the SDK sees it; it hands over pieces of records."""

    def __init__(self, receive: Callable[[bytes | bytearray], None]) -> None:
        self.receive = receive
        self._received_bytes = 0

    def write(self, data: bytes | bytearray) -> int:
        self.receive(data)
        self._received_bytes += len(data)
        return len(data)

    def seek(self, _offset: int, _whence: int = os.SEEK_SET) -> int:
        """The SDK only asks where it is."""
        return self._received_bytes

    def flush(self) -> None:
        """The chunk is finished by the file's owner, outside of the SDK's lock."""


def _ignore(_data: bytes | bytearray) -> None:
    pass
