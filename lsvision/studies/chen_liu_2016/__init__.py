"""Repetition of Chen and Liu (Sensors 2016): the paper's own pipeline and its experiments.

`paper_pipeline` follows the paper's text. The experiments repeat Tables 1-5 and Figures 5-16 on
the simulator: `cases` and `scenes` make the data, `methods` measures them in five ways, `tables`,
`repeatability`, `steps`, `ablation`, `achievability` and `paper_pitfalls` evaluate them, and
`report` runs all and writes JSON; `page`, `pictures` and `report_tables` present the results.
"""

from lsvision.studies.chen_liu_2016.page import render_report_page
from lsvision.studies.chen_liu_2016.paper_pipeline import PaperSettings, measure_cylinders_paper
from lsvision.studies.chen_liu_2016.report import (
    ExperimentSizes,
    PaperReport,
    format_report_json,
    run_experiments,
)
from lsvision.studies.chen_liu_2016.report_tables import format_readme_table

__all__ = [
    "ExperimentSizes",
    "PaperReport",
    "PaperSettings",
    "format_readme_table",
    "format_report_json",
    "measure_cylinders_paper",
    "render_report_page",
    "run_experiments",
]
