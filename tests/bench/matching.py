"""Which detection is which tube: by the points they share."""

from dataclasses import dataclass

import numpy as np

SAME_TUBE = 0.5
"""Least intersection over union of the points for a detection to count as the tube."""


@dataclass(frozen=True)
class Match:
    """Detections against the truth of one section.

    `found` pairs each matched label with its cylinder and their IoU; `false` are the other
    cylinders, `missed` the labels of visible tubes that no cylinder matches.
    """

    found: tuple
    false: tuple
    missed: tuple


def point_iou(indices, wanted):
    """Intersection over union of the points of a detection and those of a mask."""
    got = np.zeros(len(wanted), dtype=bool)
    got[indices] = True
    return (got & wanted).sum() / max(1, (got | wanted).sum())


def match_tubes(measurement, truth):
    """One detection to a tube and one tube to a detection; seldom-seen tubes are no misses."""
    found, false, free = [], [], {tube.label for tube in truth.tubes}
    for cylinder in measurement.cylinders:
        shares = {label: point_iou(cylinder.indices, truth.labels == label) for label in free}
        best = max(shares, key=shares.get, default=None)
        if best is not None and shares[best] > SAME_TUBE:
            free.remove(best)
            found.append((best, cylinder, shares[best]))
        else:
            false.append(cylinder)
    lacking = (tube.label for tube in truth.tubes if tube.visible and tube.label in free)
    return Match(tuple(found), tuple(false), tuple(lacking))
