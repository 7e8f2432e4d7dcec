"""Progress of a command in one line on stderr."""

import shutil
import sys
import time

from lsvision.files.printable import printable

BAR_WIDTH = 24
"""Width of the bar. Units: characters."""


class StatusLine:
    """Line that is overwritten; nothing is shown unless stderr is a terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()

    def write(self, text: str) -> None:
        """Replace the text of the line."""
        if self._shown:
            sys.stderr.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
            sys.stderr.flush()

    def clear(self) -> None:
        """Erase the line, so that others can be written."""
        self.write("")


class Progress(StatusLine):
    """Progress bar over files; `done` is the number of finished ones.

    Parameters
    ----------
    total : int
        Number of files.
    """

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total = total
        self._start = time.monotonic()
        self.done = 0

    def show(self, done: int, name: str, part: int = 0, parts: int = 1) -> None:
        """Draw the bar and the status beside it.

        Parameters
        ----------
        done : int
            Number of finished files.
        name : str
            Name of the current file.
        part, parts : int
            Number of finished profiles of the current file, and number of its profiles, as far as
            it is known; 1 for a file that is measured as a whole.
        """
        self.done = done
        if self._total * parts <= 1:  # nothing to show for a single profile, or without files
            return
        fraction = (done + part / parts) / self._total
        profiles = f", profile {part} of {parts}" if parts > 1 else ""
        self.write(
            f"[{'#' * int(BAR_WIDTH * fraction):.<{BAR_WIDTH}}] {done}/{self._total}{profiles}"
            f"{_time_left(time.monotonic() - self._start, fraction)} {printable(name)}"
        )


def _time_left(seconds: float, fraction: float) -> str:
    """Return the estimated remaining time as text; "" in the first second, and at the end."""
    if not 0 < fraction < 1 or seconds < 1:
        return ""
    return f", {duration_text(seconds * (1 - fraction) / fraction)} left"


def duration_text(seconds: float) -> str:
    """Return a duration as text: ``3 min 05 s`` or ``2 h 07 min``."""
    minutes, seconds_left = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min {seconds_left:02} s"
