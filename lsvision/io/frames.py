"""Frames of a video file or of a camera: its index, or the address of a GenICam camera."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import count, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import exists
from lsvision.files.limited_reading import check_readable

Frame = npt.NDArray[Any]
"""Image (height, width), or (height, width, 3) in the order blue, green, red; 8 or 16 bit."""

OPENCV_SILENT = 0
"""LOG_LEVEL_SILENT of OpenCV 4 and 5."""
MAX_CAMERA_INDEX = 2**31 - 1
"""Largest index that OpenCV takes; a larger one is that of no camera, either."""
FFMPEG_SILENT = ("OPENCV_FFMPEG_LOGLEVEL", "-8")
"""Environment variable that stops messages of ffmpeg, with which OpenCV reads videos."""
GENICAM_PREFIX = "genicam:"
"""Prefix of the address of a GenICam camera; without an address, the only connected one."""
MAX_INDEX_DIGITS = 10
"""Number of digits of `MAX_CAMERA_INDEX`; a longer name is that of a file."""
DISCOVERY_TIMEOUT_MS, FRAME_TIMEOUT_MS = 1000, 3000
"""Time limits for the discovery of cameras, and for a frame. Units: ms. Aravis waits 1 s, too, for
the answers of GigE Vision cameras; a frame includes the exposure and the wait for a trigger."""


def read_frames(path: str | os.PathLike[str]) -> Iterator[Frame]:
    """Yield the frames of a video file in order, (height, width, 3) of uint8: blue, green, red.

    Any format of OpenCV's back ends: AVI, MP4, MKV, MOV. In a grey video the channels are equal but
    for the rounding of its codec. Frames are not rotated by the orientation that the file states,
    since the camera's calibration refers to the rows and columns of the sensor.

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
    """Yield frames of a connected camera of uint8: grey, or blue, green, red.

    `index` is that of ``cv2.VideoCapture``, 0 for the first camera of the computer; without a
    `count` frames are read without end.

    Raises
    ------
    LsvisionError
        If there is no such camera, or it stops sending; names the index and the remedy.
    """
    with _open_capture(min(index, MAX_CAMERA_INDEX)) as capture:
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
    logging.setLogLevel(OPENCV_SILENT)
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


def open_camera(name: str) -> Iterator[Frame]:
    """Return the frames of a camera, without end, or those of a video file.

    The name is the index of a connected camera, such as ``"0"``; ``"genicam:192.168.1.20"``, or
    ``"genicam:"`` for the only one; or a video file. It is opened with the first frame.

    Raises
    ------
    LsvisionError
        While frames are read: if there is no such camera or file, viva-genicam is not installed, or
        the camera stops sending.
    """
    if name.startswith(GENICAM_PREFIX):
        return _read_genicam_frames(name.removeprefix(GENICAM_PREFIX))
    if name.isdecimal() and len(name) <= MAX_INDEX_DIGITS and not exists(name):
        return capture_frames(int(name))
    return read_frames(name)


def _read_genicam_frames(address: str) -> Iterator[Frame]:
    """Yield the frames of a GigE Vision camera without end; USB3 Vision is not supported."""
    try:
        library: Any = import_module("viva_genicam")
    except ImportError:
        raise LsvisionError(
            "GenICam cameras need viva-genicam: pip install 'lsvision[genicam]'"
        ) from None
    device = _find_device(library, address)
    try:
        with library.connect_gige(device) as camera, camera.stream() as stream:
            for number in count():
                frame = stream.next_frame(FRAME_TIMEOUT_MS)
                if frame is None:
                    raise LsvisionError(
                        f"camera {device.ip} sent {number} frames and then none for "
                        f"{FRAME_TIMEOUT_MS / 1000:g} s: check trigger mode, cable and firewall"
                    )
                array = np.asarray(frame.to_numpy())
                if array.ndim == 1:  # the raw bytes of a pixel format that it does not decode
                    raise LsvisionError(
                        f"camera {device.ip} sends no images that can be decoded: set its "
                        "PixelFormat to Mono8 or RGB8"
                    )
                yield array[..., ::-1] if array.ndim == 3 else array  # RGB to BGR
    except library.GenicamError as error:
        raise LsvisionError(
            f"camera {device.ip}: {error}: check that no other program uses it"
        ) from error


def _find_device(library: Any, address: str) -> Any:
    """Return the one GenICam camera at an address, or the only one if the address is empty."""
    include_loopback = address.startswith("127.")  # of a simulated camera
    interface = None  # all
    cameras = library.discover(DISCOVERY_TIMEOUT_MS, interface, include_loopback)
    matching = [device for device in cameras if address in ("", device.ip)]
    if len(matching) != 1:
        known = ", ".join(f"{device.ip} ({device.model})" for device in cameras) or "none"
        raise LsvisionError(
            f"expected one GenICam camera at {address or 'any address'}, found {known}: name one "
            "as genicam:ADDRESS, and check its cable and network"
        )
    return matching[0]
