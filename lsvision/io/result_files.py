"""Writers of the results of a run: files that are complete at any time, and streams."""

import io
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Any, Protocol, TextIO

from lsvision.errors import UnwritableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.file_kinds import STDOUT
from lsvision.io.results import CsvFormat, JsonFormat

CHECKPOINT_S = 1.0
"""Shortest time between two rewrites of a file. Units: s."""
MAX_WRITING_FRACTION = 0.05
"""Largest fraction of the run time that is spent on rewriting a file."""
SPOOL_BYTES, CHUNK_BYTES = 8 * 10**6, 10**6
"""Largest text that is kept in memory (a longer one is kept in a temporary file), and the size of
the pieces in which it is copied."""


class ResultFormat(Protocol):
    """Format of a file of results: `head`, then the text of each result, then `tail`."""

    @property
    def head(self) -> str:
        """Text before the results."""
        ...

    @property
    def tail(self) -> str:
        """Text after the results."""
        ...

    def prepare(self, results: Sequence[Any]) -> bool:
        """Prepare for results that are written next; return whether that has changed the head.

        If so, the text of the results written before is passed to `convert`.
        """
        ...

    def format_item(self, result: Any) -> str:
        """Return the text of the next result."""
        ...

    def convert(self, text: TextIO, head: str) -> Iterator[str]:
        """Yield text that was written under another head, as it is under the present one."""
        ...


class ResultFiles:
    """The JSON and the CSV file of a run, each on a disk or on standard output.

    A file is rewritten completely from time to time during the run: if the run is killed, only the
    results since the last rewrite are lost. Each result is written to standard output immediately,
    with the columns of the first one. Without any result, nothing is written unless `write_empty`.

    Parameters
    ----------
    json_file, csv_file : Path, optional
        ``-`` is standard output.
    frame : {"base", "flange"}, optional
        Frame of the robot in which cylinders are placed.
    formats : (ResultFormat, ResultFormat), optional
        Formats of the JSON and the CSV file; those of measurements unless given.
    write_empty : bool
        Whether the files are written without any result, too, so that none of an earlier run stays.
    """

    def __init__(
        self,
        json_file: Path | None,
        csv_file: Path | None,
        frame: str | None = None,
        *,
        formats: tuple[ResultFormat, ResultFormat] | None = None,
        write_empty: bool = False,
    ) -> None:
        json_format, csv_format = formats or (JsonFormat(), CsvFormat(frame))
        outputs = [(json_file, json_format), (csv_file, csv_format)]
        # Files before the stream: a closed pipe must not lose a result in the files.
        self._files: list[_RewrittenFile | _Stream] = [
            _RewrittenFile(path, format_, write_empty=write_empty)
            for path, format_ in outputs
            if path is not None and path != STDOUT
        ]
        self._files += [
            _Stream(sys.stdout, format_, write_empty=write_empty)
            for path, format_ in outputs
            if path == STDOUT
        ]

    def add(self, results: Sequence[Any]) -> None:
        """Add results; if a file cannot be written now, it is tried again at the end."""
        for file in self._files:
            file.add(results)

    def finish(self) -> None:
        """Write the remaining results.

        Raises
        ------
        UnwritableFile
            If a file cannot be written; the other one is written nevertheless.
        """
        failures = []
        for file in self._files:
            try:
                file.finish()
            except UnwritableFile as error:
                failures.append(error)
            finally:
                file.close()
        if failures:
            raise failures[0]


class _Stream:
    """An open stream to which each record is written immediately."""

    def __init__(self, stream: TextIO, format_: ResultFormat, *, write_empty: bool) -> None:
        self._stream, self._format, self._started = stream, format_, False
        self._write_empty = write_empty

    def add(self, results: Sequence[Any]) -> None:
        if results:
            self._start(results)
        self._stream.write("".join(map(self._format.format_item, results)))
        self._stream.flush()

    def _start(self, results: Sequence[Any]) -> None:
        """Write the head, unless it is written."""
        if not self._started:
            self._started = True
            self._format.prepare(results)  # later attributes get no column
            self._stream.write(self._format.head)

    def finish(self) -> None:
        if self._write_empty:
            self._start([])
        if self._started:
            self._stream.write(self._format.tail)
            self._stream.flush()

    def close(self) -> None:
        """Leave standard output open."""


class _RewrittenFile:
    """A file that is rewritten from time to time; a long text is kept on disk, not in memory."""

    def __init__(self, path: Path, format_: ResultFormat, *, write_empty: bool) -> None:
        self._path, self._format = path, format_
        self._body = _open_spool()
        self._unwritten, self._next_rewrite = write_empty, time.monotonic() + CHECKPOINT_S

    def add(self, results: Sequence[Any]) -> None:
        """Add results, and rewrite the file if the last time is long enough ago."""
        head = self._format.head
        if self._format.prepare(results):
            self._convert_earlier(head)
        for result in results:
            self._body.write(self._format.format_item(result).encode("utf-8", "backslashreplace"))
        self._unwritten |= bool(results)
        start = time.monotonic()
        if start >= self._next_rewrite:
            with suppress(UnwritableFile):  # a full disk may have free space again at the end
                self._rewrite()
            stop = time.monotonic()
            self._next_rewrite = stop + max(CHECKPOINT_S, (stop - start) / MAX_WRITING_FRACTION)

    def finish(self) -> None:
        self._rewrite()

    def _rewrite(self) -> None:
        """Write the file completely, if a result came since the last time."""
        if self._unwritten:
            write_atomic(self._path, self._iterate_chunks())
            self._unwritten = False

    def close(self) -> None:
        self._body.close()

    def _iterate_chunks(self) -> Iterator[bytes]:
        yield self._format.head.encode()
        self._body.seek(0)
        while chunk := self._body.read(CHUNK_BYTES):
            yield chunk
        yield self._format.tail.encode()

    def _convert_earlier(self, head: str) -> None:
        """Convert the text of the earlier results, written under `head`, to the present head."""
        self._body.seek(0)
        earlier_text, self._body = io.TextIOWrapper(self._body, "utf-8", newline=""), _open_spool()
        with earlier_text:
            for text in self._format.convert(earlier_text, head):
                self._body.write(text.encode("utf-8", "backslashreplace"))


def _open_spool() -> SpooledTemporaryFile[bytes]:
    return SpooledTemporaryFile(SPOOL_BYTES)
