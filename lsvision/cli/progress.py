"""Progress bar on stderr."""

import shutil
import sys
import time

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
        self._start = time.monotonic()
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
        share = (done + part / parts) / self._total
        profiles = f", profile {part} of {parts}" if parts > 1 else ""
        line = (
            f"[{'#' * int(BAR * share):.<{BAR}}] {done}/{self._total}{profiles}"
            f"{_time_left(time.monotonic() - self._start, share)} {printable(name)}"
        )
        width = shutil.get_terminal_size().columns - 1
        sys.stderr.write(f"\r\x1b[K{line[:width]}")
        sys.stderr.flush()

    def clear(self) -> None:
        """Erase the bar, so that other lines can be written."""
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def _time_left(seconds: float, share: float) -> str:
    """Return what the rest takes if it goes on like this, after the first second."""
    if not 0 < share < 1 or seconds < 1:
        return ""
    return f", {duration_text(seconds * (1 - share) / share)} left"


def duration_text(seconds: float) -> str:
    """Return ``3 min 05 s`` or ``2 h 07 min``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min {rest:02} s"
