"""Predict the uncertainty of a measurement from the Cramer-Rao bound, without simulation.

All results are standard uncertainties. `section_bound` and `scan_bound` start from given points;
`plan_section`, `plan_scan` and `sections_needed` compute the points visible in a `SensorView`. The
package shares no code with the fits, so that a fit can be compared with it.
"""

from lsvision.planning.bounds import scan_bound, section_bound
from lsvision.planning.plan import AccuracyTarget, plan_scan, plan_section, sections_needed
from lsvision.planning.predictions import ScanPrediction, SectionPrediction
from lsvision.planning.sensor_view import Feed, SensorView, find_visible_points

__all__ = [
    "AccuracyTarget",
    "Feed",
    "ScanPrediction",
    "SectionPrediction",
    "SensorView",
    "find_visible_points",
    "plan_scan",
    "plan_section",
    "scan_bound",
    "section_bound",
    "sections_needed",
]
