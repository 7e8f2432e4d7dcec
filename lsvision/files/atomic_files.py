"""Files that are written completely or not at all."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterable
from pathlib import Path

from lsvision.errors import UnwritableFile


def write_atomic(path: str | os.PathLike[str], content: str | bytes | Iterable[bytes]) -> None:
    """Write a file so that a reader finds the complete old or new file, never a part of it.

    The content is written to a new file in the same folder, which then replaces the old one; a link
    is followed, an existing file keeps its permissions. Devices and pipes (``/dev/stdout``) cannot
    be replaced and are written to directly. Text is written as UTF-8 with unchanged line ends;
    characters that UTF-8 cannot encode (a surrogate from a file name) as escape sequences.

    Raises
    ------
    UnwritableFile
        If the folder is missing, not writable or full, or the path is a directory; no part of
        the new file is left.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "result.json"
    >>> write_atomic(path, "{}")
    >>> path.read_text(), len(list(path.parent.iterdir()))
    ('{}', 1)
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    chunks = [data] if isinstance(data, bytes) else data
    try:
        given, target = Path(path), Path(os.path.realpath(path))
        # The real path of /dev/stdout does not exist if that is a pipe.
        if given.exists() and not given.is_file() and not given.is_dir():
            with given.open("wb") as file:
                file.writelines(chunks)
        elif target.is_symlink():  # realpath stops at a loop
            raise OSError(errno.ELOOP, "a loop of symbolic links")
        else:
            _replace(target, chunks)
    except (OSError, ValueError) as error:
        raise UnwritableFile(f"{os.fspath(path)}: {_describe_failure(error)}") from None


def _replace(target: Path, chunks: Iterable[bytes]) -> None:
    """Write a temporary file beside the target, then rename it to the target."""
    if target.is_dir():
        raise IsADirectoryError
    temporary = target.with_name(f".lsvision.{secrets.token_hex(8)}.part")
    try:
        with temporary.open("xb") as file:
            file.writelines(chunks)
            file.flush()
            os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, temporary)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def _describe_failure(error: OSError | ValueError) -> str:
    """Return why a file could not be written, and the remedy."""
    if isinstance(error, IsADirectoryError):
        return "a directory: name a file in it"
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return "its folder does not exist: create it first, or name another"
    if isinstance(error, PermissionError):
        return "no permission to write there: name another folder"
    reason = error.strerror if isinstance(error, OSError) else error
    return f"cannot be written ({reason}): name another file or free space"
