"""The paper's tables and figures, run again on the simulator and told honestly."""

from lsvision.studies.chen_liu_2016.accuracy import readme_table
from lsvision.studies.chen_liu_2016.json_report import report_json
from lsvision.studies.chen_liu_2016.page import report_page
from lsvision.studies.chen_liu_2016.report import ExperimentSizes, PaperReport, run_experiments

__all__ = [
    "ExperimentSizes",
    "PaperReport",
    "readme_table",
    "report_json",
    "report_page",
    "run_experiments",
]
