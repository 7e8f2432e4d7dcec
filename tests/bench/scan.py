"""Accuracy of scans: ``python -m tests.bench.scan [grid] [two] [clutter] [shape] [--runs N]``."""

import argparse
import dataclasses
import itertools
import math
import time
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, Pose
from lsvision.planning import scan_bound
from lsvision.scan import CylinderShape, ScannedCylinder, measure_scan, measure_shape
from lsvision.simulate import (
    SCENE_KINDS,
    SCENE_SENSOR,
    BentTube,
    Prism,
    Scene,
    SectionSettings,
    SimulatedSection,
    Tube,
    TubeRanges,
    simulate_scan,
)

PAPER_RADII = (15.0, 16.0, 18.5, 19.0, 29.0)
PAPER_ANGLES = ((10.0, 30.0), (20.0, 20.0), (30.0, 10.0))


@dataclass(frozen=True)
class Outcome:
    """Errors of one measured tube.

    Parameters
    ----------
    radius : float
        Error of the radius over its Cramer-Rao bound.
    direction : (2,) ndarray
        Errors of the direction along e_phi and e_theta over their bounds.
    nees : float
        Squared error of direction and radius over the predicted covariance, divided by 3.
    right_sign : bool
        Whether the error of the direction is below phi; that of the twin is 2 phi.
    gross : bool
        Whether the radius is wrong by more than 5 % or the direction by more than 2 deg.
    """

    radius: float
    direction: FloatArray
    nees: float
    right_sign: bool
    gross: bool


def feed(count: int, length: float) -> list[Pose]:
    """Return poses evenly spaced over a length (mm) along Z, from 0."""
    step = length / (count - 1)
    return [Pose.along((0.0, 0.0, 1.0), step * k) for k in range(count)]


def centred_tube(radius: float, theta_deg: float, phi_deg: float, length: float) -> Tube:
    """Tube that crosses the middle of the view in the middle of the scan."""
    tube = Tube.of(radius, math.radians(theta_deg), math.radians(phi_deg), (0.0, -400.0))
    return dataclasses.replace(
        tube, cylinder=tube.cylinder.transformed(Pose(translation=(0.0, 0.0, length / 2)))
    )


def bound_covariance(
    cylinder: Cylinder, label: int, seen: tuple[SimulatedSection, ...], poses: list[Pose]
) -> FloatArray:
    """Return the Cramer-Rao bound (5, 5) from the true points of the tube with a label."""
    points, variances = [], []
    for section, pose in zip(seen, poses, strict=True):
        in_section = section.truth.points[section.truth.labels == label]
        in_base = pose.apply(in_section)
        radial = in_base - cylinder.point
        radial -= np.outer(radial @ cylinder.direction, cylinder.direction)
        normals = radial / np.linalg.norm(radial, axis=1, keepdims=True) @ pose.rotation
        rays = in_section / np.linalg.norm(in_section, axis=1, keepdims=True)
        # The noise along the ray increases with the square of the range.
        std = section.sensor.range_std * (in_section**2).sum(axis=1) / 400.0**2
        cosine = (normals[:, :2] * rays).sum(axis=1)
        points.append(in_base)
        variances.append((std * cosine) ** 2 + section.sensor.quantum**2 / 12)
    return scan_bound(cylinder, np.concatenate(points), np.concatenate(variances)).covariance


def judge(found: ScannedCylinder, truth: Cylinder, bound: FloatArray) -> Outcome:
    """Return the errors of a measured tube; `bound` is the Cramer-Rao bound (5, 5)."""
    direction = truth.direction * np.sign(truth.direction @ found.direction)
    direction_errors = (found.direction - direction) @ found.fit.tangent_basis.T
    errors = np.array([*direction_errors, found.radius - truth.radius])
    predicted = found.covariance[2:, 2:]
    axis_deg = math.degrees(float(np.linalg.norm(direction_errors)))
    return Outcome(
        radius=float(errors[2] / math.sqrt(bound[4, 4])),
        direction=errors[:2] / np.sqrt(np.diag(bound)[2:4]),
        nees=float(errors @ np.linalg.solve(predicted, errors)) / 3,
        right_sign=axis_deg < math.degrees(math.acos(min(1.0, abs(truth.direction[2])))),
        gross=abs(errors[2]) > 0.05 * truth.radius or axis_deg > 2.0,
    )


@dataclass(frozen=True)
class ScanResult:
    """Results of one scan.

    Parameters
    ----------
    outcomes : list of Outcome or None
        For each tube that is visible in a third of the sections; None if it was missed.
    extra : int
        Number of cylinders that are not near a tube.
    seconds : float
        Time of the measurement.
    """

    outcomes: list[Outcome | None]
    extra: int
    seconds: float


