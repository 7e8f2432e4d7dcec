"""The paper on one page: one profile in, cylinders out (Figure 4).

Range image and candidates stand before the paper's steps, because rough identification alone
takes planes for huge ellipses; `Settings.paper` runs the paper's chain without them.
"""

from dataclasses import dataclass

from lsvision.arc_refinement import Priors, refine_arc
from lsvision.detection.acceptance import (
    AcceptanceSettings,
    Rejection,
    convergence_rejection_reason,
    neighbourhood_rejection_reason,
    radius_rejection_reason,
    rejection_reason,
)
from lsvision.detection.arc_detection import identify_arcs
from lsvision.detection.arc_growing import IdentificationSettings
from lsvision.detection.candidates import CandidateSettings, find_candidates
from lsvision.detection.end_extension import EndExtensionSettings
from lsvision.detection.identification import IdentifiedArc
from lsvision.detection.overlap_suppression import suppress_overlapping
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import (
    RangeImageSettings,
    connected_components,
    rasterise,
)
from lsvision.detection.rejections import complete_rejections
from lsvision.detection.screening import ScreeningSettings, screen_arc
from lsvision.detection.search_range import search_range
from lsvision.ellipse.conditioning import condition_arc
from lsvision.ellipse.fit import FittingSettings
from lsvision.ellipse.homogenising import HomogenisingSettings
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import SmoothingSettings
from lsvision.errors import LsvisionError
from lsvision.paper_pipeline import PaperSettings, measure_paper_pipeline
from lsvision.profile import Arc, NoiseModel, PreparedProfile, Profile
from lsvision.shapes import IntArray


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """One settings value for each step, in the order of the steps.

    Parameters
    ----------
    range_image, candidates, identification, acceptance, screening, end_extension : settings
        Detection, section 3.2.
    smoothing, homogenising : settings
        Conditioning, section 3.3.
    fitting : FittingSettings
        Section 2.3.
    paper_settings : PaperSettings or None
        Not None: the paper's own chain instead of all the above.
    """

    range_image: RangeImageSettings = RangeImageSettings()
    candidates: CandidateSettings = CandidateSettings()
    identification: IdentificationSettings = IdentificationSettings()
    acceptance: AcceptanceSettings = AcceptanceSettings()
    screening: ScreeningSettings = ScreeningSettings()
    end_extension: EndExtensionSettings = EndExtensionSettings()
    smoothing: SmoothingSettings = SmoothingSettings()
    homogenising: HomogenisingSettings = HomogenisingSettings()
    # Conditioned arcs start so near their fit that renewed weights change nothing, and each step
    # is a hundredth of the one before: the one after a millionth of chi^2 is 1e-4 sigma. Pipes
    # need 3 to 14 evaluations, and what needs more runs off to a needle.
    fitting: FittingSettings = FittingSettings(reweightings=0, max_evaluations=20, tolerance=1e-6)
    paper_settings: PaperSettings | None = None

    @classmethod
    def paper(cls) -> "Settings":
        """The paper's chain as literally as its text allows, for side-by-side comparison."""
        return cls(paper_settings=PaperSettings())


@dataclass(frozen=True, slots=True)
class Measurement:
    """What one profile holds.

    Parameters
    ----------
    cylinders : tuple of CylinderSection
        Left to right by centre x.
    rejections : tuple of Rejection
        What else was looked at, and why it is no cylinder; in the order of the profile.
    """

    cylinders: tuple[CylinderSection, ...]
    rejections: tuple[Rejection, ...]


