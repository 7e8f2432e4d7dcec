"""Settings of the process of a command, made before typer and numpy are imported."""

import gc
import os
import re
import sys
import warnings
from collections.abc import Sequence

from lsvision.batch.thread_limits import THREAD_VARIABLES

GARBAGE_THRESHOLD = 50_000
"""Number of new objects after which Python searches for unreachable ones. With its own, 700 or
2000, it does so 130 times while modules are imported, a tenth of the time of a short command."""

_SEVERAL_JOBS = re.compile(r"--jobs[= ]0*([2-9]|[1-9]\d+)(?= |$)", re.ASCII)
"""Option for two jobs or more. It is searched in the text of the command, since the options are
parsed only after typer is imported, and the server then starts too late to save time."""


def prepare_process(arguments: Sequence[str]) -> None:
    """Set garbage collection, streams, threads and warnings; start a fork server for several jobs.

    Parameters
    ----------
    arguments : sequence of str
        Arguments of the command.
    """
    gc.set_threshold(GARBAGE_THRESHOLD)
    open_closed_streams()
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    # The commands report implausible units themselves, unless --units states them.
    warnings.filterwarnings("ignore", "expected a profile in mm", UserWarning)
    # Processes that this one starts get its -W options.
    sys.warnoptions.append("ignore:expected a profile in mm:UserWarning")
    # On macOS system libraries do not work in forked processes, and Windows has none.
    if sys.platform == "linux" and _SEVERAL_JOBS.search(" ".join(arguments)):
        from lsvision.batch.process_pool import start_fork_server

        start_fork_server("lsvision.cli.preloaded")


def open_closed_streams() -> None:
    """Open the null device as each closed standard stream, as ``>&-`` or a service leaves it.

    Python sets such a stream to None, and a file that is opened later would get its descriptor.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