def run(scene: Scene, poses: list[Pose], noise: float, rng: np.random.Generator) -> ScanResult:
    """Simulate and measure a scan; `noise` is the std along the ray at 400 mm. Units: mm."""
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=noise)
    seen = simulate_scan(scene, poses, sensor, SectionSettings(), rng=rng)
    start = time.perf_counter()
    scan = measure_scan([section.profile for section in seen], poses)
    seconds = time.perf_counter() - start
    outcomes: list[Outcome | None] = []
    matched = 0
    for label, tube in enumerate(scene.tubes, start=1):
        near = [c for c in scan.cylinders if is_near(c, tube.cylinder)]
        matched += len(near)
        visible = [t.visible for section in seen for t in section.truth.tubes if t.label == label]
        if sum(visible) >= max(2, len(poses) / 3):
            bound = bound_covariance(tube.cylinder, label, seen, poses)
            outcomes.append(judge(near[0], tube.cylinder, bound) if near else None)
    return ScanResult(outcomes, len(scan.cylinders) - matched, seconds)


def is_near(found: ScannedCylinder, truth: Cylinder) -> bool:
    """Return whether the middle of a measured axis is within a radius of the true axis."""
    middle = found.point + found.direction * sum(found.axial_range) / 2
    return float(truth.signed_distances(middle[None])[0]) < 0


def summarise(name: str, outcomes: list[Outcome | None]) -> None:
    """Print the row of the tubes of one condition."""
    found = [outcome for outcome in outcomes if outcome is not None]
    radius = np.array([outcome.radius for outcome in found])
    direction = np.array([outcome.direction for outcome in found])
    nees = np.array([outcome.nees for outcome in found])
    rms = [float(np.sqrt(np.mean(values**2))) for values in (radius, *direction.T)]
    print(
        f"{name:34s} n {len(outcomes):4d}  missed {len(outcomes) - len(found)}  "
        f"RMSE/bound radius {rms[0]:.2f} phi {rms[1]:.2f} theta {rms[2]:.2f}  "
        f"bias/bound {radius.mean():+.2f}  NEES/dof {nees.mean():.2f}  "
        f"wrong sign {sum(not o.right_sign for o in found)}  gross {sum(o.gross for o in found)}"
    )


def paper_grid(runs: int, count: int = 20, length: float = 20.0, noise: float = 0.1) -> None:
    """Print the rows of all radii and angles of the paper."""
    print(f"# paper's grid, {count} sections over {length:g} mm, noise {noise} mm: "
          "RMSE/bound <= 1.10 for 20 sections, 1.15 for two; NEES/dof 0.8-1.25")  # fmt: skip
    total = []
    for number, (radius, (theta, phi)) in enumerate(itertools.product(PAPER_RADII, PAPER_ANGLES)):
        rng = np.random.default_rng([number, count])
        scene = Scene((centred_tube(radius, theta, phi, length),))
        outcomes = [run(scene, feed(count, length), noise, rng).outcomes[0] for _ in range(runs)]
        summarise(f"r {radius:g} theta {theta:g} phi {phi:g}", outcomes)
        total += outcomes
    summarise("all", total)


def two_sections(runs: int) -> None:
    """Print the rows of two sections 10 mm apart, at several tilts and noises."""
    for noise, phis in ((0.05, (5.0, 10.0, 20.0, 30.0)), (0.1, (10.0, 20.0, 30.0))):
        print(
            f"# 2 sections 10 mm apart, noise {noise} mm: sign right >= 99.5 %, RMSE/bound <= 1.15"
        )
        for phi in phis:
            rng = np.random.default_rng([2, round(phi)])
            outcomes = []
            for _ in range(runs):
                radius, theta = rng.choice(PAPER_RADII), rng.uniform(0.0, 180.0)
                scene = Scene((centred_tube(radius, theta, phi, 10.0),))
                outcomes += run(scene, feed(2, 10.0), noise, rng).outcomes
            summarise(f"phi {phi:g}, any theta, paper's radii", outcomes)


