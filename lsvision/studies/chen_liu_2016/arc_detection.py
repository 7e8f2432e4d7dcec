"""Arcs of a simulated section, as the detection identifies them before screening."""

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.candidates import Candidate, find_candidates
from lsvision.detection.identification import identify_arcs
from lsvision.detection.range_image import build_range_image, connected_components
from lsvision.profile import PreparedProfile

RADIUS_RANGE = (10.0, 40.0)
"""Search range of the radius. Units: mm."""
MIN_COMPONENT_POINTS = 10
"""Smallest number of points of a connected component."""


def detect_arcs(profile: PreparedProfile) -> tuple[list[IdentifiedArc], list[Candidate]]:
    """Return the identified arcs of a profile, and the candidates from which they grew."""
    components = connected_components(build_range_image(profile), MIN_COMPONENT_POINTS)
    (candidates,) = find_candidates([profile], [components], [RADIUS_RANGE])
    ((arcs, _),) = identify_arcs([profile], [candidates], [RADIUS_RANGE])
    return arcs, candidates
