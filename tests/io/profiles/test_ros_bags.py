"""ROS bags written by rosbags itself: every message is a profile in mm, with its stamp."""

import csv
import shutil

import numpy as np
import numpy.testing as npt
import pytest
from typer.testing import CliRunner

from lsvision.cli.app import app
from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "ros2": get_typestore(Stores.ROS2_HUMBLE)}
STARTED_S, STEP_S = 1_700_000_000, 0.1
SINGLE_PRECISION_MM = 1e-4  # at 0.5 m
FORMATS = ["bag", "db3", "mcap"]


def pipe_ranges(angles, radius=0.02, centre=(0.0, 0.3), rng=None):
    """Ranges in m of rays from the origin to a pipe in front, by the quadratic of each ray."""
    along = centre[0] * np.sin(angles) + centre[1] * np.cos(angles)
    with np.errstate(invalid="ignore"):
        ranges = along - np.sqrt(along**2 - centre[0] ** 2 - centre[1] ** 2 + radius**2)
    return ranges + (0 if rng is None else rng.normal(0, 2e-5, len(ranges)))


def header(store, number, frame="laser"):
    kinds = store.types
    time, head = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]
    stamp_ns = round((STARTED_S + STEP_S * number) * 1e9)
    fields = {"stamp": time(*divmod(stamp_ns, 10**9)), "frame_id": frame}
    if "seq" in head.__dataclass_fields__:
        fields["seq"] = number
    return head(**fields)


ANGLES = np.linspace(-0.12, 0.12, 200)
NARROW = np.float32(ANGLES[1] - ANGLES[0])


def scan_message(store, number, ranges):
    return store.types["sensor_msgs/msg/LaserScan"](
        header(store, number), float(ANGLES[0]), float(ANGLES[-1]), float(NARROW), 0.0, 0.1,
        0.05, 10.0, np.asarray(ranges, dtype=np.float32), np.zeros(0, dtype=np.float32),
    )  # fmt: skip


def cloud_message(store, number, rows, *, big=False, padding=4):
    """An organised cloud of (rows, columns, 3) points, with an intensity and bytes of no use."""
    field = store.types["sensor_msgs/msg/PointField"]
    order = ">" if big else "<"
    kind = np.dtype(
        {
            "names": ["z", "x", "intensity", "y"],
            "formats": [f"{order}f4", f"{order}f4", f"{order}u2", f"{order}f8"],
            "offsets": [0, 4, 8, 12],
            "itemsize": 24,
        }
    )
    count, width = rows.shape[:2]
    data = np.zeros((count, width * kind.itemsize + padding), dtype=np.uint8)
    for row in range(count):
        records = np.zeros(width, dtype=kind)
        for k, axis in enumerate("xyz"):
            records[axis] = rows[row, :, k]
        data[row, : width * kind.itemsize] = records.view(np.uint8)
    codes = {"f4": 7, "f8": 8, "u2": 4}
    fields = [
        field(name, int(kind.fields[name][1]), codes[kind.fields[name][0].str[1:]], 1)
        for name in kind.names
    ]
    return store.types["sensor_msgs/msg/PointCloud2"](
        header(store, number), count, width, fields, big, kind.itemsize, data.shape[1],
        data.ravel(), False,
    )  # fmt: skip


@pytest.fixture
def bag(tmp_path):
    """Writes a bag of topics with messages, made by functions of the message store; its file."""

    def _bag(kind, topics, name="scan"):
        store = STORES["ros1" if kind == "bag" else "ros2"]
        folder = tmp_path / name
        made = {
            topic: [make(store, k) for k, make in enumerate(makers)]
            for topic, makers in topics.items()
        }
        if kind == "bag":
            path = folder.with_suffix(".bag")
            writer, write = Writer1(path), store.serialize_ros1
        else:
            plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
            writer, write = Writer2(folder, version=9, storage_plugin=plugin), store.serialize_cdr
            path = folder / f"{name}.{kind}"
        with writer:
            for topic, messages in made.items():
                typename = messages[0].__msgtype__
                connection = writer.add_connection(topic, typename, typestore=store)
                for k, message in enumerate(messages):
                    recorded = round((STARTED_S + 1000 + STEP_S * k) * 1e9)
                    writer.write(connection, recorded, write(message, typename))
        return path

    return _bag


def scans(count=3, rng=None, **pipe):
    return [
        lambda store, k: scan_message(store, k, pipe_ranges(ANGLES, rng=rng, **pipe))
        for _ in range(count)
    ]


def expected_points(ranges):
    angles = ANGLES[0] + np.float64(NARROW) * np.arange(len(ANGLES))
    return 1000 * np.column_stack([ranges * np.sin(angles), -ranges * np.cos(angles)])


