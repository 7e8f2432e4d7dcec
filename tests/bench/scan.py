"""Issue 3's numbers, measured: ``python -m tests.bench.scan [--runs N]``."""

import argparse
import dataclasses
import itertools
import math
import time
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, Pose
from lsvision.planning import scan_bound
from lsvision.scan import ScannedCylinder, TubeShape, measure_scan, measure_shape
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
    """Errors of one measured tube over their bound, and in its own sigmas."""

    radius: float
    direction: FloatArray  # (2,) along e_phi, e_theta
    nees: float  # of direction and radius together, per degree of freedom
    right_sign: bool
    gross: bool


def feed(count: int, length: float) -> list[Pose]:
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
    """The bound from the points that the simulation says lie on the tube."""
    points, variances = [], []
    for section, pose in zip(seen, poses, strict=True):
        mine = section.truth.labels == label
        exact = section.truth.points[mine]
        true = pose.apply(exact)
        across = true - cylinder.point
        across -= np.outer(across @ cylinder.direction, cylinder.direction)
        normals = across / np.linalg.norm(across, axis=1, keepdims=True) @ pose.rotation
        rays = exact / np.linalg.norm(exact, axis=1, keepdims=True)
        std = section.sensor.range_std * (exact**2).sum(axis=1) / 400.0**2
        cosine = (normals[:, :2] * rays).sum(axis=1)
        points.append(true)
        variances.append((std * cosine) ** 2 + section.sensor.quantum**2 / 12)
    return scan_bound(cylinder, np.concatenate(points), np.concatenate(variances)).covariance


def judge(found: ScannedCylinder, truth: Cylinder, bound: FloatArray) -> Outcome:
    direction = truth.direction * np.sign(truth.direction @ found.direction)
    off = (found.direction - direction) @ found.fit.tangent_basis.T
    errors = np.array([*off, found.radius - truth.radius])
    own = found.covariance[2:, 2:]
    axis_deg = math.degrees(float(np.linalg.norm(off)))
    return Outcome(
        radius=float(errors[2] / math.sqrt(bound[4, 4])),
        direction=errors[:2] / np.sqrt(np.diag(bound)[2:4]),
        nees=float(errors @ np.linalg.solve(own, errors)) / 3,
        right_sign=axis_deg < math.degrees(math.acos(min(1.0, abs(truth.direction[2])))),
        gross=abs(errors[2]) > 0.05 * truth.radius or axis_deg > 2.0,
    )


@dataclass(frozen=True)
class Looked:
    """What one scan yielded."""

    outcomes: list[Outcome | None]  # one a tube that enough sections show; None = missed
    extra: int  # cylinders found that are no tube
    seconds: float


def run(scene: Scene, poses: list[Pose], noise: float, rng: np.random.Generator) -> Looked:
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=noise)
    seen = simulate_scan(scene, poses, sensor, SectionSettings(), rng=rng)
    start = time.perf_counter()
    scan = measure_scan([section.profile for section in seen], poses)
    seconds = time.perf_counter() - start
    outcomes: list[Outcome | None] = []
    accounted = 0
    for label, tube in enumerate(scene.tubes, start=1):
        near = [c for c in scan.cylinders if is_near(c, tube.cylinder)]
        accounted += len(near)
        visible = [t.visible for section in seen for t in section.truth.tubes if t.label == label]
        if sum(visible) >= max(2, len(poses) / 3):
            bound = bound_covariance(tube.cylinder, label, seen, poses)
            outcomes.append(judge(near[0], tube.cylinder, bound) if near else None)
    return Looked(outcomes, len(scan.cylinders) - accounted, seconds)


def is_near(found: ScannedCylinder, truth: Cylinder) -> bool:
    """Whether the axis found passes the true one within a radius where it was seen."""
    middle = found.point + found.direction * sum(found.axial_range) / 2
    apart = middle - truth.point
    apart = apart - (apart @ truth.direction) * truth.direction
    return float(np.linalg.norm(apart)) < truth.radius


def summarise(name: str, outcomes: list[Outcome | None]) -> None:
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
    """Two sections 10 mm apart: which twin, and how well."""
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
    """Clutter that the tubes run through, 11 sections over 50 mm and 101 over 100 mm."""
    print("# clutter: RMSE/bound <= 1.15, no gross failure; 101 sections <= 1.5 s")
    for count, length, share in ((11, 50.0, 1), (101, 100.0, 8)):
        for kind in ("complex", "welded_complex"):
            outcomes, extra, seconds = [], [], []
            for seed in range(max(runs // share, 1)):
                rng = np.random.default_rng([seed, count, len(kind)])
                scene = SCENE_KINDS[kind](rng, TubeRanges(phi_deg=(0.0, 30.0)))
                poses = [
                    Pose.along((0.0, 0.0, 1.0), z)
                    for z in np.linspace(-length / 2, length / 2, count)
                ]
                looked = run(scene, poses, 0.05, rng)
                outcomes += looked.outcomes
                extra.append(looked.extra)
                seconds.append(looked.seconds)
                if looked.extra or any(o is None or o.gross for o in looked.outcomes):
                    print("   look at", kind, seed, looked)
            summarise(f"{kind}, {count} over {length:g} mm", outcomes)
            print(f"   extra cylinders {sum(extra)}, median {np.median(seconds):.2f} s a scan")


def shapes(runs: int) -> None:
    """Power and false alarms of the tests of shape, noise 0.02 mm."""
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
        found = [shape_seen(Scene((scene(),)), count, length, rng) for _ in range(runs)]
        shares = [
            np.mean([getattr(shape, what).is_significant() for shape in found])
            for what in ("bow", "taper", "ovality_terms")
        ]
        radius = np.array([shape.bow_radius for shape in found]) / 1000
        ovality = np.array([shape.ovality for shape in found]) * 100
        print(
            f"{name:44s} n {runs}  significant: bow {shares[0]:.3f} taper {shares[1]:.3f} "
            f"ovality {shares[2]:.3f}  bow radius {np.median(radius):.2f} m +/- "
            f"{radius.std():.2f}  ovality {ovality.mean():.2f} +/- {ovality.std():.2f} %"
        )


def shape_seen(scene: Scene, count: int, length: float, rng: np.random.Generator) -> TubeShape:
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=0.02)
    seen = simulate_scan(scene, feed(count, length), sensor, SectionSettings(), rng=rng)
    scan = measure_scan([section.profile for section in seen], feed(count, length))
    return measure_shape(scan.cylinders[0])


def straight(radius: float) -> Tube:
    """Tilted by 5 deg, so that it stays in view over half a metre."""
    return centred_tube(radius, 40.0, 5.0, 20.0)


def bent(radius: float, bend_radius: float) -> BentTube:
    return BentTube(radius, (bend_radius, -400.0, 250.0), (0.0, 1.0, 0.05), bend_radius)


def oval(radius: float, ovality: float) -> Prism:
    """An elliptical cylinder as a prism of many corners; its long axis stands askew."""
    t = np.linspace(0, 2 * math.pi, 2001)
    across = radius * np.column_stack(
        [(1 + ovality / 2) * np.cos(t), (1 - ovality / 2) * np.sin(t)]
    )
    turn = math.radians(30.0)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return Prism(across @ rotation.T + (0.0, -400.0), along=(0.0, 0.0, 1.0))


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
