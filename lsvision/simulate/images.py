"""What a camera sees of a laser line: images with the truth of every column.

Assumptions, one by one: the laser is a sheet of light with a Gaussian section, fanned out from
a point of its own plane; surfaces scatter by Lambert's law and neither shine through nor
reflect onto one another; a point is dark where anything stands between it and the laser. The
camera samples each column at its centre, three times a row, and blurs by a Gaussian. Speckle
multiplies the line; stray light adds to it; the sensor counts, saturates and rounds.

Truth is where the visible, lit surface crosses the middle of the sheet: neither the thickness
of the sheet nor blur, incidence or speckle move it, as they move the brightness.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.simulate.image_sensor import ImageSensor, expose
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.rays import Rays
from lsvision.simulate.scene import Scene
from lsvision.simulate.speckle import speckle_field
from lsvision.simulate.stray_light import StrayLight, glint_gain, stray_light

SUB_ROWS = 3
CELL = 4
"""px; the scene is looked over in cells of this size for where the sheet may be seen."""
SHEET_CUTOFF_SIGMAS = 5.0
"""Sheet sigmas from its middle beyond which the light is left out (4e-6 of the peak)."""
MAX_DEPTH_STEP_MM = 2.0
"""mm of depth between two samples from which they lie on different surfaces."""
SHADOW_BIAS = 1e-6
"""Share of the way to the laser that a point may lie inside its own surface by rounding."""


@dataclass(frozen=True, kw_only=True)
class ImageSettings:
    """How a laser line is rendered.

    Parameters
    ----------
    peak : float
        Mean brightness of the line's brightest pixel, above the surroundings; beyond the
        sensor's full scale it saturates. Units: DN of the image.
    sheet_sigma : float
        Half thickness of the sheet of light, one sigma. Units: mm.
    psf_sigma : float
        Blur of the lens, one sigma. Units: px.
    speckle_looks : int
        Independent speckle patterns that are averaged; contrast is 1 / sqrt of it before the
        pixels average further. 0: no speckle.
    speckle_fwhm : float
        Full width at half maximum of the speckle's correlation. Units: px.
    glints : int
        Places where the surface mirrors the laser into the camera.
    stray : StrayLight
        Light that is not the laser's.
    sensor : ImageSensor
        What turns light to numbers.
    """

    peak: float = 200.0
    sheet_sigma: float = 0.12
    psf_sigma: float = 0.7
    speckle_looks: int = 0
    speckle_fwhm: float = 1.5
    glints: int = 0
    stray: StrayLight = field(default_factory=StrayLight)
    sensor: ImageSensor = field(default_factory=ImageSensor)

    def __post_init__(self) -> None:
        for name in ("peak", "sheet_sigma", "speckle_fwhm"):
            if not getattr(self, name) > 0:
                raise ValueError(f"want a positive {name}, got {getattr(self, name)}")
        for name in ("psf_sigma", "speckle_looks", "glints"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"want {name} >= 0, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class SimulatedImage:
    """An image of a laser line, with its truth.

    Parameters
    ----------
    image, laser_off : (height, width) ndarray of uint8 or uint16
        With the laser, and the same view without it.
    truth_pixels : (width, 2) ndarray
        u, v of the line in each column; v is NaN where none is seen. Units: px.
    """

    image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    laser_off: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    truth_pixels: Points


def simulate_image(
    scene: Scene,
    rig: ImagingRig,
    settings: ImageSettings | None = None,
    *,
    rng: np.random.Generator,
) -> SimulatedImage:
    """Render the laser line on a scene as the rig's camera sees it.

    Parameters
    ----------
    scene : Scene
        Section frame: the laser plane is z = 0. Units: mm.
    rig : ImagingRig
        Camera and laser.
    settings : ImageSettings, optional
        Light, blur and noise.
    rng : numpy.random.Generator
        Same generator state, same image.

    Returns
    -------
    SimulatedImage
        A scene that the laser misses gives an image without a line and a truth of NaN.

    Examples
    --------
    >>> from lsvision.simulate import Prism, Scene
    >>> plank = Scene((Prism([[-500.0, -259.8], [500.0, -259.8]], along=(0, 0.5, 0.866)),))
    >>> rendered = simulate_image(plank, ImagingRig.triangulating(), rng=np.random.default_rng(1))
    >>> rendered.image.shape, rendered.image.dtype.name, rendered.truth_pixels[640].round(1)
    ((1024, 1280), 'uint8', array([640., 512.]))
    """
    chosen = settings or ImageSettings()
    samples = _sampled(scene, rig, chosen.sheet_sigma)
    line = _blurred(samples.light, chosen)
    if chosen.speckle_looks:
        line = _with_speckle(line, chosen, rng)
    if chosen.glints:
        line = line * glint_gain(samples.truth_pixels, line.shape, chosen.glints, rng)
    background = stray_light(line.shape, chosen.stray, rng)
    pattern = chosen.sensor.pattern(line.shape, rng)
    return SimulatedImage(
        expose(background + line, pattern, chosen.sensor, rng),
        expose(background, pattern, chosen.sensor, rng),
        samples.truth_pixels,
    )


@dataclass(frozen=True, eq=False)
class _Samples:
    """Light of the sheet in each pixel, before blur; 1 = the sheet's middle, met squarely."""

    light: FloatArray
    truth_pixels: Points


