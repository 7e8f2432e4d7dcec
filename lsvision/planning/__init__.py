"""What accuracy to expect before measuring: the Cramer-Rao bound, computed, no simulation.

All numbers are one sigma. `section_bound` and `scan_bound` take the points as they lie;
`plan_section`, `plan_scan` and `sections_needed` first ask which points a `SensorView` gives. The
package shares no code with the fits, so that a fit can be compared with it.
"""

from lsvision.planning.plan import plan_scan, plan_section
from lsvision.planning.required_sections import AccuracyTarget, sections_needed
from lsvision.planning.scan_bound import Feed, ScanPrediction, scan_bound
from lsvision.planning.section_bound import SectionPrediction, section_bound
from lsvision.planning.sensor_view import SensorView, visible_points

__all__ = [
    "AccuracyTarget",
    "Feed",
    "ScanPrediction",
    "SectionPrediction",
    "SensorView",
    "plan_scan",
    "plan_section",
    "scan_bound",
    "section_bound",
    "sections_needed",
    "visible_points",
]
