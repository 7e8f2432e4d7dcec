"""Pictures of a pipe before a wall in laser light, rendered apart from `lsvision.simulate`.

Every pixel is the mean of `FINE` x `FINE` rays, met with pipe and wall in closed form, and the lens
blurs the fine picture: blur and the pixel's own width are exact in both directions. The camera
may be turned about its optical axis, the pipe may carry dark paint.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lsvision.geometry import Plane
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

FINE = 5
"""Rays of a pixel along u and along v."""
PIXEL_STD = math.sqrt((1 - 1 / FINE**2) / 12)
"""Standard deviation of the places of a pixel's rays along u. Units: px."""
SHEET_SIGMAS = 5.0
ANGLE = math.radians(30.0)
DISTANCE = 300.0
LASER = np.array([0.0, 100.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What is seen; section frame as of `LightSection`, angles in deg, blur and size in px."""

    radius: float = 20.0
    centre: tuple[float, float] = (3.0, -270.0)
    tilt: tuple[float, float] = (0.0, 0.0)  # of the axis towards X and Y
    roll: float = 0.0
    psf: float = 0.5
    sheet: float = 0.15
    wall: float | None = -290.0  # its Y
    dark: tuple[float, float] | None = None  # X of the edges of a stripe of paint
    cut: float | None = None  # cosine of incidence below which a shiny surface is dark
    focal_length: float = 1415.0
    size: tuple[int, int] = (800, 600)

    @property
    def blur(self):
        """Standard deviation of the point spread of lens and pixel."""
        return math.hypot(self.psf, PIXEL_STD)

    @property
    def camera_from_section(self):
        """Rotation (3, 3) and translation (3,)."""
        sin, cos, roll = math.sin(ANGLE), math.cos(ANGLE), math.radians(self.roll)
        level = np.array([[1, 0, 0], [0, sin, cos], [0, -cos, sin]])
        turn = np.array(
            [
                [math.cos(roll), -math.sin(roll), 0],
                [math.sin(roll), math.cos(roll), 0],
                [0, 0, 1],
            ]
        )
        rotation = turn @ level
        return rotation, rotation[:, 2] * DISTANCE * sin

    def light_section(self, blur=0.0):
        """The rig as calibrated without error, with this blur stated."""
        width, height = self.size
        matrix = [[self.focal_length, 0, width / 2], [0, self.focal_length, height / 2], [0, 0, 1]]
        rotation, translation = self.camera_from_section
        plane = Plane(rotation[:, 2], float(rotation[:, 2] @ translation))
        return LightSection(Camera(matrix, [], self.size), plane, line_blur_px=blur)

    @lru_cache(maxsize=8)  # noqa: B019 - a dozen pictures of 4 MB are a test run's
    def light(self):
        """Mean light of each pixel, 1 at the brightest place."""
        width, height = self.size
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        heights = self._seen(u.ravel(), v.ravel())[0].reshape(u.shape)
        near = np.abs(heights) < (SHEET_SIGMAS + 3) * self.sheet
        mask = cv2.dilate(near.astype(np.uint8), np.ones((5, 5), np.uint8))
        rows, columns = np.nonzero(mask)
        steps = (np.arange(FINE) - (FINE - 1) / 2) / FINE
        fine_u = columns[:, None, None] + steps[None, None, :] + 0 * steps[None, :, None]
        fine_v = rows[:, None, None] + steps[None, :, None] + 0 * steps[None, None, :]
        heights, brightness = self._seen(fine_u.ravel(), fine_v.ravel())
        values = brightness * np.exp(-0.5 * (heights / self.sheet) ** 2)
        fine = np.zeros((height, FINE, width, FINE), np.float32)
        fine[rows, :, columns, :] = np.nan_to_num(values).reshape(-1, FINE, FINE)
        blurred = fine.reshape(height * FINE, width * FINE)
        if self.psf:
            blurred = cv2.GaussianBlur(blurred, (0, 0), self.psf * FINE)
        mean = blurred.reshape(height, FINE, width, FINE).mean(axis=(1, 3), dtype=np.float64)
        mean /= mean.max()
        mean.setflags(write=False)
        return mean

    def _seen(self, u, v):
        """Height above the laser plane, and brightness, of what each pixel sees; NaN without."""
        rotation, translation = self.camera_from_section
        width, height = self.size
        rays = np.stack([u - width / 2, v - height / 2, np.full(len(u), self.focal_length)])
        directions = (rotation.T @ rays).T / self.focal_length
        eye = -rotation.T @ translation
        reach, on_pipe = self._first(np.broadcast_to(eye, directions.shape), directions)
        points = np.where(np.isfinite(reach), reach, np.nan)[:, None] * directions + eye
        normals = np.where(on_pipe[:, None], self._normals(points), [0.0, 1.0, 0.0])
        to_light = LASER - points
        distance = np.linalg.norm(to_light, axis=1)
        cosine = np.einsum("ij,ij->i", to_light, normals) / distance
        shadow = self._first(points + 1e-6 * normals, to_light)[0] < 1.0
        brightness = np.where(shadow, 0.0, np.maximum(cosine, 0.0))
        if self.cut is not None:
            brightness = np.where(brightness > self.cut, 1.0, 0.0)
        if self.dark is not None:
            painted = (points[:, 0] > self.dark[0]) & (points[:, 0] < self.dark[1])
            brightness = np.where(painted, 0.2 * brightness, brightness)
        return points[:, 2], brightness

    @property
    def _axis(self):
        axis = np.array([*np.tan(np.radians(self.tilt)), 1.0])
        return axis / np.linalg.norm(axis)

    def _normals(self, points):
        offset = points - [*self.centre, 0.0]
        return (offset - (offset @ self._axis)[:, None] * self._axis) / self.radius

    def _first(self, origins, directions):
        """Multiples of the directions at the nearest hit, inf without, and if it is the pipe."""
        axis, offset = self._axis, origins - [*self.centre, 0.0]
        across = directions - (directions @ axis)[:, None] * axis
        offset = offset - (offset @ axis)[:, None] * axis
        a = np.einsum("ij,ij->i", across, across)
        b = np.einsum("ij,ij->i", across, offset)
        c = np.einsum("ij,ij->i", offset, offset) - self.radius**2
        root = b * b - a * c
        near = (-b - np.sqrt(np.where(root > 0, root, np.nan))) / a
        pipe = np.where(near > 0, near, np.inf)
        wall = np.full(len(pipe), np.inf)
        if self.wall is not None:
            with np.errstate(divide="ignore"):
                to_wall = (self.wall - origins[:, 1]) / directions[:, 1]
            wall = np.where(to_wall > 0, to_wall, np.inf)
        return np.minimum(pipe, wall), (pipe <= wall) & np.isfinite(pipe)


def photograph(light, rng, peak=180.0, dark=8.0, read_noise=2.0, electrons_per_dn=40.0):
    """An 8-bit image of the light with shot and read noise."""
    mean = dark + peak * light
    noise = rng.normal(size=light.shape) * np.sqrt(read_noise**2 + mean / electrons_per_dn)
    return np.clip(np.rint(mean + noise), 0, 255).astype(np.uint8)