@pytest.mark.parametrize("kind", FORMATS)
def test_each_scan_is_a_profile_in_mm(bag, kind):
    path = bag(kind, {"/scan": scans()})
    file = inspect_profiles(path)
    assert (file.reader, file.units, len(file.profiles)) == ("rosbag", "m", 3)
    assert not file.units_assumed
    for number, profile in enumerate(file.profiles):
        npt.assert_allclose(
            profile.points, expected_points(pipe_ranges(ANGLES)), atol=SINGLE_PRECISION_MM
        )
        stamp = file.attributes[number]["stamp_s"]
        assert abs(stamp - STARTED_S - STEP_S * number) < 1e-6
    if kind != "bag":
        assert len(read_profiles(path.parent)) == 3  # the folder, metadata.yaml in it
        renamed = shutil.copy(path, path.parent.parent / "renamed.dat")
        assert len(read_profiles(renamed)) == 3  # recognised by its content


@pytest.mark.parametrize("kind", FORMATS)
def test_ranges_that_are_none_are_lost_points(bag, kind):
    ranges = pipe_ranges(ANGLES)
    ranges[[3, 5, 7, 9, 11]] = np.nan, np.inf, 0.0, 0.01, 12.0
    profile = read_profile(bag(kind, {"/scan": [lambda s, k: scan_message(s, k, ranges)]}))
    missing = ~np.isfinite(pipe_ranges(ANGLES))
    missing[[3, 5, 7, 9, 11]] = True
    npt.assert_array_equal(np.isnan(profile.points[:, 0]), missing)


def line_cloud(axes, rng=None):
    """Points (n, 3) of a pipe of 20 mm in a plane of two axes: across, and away from the sensor."""
    turns = np.linspace(0.4, 2.7, 150)
    noise = np.zeros((150, 2)) if rng is None else rng.normal(0, 2e-5, (150, 2))
    across, away = (0.02 * np.column_stack([np.cos(turns), -np.sin(turns)]) + [0, 0.3] + noise).T
    points = np.zeros((150, 3))
    points[:, axes[0]], points[:, axes[1]] = across, away
    return points


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("big", [False, True])
def test_a_cloud_across_y_is_x_and_z(bag, kind, big):
    points = line_cloud((0, 2))
    points[4] = np.nan
    points[9, 2] = np.inf
    path = bag(kind, {"/line": [lambda s, k: cloud_message(s, k, points[None], big=big)] * 2})
    first, _ = read_profiles(path, flip=True)
    assert first.lost == 2
    expected = 1000 * points[:, [0, 2]] * (1, -1)
    expected[[4, 9]] = np.nan
    npt.assert_allclose(first.points, expected, atol=SINGLE_PRECISION_MM)


def test_a_lidar_cloud_lies_as_its_laser_scan_does(bag):
    ranges = pipe_ranges(ANGLES)
    angles = ANGLES[0] + np.float64(NARROW) * np.arange(len(ANGLES))
    points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), 0 * ranges])
    topics = {
        "/scan": [lambda s, k: scan_message(s, k, ranges)],
        "/cloud": [lambda s, k: cloud_message(s, k, points[None])],
    }
    path = bag("mcap", topics)
    scan, cloud = read_profile(path, topic="/scan"), read_profile(path, topic="cloud")
    npt.assert_allclose(cloud.points, scan.points, atol=SINGLE_PRECISION_MM)


def test_each_row_of_an_organised_cloud_is_a_profile(bag):
    rows = np.stack([line_cloud((0, 2)) + np.array([0, y, 0]) for y in (0.0, 0.01, 0.02)])
    file = inspect_profiles(bag("db3", {"/line": [lambda s, k: cloud_message(s, k, rows)] * 2}))
    assert len(file.profiles) == 6
    assert [each["stamp_s"] for each in file.attributes] == sorted(
        [STARTED_S, STARTED_S + STEP_S] * 3
    )


def test_other_coordinates_are_named_by_columns(bag):
    points = line_cloud((1, 2)) + np.linspace(0, 0.01, 150)[:, None] * (1, 0, 0)
    path = bag("mcap", {"/line": [lambda s, k: cloud_message(s, k, points[None])]})
    rejected = r"lie in a section perpendicular to y or z \(.*--columns x,z"
    with pytest.raises(UnreadableFile, match=rejected):
        read_profile(path)
    profile = read_profile(path, columns="y,z")
    npt.assert_allclose(profile.points, 1000 * points[:, 1:], atol=SINGLE_PRECISION_MM)
    with pytest.raises(UnreadableFile, match="no columns y, range in a PointCloud2"):
        read_profile(path, columns="y,range")


