"""Frames of a named source: the index of a camera, a GenICam camera, or a video file."""

from collections.abc import Iterator
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from lsvision.errors import LsvisionError
from lsvision.io.frames import Frame, capture_frames, read_frames

GENICAM = "genicam:"
"""Prefix of the address of a GenICam camera; without an address, the only connected one."""
DISCOVERY_MS, FRAME_MS = 1000, 3000
"""Time limits for the discovery of cameras, and for a frame. Units: ms."""


def open_camera(name: str) -> Iterator[Frame]:
    """Return the frames of a camera, without end, or those of a video file.

    Parameters
    ----------
    name : str
        Index of a connected camera, such as ``"0"``; ``"genicam:192.168.1.20"``, or ``"genicam:"``
        for the only one; or a video file.

    Returns
    -------
    iterator of Frame
        The camera is opened when the first frame is requested.

    Raises
    ------
    LsvisionError
        While frames are read: if there is no such camera or file, viva-genicam is not installed, or
        the camera stops sending.
    """
    if name.startswith(GENICAM):
        return _read_genicam_frames(name.removeprefix(GENICAM))
    if name.isdecimal() and not Path(name).exists():
        return capture_frames(int(name))
    return read_frames(name)


def _read_genicam_frames(address: str) -> Iterator[Frame]:
    """Yield the frames of a GigE Vision camera without end."""
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
                frame = stream.next_frame(FRAME_MS)
                if frame is None:
                    raise LsvisionError(
                        f"camera {device.ip} sent {number} frames and then none for "
                        f"{FRAME_MS / 1000:g} s: check trigger mode, cable and firewall"
                    )
                array = np.asarray(frame.to_numpy())
                if array.ndim == 1:
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
    cameras = library.discover(DISCOVERY_MS, None, include_loopback)  # None: on all interfaces
    matching = [device for device in cameras if address in ("", device.ip)]
    if len(matching) != 1:
        known = ", ".join(f"{device.ip} ({device.model})" for device in cameras) or "none"
        raise LsvisionError(
            f"expected one GenICam camera at {address or 'any address'}, found {known}: name one "
            "as genicam:ADDRESS, and check its cable and network"
        )
    return matching[0]
