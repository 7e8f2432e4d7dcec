"""Read untrusted files, after a check of size and kind."""

import errno
import os
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from lsvision.errors import UnreadableFile
from lsvision.files.file_kinds import STDIN

MAX_FILE_BYTES = 2 * 10**9
"""Largest file that is read without ``--max-size``. Units: bytes."""
WRITER_TIMEOUT_S = 10.0
"""Longest wait until a program opens a named pipe for writing. Units: s."""

_POLL_S = 0.02  # time between two looks at a named pipe
_BINARY = getattr(os, "O_BINARY", 0)  # Windows: no conversion of line ends
_MESSAGES = {  # what is wrong, and the remedy
    errno.ENOENT: "no such file: check the name",
    errno.ENOTDIR: "no such file: check the name",
    errno.EISDIR: "a directory: name a file in it",
    errno.EACCES: "no permission to read it: check its owner and mode",
    errno.EPERM: "no permission to read it: check its owner and mode",
    errno.ELOOP: "a loop of symbolic links: check where they point",
    errno.ENAMETOOLONG: "the name is too long for a file: check it",
    errno.ENXIO: "a device or socket: name a file",
}

_limit: ContextVar[int] = ContextVar("size_limit", default=MAX_FILE_BYTES)


@contextmanager
def limit_file_size(limit: int) -> Iterator[None]:
    """Set the largest size, in bytes, of a file read in this thread within a ``with`` block.

    Examples
    --------
    >>> with limit_file_size(10):
    ...     get_size_limit()
    10
    """
    token = _limit.set(limit)
    try:
        yield
    finally:
        _limit.reset(token)


def get_size_limit() -> int:
    """Return the size limit of files, and of the data unpacked from them. Units: bytes."""
    return _limit.get()


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Return the content of a file, a named pipe or standard input (``"-"``).

    A named pipe is read as soon as a program opens it for writing; this may take up to
    `WRITER_TIMEOUT_S`.

    Raises
    ------
    UnreadableFile
        If there is no such file, it is a device, a directory or a socket, it is larger than
        `get_size_limit`, or no program opens the pipe; the message states the remedy.

    Examples
    --------
    >>> read_bytes("no_such_file.csv")
    Traceback (most recent call last):
        ...
    lsvision.errors.UnreadableFile: no_such_file.csv: no such file: check the name
    """
    name = os.fspath(path)
    with _name_file_in_errors(name):
        return _read_all(sys.stdin.buffer.read) if name == STDIN else _read(name)


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a UTF-8 file; see `read_bytes`.

    Raises
    ------
    UnreadableFile
        As `read_bytes`, and if the bytes are not UTF-8.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        got, remedy = f"byte 0x{error.object[error.start]:02x} at {error.start}", "save it as UTF-8"
        if error.object.startswith(b"\x93NUMPY"):
            got, remedy = "a NumPy array", "write it with numpy.savetxt, one row for each line"
        raise UnreadableFile(
            f"{os.fspath(path)}: expected a text file in UTF-8, got {got}: {remedy}"
        ) from None


def check_readable(path: str | os.PathLike[str]) -> None:
    """Raise the errors of `read_bytes` for a file that another library opens by its name.

    Raises
    ------
    UnreadableFile
        If there is no such file, it is not a regular one, it is larger than `get_size_limit`,
        or this user has no permission to read it.
    """
    name = os.fspath(path)
    with _name_file_in_errors(name):
        _check_regular(Path(name).stat())
        if not os.access(name, os.R_OK):
            raise UnreadableFile(_MESSAGES[errno.EACCES])


@contextmanager
def _name_file_in_errors(name: str) -> Iterator[None]:
    """Raise every error of a file as an UnreadableFile whose message begins with its name."""
    try:
        yield
    except UnreadableFile as error:
        raise UnreadableFile(f"{name}: {error}") from None
    except OSError as error:
        raise UnreadableFile(f"{name}: {_describe_failure(error)}") from None
    except ValueError:  # a null character, or one that the file system cannot encode
        raise UnreadableFile(f"{name}: no file can have this name: check it") from None


def _read(name: str) -> bytes:
    """Return the content of a regular file or a pipe; see `read_bytes` for the limits."""
    status = Path(name).stat()
    is_pipe = stat.S_ISFIFO(status.st_mode)
    if not is_pipe:
        _check_regular(status)
    # Without O_NONBLOCK, a pipe without a writer would block here, with no time limit.
    descriptor = os.open(name, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
    with open(descriptor, "rb", buffering=0) as file:  # noqa: PTH123 - Path takes no descriptor
        if is_pipe:
            start = _wait_for_writer(descriptor)
            os.set_blocking(descriptor, True)
            return _read_all(file.read, start)
        status = os.fstat(descriptor)
        _check_regular(status)  # again: the file may have been replaced since the first check
        # The whole file in one chunk; never 0 bytes, which would look like its end.
        return _read_all(file.read, chunk_size=status.st_size + 1)


def _read_all(
    read: Callable[[int], bytes | None], start: bytes = b"", chunk_size: int = 1 << 20
) -> bytes:
    """Return `start` and all bytes that `read` returns; stop with an error above the size limit."""
    chunks, size, limit = [start] if start else [], len(start), get_size_limit()
    while size <= limit and (chunk := read(chunk_size)):
        chunks.append(chunk)
        size += len(chunk)
    if size > limit:
        raise UnreadableFile(_describe_excess(None))
    return chunks[0] if len(chunks) == 1 else b"".join(chunks)


def _check_regular(status: os.stat_result) -> None:
    """Raise an error unless a file is a regular one within the size limit."""
    mode = status.st_mode
    if stat.S_ISDIR(mode):
        raise UnreadableFile(_MESSAGES[errno.EISDIR])
    if not stat.S_ISREG(mode):
        raise UnreadableFile("a device or socket: name a file, or - for standard input")
    if status.st_size > get_size_limit():
        raise UnreadableFile(_describe_excess(status.st_size))


def _describe_excess(size: int | None) -> str:
    """Return the message for a file that is too large; None if its size is not known."""
    got = "more" if size is None else _format_size(size)
    return (
        f"expected {_format_size(get_size_limit())} at most, got {got}: split the file, or "
        "increase the limit, such as --max-size 8GB"
    )


def _format_size(size: int) -> str:
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= factor:
            return f"{size / factor:.4g} {unit}"
    return f"{size} bytes"


def _wait_for_writer(descriptor: int) -> bytes:
    """Wait until a program has opened a pipe for writing; return what it has written so far."""
    deadline = time.monotonic() + WRITER_TIMEOUT_S
    while True:
        try:
            start = os.read(descriptor, 1 << 16)
        except BlockingIOError:  # opened for writing, nothing written yet
            return b""
        if start:
            return start
        if time.monotonic() > deadline:
            raise UnreadableFile(
                f"a named pipe that no program opened for writing within {WRITER_TIMEOUT_S:g} s: "
                "start the program that writes to it first"
            )
        time.sleep(_POLL_S)


def _describe_failure(error: OSError) -> str:
    """Return the message for an error of the operating system, with the remedy."""
    reason = error.strerror or str(error)
    return _MESSAGES.get(
        error.errno or 0, f"cannot be read ({reason}): check the disk and the name"
    )