@pytest.mark.parametrize("kind", FORMATS)
def test_one_of_several_topics_is_chosen(bag, kind):
    path = bag(kind, {"/left": scans(2), "/right": scans(1, centre=(0.01, 0.35))})
    named = r"use --topic /left \(LaserScan, 2 messages\) or /right \(LaserScan, 1 messages\)"
    with pytest.raises(UnreadableFile, match=f"several topics with profiles: {named}"):
        read_profiles(path)
    with pytest.raises(UnreadableFile, match=f"no topic '/up' with profiles in it: {named}"):
        read_profiles(path, topic="/up")
    assert len(read_profiles(path, topic="/left")) == 2
    far = read_profile(path, topic="/right")
    assert np.nanmin(far.points[:, 1]) < -330


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_of_other_messages_says_what_it_holds(bag, kind):
    def word(store, _):
        return store.types["std_msgs/msg/String"]("hello")

    path = bag(kind, {"/chatter": [word]})
    with pytest.raises(UnreadableFile, match=r"without .* PointCloud2 \(it has /chatter \(String"):
        read_profile(path)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_that_is_cut_or_spoilt_is_one_line(bag, kind, tmp_path, rng):
    content = bag(kind, {"/scan": scans(4)}).read_bytes()
    failure = 0
    for trial in range(40):
        spoilt = bytearray(content)
        if trial % 2:
            spoilt = spoilt[: rng.integers(30, len(spoilt))]
        else:
            for place in rng.integers(14, len(spoilt), 30):
                spoilt[place] = rng.integers(256)
        path = tmp_path / f"spoilt.{kind}"
        path.write_bytes(spoilt)
        text, profiles = "", []
        try:
            profiles = read_profiles(path)
        except UnreadableFile as error:
            text = str(error)
        failure += bool(text)
        assert not text or text.startswith(f"{path}: ")
        assert "\n" not in text
        assert all(not np.isinf(profile.points).any() for profile in profiles)
    assert failure >= 10


def test_a_cloud_that_is_cut_short_is_rejected(bag):
    def short(store, number):
        cloud = cloud_message(store, number, line_cloud((0, 2))[None])
        cloud.data = cloud.data[:100]
        return cloud

    def flat(store, number):
        cloud = cloud_message(store, number, line_cloud((0, 2))[None])
        cloud.fields = [field for field in cloud.fields if field.name != "z"]
        return cloud

    with pytest.raises(UnreadableFile, match="whose x is truncated or of an unknown type"):
        read_profile(bag("mcap", {"/line": [short]}, "short"))
    with pytest.raises(UnreadableFile, match="PointCloud2 with x, intensity, y: expected x, y, z"):
        read_profile(bag("mcap", {"/line": [flat]}, "flat"))


def test_a_bag_without_messages_or_points_is_rejected(bag, monkeypatch):
    empty = [lambda store, k: cloud_message(store, k, np.zeros((0, 5, 3)))]
    with pytest.raises(UnreadableFile, match="PointCloud2 messages without a row of points"):
        read_profile(bag("mcap", {"/line": empty}, "rows"))
    path = bag("bag", {"/scan": scans(1)})
    monkeypatch.setattr("lsvision.io.profiles.ros_bags._decode_messages", lambda *_: iter(()))
    with pytest.raises(UnreadableFile, match="a ROS bag whose index refers to no message"):
        read_profile(path)


def test_without_the_library_the_extra_is_named(bag, monkeypatch):
    path = bag("mcap", {"/scan": scans()})
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(UnreadableFile, match=r"pip install 'lsvision\[ros\]'"):
        read_profile(path)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_is_measured_and_its_stamps_stand_in_the_results(bag, kind, tmp_path, rng):
    path = bag(kind, {"/scan": scans(2, rng), "/other": scans(1)})
    out = tmp_path / "out.csv"
    result = CliRunner().invoke(app, ["measure", str(path), "--topic", "/scan", "--csv", str(out)])
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 2
    for number, row in enumerate(rows):
        low, high = float(row["radius_low_95_mm"]), float(row["radius_high_95_mm"])
        assert low - 0.05 < 20 < high + 0.05
        assert abs(float(row["stamp_s"]) - STARTED_S - STEP_S * number) < 1e-6
        assert row["frame_id"] == "laser"


def test_a_bag_is_a_scan(bag, rng):
    path = bag("mcap", {"/scan": scans(4, rng)})
    words = ["scan", str(path), "--feed", "0,0,1", "--step", "10", "--csv", "-"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    (row,) = csv.DictReader(result.stdout.splitlines())
    assert abs(float(row["radius_mm"]) - 20) < 0.05
    assert row["sections"] == "4"
