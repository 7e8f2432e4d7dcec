"""Functions that other processes run, which import only what they need."""

import os
import signal
import time
from pathlib import Path

IMPORTING_PROCESS = os.getpid()
"""The process that has imported this module, which differs from that of a task if it is forked."""


def square(number):
    return number * number


def waits_for_another_result_if_zero(task):
    """The number; zero comes when the caller, on another result, has made the file."""
    number, mark = task
    give_up = time.monotonic() + 120
    while number == 0 and not Path(mark).exists():
        if time.monotonic() > give_up:
            raise TimeoutError("no other result came")
        time.sleep(0.01)
    return number


def ends_its_process(task):
    """Ends the process at the first call, or at every call, of the tasks that say so."""
    number, folder, when = task
    mark = Path(folder) / f"{number}"
    if when == "always" or (when == "once" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def large(task):
    """The task reversed: of large tasks, both are larger than the buffer of a connection."""
    return task[::-1]


def local_function(_):
    """A result that cannot be pickled."""
    return lambda: None


def pid_then_sleep(seconds):
    """The id of the process, after a while."""
    time.sleep(seconds)
    return os.getpid()


def blocks_interrupts(_):
    """Whether the process was started with interrupts blocked, after a while."""
    time.sleep(0.1)
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


class FailsOnArrival:
    """A task that can be pickled, but raises an exception when the process receives it."""

    def __reduce__(self):
        return fails, (0,)


class EndsOnArrival:
    """A function that ends so many of the processes that receive it, or all without a folder."""

    def __init__(self, folder=None, times=0):
        self.folder, self.times = folder, times

    def __reduce__(self):
        return arrive, (self.folder, self.times)

    def __call__(self, number):
        return number


def arrive(folder, times):
    if folder is None or len(list(folder.iterdir())) < times:
        if folder is not None:
            (folder / str(os.getpid())).touch()
        os._exit(9)
    return EndsOnArrival(folder, times)


def fails(number):
    raise ValueError(f"task {number}")


class Killer:
    """Measures, but ends its process at the first profiles of so many points."""

    __name__ = "killer"

    def __init__(self, folder, length, times):
        self.folder, self.length, self.times = folder, length, times

    def __call__(self, profiles):
        if self.length in map(len, profiles):
            calls = len(list(self.folder.glob("call*")))
            if calls < self.times:
                (self.folder / f"call{calls}").touch()
                os._exit(9)
        from lsvision.measure import measure_profiles

        return measure_profiles(profiles)


def importing_process(_):
    return IMPORTING_PROCESS