def measure_cylinders(
    profile: Profile,
    *,
    radius: float | tuple[float, float] | None = None,
    known_radius: float | tuple[float, float] | None = None,
    known_phi: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: Settings = Settings(),
) -> Measurement:
    """Radius, orientation and position of every cylinder in a profile.

    Parameters
    ----------
    profile : Profile
        Points of one light section.
    radius : float or tuple of float, optional
        Search range (min, max), or a nominal radius that is searched within 20 %. Units: mm.
    known_radius : float or tuple of float, optional
        Radius, or (radius, std): a prior in the fit, and the search range where `radius` gives
        none. Units: mm.
    known_phi : float or tuple of float, optional
        Tilt of the axis from the laser plane's normal, or (tilt, std): a prior in the fit. 0
        makes circles of the sections, and so a radius of an arc too short for an ellipse; see
        `PhiPrior`. Units: rad.
    sensor : NoiseModel, optional
        Noise of the points; that of the profile without; where neither is given the noise is
        taken as isotropic and estimated from the residuals.
    settings : Settings
        One value for each step.

    Returns
    -------
    Measurement
        Same input and settings, same numbers out. A profile without cylinders, or without
        points, gives an empty one.

    Raises
    ------
    ValueError
        If a radius is not positive, its range is reversed, or a known phi is no tilt.

    Notes
    -----
    One section leaves the sign of the tilt open (`CylinderSection.axis_twins`), and knows
    little of phi below 10 deg: look at ``interval("phi")``; two sections know both.
    The paper's chain (`Settings.paper`) has no priors: a known radius sets its search range only,
    a known phi nothing.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> section = random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = measure_cylinders(section.profile).cylinders
    >>> (truth,) = section.truth.tubes
    >>> abs(pipe.radius - truth.radius) < 4 * pipe.radius_std
    True
    """
    known = Priors(_known_radius(known_radius), _known_phi(known_phi))
    weighed = prepare_profile(profile, sensor or profile.noise)
    radius_range = search_range(radius, known.radius, weighed)
    if settings.paper_settings is not None:
        found, refused = measure_paper_pipeline(weighed, radius_range, settings.paper_settings)
        return _to_sensor_indices(list(found), list(refused), weighed)

    # Recognition, section 3.2.
    range_image = rasterise(weighed, settings.range_image)
    components = connected_components(range_image, settings.candidates.min_window_points)
    candidates = find_candidates(weighed, components, radius_range, settings.candidates)
    arcs, rejections = identify_arcs(
        weighed, candidates, radius_range, settings.identification, settings.acceptance
    )
    # Screening, smoothing, homogenising and ellipse fitting, sections 3.2.2, 3.3 and 2.3.
    results = [_measure_arc(weighed, arc, known, radius_range, settings) for arc in arcs]
    cylinders = suppress_overlapping([r for r in results if isinstance(r, CylinderSection)])
    rejections += [result for result in results if isinstance(result, Rejection)]
    rejections = complete_rejections(weighed, components, cylinders, rejections, radius_range)
    return _to_sensor_indices(cylinders, rejections, weighed)


def _measure_arc(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    known: Priors,
    radius_range: tuple[float, float],
    settings: Settings,
) -> CylinderSection | Rejection:
    """An identified arc made a cylinder, or the reason why it is none."""
    screened = screen_arc(profile, arc, settings.screening, settings.end_extension)
    reason = neighbourhood_rejection_reason(profile, arc, settings.acceptance)
    if reason is not None:
        return Rejection(screened.arc, reason)
    conditioned = condition_arc(
        profile.noisy_points[screened.indices],
        screened.ellipse,
        settings.smoothing,
        settings.homogenising,
    )
    jumpless = screened.indices[conditioned.inliers]
    start = IdentifiedArc(screened.arc, jumpless, conditioned.ellipse)
    try:
        fit, fitted = refine_arc(
            profile, start, known, settings.fitting, settings.end_extension, settings.acceptance
        )
    except LsvisionError as failure:
        return Rejection(screened.arc, str(failure))
    section = CylinderSection(fit, fitted.arc, fitted.indices)
    reason = rejection_reason(profile, fitted, radius_range, settings.acceptance)
    reason = reason or convergence_rejection_reason(fit)
    reason = reason or radius_rejection_reason(profile, section.radius, section.radius_std)
    return section if reason is None else Rejection(screened.arc, reason)


def _to_sensor_indices(
    cylinders: list[CylinderSection], rejections: list[Rejection], profile: PreparedProfile
) -> Measurement:
    """The result with the indices of the profile as it came, cylinders from left to right."""

    def arc_of(indices: IntArray) -> Arc:
        return Arc(int(indices.min()), int(indices.max()) + 1)

    columns = profile.sensor_columns
    sections = [
        CylinderSection(cylinder.fit, arc_of(columns[cylinder.indices]), columns[cylinder.indices])
        for cylinder in cylinders
    ]
    refused = [
        Rejection(arc_of(columns[rejection.arc.start : rejection.arc.stop]), rejection.reason)
        for rejection in rejections
    ]
    return Measurement(
        tuple(sorted(sections, key=lambda section: section.centre[0])), tuple(refused)
    )


def _known_radius(known_radius: float | tuple[float, float] | None) -> RadiusPrior | None:
    if known_radius is None:
        return None
    if isinstance(known_radius, tuple):
        return RadiusPrior(*known_radius)
    return RadiusPrior(float(known_radius))


def _known_phi(known_phi: float | tuple[float, float] | None) -> PhiPrior | None:
    if known_phi is None:
        return None
    if isinstance(known_phi, tuple):
        return PhiPrior(*known_phi)
    return PhiPrior(float(known_phi))
