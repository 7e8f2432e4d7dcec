"""Output files of ``lsvision inspect``: JSON, CSV, Parquet and the page."""

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.outputs import write_output
from lsvision.errors import LsvisionError

if TYPE_CHECKING:
    from lsvision.inspection.job import Job
    from lsvision.inspection.judged_measurements import JudgedMeasurement
    from lsvision.results.quantities import Record


@dataclass(frozen=True)
class VerdictPaths:
    """Output files of a run; None for one that is not written. JSON or CSV may be ``-``."""

    json_file: Path | None = None
    csv_file: Path | None = None
    parquet: Path | None = None
    report: Path | None = None


class VerdictOutputs:
    """Writer of the verdicts of a run.

    JSON and CSV are rewritten during the run (see `ResultFiles`); Parquet and the page, which need
    all verdicts, are written at its end. If a file cannot be written, the others are nevertheless.
    `make_page` returns the page of all verdicts, `not_judged` is the growing list of the reasons
    why files are not judged.

    Raises
    ------
    LsvisionError
        If a Parquet file is expected and pyarrow is not installed.
    """

    def __init__(
        self,
        paths: VerdictPaths,
        make_page: "Callable[[Sequence[JudgedMeasurement]], str]",
        not_judged: Sequence[str] = (),
    ) -> None:
        from lsvision.io.result_files import ResultFiles
        from lsvision.io.verdict_files import VerdictCsvFormat, VerdictJsonFormat, require_parquet

        if paths.parquet is not None:
            require_parquet()
        self._paths, self._make_page = paths, make_page
        self._files = ResultFiles(
            paths.json_file,
            paths.csv_file,
            formats=(VerdictJsonFormat(not_judged), VerdictCsvFormat()),
            write_empty=True,
        )
        self.judged: list[JudgedMeasurement] = []

    def add(self, judged: "JudgedMeasurement") -> None:
        """Add a verdict."""
        self.judged.append(judged)
        self._files.add([judged])

    def finish(self) -> list[LsvisionError]:
        """Write all files; return the error of each that could not be written."""
        steps: list[Callable[[], None]] = [self._files.finish]
        if self._paths.parquet is not None:
            steps.append(self._write_parquet)
        if self._paths.report is not None and self.judged:
            steps.append(self._write_report)
        errors = []
        for step in steps:
            try:
                step()
            except LsvisionError as error:
                errors.append(error)
        return errors

    def _write_parquet(self) -> None:
        from lsvision.files.atomic_files import write_atomic
        from lsvision.io.verdict_files import encode_verdicts_parquet

        if self._paths.parquet is not None:
            rows = [row for judged in self.judged for row in judged.rows]
            write_atomic(self._paths.parquet, encode_verdicts_parquet(rows))

    def _write_report(self) -> None:
        if self._paths.report is not None:
            write_output(self._paths.report, self._make_page(self.judged))


def make_page(
    job: "Job",
    calibration: "Mapping[str, Mapping[str, str | None]]",
    golden: "Sequence[Record]",
    now: datetime.datetime,
    not_judged: Sequence[str],
    judged: "Sequence[JudgedMeasurement]",
) -> str:
    """Return the page of a run; `golden` is the log of the golden part."""
    from lsvision.draw.inspection_page import InspectionContext, render_inspection_page
    from lsvision.inspection.calibration_files import compute_calibration_age_days

    context = InspectionContext(
        job=job,
        made=now.isoformat(timespec="minutes"),
        calibration_days=compute_calibration_age_days(calibration, now),
        golden=golden,
        not_judged=not_judged,
    )
    return render_inspection_page(judged, context)
