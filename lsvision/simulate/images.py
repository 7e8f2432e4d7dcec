"""Simulate camera images of a laser line, with the true position of the line in every column.

Assumptions: the laser is a sheet of light with a Gaussian cross-section that diverges from a point
in its plane; surfaces are Lambertian and opaque, without multiple reflections; a point is dark if
an object is between it and the laser. The camera samples each column at its centre, three times
per row, and blurs by a Gaussian; by a narrow one before it averages the samples of a row. Speckle
multiplies the line, stray light is added, the sensor adds noise, saturates and rounds.

The true line is the intersection of the visible, illuminated surface with the middle of the sheet.
It is independent of sheet thickness, blur, incidence and speckle, which shift the brightness.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.simulate.image_effects import (
    ImageSensor,
    StrayLight,
    expose,
    simulate_glint_gain,
    simulate_speckle_field,
    simulate_stray_light,
)
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Rays

SUB_ROWS = 3
"""Samples per row of the image."""
CELL_PX = 4
"""Size of the cells in which the scene is first searched for illuminated pixels. Units: px."""
MIN_SAMPLED_BLUR_PX = 0.6
"""Smallest blur that is applied to whole pixels: sampled more coarsely, its kernel is no Gaussian,
and a line that is blurred after its sampling is drawn to the centres of the pixels. Units: px."""
SHEET_CUTOFF_SIGMAS = 5.0
"""Distance from the middle of the sheet, in its standard deviations, beyond which the light
(4e-6 of the peak) is neglected."""
MAX_DEPTH_STEP_MM = 2.0
"""Largest difference in depth of two samples of the same surface. Units: mm."""
SHADOW_BIAS = 1e-6
"""Relative distance by which rounding may place a point below its own surface."""


@dataclass(frozen=True, kw_only=True)
class ImageSettings:
    """Settings of a simulated image of a laser line.

    Parameters
    ----------
    peak : float
        Mean brightness of the brightest pixel of the line above the background; beyond the full
        scale of the sensor it saturates. Units: DN of the image.
    sheet_sigma : float
        Standard deviation of the sheet's cross-section. Units: mm.
    psf_sigma : float
        Standard deviation of the lens blur. Units: px.
    speckle_looks : int
        Number of independent speckle patterns that are averaged, see `simulate_speckle_field`. 0:
        no speckle.
    speckle_fwhm : float
        Full width at half maximum of the autocorrelation of the speckle. Units: px.
    glints : int
        Number of specular reflections of the laser into the camera.
    stray : StrayLight
        Light other than the laser's.
    sensor : ImageSensor
        Noise, gain and bit depth of the camera.
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
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"expected a positive {name}, got {getattr(self, name)}")
        for name in ("psf_sigma", "speckle_looks", "glints"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"expected {name} >= 0, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class SimulatedImage:
    """Simulated image of a laser line, with its truth.

    Parameters
    ----------
    image, laser_off : (height, width) ndarray of uint8 or uint16
        Image with the laser, and image of the same view without it.
    truth_pixels : (width, 2) ndarray
        u, v of the line in each column, of the lowest if several are visible; v is NaN where none
        is. Units: px.
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
    """Simulate the camera image of the laser line on a scene.

    Parameters
    ----------
    scene : Scene
        Scene in the section frame: the laser plane is z = 0. Units: mm.
    rig : ImagingRig
        Camera and laser.
    settings : ImageSettings, optional
        Light, blur and noise.
    rng : numpy.random.Generator
        Source of all random numbers; the same state yields the same image.

    Returns
    -------
    SimulatedImage
        Image with its truth; without a line and with NaN as truth if the laser misses the scene.

    Examples
    --------
    >>> from lsvision.simulate import Prism, Scene
    >>> plank = Scene((Prism([[-500.0, -259.8], [500.0, -259.8]], along=(0, 0.5, 0.866)),))
    >>> rendered = simulate_image(plank, ImagingRig.triangulating(), rng=np.random.default_rng(1))
    >>> rendered.image.shape, rendered.image.dtype.name, rendered.truth_pixels[640].round(1)
    ((1024, 1280), 'uint8', array([640., 512.]))
    """
    settings = settings or ImageSettings()
    light, truth_pixels = _render_sheet(scene, rig, settings.sheet_sigma)
    line = _blur_and_scale(light, rig.size, settings)
    if settings.speckle_looks:
        line = _multiply_speckle(line, settings, rng)
    if settings.glints:
        line = line * simulate_glint_gain(truth_pixels, line.shape, settings.glints, rng)
    background = simulate_stray_light(line.shape, settings.stray, rng)
    sensitivity = settings.sensor.draw_sensitivity(line.shape, rng)
    return SimulatedImage(
        expose(background + line, sensitivity, settings.sensor, rng),
        expose(background, sensitivity, settings.sensor, rng),
        truth_pixels,
    )


@dataclass(frozen=True, eq=False)
class _SampledLight:
    """Light before blur in the k pixels that have any.

    Parameters
    ----------
    rows, columns : (k,) ndarray of int
        Pixels.
    samples : (k, SUB_ROWS) ndarray
        Light at the samples of each pixel, from its upper to its lower edge.
    """

    rows: IntArray
    columns: IntArray
    samples: FloatArray


def _render_sheet(
    scene: Scene, rig: ImagingRig, sheet_sigma: float
) -> tuple[_SampledLight, Points]:
    """Return the light before blur and the true line.

    The light is the sheet's Gaussian profile times the cosine of incidence, thus at most 1.
    """
    # Transposed, so that the samples of a column are consecutive.
    columns, rows = np.nonzero(_mask_illuminated_pixels(scene, rig, sheet_sigma).T)
    offsets = (np.arange(SUB_ROWS) - (SUB_ROWS - 1) / 2) / SUB_ROWS
    u = np.repeat(columns, SUB_ROWS)
    v = (rows[:, None] + offsets).ravel()
    rays = rig.compute_rays(np.column_stack([u, v]))
    hits, labels = scene.first_hits(rays)
    hit = np.isfinite(hits.distances)
    depth = np.where(hit, hits.distances, 0.0)
    points = rays.origins + depth[:, None] * rays.directions
    heights = points[:, 2]  # distance from the middle of the sheet, z = 0
    in_sheet = hit & (np.abs(heights) < SHEET_CUTOFF_SIGMAS * sheet_sigma)
    light = np.zeros(len(u))
    light[in_sheet] = _compute_irradiance(scene, rig, points[in_sheet], hits.normals[in_sheet])
    truth = _find_crossings(u, v, np.where(light > 0, heights, np.nan), depth, labels)
    light *= np.exp(-0.5 * (heights / sheet_sigma) ** 2)
    width = rig.size[0]
    pixels = np.column_stack([np.arange(width, dtype=np.float64), np.full(width, np.nan)])
    # Of several crossings in a column, the lowest in the image is written last and remains.
    pixels[truth[:, 0].astype(int), 1] = truth[:, 1]
    return _SampledLight(rows, columns, light.reshape(-1, SUB_ROWS)), pixels


def _mask_illuminated_pixels(scene: Scene, rig: ImagingRig, sheet_sigma: float) -> BoolArray:
    """Return a (height, width) mask of the cells in whose neighbourhood the sheet may be visible.

    A cell counts if the surfaces seen at its corner and at those of its neighbours are not all on
    one side of the sheet.
    """
    width, height = rig.size
    u, v = np.meshgrid(
        np.arange(0, width + CELL_PX, CELL_PX), np.arange(0, height + CELL_PX, CELL_PX)
    )
    rays = rig.compute_rays(np.column_stack([u.ravel(), v.ravel()]))
    distances = scene.first_hits(rays)[0].distances.reshape(u.shape)
    direction_z = rays.directions[:, 2].reshape(u.shape)
    origin_z = rays.origins[:, 2].reshape(u.shape)
    hit = np.isfinite(distances)
    heights = origin_z + np.where(hit, distances, 0.0) * direction_z
    neighbourhood = np.ones((3, 3), np.uint8)
    max_heights = cv2.dilate(np.where(hit, heights, -np.inf), neighbourhood)
    min_heights = cv2.erode(np.where(hit, heights, np.inf), neighbourhood)
    cells = (max_heights > -SHEET_CUTOFF_SIGMAS * sheet_sigma) & (
        min_heights < SHEET_CUTOFF_SIGMAS * sheet_sigma
    )
    pixels: BoolArray = cells.repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)[:height, :width]
    return pixels


def _compute_irradiance(
    scene: Scene, rig: ImagingRig, points: Points, normals: FloatArray
) -> FloatArray:
    """Return the cosine of incidence of the laser at each point, 0 in shadow."""
    origin = np.array([*rig.laser_origin, 0.0])
    to_points = points - origin
    cosine = -np.einsum("ij,ij->i", to_points, normals) / np.linalg.norm(to_points, axis=1)
    laser_rays = Rays(np.broadcast_to(origin, to_points.shape), to_points)
    distances = scene.first_hits(laser_rays)[0].distances
    return np.where(distances > 1 - SHADOW_BIAS, np.maximum(cosine, 0.0), 0.0)


def _find_crossings(
    u: IntArray, v: FloatArray, heights: FloatArray, depth: FloatArray, labels: IntArray
) -> FloatArray:
    """Return u, v (k, 2) where adjacent samples of a surface lie on both sides of the sheet."""
    height, next_height = heights[:-1], heights[1:]
    # A sample exactly in the middle counts as positive, so that it yields one crossing only.
    crossed = (height >= 0) != (next_height >= 0)
    same_surface = (u[:-1] == u[1:]) & (np.diff(v) < 1.5 / SUB_ROWS) & (labels[:-1] == labels[1:])
    index = np.flatnonzero(
        crossed
        & same_surface
        & np.isfinite(height + next_height)
        & (np.abs(np.diff(depth)) < MAX_DEPTH_STEP_MM)
    )
    fraction = height[index] / (height[index] - next_height[index])
    return np.column_stack([u[index], v[index] + fraction * (v[index + 1] - v[index])])


def _blur_and_scale(
    light: _SampledLight, size: tuple[int, int], settings: ImageSettings
) -> FloatArray:
    """Return the light blurred by the lens, scaled to the peak of the settings. Units: DN."""
    width, height = size
    blur = settings.psf_sigma
    if 0 < blur < MIN_SAMPLED_BLUR_PX:
        fine = np.zeros((height, SUB_ROWS, width))
        fine[light.rows, :, light.columns] = light.samples
        spread = cv2.GaussianBlur(
            fine.reshape(-1, width), (0, 0), sigmaX=blur, sigmaY=SUB_ROWS * blur
        )
        blurred: FloatArray = spread.reshape(height, SUB_ROWS, width).mean(axis=1)
    else:
        blurred = np.zeros((height, width))
        blurred[light.rows, light.columns] = light.samples.mean(axis=1)
        if blur > 0:
            blurred = cv2.GaussianBlur(blurred, (0, 0), blur)
    brightest = blurred.max()
    return blurred * (settings.peak / brightest) if brightest > 0 else blurred


def _multiply_speckle(
    line: FloatArray, settings: ImageSettings, rng: np.random.Generator
) -> FloatArray:
    """Return the light of the line with speckle, in the rows that contain it. Units: DN."""
    rows = np.flatnonzero(line.any(axis=1))
    if not len(rows):
        return line
    band = slice(rows[0], rows[-1] + 1)
    speckled = line.copy()
    shape = speckled[band].shape
    speckled[band] *= simulate_speckle_field(
        shape, settings.speckle_looks, settings.speckle_fwhm, rng=rng
    )
    return speckled
