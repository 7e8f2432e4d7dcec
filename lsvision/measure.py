"""The paper on one page: one profile in, cylinders out (Figure 4).

Range image and candidates stand before the paper's steps, because rough identification alone
takes planes for huge ellipses; `Settings.paper` runs the paper's chain without them.
"""

from dataclasses import dataclass

from lsvision.errors import LsvisionError
from lsvision.fitting.conditioning import condition_arc
from lsvision.fitting.cylinder_section import CylinderSection
from lsvision.fitting.ellipse_fit import FittingSettings
from lsvision.fitting.ellipse_problem import KnownRadius
from lsvision.fitting.homogenising import HomogenisingSettings
from lsvision.fitting.known_phi import KnownPhi
from lsvision.fitting.smoothing import SmoothingSettings
from lsvision.literal import LiteralSettings, measure_literally
from lsvision.profile import Arc, NoiseModel, Profile, WeighedProfile
from lsvision.recognition.candidates import CandidateSettings, find_candidates
from lsvision.recognition.growing import IdentificationSettings
from lsvision.recognition.identification import IdentifiedArc
from lsvision.recognition.leftovers import explain_leftovers
from lsvision.recognition.parts import without_parts
from lsvision.recognition.range_image import (
    RangeImageSettings,
    connected_components,
    rasterise,
)
from lsvision.recognition.reaching import ReachingSettings
from lsvision.recognition.recognise import identify_arcs
from lsvision.recognition.screening import ScreeningSettings, screen_arc
from lsvision.recognition.search_range import search_range
from lsvision.recognition.verdict import (
    Rejection,
    VerdictSettings,
    reason_against,
    reason_in_surroundings,
    reason_of_size,
    reason_unsettled,
)
from lsvision.recognition.weighing import weigh_profile
from lsvision.refinement import Known, refine_arc
from lsvision.shapes import IntArray


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """One settings value for each step, in the order of the steps.

    Parameters
    ----------
    range_image, candidates, identification, verdict, screening, reaching : settings
        Recognition, section 3.2.
    smoothing, homogenising : settings
        Conditioning, section 3.3.
    fitting : FittingSettings
        Section 2.3.
    literal : LiteralSettings or None
        Not None: the paper's own chain instead of all the above.
    """

    range_image: RangeImageSettings = RangeImageSettings()
    candidates: CandidateSettings = CandidateSettings()
    identification: IdentificationSettings = IdentificationSettings()
    verdict: VerdictSettings = VerdictSettings()
    screening: ScreeningSettings = ScreeningSettings()
    reaching: ReachingSettings = ReachingSettings()
    smoothing: SmoothingSettings = SmoothingSettings()
    homogenising: HomogenisingSettings = HomogenisingSettings()
    # Conditioned arcs start so near their fit that renewed weights change nothing, and each step
    # is a hundredth of the one before: the one after a millionth of chi^2 is 1e-4 sigma. Pipes
    # need 3 to 14 evaluations, and what needs more runs off to a needle.
    fitting: FittingSettings = FittingSettings(reweightings=0, most_evaluations=20, negligible=1e-6)
    literal: LiteralSettings | None = None

    @classmethod
    def paper(cls) -> "Settings":
        """The paper's chain as literally as its text allows, for side-by-side comparison."""
        return cls(literal=LiteralSettings())


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
        `KnownPhi`. Units: rad.
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
    known = Known(_known_radius(known_radius), _known_phi(known_phi))
    weighed = weigh_profile(profile, sensor or profile.noise)
    radius_range = search_range(radius, known.radius, weighed)
    if settings.literal is not None:
        found, refused = measure_literally(weighed, radius_range, settings.literal)
        return _in_columns_of_sensor(list(found), list(refused), weighed)

    # Recognition, section 3.2.
    range_image = rasterise(weighed, settings.range_image)
    components = connected_components(range_image, settings.candidates.smallest_span)
    candidates = find_candidates(weighed, components, radius_range, settings.candidates)
    arcs, rejections = identify_arcs(
        weighed, candidates, radius_range, settings.identification, settings.verdict
    )
    # Screening, smoothing, homogenising and ellipse fitting, sections 3.2.2, 3.3 and 2.3.
    results = [_measure_arc(weighed, arc, known, radius_range, settings) for arc in arcs]
    cylinders = without_parts([r for r in results if isinstance(r, CylinderSection)])
    rejections += [result for result in results if isinstance(result, Rejection)]
    rejections = explain_leftovers(weighed, components, cylinders, rejections, radius_range)
    return _in_columns_of_sensor(cylinders, rejections, weighed)


def _measure_arc(
    profile: WeighedProfile,
    arc: IdentifiedArc,
    known: Known,
    radius_range: tuple[float, float],
    settings: Settings,
) -> CylinderSection | Rejection:
    """An identified arc made a cylinder, or the reason why it is none."""
    screened = screen_arc(profile, arc, settings.screening, settings.reaching)
    reason = reason_in_surroundings(profile, arc, settings.verdict)
    if reason is not None:
        return Rejection(screened.arc, reason)
    conditioned = condition_arc(
        profile.noisy[screened.indices],
        screened.ellipse,
        settings.smoothing,
        settings.homogenising,
    )
    jumpless = screened.indices[conditioned.kept]
    start = IdentifiedArc(screened.arc, jumpless, conditioned.ellipse)
    try:
        fit, fitted = refine_arc(
            profile, start, known, settings.fitting, settings.reaching, settings.verdict
        )
    except LsvisionError as failure:
        return Rejection(screened.arc, str(failure))
    section = CylinderSection(fit, fitted.arc, fitted.indices)
    reason = reason_against(profile, fitted, radius_range, settings.verdict)
    reason = reason or reason_unsettled(fit)
    reason = reason or reason_of_size(profile, section.radius, section.radius_std)
    return section if reason is None else Rejection(screened.arc, reason)


def _in_columns_of_sensor(
    cylinders: list[CylinderSection], rejections: list[Rejection], profile: WeighedProfile
) -> Measurement:
    """The result with the indices of the profile as it came, cylinders from left to right."""

    def arc_of(indices: IntArray) -> Arc:
        return Arc(int(indices.min()), int(indices.max()) + 1)

    columns = profile.columns
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


def _known_radius(known_radius: float | tuple[float, float] | None) -> KnownRadius | None:
    if known_radius is None:
        return None
    if isinstance(known_radius, tuple):
        return KnownRadius(*known_radius)
    return KnownRadius(float(known_radius))


def _known_phi(known_phi: float | tuple[float, float] | None) -> KnownPhi | None:
    if known_phi is None:
        return None
    if isinstance(known_phi, tuple):
        return KnownPhi(*known_phi)
    return KnownPhi(float(known_phi))
