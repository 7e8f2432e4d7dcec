"""From joint fits to what the user gets: point, sign, covariance, ends and order."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lsvision.scan.pose_errors import (
    PoseErrors,
    carried_covariance,
    feed_of,
    own_columns,
    shared_columns,
)
from lsvision.scan.scanned import ScannedCylinder
from lsvision.scan.settling import SettledCylinder
from lsvision.shapes import Pose

SQUARE = 1e-6
"""Cosine between feed and axis under which the feed gives the axis no sign."""


def finish_cylinder(settled: SettledCylinder, errors: PoseErrors) -> ScannedCylinder:
    """Put point, sign, covariance and ends of a joint fit as the user gets them."""
    fit, cloud = settled.fit, settled.cloud
    fit = replace(fit, covariance=carried_covariance(fit, cloud, errors))
    fit = fit.at(cloud.poses[0].translation)
    feed, _ = feed_of(cloud.poses)
    sense = float(feed @ fit.direction)
    if abs(sense) < SQUARE:
        sense = float(cloud.poses[0].rotation[:, 2] @ fit.direction)
    if sense < 0:
        fit = fit.turned()
    along = (cloud.points - fit.point) @ fit.direction
    ends = np.array([along.argmin(), along.argmax()])
    seen, axis = cloud.only(ends), np.tile(fit.direction, (2, 1))
    moved = np.hstack([columns(axis, seen, errors) for columns in (shared_columns, own_columns)])
    variances = fit.direction @ seen.covariances @ fit.direction + (moved**2).sum(axis=1)
    return ScannedCylinder(
        fit=fit,
        sections=tuple(int(section) for section in np.unique(cloud.owners)),
        points=cloud.points,
        owners=cloud.owners,
        indices=cloud.indices,
        ends=(float(along[ends[0]]), float(along[ends[1]])),
        ends_std=(math.sqrt(variances[0]), math.sqrt(variances[1])),
        twin=settled.twin,
        includes_calibration=errors.calibration is not None,
    )


def in_order(
    cylinders: Sequence[ScannedCylinder], poses: Sequence[Pose]
) -> tuple[ScannedCylinder, ...]:
    """Cylinders by the first section that shows them, then from left to right in it."""

    def place(cylinder: ScannedCylinder) -> tuple[int, float]:
        first = cylinder.sections[0]
        own = poses[first].inverse().apply(cylinder.points[cylinder.owners == first])
        return first, float(own[:, 0].mean())

    return tuple(sorted(cylinders, key=place))
