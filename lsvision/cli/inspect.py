"""``lsvision inspect``: a job and profiles in, OK, NG or undecided out."""

import datetime
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lsvision.cli.image_options import parse_imaging, reject_reading_of_images
from lsvision.cli.image_sources import JOB, holds_images, read_image_source
from lsvision.cli.messages import FAILED, print_error, print_lines
from lsvision.cli.option_groups import expand_option_groups
from lsvision.cli.outputs import check_outputs
from lsvision.cli.profile_options import JsonFile, ReadingOptions
from lsvision.cli.sources import (
    MEASURED_SUFFIXES,
    find_sources,
    list_suffixes_of_profiles,
    read_sources,
    require_points_of_scan,
)
from lsvision.cli.verdict_outputs import VerdictOutputs, VerdictPaths, make_page
from lsvision.errors import LsvisionError
from lsvision.files.file_kinds import STDOUT, is_directory
from lsvision.files.printable import escape_name, escape_text
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from lsvision.geometry import Pose
    from lsvision.inspection.job import Job
    from lsvision.inspection.judged_measurements import JudgedMeasurement
    from lsvision.io.profiles import ReadOptions
    from lsvision.measure import Measurement
    from lsvision.scan import ScanMeasurement

_KEYS_BY_OPTION = {
    "feed": "feed",
    "step": "step_mm",
    "poses": "poses",
    "convention": "convention",
    "flange-from-section": "flange_from_section",
}
"""Keys of [scan] and [rig] in a job, by the options of ``lsvision scan``."""
EXIT_CODES = {"OK": 0, "NG": 3, "undecided": 4}
"""Exit code for each verdict, if it is the worst; `FAILED` if a file could not be judged."""


