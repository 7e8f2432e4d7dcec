"""ROS bags (ROS 1 ``.bag``, ROS 2 ``.db3`` and ``.mcap``) of LaserScan or PointCloud2.

They are read by the library rosbags (``pip install 'lsvision[ros]'``). Units of ROS (REP 103): m.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.laser_scan import SCAN_KEYS, profiles_from_scans
from lsvision.io.profiles.point_messages import cloud_points, profiles_from_clouds
from lsvision.io.profiles.settings import RawProfiles, ReadSettings

LASER_SCAN, POINT_CLOUD = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
MAX_NAMED_TOPICS = 8
"""Largest number of topics that an error message lists."""

_SUFFIXES = {b"#ROS": ".bag", b"\x89MCA": ".mcap", b"SQLi": ".db3"}


@dataclass(frozen=True, eq=False)
class Message:
    """A message of a bag.

    Parameters
    ----------
    content : mapping or (rows, columns, 3) ndarray
        The fields of a LaserScan, or the points of a cloud in m.
    attributes : mapping
        ``stamp_s``, the time stamp (of the recording where the message has none), and
        ``frame_id``.
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
        return profiles_from_clouds(contents, attributes, settings)
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
        content = _scan_fields(fields) if connection.msgtype == LASER_SCAN else cloud_points(fields)
        yield Message(content, attributes)


def _scan_fields(fields: Any) -> dict[str, Any]:
    """Return the fields of a LaserScan from which its points are computed."""
    scan = {name: float(getattr(fields, name)) for name in SCAN_KEYS}
    return scan | {"ranges": fields.ranges.tolist()}
