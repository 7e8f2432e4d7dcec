"""Points of PointCloud2 messages: each message is a profile; of an organised one, each row.

Definition (sensor_msgs/PointCloud2): ``height`` rows of ``width`` points; a point has `point_step`
bytes, and each field its offset in them, its type and its count. NaN is a point that is lost.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_cells import floats_from
from lsvision.io.profiles.settings import RawProfiles, ReadSettings

MAX_FLATNESS = 1e-6
"""Extent along an axis relative to the largest one, up to which points lie in a plane perpendicular
to that axis."""

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_LIDAR = "PointCloud2 in its x-y plane: X is the scanner's y, Y the opposite of its x"


def profiles_from_clouds(
    clouds: Sequence[FloatArray],
    attributes: Sequence[Mapping[str, float | str]],
    settings: ReadSettings,
) -> RawProfiles:
    """Return the profiles of PointCloud2 messages.

    Points of one plane perpendicular to y are read as x and z; of one perpendicular to z, as of a
    lidar, as those of a LaserScan; other columns where the user names them; all three where a plane
    is to be fitted.

    Parameters
    ----------
    clouds : sequence of (rows, columns, 3) ndarray
        Points from `cloud_points`. Units: m.
    attributes : sequence of mapping
        Attributes of each message.
    settings : ReadSettings
        Columns that the user names.

    Raises
    ------
    UnreadableFile
        If there is no row of points, or those of a row do not lie in a section.
    """
    rows, row_attributes = [], []
    for cloud, cloud_attributes in zip(clouds, attributes, strict=True):
        rows += list(cloud)
        row_attributes += [cloud_attributes] * len(cloud)
    if not rows:
        raise UnreadableFile("PointCloud2 messages without a row of points: record the topic again")
    columns, away, notes = _section_columns(rows, settings)
    return RawProfiles(
        sections=[row[:, columns] for row in rows],
        units=("m", "m"),
        away=away,
        notes=notes,
        attributes=tuple(row_attributes),
    )


def cloud_points(cloud: Any) -> FloatArray:
    """Return the (rows, columns, 3) points of a message, whose fields are attributes. Units: m.

    Raises
    ------
    UnreadableFile
        If it has no x, y and z, or is truncated.
    """
    order = ">" if cloud.is_bigendian else "<"
    fields = {field.name: field for field in cloud.fields}
    if not {"x", "y", "z"} <= set(fields):
        raise UnreadableFile(
            f"a PointCloud2 with {', '.join(fields) or 'nothing'}: expected x, y, z"
        )
    data = np.ascontiguousarray(cloud.data, dtype=np.uint8)
    shape = (int(cloud.height), int(cloud.width))
    strides = (int(cloud.row_step), int(cloud.point_step))
    coordinates = []
    for axis in "xyz":
        field = fields[axis]
        kind = np.dtype(order + _TYPES.get(field.datatype, "V1"))
        last_offset = (shape[0] - 1) * strides[0] + (shape[1] - 1) * strides[1] + field.offset
        if (
            kind.kind == "V"
            or last_offset + kind.itemsize > data.nbytes
            or min(*shape, *strides) < 0
        ):
            raise UnreadableFile(
                f"a PointCloud2 whose {axis} is truncated or of an unknown type: record it again"
            )
        coordinate: Any = np.zeros(shape)
        if coordinate.size:
            coordinate = np.ndarray(shape, kind, data, field.offset, strides)
        coordinates.append(floats_from(coordinate))
    return np.stack(coordinates, axis=-1)


def _section_columns(
    rows: Sequence[FloatArray], settings: ReadSettings
) -> tuple[list[int], bool, tuple[str, ...]]:
    """Return the columns of x and height, whether heights grow away from the sensor, and notes.

    All three columns if a plane is to be fitted.
    """
    if settings.plane is not None:
        return [0, 1, 2], False, ()
    if settings.columns is not None:
        requested = [str(column).lower() for column in settings.columns]
        names = {**{axis: k for k, axis in enumerate("xyz")}, "0": 0, "1": 1, "2": 2}
        if len(requested) != 2 or not set(requested) <= set(names):
            raise UnreadableFile(
                f"no columns {', '.join(requested)} in a PointCloud2: expected two of x,y,z"
            )
        return [names[column] for column in requested], False, ()
    extents = np.array([_largest_extent(rows, axis) for axis in range(3)])
    is_flat = extents <= MAX_FLATNESS * extents.max()
    if is_flat[1]:
        return [0, 2], False, ()
    if is_flat[2]:
        return [1, 0], True, (_LIDAR,)
    raise UnreadableFile(
        "a PointCloud2 whose points do not lie in a section perpendicular to y or z (they span "
        f"{' x '.join(f'{extent:.3g}' for extent in extents)} m): publish it in the scanner's own "
        "frame, or name two of its coordinates as --columns x,z"
    )


def _largest_extent(rows: Sequence[FloatArray], axis: int) -> float:
    """Return the largest extent of a row of points along an axis. Units: m."""
    extents = [0.0]
    for row in rows:
        finite = row[np.isfinite(row).all(axis=1), axis]
        extents.append(float(np.ptp(finite)) if len(finite) else 0.0)
    return max(extents)
