"""Frames of a video file or of a connected camera."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.limited_reading import check_readable

Frame = npt.NDArray[Any]
"""Image (height, width), or (height, width, 3) in the order blue, green, red; 8 or 16 bit."""

SILENT = 0
"""LOG_LEVEL_SILENT of OpenCV 4 and 5."""
FFMPEG_SILENT = ("OPENCV_FFMPEG_LOGLEVEL", "-8")
"""Environment variable that stops messages of ffmpeg, with which OpenCV reads videos."""


def read_frames(path: str | os.PathLike[str]) -> Iterator[Frame]:
    """Read the frames of a video file in order.

    Parameters
    ----------
    path : path
        Any format of OpenCV's back ends: AVI, MP4, MKV, MOV.

    Yields
    ------
    (height, width, 3) ndarray of uint8
        Blue, green, red; in a grey video equal but for the rounding of its codec. Not rotated by
        the orientation that the file states.

    Raises
    ------
    UnreadableFile
        If the file is missing, is not a video, or holds no frame; names the file and the remedy.
    """
    source = Path(path)
    check_readable(source)
    with _open_capture(str(source)) as capture:
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        frames = _decode_frames(capture)
        first_frame = next(frames, None)
        if first_frame is None:
            raise UnreadableFile(
                f"{source} holds no frame that can be decoded: play it to see whether it is "
                "complete, or save it again as AVI or MP4"
            )
        yield first_frame
        yield from frames


def capture_frames(index: int, count: int | None = None) -> Iterator[Frame]:
    """Read frames of a connected camera.

    Parameters
    ----------
    index : int
        Index of ``cv2.VideoCapture``: 0 is the first camera of the computer.
    count : int, optional
        Number of frames; None reads without end.

    Yields
    ------
    (height, width) or (height, width, 3) ndarray of uint8
        Grey, or blue, green, red.

    Raises
    ------
    LsvisionError
        If there is no such camera, or it stops sending; names the index and the remedy.
    """
    with _open_capture(index) as capture:
        received = 0
        for frame in islice(_decode_frames(capture), count):
            received += 1
            yield frame
    if count is None or received < count:
        requested = "" if count is None else f" of {count}"
        raise LsvisionError(
            f"camera {index} sent {received}{requested} frames: check its cable, "
            "that no other program uses it, and its index (0 is the first)"
        )


@contextmanager
def _open_capture(source: str | int) -> Iterator[Any]:
    """Open a video file or a camera; suppress the messages of OpenCV and ffmpeg until it is closed.

    The log level of OpenCV is that of the whole process; the one of ffmpeg stays set.
    """
    # OpenCV 4 has getLogLevel and setLogLevel in cv2, OpenCV 5 in cv2.utils.logging.
    logging: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    level = logging.getLogLevel()
    os.environ.setdefault(*FFMPEG_SILENT)
    logging.setLogLevel(SILENT)
    try:
        capture = cv2.VideoCapture(source)
        try:
            yield capture
        finally:
            capture.release()
    finally:
        logging.setLogLevel(level)


def _decode_frames(capture: Any) -> Iterator[Frame]:
    while True:
        received, frame = capture.read()
        if not received:
            return
        yield np.asarray(frame)
