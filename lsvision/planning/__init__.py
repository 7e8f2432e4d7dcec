"""What accuracy to expect before measuring: the Cramer-Rao bound, computed, no simulation.

All numbers are one sigma. `section_bound` and `scan_bound` take the points as they lie;
`plan_section`, `plan_scan` and `sections_needed` first ask which points a `View` gives. The
room shares no code with the fits, so that a fit can be held against it.
"""

from lsvision.planning.need import Target, sections_needed
from lsvision.planning.plan import plan_scan, plan_section
from lsvision.planning.scan_bound import Feed, ScanPrediction, scan_bound
from lsvision.planning.section_bound import Prediction, section_bound
from lsvision.planning.view import View, see_cylinder

__all__ = [
    "Feed",
    "Prediction",
    "ScanPrediction",
    "Target",
    "View",
    "plan_scan",
    "plan_section",
    "scan_bound",
    "section_bound",
    "sections_needed",
    "see_cylinder",
]