def _sampled(scene: Scene, rig: ImagingRig, sheet_sigma: float) -> _Samples:
    # Transposed, so that the samples of a column follow one another down the image.
    columns, rows = np.nonzero(_where_lit(scene, rig, sheet_sigma).T)
    offsets = (np.arange(SUB_ROWS) - (SUB_ROWS - 1) / 2) / SUB_ROWS
    u = np.repeat(columns, SUB_ROWS)
    v = (rows[:, None] + offsets).ravel()
    rays = rig.rays(np.column_stack([u, v]))
    hits, labels = scene.first_hits(rays)
    met = np.isfinite(hits.distances)
    depth = np.where(met, hits.distances, 0.0)
    points = rays.origins + depth[:, None] * rays.directions
    heights = points[:, 2]
    near = met & (np.abs(heights) < SHEET_CUTOFF_SIGMAS * sheet_sigma)
    light = np.zeros(len(u))
    light[near] = _irradiance(scene, rig, points[near], hits.normals[near])
    truth = _crossings(u, v, np.where(light > 0, heights, np.nan), depth, labels)
    light *= np.exp(-0.5 * (heights / sheet_sigma) ** 2)
    width, height = rig.size
    image = np.zeros((height, width))
    image[rows, columns] = light.reshape(-1, SUB_ROWS).mean(axis=1)
    pixels = np.column_stack([np.arange(width, dtype=np.float64), np.full(width, np.nan)])
    # Of several crossings in a column the lowest in the image stands; written last.
    pixels[truth[:, 0].astype(int), 1] = truth[:, 1]
    return _Samples(image, pixels)


def _where_lit(scene: Scene, rig: ImagingRig, sheet_sigma: float) -> BoolArray:
    """Pixels in whose neighbourhood the sheet may be seen."""
    width, height = rig.size
    u, v = np.meshgrid(np.arange(0, width + CELL, CELL), np.arange(0, height + CELL, CELL))
    rays = rig.rays(np.column_stack([u.ravel(), v.ravel()]))
    distances = scene.first_hits(rays)[0].distances.reshape(u.shape)
    along = rays.directions[:, 2].reshape(u.shape)
    start = rays.origins[:, 2].reshape(u.shape)
    met = np.isfinite(distances)
    heights = start + np.where(met, distances, 0.0) * along
    around = np.ones((3, 3), np.uint8)
    top = cv2.dilate(np.where(met, heights, -np.inf), around)
    bottom = cv2.erode(np.where(met, heights, np.inf), around)
    cells = (top > -SHEET_CUTOFF_SIGMAS * sheet_sigma) & (
        bottom < SHEET_CUTOFF_SIGMAS * sheet_sigma
    )
    pixels: BoolArray = cells.repeat(CELL, axis=0).repeat(CELL, axis=1)[:height, :width]
    return pixels


def _irradiance(scene: Scene, rig: ImagingRig, points: Points, normals: FloatArray) -> FloatArray:
    """Cosine of incidence where the laser reaches a point; 0 in its shadow."""
    origin = np.array([*rig.laser_origin, 0.0])
    ways = points - origin
    cosine = -np.einsum("ij,ij->i", ways, normals) / np.linalg.norm(ways, axis=1)
    first = scene.first_hits(Rays(np.broadcast_to(origin, ways.shape), ways))[0].distances
    return np.where(first > 1 - SHADOW_BIAS, np.maximum(cosine, 0.0), 0.0)


def _crossings(
    u: IntArray, v: FloatArray, heights: FloatArray, depth: FloatArray, labels: IntArray
) -> FloatArray:
    """(k, 2) u, v at which neighbouring samples of one surface lie on both sides of the sheet."""
    before, after = heights[:-1], heights[1:]
    # Of two signs, one may be zero: a sample in the very middle belongs to the pair below it.
    crossed = (before >= 0) != (after >= 0)
    same = (u[:-1] == u[1:]) & (np.diff(v) < 1.5 / SUB_ROWS) & (labels[:-1] == labels[1:])
    at = np.flatnonzero(
        crossed & same & np.isfinite(before + after) & (np.abs(np.diff(depth)) < MAX_DEPTH_STEP_MM)
    )
    share = before[at] / (before[at] - after[at])
    return np.column_stack([u[at], v[at] + share * (v[at + 1] - v[at])])


def _blurred(light: FloatArray, settings: ImageSettings) -> FloatArray:
    blurred = light
    if settings.psf_sigma > 0:
        blurred = cv2.GaussianBlur(light, (0, 0), settings.psf_sigma)
    brightest = blurred.max()
    scaled: FloatArray = blurred * (settings.peak / brightest) if brightest > 0 else blurred
    return scaled


def _with_speckle(
    line: FloatArray, settings: ImageSettings, rng: np.random.Generator
) -> FloatArray:
    rows = np.flatnonzero(line.any(axis=1))
    if not len(rows):
        return line
    band = slice(rows[0], rows[-1] + 1)
    speckled = line.copy()
    shape = speckled[band].shape
    speckled[band] *= speckle_field(shape, settings.speckle_looks, settings.speckle_fwhm, rng=rng)
    return speckled
