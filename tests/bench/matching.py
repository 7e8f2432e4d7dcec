"""Assignment of detections to true tubes, by the points that they have in common."""

from dataclasses import dataclass

import numpy as np

MIN_IOU = 0.5
"""Intersection over union of the points that a detection of a tube must exceed."""


@dataclass(frozen=True)
class Match:
    """Detections of one section, compared with the truth.

    `found` has a tuple (label of the tube, cylinder, IoU) for each matched tube; `false` are the
    other cylinders, `missed` the labels of visible tubes without a cylinder.
    """

    found: tuple
    false: tuple
    missed: tuple


def point_iou(indices, true_points):
    """Return the intersection over union of the points of a detection and those of a mask."""
    detected = np.zeros(len(true_points), dtype=bool)
    detected[indices] = True
    return (detected & true_points).sum() / max(1, (detected | true_points).sum())


def match_tubes(measurement, truth):
    """Match each cylinder to the tube with most of its points, each tube at most once.

    A tube that is not `visible` (its arc is too short) does not count as missed.
    """
    found, false, unmatched = [], [], {tube.label for tube in truth.tubes}
    for cylinder in measurement.cylinders:
        ious = {label: point_iou(cylinder.indices, truth.labels == label) for label in unmatched}
        best = max(ious, key=ious.get, default=None)
        if best is not None and ious[best] > MIN_IOU:
            unmatched.remove(best)
            found.append((best, cylinder, ious[best]))
        else:
            false.append(cylinder)
    missed = (tube.label for tube in truth.tubes if tube.visible and tube.label in unmatched)
    return Match(tuple(found), tuple(false), tuple(missed))
