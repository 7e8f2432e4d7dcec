"""Views of a board in a calibration: collection, checks and outliers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.calibration.repeated import find_repeated
from lsvision.errors import CalibrationFailed, DegenerateGeometry, LsvisionError
from lsvision.geometry import Pose
from lsvision.laser_line.image_array import as_image
from lsvision.results.summaries import counted
from lsvision.sensors.camera import Camera

Image = TypeVar("Image")
View = TypeVar("View")

MIN_OUTLIER_PX = 0.15
"""Residual up to which a view is no outlier, however small the others are: good sets have 0.05 to
0.3 px. Units: px."""
MAX_REPEATED = 2
"""Number of images up to which each is listed with the reason that it shares with others."""
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
    images: Iterable[Image], find: Callable[[Image], View], content: Callable[[View], bytes]
) -> tuple[list[View], ViewSources]:
    """Apply `find` to each image; images in which it fails are rejected with the error.

    So are those of the same `content` as an earlier one: a photo that is there twice counts once.
    """
    found, rejected = dict[int, View](), []
    for index, image in enumerate(images):
        try:
            found[index] = find(image)
        except LsvisionError as error:
            rejected.append(RejectedView(index, str(error)))
    indices = list(found)
    for repeated, first in find_repeated(map(content, found.values())).items():
        del found[indices[repeated]]
        reason = f"the same photo as image {indices[first]}"
        rejected.append(RejectedView(indices[repeated], reason))
    rejected.sort(key=lambda view: view.index)
    return list(found.values()), ViewSources(tuple(found), tuple(rejected))


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
        "`count` views show `shown` and `need` are needed, best 15: `remedy`", and the reasons.
    """
    if count < need:
        show = "show" if count != 1 else "shows"
        reasons = "".join(f"; {text}" for text in _rejections(sources.rejected))
        raise CalibrationFailed(
            f"{counted(count, 'view')} {show} {shown} and {need} are needed, best 15: "
            f"{remedy}{reasons}"
        )


def _rejections(rejected: Sequence[RejectedView]) -> list[str]:
    """Return the reason for each image; one that many share only once, behind all of them."""
    images: dict[str, list[int]] = {}
    for view in rejected:
        images.setdefault(view.reason, []).append(view.index)
    texts = []
    for reason, indices in images.items():
        if len(indices) > MAX_REPEATED:
            texts.append(", ".join(f"image {index}" for index in indices) + f": {reason}")
        else:
            texts += [f"image {index}: {reason}" for index in indices]
    return texts


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
    """Return the views whose residual exceeds `factor` times the median, and `MIN_OUTLIER_PX`.

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
        if rms > max(factor * median, MIN_OUTLIER_PX)
    ]


def max_tilt(poses: Sequence[Pose]) -> float:
    """Return the largest angle between a board and the mean board. Units: rad."""
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    return float(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)).max())
