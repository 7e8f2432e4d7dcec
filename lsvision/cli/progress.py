"""Progress bar on stderr."""

import shutil
import sys

from lsvision.files.printable import printable

BAR = 24


class Progress:
    """Progress bar in one line; nothing is shown unless stderr is a terminal.

    Parameters
    ----------
    total : int
        How many files there are.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self.done = 0
        self._shown = sys.stderr.isatty()

    def show(self, done: int, name: str, part: int = 0, parts: int = 1) -> None:
        """Draw the bar.

        Parameters
        ----------
        done : int
            Files that are finished.
        name : str
            The current file.
        part, parts : int
            Number of its finished profiles, and of all its profiles.
        """
        self.done = done
        if not self._shown or self._total * parts == 1:
            return
        filled = int(BAR * (done + part / parts) / self._total)
        profiles = f", profile {part + 1} of {parts}" if parts > 1 else ""
        line = f"[{'#' * filled:.<{BAR}}] {done}/{self._total} {printable(name)}{profiles}"
        width = shutil.get_terminal_size().columns - 1
        sys.stderr.write(f"\r\x1b[K{line[:width]}")
        sys.stderr.flush()

    def clear(self) -> None:
        """Erase the bar, so that other lines can be written."""
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
