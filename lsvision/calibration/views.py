"""Views of a board that a calibration was given: which are used, named, doubted, enough."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.errors import CalibrationFailed, DegenerateGeometry, LsvisionError
from lsvision.geometry import Pose
from lsvision.sensors.camera import Camera

Image = TypeVar("Image")
View = TypeVar("View")

MIN_TILT = np.radians(5.0)
"""Largest angle between two boards, below which they count as parallel."""


@dataclass(frozen=True, slots=True)
class RejectedView:
    """A view named with what is wrong with it.

    Parameters
    ----------
    index : int
        Which of the images given, from 0.
    reason : str
        In words and numbers.
    """

    index: int
    reason: str


@dataclass(frozen=True, slots=True)
class ViewSources:
    """Which images the views come from, and which images gave none.

    Parameters
    ----------
    indices : tuple of int, optional
        What each view is called in the result; its place if None.
    rejected : tuple of RejectedView
        Views already left out, for the result and the messages.
    """

    indices: tuple[int, ...] | None = None
    rejected: tuple[RejectedView, ...] = ()

    def names(self, count: int) -> list[int]:
        """What each of `count` views is called."""
        return list(range(count)) if self.indices is None else list(self.indices)


def collect_views(
    images: Iterable[Image], find: Callable[[Image], View]
) -> tuple[list[View], ViewSources]:
    """What `find` finds in each image; images in which it fails are rejected by their number."""
    views, indices, rejected = [], [], []
    for index, image in enumerate(images):
        try:
            views.append(find(image))
            indices.append(index)
        except LsvisionError as error:
            rejected.append(RejectedView(index, str(error)))
    return views, ViewSources(tuple(indices), tuple(rejected))


def require_size(camera: Camera, image: npt.ArrayLike, name: str) -> None:
    """Refuse an image of another size than the camera's.

    Raises
    ------
    CalibrationFailed
        With the image's name and both sizes.
    """
    width, height = camera.size
    shape = np.asarray(image).shape
    if shape[:2] != (height, width):
        got = " x ".join(str(length) for length in shape[1::-1])
        raise CalibrationFailed(
            f"{name} is {got} px and the camera {width} x {height} px: take all images with one "
            "size, uncropped and unscaled"
        )


def require_views(count: int, need: int, shown: str, mend: str, sources: ViewSources) -> None:
    """Refuse fewer views than needed, with the reason for each image that gave none.

    Raises
    ------
    CalibrationFailed
        "`count` views show `shown` and `need` are needed, best 15: `mend`".
    """
    if count < need:
        reasons = "".join(f"\n  image {view.index}: {view.reason}" for view in sources.rejected)
        raise CalibrationFailed(
            f"{count} views show {shown} and {need} are needed, best 15: {mend}{reasons}"
        )


def require_tilted(camera_from_boards: Sequence[Pose], undetermined: str) -> None:
    """Refuse boards that are all parallel, which leave something undetermined.

    Raises
    ------
    DegenerateGeometry
        Naming the largest angle and the mend.
    """
    normals = np.array([pose.rotation[:, 2] for pose in camera_from_boards])
    between = np.arccos(np.clip(normals @ normals.T, -1, 1)).max()
    if between < MIN_TILT:
        raise DegenerateGeometry(
            f"all boards are parallel within {np.degrees(between):.1f} deg, which leaves "
            f"{undetermined} undetermined: tilt the board by 25 deg and more to all sides"
        )


def outlier_views(
    indices: Sequence[int], sizes: Sequence[float], factor: float, words: tuple[str, str]
) -> list[RejectedView]:
    """Views whose residual is `factor` times the median view's and more.

    Parameters
    ----------
    indices : sequence of int
        What the views are called.
    sizes : sequence of float
        Root mean square residual of each. Units: px.
    factor : float
        From which on a view is named.
    words : tuple of str
        Before the numbers, and the mend behind them.
    """
    usual = float(np.median(sizes))
    before, mend = words
    return [
        RejectedView(
            index, f"{before}{size:.2f} px rms where the median view has {usual:.2f} px: {mend}"
        )
        for index, size in zip(indices, sizes, strict=True)
        if size > factor * usual
    ]
