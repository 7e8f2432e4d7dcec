"""ROS bags (ROS 1 ``.bag``, ROS 2 ``.db3`` and ``.mcap``) of LaserScan or PointCloud2.

They are read by the library rosbags (``pip install 'lsvision[ros]'``). Units of ROS (REP 103): m.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.laser_scan import SCAN_KEYS, profiles_from_scans
from lsvision.io.profiles.number_table import floats_from
from lsvision.io.profiles.settings import RawProfiles, ReadSettings

MAX_FLATNESS_RATIO = 1e-6
"""Extent along an axis relative to the largest one, up to which points lie in a plane perpendicular
to that axis."""

_NUMPY_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's name of each data type of a PointField."""
_LIDAR_NOTE = "PointCloud2 in its x-y plane: X is the scanner's y, Y the opposite of its x"
"""Note on the axes of a cloud of a scanner."""
LASER_SCAN, POINT_CLOUD = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
"""Types of messages that hold profiles."""
MAX_NAMED_TOPICS = 8
"""Largest number of topics that an error message lists."""
_SUFFIXES = {b"#ROS": ".bag", b"\x89MCA": ".mcap", b"SQLi": ".db3"}
"""Suffix of a bag by the first four bytes of its file."""


@dataclass(frozen=True, eq=False)
class Message:
    """A message of a bag: fields of a LaserScan, or the (rows, columns, 3) points of a cloud in m.

    Its attributes are ``stamp_s``, the time stamp (of the recording where the message has none),
    and ``frame_id``.
    """

    content: Any
    attributes: Mapping[str, float | str]


