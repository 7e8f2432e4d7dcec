"""Set E: real spheres, read and measured by the code under test, with `tests.bench.spheres`."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tests.bench import spheres
from tests.bench.goals import Number
from tests.bench.matching import point_iou

MIN_IOU, MAX_CENTRE_ERROR, MAX_RADIUS_ERROR = 0.985, 0.0075, 0.0065  # mm


def measure_real(trees):
    """Rows and faults of each tree; a single row if the data are absent."""
    for tree in trees:
        if spheres.real_data():
            yield _spheres(tree)
        else:
            yield [Number("E: ../shared/real is absent, skipped", float("nan"))], []


def _spheres(tree):
    files = sorted((spheres.REAL / "sphere-profiles").glob("*.csv"))
    results = tree.read(files)
    profiles = [judge_sphere(*pair) for pair in zip(files, results, strict=True)]
    robot_rows, faults = _robot(tree)
    faults = [f"E:{p.name}: missed" for p in profiles if not np.isfinite(p.iou)] + faults
    ms = float(np.median([result["ms"] for result in results]))
    return [
        *_sphere_rows(profiles),
        *robot_rows,
        Number("E: median of a profile", ms, unit="ms"),
    ], faults


def judge_sphere(path, result):
    """Compare the cylinder with the largest IoU with the labelled arc; NaN if nothing was found."""
    labelled = np.loadtxt(path, delimiter=",")[:, 2] == 1
    points = np.array(result["points"])
    cylinders = [SimpleNamespace(**cylinder) for cylinder in result["cylinders"]]
    ious = [point_iou(cylinder.indices, labelled) for cylinder in cylinders]
    if max(ious, default=0.0) < spheres.MIN_IOU:
        nothing = [np.nan] * 4
        return spheres.SphereProfile(path.stem, *nothing, len(cylinders))
    cylinder = cylinders[int(np.argmax(ious))]
    off = spheres.fit_circle(points[cylinder.indices]) - spheres.fit_circle(points[labelled])
    low = cylinder.intervals["phi"][0]
    centre, radius = float(np.hypot(*off[:2])), abs(float(off[2]))
    return spheres.SphereProfile(path.stem, max(ious), centre, radius, low, len(cylinders) - 1)


def _sphere_rows(profiles):
    found = [p for p in profiles if np.isfinite(p.iou)]
    missed = [p.name for p in profiles if not np.isfinite(p.iou)]
    centre = np.array([p.centre_error for p in found])
    radius = np.array([p.radius_error for p in found])
    yield Number("E: mIoU", np.mean([p.iou for p in found]), MIN_IOU)
    note = f"worst {centre.max():.3f}, median {np.median(centre):.4f}"
    yield Number(
        "E: circle centre off, mean", centre.mean(), high=MAX_CENTRE_ERROR, unit="mm", note=note
    )
    note = f"worst {radius.max():.3f}, median {np.median(radius):.4f}"
    yield Number(
        "E: circle radius off, mean", radius.mean(), high=MAX_RADIUS_ERROR, unit="mm", note=note
    )
    note = f"of {len(profiles)} {' '.join(missed)}"
    yield Number("E: spheres missed", len(missed), high=0, note=note)
    reach = 100 * np.mean([p.phi_low <= spheres.ZERO_PHI for p in found])
    yield Number("E: 95 % of phi begins at <= 1 deg", reach, unit="%")
    extra = [p.name for p in found if p.extra]
    note = " ".join(extra[:6])
    yield Number("E: profiles with a second cylinder", len(extra), note=note)


def _robot(tree):
    """Rows of the data set sphere-robot, and its profiles without an arc."""
    folder = spheres.REAL / "sphere-robot"
    main = _longest_radii(tree, [folder / "main" / f"{p}.yml" for p in spheres.MAIN_RADII])
    off = np.abs(np.array(main) - np.array(list(spheres.MAIN_RADII.values())))
    ball_names = [f"{i}_3C_line" for i in range(1, 11)]
    files = [folder / "ball" / f"{name}.yml" for name in ball_names]
    ball = _longest_radii(tree, files, "soft_l1")
    board = tree.read(sorted((folder / "board").glob("*.yml")), ())
    on_board = sum(len(result["cylinders"]) for result in board)
    wanted = {name: ball[ball_names.index(name)] for name in spheres.BALL_RADII}
    worst = max(abs(wanted[name] - radius) for name, radius in spheres.BALL_RADII.items())
    rows = [
        Number("E: sphere-robot main, arcs found of 15", int(np.isfinite(off).sum()), 15),
        Number("E: main, circle radius off, worst", float(np.nanmax(off)), unit="mm"),
        Number("E: ball, arcs found of 10", int(np.isfinite(ball).sum()), 10),
        Number("E: ball, circle radius off, worst of 3", worst, unit="mm"),
        Number("E: board, cylinders", on_board, high=0),
    ]
    found = zip([*spheres.MAIN_RADII, *ball_names], [*main, *ball], strict=True)
    return rows, [f"E:{name}: missed" for name, radius in found if not np.isfinite(radius)]


def _longest_radii(tree, files: list[Path], loss="linear"):
    """Radius of the circle fitted to the longest arc of each file; NaN without an arc."""
    radii = []
    for result in tree.read(files, ()):
        longest = max((c["indices"] for c in result["cylinders"]), key=len, default=None)
        points = np.array(result["points"])
        radius = np.nan if longest is None else spheres.fit_circle(points[longest], loss)[2]
        radii.append(float(radius))
    return radii
