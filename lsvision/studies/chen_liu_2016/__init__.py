"""The paper's tables and figures, run again on the simulator and told honestly."""

from lsvision.studies.chen_liu_2016.json_report import report_json
from lsvision.studies.chen_liu_2016.page import report_page
from lsvision.studies.chen_liu_2016.paper_chain import PaperSettings, measure_cylinders_paper
from lsvision.studies.chen_liu_2016.report import ExperimentSizes, PaperReport, run_experiments
from lsvision.studies.chen_liu_2016.report_tables import readme_table

__all__ = [
    "ExperimentSizes",
    "PaperReport",
    "PaperSettings",
    "measure_cylinders_paper",
    "readme_table",
    "report_json",
    "report_page",
    "run_experiments",
]