def read_ros_bag(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a bag's LaserScan or PointCloud2 messages, with their attributes.

    Raises
    ------
    UnreadableFile
        If rosbags is not installed, the bag is broken or holds no such message, or several topics
        do and none is chosen.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"bag{_SUFFIXES.get(content[:4], '.bag')}"
        path.write_bytes(content)
        kind, messages = _read_messages(path, settings.topic)
    contents = [message.content for message in messages]
    attributes = [message.attributes for message in messages]
    if kind == POINT_CLOUD:
        return _profiles_from_clouds(contents, attributes, settings)
    return replace(profiles_from_scans(contents), attributes=tuple(attributes))


def _read_messages(path: Path, topic: str | None) -> tuple[str, list[Message]]:
    """Return the type and messages of the chosen topic."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UnreadableFile(
            "a ROS bag, which the library rosbags reads: pip install 'lsvision[ros]'"
        ) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            connections = _select_connections(reader.connections, topic)
            kind: str = connections[0].msgtype
            messages = list(_decode_messages(reader, connections))
    except UnreadableFile:
        raise
    except Exception as error:  # noqa: BLE001 - rosbags states no list of what broken bytes raise
        reason = " ".join(str(error).replace(str(path), "the file").split())[:100]
        raise UnreadableFile(
            f"a ROS bag that rosbags cannot read ({reason or type(error).__name__}): check it with "
            "rosbag info or ros2 bag info, repair it with rosbag reindex, or record it again"
        ) from None
    if not messages:
        raise UnreadableFile(
            "a ROS bag whose index refers to no message: repair or record it again"
        )
    return kind, messages


def _select_connections(connections: Sequence[Any], topic: str | None) -> list[Any]:
    """Return the connections of one topic with profiles: the chosen one, or the only one."""
    supported = [c for c in connections if c.msgtype in (LASER_SCAN, POINT_CLOUD) and c.msgcount]
    selected = [c for c in supported if topic is None or c.topic.strip("/") == topic.strip("/")]
    topics = dict.fromkeys((c.topic, c.msgtype) for c in selected)
    if len(topics) == 1:
        return selected
    if topics:
        raise UnreadableFile(
            f"a ROS bag of several topics with profiles: use --topic {_list_topics(selected)}"
        )
    if topic is not None and supported:
        raise UnreadableFile(
            f"no topic {topic!r} with profiles in it: use --topic {_list_topics(supported)}"
        )
    raise UnreadableFile(
        "a ROS bag without a message of LaserScan or PointCloud2 (it has "
        f"{_list_topics(connections) or 'no topic'}): record the topic of the scanner"
    )


def _list_topics(connections: Sequence[Any]) -> str:
    """Return the topics with their types and numbers of messages as text, for an error message."""
    counts: dict[str, int] = {}
    for connection in connections:
        kind = connection.msgtype.rpartition("/")[2]
        name = f"{connection.topic} ({kind})"
        counts[name] = counts.get(name, 0) + connection.msgcount
    names = [f"{name[:-1]}, {count} messages)" for name, count in counts.items()]
    more = len(names) - MAX_NAMED_TOPICS
    joined = " or ".join(names[:MAX_NAMED_TOPICS])
    return f"{joined} or {more} more" if more > 0 else joined


def _decode_messages(reader: Any, connections: Sequence[Any]) -> Iterator[Message]:
    """Yield the content of each message, with its time stamp and frame."""
    for connection, recorded_ns, raw in reader.messages(connections=connections):
        fields = reader.deserialize(raw, connection.msgtype)
        stamp = fields.header.stamp
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        attributes = {
            "stamp_s": (stamp_ns or recorded_ns) / 1e9,
            "frame_id": fields.header.frame_id,
        }
        content = (
            _read_scan_fields(fields)
            if connection.msgtype == LASER_SCAN
            else _read_cloud_points(fields)
        )
        yield Message(content, attributes)


def _read_scan_fields(fields: Any) -> dict[str, Any]:
    """Return the fields of a LaserScan from which its points are computed."""
    scan = {name: float(getattr(fields, name)) for name in SCAN_KEYS}
    return scan | {"ranges": fields.ranges.tolist()}


def _read_cloud_points(cloud: Any) -> FloatArray:
    """Return the (rows, columns, 3) points of a message, whose fields are attributes. Units: m.

    Definition (sensor_msgs/PointCloud2): ``height`` rows of ``width`` points; a point has
    `point_step` bytes, and each field its offset in them, its type and its count. NaN is a lost
    point. Each message is a profile; of an organised one, each row.

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
        kind = np.dtype(order + _NUMPY_TYPES.get(field.datatype, "V1"))
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


def _profiles_from_clouds(
    clouds: Sequence[FloatArray],
    attributes: Sequence[Mapping[str, float | str]],
    settings: ReadSettings,
) -> RawProfiles:
    """Return the profiles of PointCloud2 messages, (rows, columns, 3) each in m.

    Points of one plane perpendicular to y are read as x and z; of one perpendicular to z, as of a
    lidar, as those of a LaserScan; other columns where the user names them; all three where a plane
    is to be fitted.

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
    columns, away, notes = _choose_section_columns(rows, settings)
    return RawProfiles(
        sections=[row[:, columns] for row in rows],
        units=("m", "m"),
        away=away,
        notes=notes,
        attributes=tuple(row_attributes),
    )


def _choose_section_columns(
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
    extents = np.array([_measure_largest_extent(rows, axis) for axis in range(3)])
    is_flat = extents <= MAX_FLATNESS_RATIO * extents.max()
    if is_flat[1]:
        return [0, 2], False, ()
    if is_flat[2]:
        return [1, 0], True, (_LIDAR_NOTE,)
    raise UnreadableFile(
        "a PointCloud2 whose points do not lie in a section perpendicular to y or z (they span "
        f"{' x '.join(f'{extent:.3g}' for extent in extents)} m): publish it in the scanner's own "
        "frame, or name two of its coordinates as --columns x,z"
    )


def _measure_largest_extent(rows: Sequence[FloatArray], axis: int) -> float:
    """Return the largest extent of a row of points along an axis. Units: m."""
    extents = [0.0]
    for row in rows:
        finite = row[np.isfinite(row).all(axis=1), axis]
        extents.append(float(np.ptp(finite)) if len(finite) else 0.0)
    return max(extents)
