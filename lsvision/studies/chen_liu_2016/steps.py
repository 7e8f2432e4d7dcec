"""Figures 5-10: intermediate results of both pipelines on one section."""

from dataclasses import dataclass

import numpy as np

from lsvision.detection.arcs import IdentifiedArc, ScreenedArc
from lsvision.detection.candidates import Candidate, find_candidates
from lsvision.detection.identification import identify_arcs
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.detection.screening import screen_arcs
from lsvision.ellipse.homogenising import HomogenisedArc, homogenise_arcs
from lsvision.ellipse.smoothing import SmoothedArc, smooth_arcs
from lsvision.geometry import FloatArray, Points
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import PreparedProfile
from lsvision.simulate import SimulatedSection, TubeRanges, random_section
from lsvision.studies.chen_liu_2016.paper_pipeline import (
    PaperSettings,
    homogenise_profile_paper,
    largest_window_residual,
    smooth_profile_paper,
)
from lsvision.studies.chen_liu_2016.scenes import SEARCH_RANGE_MM

MIN_COMPONENT_POINTS = 10
"""Smallest number of points of a connected component."""
KIND, SEED = "welded_complex", 2
"""Kind and seed of the scene."""
TUBES = TubeRanges(radius_mm=(19.0, 19.0), phi_deg=(15.0, 30.0))
"""Pipes of the scene: the radius of the paper's welded pipes, tilts from its tables."""
WINDOW_STEP = 2
"""Step from window to window, in points: every second one is enough for a picture."""


def detect_arcs(profile: PreparedProfile) -> tuple[list[IdentifiedArc], list[Candidate]]:
    """Return the identified arcs of a profile, and the candidates from which they grew."""
    components = find_connected_components(build_range_image(profile), MIN_COMPONENT_POINTS)
    (candidates,) = find_candidates([profile], [components], [SEARCH_RANGE_MM])
    ((arcs, _),) = identify_arcs([profile], [candidates], [SEARCH_RANGE_MM])
    return arcs, candidates


@dataclass(frozen=True, eq=False)
class StepExample:
    """One section and the results of each step on it.

    Parameters
    ----------
    section : SimulatedSection
        Section with its truth.
    measurement : Measurement
        Result of lsvision.
    profile : PreparedProfile
        Ordered profile, the input of the steps.
    windows : (k, 2) ndarray
        Middle of each window of the paper's rough identification (x) and its largest abs(r_j);
        inf where no ellipse fits. Units: mm.
    identified : IdentifiedArc
        Arc of a pipe with the most points, before accurate screening.
    screened : ScreenedArc
        Arc after accurate screening.
    smoothed : SmoothedArc
        Arc after smoothing.
    homogenised : HomogenisedArc
        Arc after homogenising.
    homogenised_over_x : (m, 2) ndarray
        Arc smoothed and homogenised over x, as in the paper's text. Units: mm.
    """

    section: SimulatedSection
    measurement: Measurement
    profile: PreparedProfile
    windows: FloatArray
    identified: IdentifiedArc
    screened: ScreenedArc
    smoothed: SmoothedArc
    homogenised: HomogenisedArc
    homogenised_over_x: Points


def run_steps(*, noise_mm: float) -> StepExample:
    """Return the results of all steps on one welded pair among clutter.

    Raises
    ------
    ValueError
        If the noise is so large that neither pipe is found.
    """
    section = random_section(KIND, SEED, noise_mm=noise_mm, tubes=TUBES)
    profile = prepare_profile(section.profile, section.profile.noise)
    arcs, _ = detect_arcs(profile)
    labels = section.truth.labels[profile.sensor_columns]
    pipe_arcs = [arc for arc in arcs if (labels[arc.indices] > 0).mean() > 0.5]
    identified = max(pipe_arcs, key=lambda arc: len(arc.indices), default=None)
    screened = None if identified is None else screen_arcs([profile], [identified])[0]
    if identified is None or screened is None:
        raise ValueError(
            f"expected noise at which the example's pipes are found, got {noise_mm} mm"
        )
    (smoothed,) = smooth_arcs([screened.points], [screened.ellipse])
    (homogenised,) = homogenise_arcs([smoothed])
    points = profile.points[screened.indices]
    ordered_points = points[np.argsort(points[:, 0], kind="stable")]
    return StepExample(
        section=section,
        measurement=measure_cylinders(section.profile, radius=SEARCH_RANGE_MM),
        profile=profile,
        windows=_compute_windows(profile),
        identified=identified,
        screened=screened,
        smoothed=smoothed,
        homogenised=homogenised,
        homogenised_over_x=homogenise_profile_paper(smooth_profile_paper(ordered_points)),
    )


def _compute_windows(profile: PreparedProfile) -> FloatArray:
    """Return middle x and largest abs(r_j) of the paper's k windows (Figure 6), (k, 2) in mm."""
    points = profile.points[profile.valid_indices]
    num = PaperSettings().count_window_points(len(points))
    radius = float(np.sqrt(SEARCH_RANGE_MM[0] * SEARCH_RANGE_MM[1]))
    windows = [points[i : i + num] for i in range(0, len(points) - num + 1, WINDOW_STEP)]
    return np.array([[w[num // 2, 0], largest_window_residual(w, radius)] for w in windows])
