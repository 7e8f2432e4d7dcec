"""Many profiles in Python, measured in parallel."""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from numbers import Integral
from typing import TYPE_CHECKING, Any

from lsvision.batch.process_pool import EndedProcess, count_usable_cores, run_tasks
from lsvision.errors import LsvisionError
from lsvision.measure import PROFILES_AT_ONCE, Measurement, measure_profiles
from lsvision.profile import Profile, as_profile, require_several

if TYPE_CHECKING:
    import numpy.typing as npt


def measure_many(
    profiles: "Iterable[Profile | npt.ArrayLike]", *, jobs: int | None = None, **options: Any
) -> Iterator[Measurement]:
    """Measure many profiles in parallel.

    Parameters
    ----------
    profiles : iterable of Profile, (n, 2) array_like or data frame
        Profiles, read lazily, a bounded number ahead of the results: a generator may be endless.
    jobs : int, optional
        Number of processes; 1 measures in the calling process. Default: the number of cores. A
        script that uses more than 1 needs ``if __name__ == "__main__":``, since each process
        imports it.
    **options
        Arguments of `measure_cylinders`: radius, known_radius, known_phi, sensor, settings.

    Returns
    -------
    iterator of Measurement
        In the order of the profiles; the same as by `measure_cylinders`, up to rounding.

    Raises
    ------
    ValueError, TypeError
        As `measure_cylinders`, and if `jobs` is below 1.
    LsvisionError
        If a process ended twice (out of memory) while it measured the same group of up to
        `PROFILES_AT_ONCE` profiles; the message has their indices. Or if processes end while they
        start.
    Exception
        What reading `profiles` raises, after the measurements of those before.

    Examples
    --------
    >>> import lsvision as lsv
    >>> profiles = [lsv.simulate.random_section("single", seed).profile for seed in (7, 8)]
    >>> [len(measurement.cylinders) for measurement in measure_many(profiles, jobs=1)]
    [1, 1]
    """
    given: object = count_usable_cores() if jobs is None else jobs
    if isinstance(given, bool) or not isinstance(given, Integral):
        raise TypeError(f"expected jobs as a whole number, got {type(given).__name__} {given!r}")
    count = int(given)
    if count < 1:
        raise ValueError(f"expected jobs >= 1, got {count}")
    require_several(profiles)
    return _measure_many(profiles, count, options)


def _measure_many(
    profiles: "Iterable[Profile | npt.ArrayLike]", jobs: int, options: dict[str, Any]
) -> Iterator[Measurement]:
    """Yield the measurement of each profile; groups of them are measured in `jobs` processes."""
    measured = 0
    groups = _split_into_groups(map(as_profile, profiles))
    for task, measurements in run_tasks(
        partial(_measure_group, options), groups, jobs, ordered=True
    ):
        if isinstance(measurements, EndedProcess):
            last = measured + len(task) - 1
            raise LsvisionError(
                f"profiles {measured} to {last} ended their process twice (out of memory): measure "
                "them with jobs=1"
            )
        yield from measurements
        measured += len(task)


def _measure_group(options: dict[str, Any], profiles: list[Profile]) -> list[Measurement]:
    """Measure a group of profiles; a function of the module, so that it can be pickled."""
    return measure_profiles(profiles, **options)


def _split_into_groups(profiles: Iterator[Profile]) -> Iterator[list[Profile]]:
    """Yield groups of profiles; an error of the iterator is raised after the profiles before it."""
    while True:
        group: list[Profile] = []
        try:
            # If the iterator fails, the group keeps the profiles that came before.
            group.extend(islice(profiles, PROFILES_AT_ONCE))
        except Exception:
            if group:
                yield group
            raise
        if not group:
            return
        yield group
