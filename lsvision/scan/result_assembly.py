"""From joint fits to what the user gets: point, sign, covariance, ends and order."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lsvision.geometry import Pose
from lsvision.scan.joint_fit import JointFit
from lsvision.scan.pose_errors import (
    PoseErrors,
    common_error_jacobian,
    feed_direction,
    propagate_pose_errors,
    section_error_jacobian,
)
from lsvision.scan.scan_result import ScannedCylinder

MIN_FEED_COSINE = 1e-6
"""Cosine between feed and axis under which the feed gives the axis no sign."""


def build_scanned_cylinder(settled: JointFit, errors: PoseErrors) -> ScannedCylinder:
    """Put point, sign, covariance and ends of a joint fit as the user gets them."""
    fit, cloud = settled.fit, settled.cloud
    fit = replace(fit, covariance=propagate_pose_errors(fit, cloud, errors))
    fit = fit.with_reference_point(cloud.poses[0].translation)
    feed, _ = feed_direction(cloud.poses)
    sense = float(feed @ fit.direction)
    if abs(sense) < MIN_FEED_COSINE:
        sense = float(cloud.poses[0].rotation[:, 2] @ fit.direction)
    if sense < 0:
        fit = fit.with_reversed_direction()
    along = (cloud.points - fit.point) @ fit.direction
    ends = np.array([along.argmin(), along.argmax()])
    seen, axis = cloud.subset(ends), np.tile(fit.direction, (2, 1))
    moved = np.hstack(
        [columns(axis, seen, errors) for columns in (common_error_jacobian, section_error_jacobian)]
    )
    variances = fit.direction @ seen.covariances @ fit.direction + (moved**2).sum(axis=1)
    return ScannedCylinder(
        fit=fit,
        sections=tuple(int(section) for section in np.unique(cloud.point_sections)),
        points=cloud.points,
        point_sections=cloud.point_sections,
        indices=cloud.indices,
        axial_range=(float(along[ends[0]]), float(along[ends[1]])),
        axial_range_std=(math.sqrt(variances[0]), math.sqrt(variances[1])),
        twin=settled.twin,
        includes_calibration=errors.calibration is not None,
    )


def sort_cylinders(
    cylinders: Sequence[ScannedCylinder], poses: Sequence[Pose]
) -> tuple[ScannedCylinder, ...]:
    """Cylinders by the first section that shows them, then from left to right in it."""

    def place(cylinder: ScannedCylinder) -> tuple[int, float]:
        first = cylinder.sections[0]
        own = poses[first].inverse().apply(cylinder.points[cylinder.point_sections == first])
        return first, float(own[:, 0].mean())

    return tuple(sorted(cylinders, key=place))
