"""Figures 5-10 as numbers: the steps followed on one section, both chains side by side."""

from dataclasses import dataclass

import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.candidates import find_candidates
from lsvision.detection.identification import identify_arcs
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import connected_components, rasterise
from lsvision.detection.screening import ScreenedArc, screen_arc
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.homogenising import (
    HomogenisedArc,
    homogenise_arc,
    homogenise_profile_paper,
)
from lsvision.ellipse.smoothing import SmoothedArc, smooth_arc, smooth_profile_paper
from lsvision.errors import LsvisionError
from lsvision.geometry import FloatArray, Points
from lsvision.measure import Measurement, measure_cylinders
from lsvision.paper_pipeline import PaperSettings, initial_ellipse
from lsvision.profile import PreparedProfile
from lsvision.simulate import SimulatedSection, TubeRanges, random_section

KIND, SEED = "welded_complex", 2
"""Of the one scene that is followed."""
TUBES = TubeRanges(radius_mm=(19.0, 19.0), phi_deg=(15.0, 30.0))
RADIUS_RANGE = (10.0, 40.0)
SMALLEST_SPAN = 10
WINDOW_STEP = 2
"""Every second window is enough to see."""
RADIAL = FittingSettings(residual="radial")


@dataclass(frozen=True, eq=False)
class StepExample:
    """One section and what each step makes of it.

    Parameters
    ----------
    section : SimulatedSection
        The section with its truth.
    measurement : Measurement
        lsvision's result.
    profile : PreparedProfile
        What the detection of arcs works on.
    windows : (k, 2) ndarray
        Middle of each window of the paper's rough identification (x) and its largest abs(r_j);
        inf where no ellipse fits. Units: mm.
    identified : IdentifiedArc
        The longer pipe's arc before accurate screening.
    screened : ScreenedArc
        The same after accurate screening.
    smoothed : SmoothedArc
        The same, smoothed.
    homogenised : HomogenisedArc
        The same, homogenised.
    literal : (m, 2) ndarray
        The arc smoothed and homogenised over x, as the paper's text has it. Units: mm.
    """

    section: SimulatedSection
    measurement: Measurement
    profile: PreparedProfile
    windows: FloatArray
    identified: IdentifiedArc
    screened: ScreenedArc
    smoothed: SmoothedArc
    homogenised: HomogenisedArc
    literal: Points


def run_steps(*, noise_mm: float) -> StepExample:
    """Follow the steps on one welded pair among clutter.

    Parameters
    ----------
    noise_mm : float
        One sigma along the ray at 400 mm. Units: mm.

    Raises
    ------
    ValueError
        If so much noise hides both pipes.
    """
    section = random_section(KIND, SEED, noise_mm=noise_mm, tubes=TUBES)
    profile = prepare_profile(section.profile, section.profile.noise)
    components = connected_components(rasterise(profile), SMALLEST_SPAN)
    candidates = find_candidates(profile, components, RADIUS_RANGE)
    arcs, _ = identify_arcs(profile, candidates, RADIUS_RANGE)
    labels = section.truth.labels[profile.sensor_columns]
    ours = [arc for arc in arcs if (labels[arc.indices] > 0).mean() > 0.5]
    identified = max(ours, key=lambda arc: len(arc.indices), default=None)
    screened = None if identified is None else screen_arc(profile, identified)
    if identified is None or screened is None:
        raise ValueError(f"want noise in which the example's pipes are found, got {noise_mm} mm")
    smoothed = smooth_arc(screened.points, screened.ellipse)
    own = profile.points[screened.indices]
    by_x = own[np.argsort(own[:, 0], kind="stable")]
    return StepExample(
        section=section,
        measurement=measure_cylinders(section.profile, radius=RADIUS_RANGE),
        profile=profile,
        windows=_windows(profile),
        identified=identified,
        screened=screened,
        smoothed=smoothed,
        homogenised=homogenise_arc(smoothed),
        literal=homogenise_profile_paper(smooth_profile_paper(by_x)),
    )


def _windows(profile: PreparedProfile) -> FloatArray:
    """Largest r_j of the paper's windows along the line, Figure 6."""
    points, literal = profile.points[profile.valid_indices], PaperSettings()
    num = max(6, round(literal.window_fraction * len(points)))
    radius = float(np.sqrt(RADIUS_RANGE[0] * RADIUS_RANGE[1]))
    worst = []
    for start in range(0, len(points) - num + 1, WINDOW_STEP):
        window = points[start : start + num]
        try:
            fit = fit_ellipse(window, initial_ellipse(window, radius), settings=RADIAL)
            largest = float(np.abs(fit.residuals).max())
        except LsvisionError:
            largest = np.inf
        worst.append([float(window[num // 2, 0]), largest])
    return np.array(worst)
