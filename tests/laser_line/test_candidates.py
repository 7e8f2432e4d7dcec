"""Candidates for points of a line, against their definition applied pixel by pixel."""

import cv2
import numpy as np
import pytest

from lsvision.laser_line.candidates import (
    DETECTION_SIGMAS,
    NOISE_SAMPLE_STEP,
    build_matched_kernel,
    find_line_candidates,
)
from lsvision.statistics.robust import MAD_TO_STD

SIGMA, PLENTY = 2.0, 100


def plateaus(rng, kind):
    """Return an image of spots of few levels, some at the border: neighbours have equal values."""
    levels = np.where(rng.random((40, 16)) < 0.04, rng.integers(1, 4, (40, 16)), 0)
    levels[::8, 3], levels[:, 5] = 2, 0
    spots = 60 * levels.repeat(6, axis=0).repeat(4, axis=1)
    spots[[0, -1], 20:24] = 180  # a ridge along each border
    return (spots + rng.integers(0, 3, spots.shape)).astype(kind)


def response_of(image):
    """Return the response of the matched filter, of 8-bit images rounded to 1 / 32 DN."""
    kernel, along = build_matched_kernel(SIGMA).astype(np.float32), np.ones(1, np.float32)
    if image.dtype == np.uint8:
        return cv2.sepFilter2D(image, cv2.CV_16S, along, 32 * kernel) / 32
    return cv2.sepFilter2D(image, cv2.CV_32F, along, kernel)


def maxima_of(response, threshold):
    found = []
    for column in range(response.shape[1]):
        section = response[:, column]
        for row, value in enumerate(section):
            nearby = section[np.clip(row + np.arange(-2, 3), 0, len(section) - 1)]
            if value > threshold and value >= nearby.max():
                found.append((column, row))
    return np.array(found)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_candidates_are_the_maxima_of_the_columns(kind, rng):
    image = plateaus(rng, kind)
    response = response_of(image)
    sample = np.abs(response[::NOISE_SAMPLE_STEP, ::NOISE_SAMPLE_STEP])
    threshold = max(5.0, DETECTION_SIGMAS * MAD_TO_STD * np.median(sample))
    found = find_line_candidates(image, SIGMA, 5.0, PLENTY)
    assert found.threshold == pytest.approx(threshold, rel=1e-6)
    columns, rows = maxima_of(response, threshold).T
    np.testing.assert_array_equal(found.columns, columns)
    assert np.abs(found.rows - rows).max() <= 0.5
    np.testing.assert_allclose(found.scores, response[rows, columns], rtol=1e-5)
    assert rows.min() == 0
    assert rows.max() == len(image) - 1


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_each_column_the_highest_candidates_are_kept(count, rng):
    image = plateaus(rng, "uint8")
    every = find_line_candidates(image, SIGMA, 5.0, PLENTY)
    kept = find_line_candidates(image, SIGMA, 5.0, count)
    assert np.bincount(every.columns).max() > count
    for column in np.unique(every.columns):
        scores = every.scores[every.columns == column]
        highest = np.sort(scores)[::-1][:count]
        of_kept = kept.scores[kept.columns == column]
        np.testing.assert_array_equal(np.sort(of_kept)[::-1], highest)
    assert (np.diff(kept.columns) >= 0).all()
