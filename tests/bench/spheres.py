"""Real profiles of spheres: the labelled arcs of sphere-profiles, and those of sphere-robot.

A plane cuts a sphere in a circle, so that phi is exactly 0. The data are not in the repository: see
`real_data`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from lsvision.io.profiles import read_profile
from lsvision.measure import measure_cylinders
from tests.bench.goals import Number
from tests.bench.matching import point_iou
from tests.bench.progress import counted

REAL = Path(__file__).parents[3] / "shared" / "real"
MIN_IOU = 0.3
"""Smallest intersection over union of the points of a detection and of the labelled arc."""
GROSS_ERROR = 1.0
"""Error of a centre or radius above which a result is wrong. Units: mm."""
ZERO_PHI = np.radians(1.0)
"""Lower end of the interval of phi (rad) up to which it counts as containing 0."""
MAIN_RADII = dict(
    zip(
        (f"p{i}" for i in range(1, 16)),
        (39.428, 36.300, 20.707, 39.380, 39.322, 39.357, 39.432, 39.423, 39.431, 37.859,
         38.186, 38.418, 37.681, 33.703, 36.951),
        strict=True,
    )
)  # fmt: skip
"""Radii of the circles of sphere-robot/main in the table that comes with the data. Units: mm."""
BALL_RADII = {"7_3C_line": 10.72, "9_3C_line": 9.69, "10_3C_line": 9.04}
BALL_NOISE, BALL_TOLERANCE = 0.1, 0.1
"""Noise of the points, and tolerance of the radii, of the same table. Units: mm."""


def real_data():
    """Return whether the real data are there, in ``shared/real`` beside the repository."""
    return REAL.is_dir()


@dataclass(frozen=True)
class SphereProfile:
    """Result of one labelled profile; NaN where the sphere was not found.

    IoU with the labelled arc; errors of centre and radius of the circle through the points found,
    compared with that through the labelled ones (mm); lower end of the interval of phi (rad);
    number of other cylinders.
    """

    name: str
    iou: float
    centre_error: float
    radius_error: float
    phi_low: float
    extra: int


@dataclass(frozen=True)
class Spheres:
    """Results of all labelled profiles."""

    profiles: tuple[SphereProfile, ...]

    @property
    def numbers(self):
        found = [p for p in self.profiles if np.isfinite(p.iou)]
        lost = [p.name for p in self.profiles if not np.isfinite(p.iou)]
        centre = np.array([p.centre_error for p in found])
        radius = np.array([p.radius_error for p in found])
        wrong = [p.name for p in found if max(p.centre_error, p.radius_error) > GROSS_ERROR]
        contains_zero = 100 * np.mean([p.phi_low <= ZERO_PHI for p in found])
        extra = [p.name for p in found if p.extra]
        worst = max(found, key=lambda p: p.centre_error)
        yield Number("sphere-profiles: mIoU", np.mean([p.iou for p in found]), 0.982)
        note = f"worst {worst.centre_error:.3f} in {worst.name}, median {np.median(centre):.4f}"
        yield Number(
            "error of the circle's centre, mean", centre.mean(), high=0.018, unit="mm", note=note
        )
        note = f"worst {radius.max():.3f}, median {np.median(radius):.4f}"
        yield Number(
            "error of the circle's radius, mean", radius.mean(), high=0.012, unit="mm", note=note
        )
        yield Number("spheres missed", len(lost), high=0, note=" ".join(lost))
        yield Number("errors above 1 mm", len(wrong), high=0, note=" ".join(wrong))
        yield Number("95 % of phi begins at <= 1 deg", contains_zero, 93, unit="%")
        note = " ".join(extra[:6])
        yield Number("profiles with a second cylinder", len(extra), note=note)


def score_spheres():
    """Measure all labelled profiles of ``sphere-profiles``."""
    files = sorted((REAL / "sphere-profiles").glob("*.csv"))
    return Spheres(tuple(_score_sphere(path) for path in counted(files, "sphere-profiles")))


def fit_circle(points, loss="linear"):
    """Return the least-squares circle of points: centre_x, centre_y, radius. Units: mm.

    With ``loss="soft_l1"`` the cost of distances above `BALL_NOISE` increases only linearly.
    """
    design = np.column_stack([2 * points, np.ones(len(points))])
    x, y, c = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    start = (x, y, np.sqrt(c + x * x + y * y))
    return least_squares(
        lambda q: np.hypot(*(points - q[:2]).T) - q[2],
        start, x_scale="jac", loss=loss, f_scale=BALL_NOISE,
    ).x  # fmt: skip


def _score_sphere(path):
    labelled = np.loadtxt(path, delimiter=",")[:, 2] == 1
    profile = read_profile(path)
    cylinders = measure_cylinders(profile).cylinders
    ious = [point_iou(cylinder.indices, labelled) for cylinder in cylinders]
    if not ious or max(ious) < MIN_IOU:
        return SphereProfile(path.stem, np.nan, np.nan, np.nan, np.nan, len(cylinders))
    cylinder = cylinders[int(np.argmax(ious))]
    error = fit_circle(profile.points[cylinder.indices]) - fit_circle(profile.points[labelled])
    return SphereProfile(
        path.stem,
        max(ious),
        float(np.hypot(*error[:2])),
        abs(float(error[2])),
        cylinder.interval("phi")[0],
        len(cylinders) - 1,
    )


@dataclass(frozen=True)
class SphereOnRobot:
    """Results of sphere-robot.

    `main` and `ball`: name of a profile, radius measured (NaN if none) and radius of the table (NaN
    if none), in mm. `on_board`: name of the profile of the plane board of each false cylinder.
    """

    main: tuple[tuple[str, float, float], ...]
    ball: tuple[tuple[str, float, float], ...]
    on_board: tuple[str, ...]

    @property
    def numbers(self):
        errors = np.array([abs(measured - radius) for _, measured, radius in self.main])
        yield Number("sphere-robot/main: arcs found of 15", np.isfinite(errors).sum(), 15)
        yield Number("main: error of the circle's radius, worst", np.nanmax(errors), unit="mm")
        found = sum(np.isfinite(radius) for _, radius, _ in self.ball)
        yield Number("ball: arcs found of 10", found, 10)
        for name, measured, radius in self.ball:
            if np.isfinite(radius):
                what = f"ball {name.split('_')[0]}: radius beside {radius}"
                yield Number(what, measured, radius - BALL_TOLERANCE, radius + BALL_TOLERANCE, "mm")
        note = " ".join(self.on_board)
        yield Number("board: cylinders found", len(self.on_board), high=0, note=note)


def measure_sphere_robot():
    """Measure the radius of the circle through the longest arc of each profile of a sphere."""
    folder = REAL / "sphere-robot"
    main = [(p, _radius(folder / "main" / f"{p}.yml"), r) for p, r in MAIN_RADII.items()]
    names = [f"{i}_3C_line" for i in range(1, 11)]
    # These arcs are not circular (b / a is 0.88) and have outliers: the radius depends on the
    # weights by 0.2 mm.
    ball = [
        (n, _radius(folder / "ball" / f"{n}.yml", "soft_l1"), BALL_RADII.get(n, np.nan))
        for n in names
    ]
    board = [
        path.stem
        for path in sorted((folder / "board").glob("*.yml"))
        for _ in measure_cylinders(read_profile(path)).cylinders
    ]
    return SphereOnRobot(tuple(main), tuple(ball), tuple(board))


def _radius(path, loss="linear"):
    """Return the radius of the circle through the longest arc of a profile in mm, NaN if none."""
    profile = read_profile(path)
    cylinders = measure_cylinders(profile).cylinders
    if not cylinders:
        return float("nan")
    longest = max(cylinders, key=lambda cylinder: len(cylinder.indices))
    return float(fit_circle(profile.points[longest.indices], loss)[2])
