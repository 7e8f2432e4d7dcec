"""Views of a board in a calibration: collection, checks and outliers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.errors import CalibrationFailed, DegenerateGeometry, LsvisionError
from lsvision.geometry import FloatArray, Pose
from lsvision.laser_line.image_array import as_image
from lsvision.results.summaries import format_count
from lsvision.sensors.camera import Camera

Image = TypeVar("Image")
View = TypeVar("View")

MIN_OUTLIER_PX = 0.15
"""Rms residual up to which a view is never an outlier, whatever the others have: good views have
0.05 to 0.3 px. Units: px."""
MAX_LISTED_PER_REASON = 2
"""Largest number of images with the same reason for rejection that are listed one by one."""
RECOMMENDED_VIEWS = 10
"""Number of views below which a warning is given."""
RECOMMENDED_TILT = np.radians(25.0)
"""A warning is given if no board's normal is tilted by more than this from the mean normal. The
error of the focal length is twice as large at 15 deg, and ten times at 5 deg; that of a laser plane
is 7 times larger at 5 deg. Units: rad."""
MIN_TILT = np.radians(5.0)
"""Boards are parallel if no two of their normals differ by this angle. Units: rad."""


@dataclass(frozen=True)
class RejectedView:
    """Index of a view, and the reason why it is rejected or reported as an outlier.

    Parameters
    ----------
    index : int
        Index of the image, from 0.
    reason : str
        Reason in words, with numbers.
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

    def list_image_indices(self, count: int) -> list[int]:
        """Return the image indices of `count` views."""
        return list(range(count)) if self.indices is None else list(self.indices)


def collect_views(
    images: Iterable[Image], find: Callable[[Image], View], content_key: Callable[[View], bytes]
) -> tuple[list[View], ViewSources]:
    """Return the views that `find` finds in the images, and the rejected images.

    Rejected are images in which `find` raises an `LsvisionError`, and those of the same content as
    an earlier one (equal `content_key` of the view): a photo that is stored twice counts once.
    """
    views, rejected = dict[int, View](), []
    for index, image in enumerate(images):
        try:
            views[index] = find(image)
        except LsvisionError as error:
            rejected.append(RejectedView(index, str(error)))
    indices = list(views)
    for repeated, original in find_repeated(map(content_key, views.values())).items():
        del views[indices[repeated]]
        reason = f"the same photo as image {indices[original]}"
        rejected.append(RejectedView(indices[repeated], reason))
    rejected.sort(key=lambda view: view.index)
    return list(views.values()), ViewSources(tuple(views), tuple(rejected))


def find_repeated(contents: Iterable[bytes]) -> dict[int, int]:
    """Return the index of each content that equals an earlier one, with the index of the first.

    The contents are the numbers of each observation, to the last digit, as bytes: one that is
    stored twice would be taken for a perfect agreement. Sorted by index; empty if all differ.

    Examples
    --------
    >>> find_repeated([b"a", b"b", b"a", b"a"])
    {2: 0, 3: 0}
    """
    first_index: dict[bytes, int] = {}
    repeated = {}
    for index, content in enumerate(contents):
        earlier = first_index.setdefault(content, index)
        if earlier != index:
            repeated[index] = earlier
    return repeated


def require_size(camera: Camera, image: npt.ArrayLike, name: str) -> None:
    """Raise CalibrationFailed, with a name, unless an image is of the camera's size."""
    width, height = camera.size
    shape = as_image(image, name).shape
    if shape[:2] != (height, width):
        got = " x ".join(str(length) for length in shape[1::-1])
        raise CalibrationFailed(
            f"{name} is {got} px and the camera {width} x {height} px: take all images with one "
            "size, uncropped and unscaled"
        )


def require_views(
    count: int, min_count: int, content: str, remedy: str, sources: ViewSources
) -> None:
    """Raise an error if there are too few views, with the reason for each rejected image.

    CalibrationFailed: "`count` views show `content` and `min_count` are needed, best 15: `remedy`",
    and reasons.
    """
    if count < min_count:
        show = "show" if count != 1 else "shows"
        reasons = "".join(f"; {text}" for text in _describe_rejections(sources.rejected))
        raise CalibrationFailed(
            f"{format_count(count, 'view')} {show} {content} and {min_count} are needed, best 15: "
            f"{remedy}{reasons}"
        )


def _describe_rejections(rejected: Sequence[RejectedView]) -> list[str]:
    """Return the reason for each image; a reason shared by many only once, after all of them."""
    images: dict[str, list[int]] = {}
    for view in rejected:
        images.setdefault(view.reason, []).append(view.index)
    texts = []
    for reason, indices in images.items():
        if len(indices) > MAX_LISTED_PER_REASON:
            texts.append(", ".join(f"image {index}" for index in indices) + f": {reason}")
        else:
            texts += [f"image {index}: {reason}" for index in indices]
    return texts


def require_tilted(camera_from_boards: Sequence[Pose], undetermined: str) -> None:
    """Raise DegenerateGeometry if all boards are parallel.

    The message states the angle, what is `undetermined`, and the remedy.
    """
    normals = np.array([pose.rotation[:, 2] for pose in camera_from_boards])
    largest_angle = np.arccos(np.clip(normals @ normals.T, -1, 1)).max()
    if largest_angle < MIN_TILT:
        raise DegenerateGeometry(
            f"all boards are parallel within {np.degrees(largest_angle):.1f} deg, which leaves "
            f"{undetermined} undetermined: tilt the board by "
            f"{np.degrees(RECOMMENDED_TILT):.0f} deg and more to all sides"
        )


def rms_distance(residuals: FloatArray) -> float:
    """Return the root mean square length of residuals (n, 2), per point as in OpenCV."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def find_outlier_views(
    indices: Sequence[int],
    rms_values: Sequence[float],
    factor: float,
    *,
    remedy: str,
    prefix: str = "",
) -> list[RejectedView]:
    """Return the views whose residual exceeds `factor` times the median, and `MIN_OUTLIER_PX`.

    `indices` are the image indices, `rms_values` the root mean square residuals in px; each reason
    starts with `prefix` and ends with `remedy`.
    """
    median = float(np.median(rms_values))
    return [
        RejectedView(
            index, f"{prefix}{rms:.2f} px rms where the median view has {median:.2f} px: {remedy}"
        )
        for index, rms in zip(indices, rms_values, strict=True)
        if rms > max(factor * median, MIN_OUTLIER_PX)
    ]


def compute_max_tilt(poses: Sequence[Pose]) -> float:
    """Return the largest angle between a board's normal and the mean normal. Units: rad."""
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    return float(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)).max())
