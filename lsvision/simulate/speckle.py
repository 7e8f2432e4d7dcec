"""Speckle: the grain of laser light on a rough surface."""

import cv2
import numpy as np

from lsvision.geometry import FloatArray

OVERSAMPLING = 2
"""Samples of the speckle along each side of a pixel, which then averages them."""


def speckle_field(
    shape: tuple[int, int], looks: int, fwhm: float, *, rng: np.random.Generator
) -> FloatArray:
    """Factor of mean 1 by which speckle multiplies the light in each pixel.

    Parameters
    ----------
    shape : tuple of int
        ``(height, width)``.
    looks : int
        Independent patterns averaged (time, colour, polarisation); at least 1.
    fwhm : float
        Full width at half maximum of the intensity's correlation. Units: px.
    rng : numpy.random.Generator
        Source of the pattern.

    Returns
    -------
    (height, width) ndarray
        Contrast 1 / sqrt(looks) before, and a little less after, each pixel's own averaging.

    Notes
    -----
    Fully developed speckle is the squared modulus of a circular complex Gaussian field; where
    the field's correlation is mu, the intensity's is mu^2 (Goodman, Speckle Phenomena in
    Optics, section 4.3). A Gaussian filter of sigma s gives mu = exp(-x^2 / 4 s^2), hence
    mu^2 = exp(-x^2 / 2 s^2), and s = fwhm / 2.355.
    """
    if looks < 1:
        raise ValueError(f"want one look or more, got {looks}")
    fine = (shape[0] * OVERSAMPLING, shape[1] * OVERSAMPLING)
    sigma = fwhm / 2.3548 * OVERSAMPLING
    total = np.zeros(fine, dtype=np.float32)
    for _ in range(2 * looks):
        part = rng.standard_normal(fine, dtype=np.float32)
        total += cv2.GaussianBlur(part, (0, 0), sigma, borderType=cv2.BORDER_REFLECT) ** 2
    binned = total.reshape(shape[0], OVERSAMPLING, shape[1], OVERSAMPLING).mean(axis=(1, 3))
    factor: FloatArray = (binned / binned.mean()).astype(np.float64)
    return factor
