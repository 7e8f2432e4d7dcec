"""A task of ``lsvision measure``, as each of its processes runs it.

Neither this module nor those that it imports import typer, so that a process starts faster.
"""

from dataclasses import dataclass
from pathlib import Path

from lsvision.cli.file_part import FilePart, PartOptions
from lsvision.cli.image_sources import LiveCamera
from lsvision.cli.part_results import PartResult, measure_files, measure_parts
from lsvision.files.limited_reading import size_limit


@dataclass(frozen=True, eq=False)
class MeasureTask:
    """Small files, a part of a larger one, or the error of reading it.

    Parameters
    ----------
    first : int
        Number of the first of the files, from 0.
    sources : tuple of Path or LiveCamera
        Small files, which are read in the task, or the larger file.
    part : FilePart, optional
        Part of the larger file.
    profiles_read : int
        Number of profiles of the larger file that are read so far.
    error : str
        Error of reading the larger file.
    """

    first: int
    sources: tuple[Path | LiveCamera, ...]
    part: FilePart | None = None
    profiles_read: int = 0
    error: str = ""


def measure_task(options: PartOptions, task: MeasureTask) -> list[PartResult]:
    """Return the results of a task: one for each small file, or one for the part or the error."""
    if task.error:
        return [PartResult(errors=[task.error])]
    if task.part is not None:
        return measure_parts(options, [task.part])
    with size_limit(options.max_size):
        return measure_files(options, [Path(str(source)) for source in task.sources])