def in_clutter(runs: int) -> None:
    """Print the rows of tubes in clutter, 11 sections over 50 mm and 101 over 100 mm."""
    print("# clutter: RMSE/bound <= 1.15, no gross failure; 101 sections <= 1.5 s")
    for count, length, runs_divisor in ((11, 50.0, 1), (101, 100.0, 8)):
        for kind in ("complex", "welded_complex"):
            outcomes, extra, seconds = [], [], []
            for seed in range(max(runs // runs_divisor, 1)):
                rng = np.random.default_rng([seed, count, len(kind)])
                scene = SCENE_KINDS[kind](rng, TubeRanges(phi_deg=(0.0, 30.0)))
                poses = [
                    Pose.along((0.0, 0.0, 1.0), z)
                    for z in np.linspace(-length / 2, length / 2, count)
                ]
                result = run(scene, poses, 0.05, rng)
                outcomes += result.outcomes
                extra.append(result.extra)
                seconds.append(result.seconds)
                if result.extra or any(o is None or o.gross for o in result.outcomes):
                    print("   fault in", kind, seed, result)
            summarise(f"{kind}, {count} over {length:g} mm", outcomes)
            print(f"   extra cylinders {sum(extra)}, median {np.median(seconds):.2f} s a scan")


def shapes(runs: int) -> None:
    """Print power and false alarms of the tests of shape, noise 0.02 mm."""
    print("# noise 0.02 mm: 5 m bend over 500 mm, 0.5 % ovality: power >= 0.95 at 1 % false alarms")
    scenes = {
        "straight and round, 26 sections over 500 mm": (lambda: straight(19.0), 26, 500.0),
        "bend of 5 m, 26 sections over 500 mm": (lambda: bent(19.0, 5000.0), 26, 500.0),
        "bend of 50 m, 26 sections over 500 mm": (lambda: bent(19.0, 50_000.0), 26, 500.0),
        "straight and round, 20 sections over 20 mm": (lambda: straight(19.0), 20, 20.0),
        "0.5 % oval, 20 sections over 20 mm": (lambda: oval(19.0, 0.005), 20, 20.0),
        "0.5 % oval, 26 sections over 500 mm": (lambda: oval(19.0, 0.005), 26, 500.0),
    }
    for number, (name, (scene, count, length)) in enumerate(scenes.items()):
        rng = np.random.default_rng([7, number])
        found = [measured_shape(Scene((scene(),)), count, length, rng) for _ in range(runs)]
        fractions = [
            np.mean([getattr(shape, what).is_significant() for shape in found])
            for what in ("bow", "taper", "ovality_terms")
        ]
        radius = np.array([shape.bow_radius for shape in found]) / 1000
        ovality = np.array([shape.ovality for shape in found]) * 100
        print(
            f"{name:44s} n {runs}  significant: bow {fractions[0]:.3f} taper {fractions[1]:.3f} "
            f"ovality {fractions[2]:.3f}  bow radius {np.median(radius):.2f} m +/- "
            f"{radius.std():.2f}  ovality {ovality.mean():.2f} +/- {ovality.std():.2f} %"
        )


def measured_shape(
    scene: Scene, count: int, length: float, rng: np.random.Generator
) -> CylinderShape:
    """Return the shape of a scene's tube from `count` sections over a length (mm)."""
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=0.02)
    seen = simulate_scan(scene, feed(count, length), sensor, SectionSettings(), rng=rng)
    scan = measure_scan([section.profile for section in seen], feed(count, length))
    return measure_shape(scan.cylinders[0])


def straight(radius: float) -> Tube:
    """Return a tube tilted by 5 deg, so that it stays in view over half a metre."""
    return centred_tube(radius, 40.0, 5.0, 20.0)


def bent(radius: float, bend_radius: float) -> BentTube:
    """Return a tube bent about an axis near Y, 400 mm from the sensor at z = 250 mm."""
    return BentTube(radius, (bend_radius, -400.0, 250.0), (0.0, 1.0, 0.05), bend_radius)


def oval(radius: float, ovality: float) -> Prism:
    """Return an elliptical cylinder, as a prism of many corners, with its major axis at 30 deg."""
    t = np.linspace(0, 2 * math.pi, 2001)
    corners = radius * np.column_stack(
        [(1 + ovality / 2) * np.cos(t), (1 - ovality / 2) * np.sin(t)]
    )
    cos, sin = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    rotation = np.array([[cos, -sin], [sin, cos]])
    return Prism(corners @ rotation.T + (0.0, -400.0), along=(0.0, 0.0, 1.0))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", nargs="*", default=["grid"])
    parser.add_argument("--runs", type=int, default=10)
    arguments = parser.parse_args()
    start = time.perf_counter()
    for what in arguments.what:
        BENCHES[what](arguments.runs)
    print(f"{time.perf_counter() - start:.0f} s")


BENCHES = {"grid": paper_grid, "two": two_sections, "clutter": in_clutter, "shape": shapes}


if __name__ == "__main__":
    main()
