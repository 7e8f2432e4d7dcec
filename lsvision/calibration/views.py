"""Views of a board in a calibration: collection, checks and outliers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.errors import CalibrationFailed, DegenerateGeometry, LsvisionError
from lsvision.geometry import Pose
from lsvision.laser_line.image_array import as_image
from lsvision.sensors.camera import Camera

Image = TypeVar("Image")
View = TypeVar("View")

MIN_TILT = np.radians(5.0)
"""Smallest angle between two boards; below it all boards count as parallel. Units: rad."""


@dataclass(frozen=True)
class RejectedView:
    """Index of a view and the reason for its rejection.

    Parameters
    ----------
    index : int
        Index of the image, from 0.
    reason : str
        Reason with numbers.
    """

    index: int
    reason: str


@dataclass(frozen=True, slots=True)
class ViewSources:
    """Image indices of the views, and the images without a view.

    Parameters
    ----------
    indices : tuple of int, optional
        Image index of each view; the position of the view if None.
    rejected : tuple of RejectedView
        Images without a view, for result and messages.
    """

    indices: tuple[int, ...] | None = None
    rejected: tuple[RejectedView, ...] = ()

    def names(self, count: int) -> list[int]:
        """Return the image indices of `count` views."""
        return list(range(count)) if self.indices is None else list(self.indices)


def collect_views(
    images: Iterable[Image], find: Callable[[Image], View]
) -> tuple[list[View], ViewSources]:
    """Apply `find` to each image; images in which it fails are rejected with the error."""
    views, indices, rejected = [], [], []
    for index, image in enumerate(images):
        try:
            views.append(find(image))
            indices.append(index)
        except LsvisionError as error:
            rejected.append(RejectedView(index, str(error)))
    return views, ViewSources(tuple(indices), tuple(rejected))


def require_size(camera: Camera, image: npt.ArrayLike, name: str) -> None:
    """Require an image of the camera's size.

    Raises
    ------
    CalibrationFailed
        With the image's name and both sizes.
    """
    width, height = camera.size
    shape = as_image(image, name).shape
    if shape[:2] != (height, width):
        got = " x ".join(str(length) for length in shape[1::-1])
        raise CalibrationFailed(
            f"{name} is {got} px and the camera {width} x {height} px: take all images with one "
            "size, uncropped and unscaled"
        )


def require_views(count: int, need: int, shown: str, remedy: str, sources: ViewSources) -> None:
    """Require a number of views, with the reason for each rejected image.

    Raises
    ------
    CalibrationFailed
        "`count` views show `shown` and `need` are needed, best 15: `remedy`".
    """
    if count < need:
        reasons = "".join(f"\n  image {view.index}: {view.reason}" for view in sources.rejected)
        raise CalibrationFailed(
            f"{count} views show {shown} and {need} are needed, best 15: {remedy}{reasons}"
        )


def require_tilted(camera_from_boards: Sequence[Pose], undetermined: str) -> None:
    """Require boards that are not all parallel.

    Raises
    ------
    DegenerateGeometry
        With the largest angle, what is undetermined, and the remedy.
    """
    normals = np.array([pose.rotation[:, 2] for pose in camera_from_boards])
    largest_angle = np.arccos(np.clip(normals @ normals.T, -1, 1)).max()
    if largest_angle < MIN_TILT:
        raise DegenerateGeometry(
            f"all boards are parallel within {np.degrees(largest_angle):.1f} deg, which leaves "
            f"{undetermined} undetermined: tilt the board by 25 deg and more to all sides"
        )


def outlier_views(
    indices: Sequence[int], rms_values: Sequence[float], factor: float, texts: tuple[str, str]
) -> list[RejectedView]:
    """Return the views whose residual exceeds `factor` times the median.

    `rms_values` are the root mean square residuals in px; `texts` are the beginning of the message
    and the remedy.
    """
    median = float(np.median(rms_values))
    prefix, remedy = texts
    return [
        RejectedView(
            index, f"{prefix}{rms:.2f} px rms where the median view has {median:.2f} px: {remedy}"
        )
        for index, rms in zip(indices, rms_values, strict=True)
        if rms > factor * median
    ]


def max_tilt(poses: Sequence[Pose]) -> float:
    """Return the largest angle between a board and the mean board. Units: rad."""
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    return float(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)).max())