@expand_option_groups
def inspect(
    *,
    job_file: Annotated[Path, typer.Argument(metavar="JOB.toml", help="Parts and limits.")],
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE|DIR|GLOB",
            help="Profiles, each a part; with [scan] in the job each folder is a scan.",
        ),
    ],
    json_file: JsonFile = None,
    csv_file: Annotated[
        Path | None,
        typer.Option(
            "--csv", metavar="F", help="Write one quantity per row; - is standard output."
        ),
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option(metavar="F", help="Write the rows of --csv as Parquet.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="F.html", help="Write a page with pictures, also for A4."),
    ] = None,
    golden: Annotated[
        bool, typer.Option("--golden", help="The files show the golden part: check and log it.")
    ] = False,
    reading: ReadingOptions,
) -> None:
    """Judge measured parts by a job: OK, NG or undecided, with the reason of each.

    A quantity is OK where its interval lies inside the limits, NG where it lies wholly outside,
    else undecided, with what would decide it. Exit code 0 for OK, 3 for NG, 4 for undecided, 1
    for a file that cannot be judged.

    \b
      lsvision inspect fixtures/jobs/welded_pair.toml fixtures/welded_pair.csv --report pair.html
      lsvision inspect job.toml parts --json verdicts.json --csv verdicts.csv
      lsvision inspect fixtures/jobs/scan_welded_pair.toml fixtures/scan_welded_pair
      lsvision inspect job.toml golden.csv --golden
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.inspection.golden import build_golden_log_path, find_blocking_reason
    from lsvision.inspection.history import read_records
    from lsvision.inspection.job import Job

    if report is not None and report.suffix.lower() not in (".html", ".htm"):
        raise typer.BadParameter(f"expected --report F.html, got {report.name!r}")
    if golden and any((json_file, csv_file, parquet, report)):
        raise typer.BadParameter("expected --golden without output files: its checks are logged")
    options = reading.parse()
    job = Job.load(job_file)
    has_rig = job.rig.light_section is not None
    suffixes = MEASURED_SUFFIXES if has_rig else list_suffixes_of_profiles(reading.dx)
    groups, missing = _group_files(files, suffixes, is_scan=job.scan is not None)
    inputs = [job_file, *_list_rig_files(job, job_file.parent)]
    inputs += [source for _, sources in groups for source in sources]
    check_outputs((parquet, report), inputs, streams=(json_file, csv_file))
    _print_notes_on_job(job, job_file)
    now = datetime.datetime.now(datetime.UTC)
    run = _Run(job, job_file, options)
    run.require_profiles(groups)
    for failure in missing:
        run.fail("", failure)
    if golden:
        raise typer.Exit(_check_golden(run, groups, build_golden_log_path(job, job_file), now))
    log = (
        read_records(build_golden_log_path(job, job_file), "passed")
        if job.golden is not None
        else []
    )
    outputs = VerdictOutputs(
        VerdictPaths(json_file, csv_file, parquet, report),
        partial(make_page, job, run.calibration, log, now, run.failures),
        run.failures,
    )
    blocked = find_blocking_reason(job, log, now, run.calibration)
    _inspect_all(run, groups, blocked, outputs, to_stderr=STDOUT in (json_file, csv_file))


def _list_rig_files(job: "Job", folder: Path) -> list[Path]:
    """Return the files that [rig] of a job names, relative to its folder."""
    rig = job.rig
    files = [folder / name for name in filter(None, (rig.light_section, rig.flange_from_section))]
    if rig.poses is not None:
        from lsvision.io.robot_poses import find_pose_files

        files += find_pose_files(folder / rig.poses)
    return files


def _print_notes_on_job(job: "Job", path: Path) -> None:
    """Print whether the job was changed without being recorded, and which keys are not used."""
    from lsvision.inspection.history import describe_unrecorded_change
    from lsvision.inspection.unused_keys import describe_unused_keys

    for note in (describe_unrecorded_change(job, path), describe_unused_keys(job)):
        if note:
            print_error(f"{path}: note: {note}")


class _Run:
    """Job of a run, how its files are read, and number of files that failed.

    Paths in the job are relative to the folder of `path`, its file.
    """

    def __init__(self, job: "Job", path: Path, reading: "ReadOptions") -> None:
        from lsvision.inspection.calibration_files import check_calibration_files

        self.job, self.path, self.folder, self.reading = job, path, path.parent, reading
        self.calibration = check_calibration_files(job, path)
        self.failures: list[str] = []
        rig = None if job.rig.light_section is None else self.folder / job.rig.light_section
        self.imaging = parse_imaging(rig, job.rig.laser)

    def require_profiles(self, groups: Sequence[tuple[str, list[Path]]]) -> None:
        """Raise an error for options for reading profiles if all files are images."""
        sources = (source for _, group in groups for source in group)
        are_images = [holds_images(source, self.imaging, self.reading) for source in sources]
        reject_reading_of_images(self.reading, are_images)

    def fail(self, name: str, error: Exception) -> None:
        """Print the error of a file or scan, and keep it."""
        message = str(error) if str(error).startswith(name) else f"{name}: {error}"
        self.failures.append(escape_text(message))
        print_error(message)

    def measure(
        self, name: str, sources: Sequence[Path]
    ) -> "Iterator[tuple[str, int, Measurement | ScanMeasurement]]":
        """Yield file, index in it and measurement of each profile of the files `sources`.

        With a scan in the job yield `name`, 0 and the measurement of the scan of all profiles.
        """
        from lsvision.inspection.measuring import measure_profiles_of_job, measure_scan_of_job

        files = [
            read_image_source(source, self.imaging, JOB)
            if holds_images(source, self.imaging, self.reading)
            else read_sources([source], self.reading, may_be_lost=self.job.scan is not None)[0]
            for source in sources
        ]
        if self.job.scan is None:
            for file in files:
                measurements = measure_profiles_of_job(file.profiles, self.job)
                for index, measurement in enumerate(measurements):
                    yield str(file.path), index, measurement
            return
        profiles = [profile for file in files for profile in file.profiles]
        require_points_of_scan(profiles, sources)
        poses, calibration = self._read_poses(len(profiles))
        yield name, 0, measure_scan_of_job(profiles, poses, self.job, calibration)

    def _read_poses(self, count: int) -> "tuple[list[Pose], Any]":
        """Return `count` poses of a scan's sections, and the hand-eye calibration or None.

        The keys of the job are checked like the options of ``lsvision scan``.

        Raises
        ------
        LsvisionError
            If a key is missing or invalid, or a file cannot be used.
        """
        from lsvision.cli.robot_options import (
            RobotMotion,
            RobotOptions,
            build_scan_poses,
            parse_motion,
        )

        rig, scan = self.job.rig, self.job.scan
        names = (rig.poses, rig.flange_from_section)
        poses, hand_eye = (None if name is None else self.folder / name for name in names)
        feed = step = None
        if scan is not None:
            feed = None if scan.feed is None else ",".join(map(repr, scan.feed))  # as in --feed
            step = scan.step_mm
        robot = RobotOptions(poses=poses, convention=rig.convention, flange_from_section=hand_eye)
        try:
            motion = parse_motion(feed, step, robot)
        except typer.BadParameter as error:
            message = _replace_options_by_keys(str(error))
            raise LsvisionError(f"{self.path}: [scan] and [rig]: {message}") from None
        calibration = motion.calibration if isinstance(motion, RobotMotion) else None
        return build_scan_poses(motion, count), calibration


def _replace_options_by_keys(message: str) -> str:
    """Return a message on options of ``lsvision scan`` with the keys of a job in their places.

    Examples
    --------
    >>> _replace_options_by_keys("expected --feed X,Y,Z and --step MM, got none")
    'expected feed and step_mm, got none'
    """
    return re.sub(
        r"--([a-z-]+)( X,Y,Z| MM| in mm| F\b| NAME)?",
        lambda match: _KEYS_BY_OPTION.get(match[1], match[0]),
        message,
    )


def _group_files(
    names: Sequence[str], suffixes: frozenset[str], *, is_scan: bool
) -> tuple[list[tuple[str, list[Path]]], list[LsvisionError]]:
    """Return groups of files, each with the first of its names, and the errors.

    Each file is a group; with `is_scan` the files of each folder are, and those of all other names,
    files and patterns.
    """
    others = [name for name in names if not is_directory(name)]
    names_of_groups = [[name] for name in names if is_directory(name)]
    if others:
        names_of_groups.append(others)
    groups: list[tuple[str, list[Path]]] = []
    failures: list[LsvisionError] = []
    for group in names_of_groups:
        sources, missing = find_sources(group, suffixes)
        failures += missing
        if sources:
            groups.append((group[0], sources))
    if not is_scan:
        groups = [(str(source), [source]) for _, sources in groups for source in sources]
    return groups, failures


def _inspect_all(
    run: _Run,
    groups: Sequence[tuple[str, list[Path]]],
    blocked: str,
    outputs: VerdictOutputs,
    *,
    to_stderr: bool,
) -> None:
    """Judge, print and write all measurements, and exit with the code of the run.

    `blocked` is the reason why nothing can be decided, from `find_blocking_reason`; empty if none.
    After an interruption the files contain the verdicts so far.
    """
    try:
        for judged in _judge_all(run, groups, blocked):
            outputs.add(judged)  # first: a closed pipe must not lose a verdict in the files
            print_lines(_format_verdict_lines(judged), err=to_stderr)
    except KeyboardInterrupt:
        message = f"interrupted: {format_count(len(outputs.judged), 'measurement')} judged"
        run.failures.append(message)
        print_error(message)
        raise
    finally:
        errors = outputs.finish()
        for error in errors:
            print_error(str(error))
    code = _print_counts(outputs.judged, len(run.failures), to_stderr=to_stderr)
    raise typer.Exit(FAILED if errors else code)


def _judge_all(
    run: _Run, groups: Sequence[tuple[str, list[Path]]], blocked: str
) -> "Iterator[JudgedMeasurement]":
    """Yield all judged measurements; a failure is printed, and does not stop the others."""
    for name, sources in groups:
        try:
            for source, index, measurement in run.measure(name, sources):
                yield _judge_measurement(run, source, index, measurement, blocked)
        except (LsvisionError, ValueError) as error:
            run.fail(name, error)


def _judge_measurement(
    run: _Run,
    source: str,
    index: int,
    measurement: "Measurement | ScanMeasurement",
    blocked: str,
) -> "JudgedMeasurement":
    """Return a measurement with its verdict and, unless it is of a scan, the remedies."""
    from lsvision.inspection.judge import judge
    from lsvision.inspection.judged_measurements import JudgedMeasurement
    from lsvision.inspection.remedies import plan_remedies
    from lsvision.measure import Measurement

    verdict = judge(measurement, run.job, blocked=blocked, calibration=run.calibration)
    remedies = (
        plan_remedies(verdict, measurement, run.job) if isinstance(measurement, Measurement) else ()
    )
    return JudgedMeasurement(escape_name(source), index, measurement, verdict, remedies)


def _format_verdict_lines(judged: "JudgedMeasurement") -> list[str]:
    """Return the printed lines of a verdict."""
    name = judged.source if judged.profile == 0 else f"{judged.source}, profile {judged.profile}"
    decision = str(judged.verdict.decision)
    table = [f"  {line}" for line in str(judged.verdict).splitlines() if line != decision]
    remedies = [f"  {remedy}" for remedy in judged.remedies]
    return [f"{name}: {decision}", *table, *remedies]


def _check_golden(
    run: _Run,
    groups: Sequence[tuple[str, list[Path]]],
    path: Path,
    now: datetime.datetime,
) -> int:
    """Check the golden part in every file, and log the checks in the file `path`.

    Return the exit code; a file that cannot be measured does not stop the others.
    """
    from lsvision.inspection.golden import check_golden
    from lsvision.inspection.history import append_record

    if run.job.golden is None:
        raise LsvisionError(f"{run.path}: the job names no golden part: add a [golden] table to it")
    passed = True
    for name, sources in groups:
        try:
            measured = list(run.measure(name, sources))
        except (LsvisionError, ValueError) as error:
            run.fail(name, error)
            continue
        for source, _, measurement in measured:
            name_of_source = escape_name(source)
            record = check_golden(
                measurement.cylinders, run.job, name_of_source, now, run.calibration
            )
            append_record(path, record, "passed")
            word = "passed" if record["passed"] else "failed"
            print_lines([f"{source}: golden part {word}: {record['reason']}; logged in {path}"])
            passed &= record["passed"]
    return FAILED if run.failures else EXIT_CODES["OK" if passed else "NG"]


def _print_counts(
    measurements: "Sequence[JudgedMeasurement]", failures: int, *, to_stderr: bool
) -> int:
    """Print the number of each verdict, and return the exit code of the worst."""
    from lsvision.inspection.decision import Decision, select_worst_decision

    decisions = [judged.verdict.decision for judged in measurements]
    if len(decisions) + failures > 1:
        counts = ", ".join(f"{decisions.count(kind)} {kind}" for kind in Decision)
        failed = f", {failures} could not be judged" if failures else ""
        print_lines([f"{len(decisions)} judged: {counts}{failed}"], err=to_stderr)
    return FAILED if failures else EXIT_CODES[select_worst_decision(decisions).value]
