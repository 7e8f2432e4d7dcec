"""The report as JSON: all numbers of the page, in keys that end in their unit.

Numbers of `Achievability` without a unit in their key are in that of its quantity.
The keys "ways", "places_mm", "reach" and "traps" are those of the first version of the file.
"""

import dataclasses
import json
import math
from typing import Any

from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.repeatability import Repeatability
from lsvision.studies.chen_liu_2016.report import PaperReport
from lsvision.studies.chen_liu_2016.report_tables import readme_table
from lsvision.studies.chen_liu_2016.scenes import SceneFigure

SCHEMA = "lsvision.paper/1"
"""Name and version of the file."""


def report_json(report: PaperReport) -> str:
    """Return the report as JSON text; the same report gives the same text.

    Parameters
    ----------
    report : PaperReport
        Result of `run_experiments`.

    Returns
    -------
    str
        JSON text: lengths in ``*_mm``, angles in ``*_deg``, times in ``*seconds``; NaN and infinity
        are null.
    """
    document = {
        "schema": SCHEMA,
        "noise_mm": report.noise_mm,
        "effort": _plain(report.sizes),
        "ways": {key: {"letter": info.letter, "name": info.name, "places_mm": info.positions_mm}
                 for key, info in METHODS.items()},
        "tables_1_to_4": [_plain(row) for row in report.rows],
        "readme_table": readme_table(report.rows),
        "reach": [
            {**_plain(result), "chance": result.chance, "reachable": result.reachable}
            for result in report.achievability
        ],
        "table_5": [{**_plain(timing), "ratio": timing.ratio} for timing in report.timings],
        "figures_14_and_15": [_scene(scene) for scene in report.scenes],
        "figure_16": _repeatability(report.repeatability),
        "ablation_in_units_of_the_bound": [_plain(result) for result in report.ablation],
        "traps": [_plain(pitfall) for pitfall in report.pitfalls],
    }  # fmt: skip
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _scene(scene: SceneFigure) -> dict[str, Any]:
    return {"title": scene.title, "false": scene.false, "pipes": _plain(scene.pipes)}


def _repeatability(repeatability: Repeatability) -> dict[str, Any]:
    """Return the results of Figure 16 as a JSON object."""
    order = ("centre_x_mm", "centre_y_mm", "semi_major_mm", "semi_minor_mm")
    return {
        "measurements": len(repeatability.ellipses),
        "missed": repeatability.missed,
        "std": _plain(dict(zip(order, repeatability.stds_mm, strict=True))),
        "bound": dict(zip(order, repeatability.bound_stds_mm, strict=True)),
        "box_mm": repeatability.box_mm,
        "expected_box_mm": repeatability.expected_box_mm,
        "noise_of_printed_box_mm": repeatability.noise_of_printed_box_mm,
    }


def _plain(value: Any) -> Any:
    """Return dataclasses as dicts, tuples as lists, NaN and infinity as None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
