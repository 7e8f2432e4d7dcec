"""The paper's tables and figures, run again on the simulator, beside the least possible errors."""

from lsvision.experiments.accuracy import readme_table
from lsvision.experiments.json_report import report_json
from lsvision.experiments.page import report_page
from lsvision.experiments.report import ExperimentSizes, PaperReport, run_experiments

__all__ = [
    "ExperimentSizes",
    "PaperReport",
    "readme_table",
    "report_json",
    "report_page",
    "run_experiments",
]
