"""Points in JSON and YAML of every shape, and ROS LaserScan; what is neither is rejected."""

import json

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles


def dicts(arc):
    return [{"x": x, "z": z} for x, z in arc.tolist()]


SHAPES = {
    "x and z": lambda a: {"x": a[:, 0].tolist(), "z": a[:, 1].tolist()},
    "capitals, other keys": lambda a: {"name": "p", "Z": a[:, 1].tolist(), "X": a[:, 0].tolist()},
    "position and height": lambda a: {"lateral": a[:, 0].tolist(), "height": a[:, 1].tolist()},
    "with intensities": lambda a: {
        "x": a[:, 0].tolist(), "z": a[:, 1].tolist(), "grey": [1] * len(a), "size": [4, 5],
    },
    "pairs": lambda a: a.tolist(),
    "pairs under a key": lambda a: {"points": a.tolist()},
    "pairs under another key": lambda a: {"scale": [1, 2], "dots": a.tolist()},
    "pairs deeper": lambda a: {"profile": {"time": 3, "points": a.tolist()}},
    "pairs under six keys": lambda a: {
        "run": {"job": {"part": {"top": {"scan": {"points": a.tolist()}}}}}
    },
    "two lists": lambda a: {"points": a.T.tolist()},
    "triples": lambda a: {"points": [[x, 0.0, z] for x, z in a.tolist()]},
    "objects": dicts,
    "objects under a key": lambda a: {"points": dicts(a)},
    "objects in space": lambda a: [{"x": x, "y": 0, "z": z, "ok": "yes"} for x, z in a.tolist()],
    "lists in an object": lambda a: {"profile": {"x": a[:, 0].tolist(), "z": a[:, 1].tolist()}},
    "scan line": lambda a: {"scan_line": [n for x, z in a.tolist() for n in (x, 0, z)]},
    "flat pairs": lambda a: {"points": [n for pair in a.tolist() for n in pair]},
    "matrix of OpenCV": lambda a: {
        "profile": {
            "type_id": "opencv-matrix", "rows": len(a), "cols": 2, "dt": "d",
            "data": a.ravel().tolist(),
        }
    },
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("indent", [None, 2])
def test_points_are_found_in_json(write, arc, shape, indent):
    path = write(json.dumps(SHAPES[shape](arc[np.argsort(arc[:, 0])]), indent=indent), "p.json")
    file = inspect_profiles(path)
    npt.assert_array_equal(file.profiles[0].points, arc[np.argsort(arc[:, 0])])
    assert file.units_assumed


@pytest.mark.parametrize(
    "more",
    [{"unit": "um"}, {"units": "micrometer"}, {"units": {"x": "um", "z": "um"}}, {"Unit": "1 um"}],
)
@pytest.mark.parametrize("shape", ["x and z", "pairs under a key"])
def test_units_in_json_count(write, arc, shape, more):
    document = {**more, **SHAPES[shape](arc * 1000)}
    if shape != "x and z" and "units" in more and isinstance(more["units"], dict):
        return  # of which axis a pair is one, no key says
    file = inspect_profiles(write(json.dumps(document)))
    npt.assert_allclose(file.profiles[0].points, arc, rtol=1e-9)
    assert not file.units_assumed


def test_a_unit_in_json_that_is_not_understood_is_rejected(write, arc):
    for more in ({"unit": "elle"}, {"x_unit": "elle", "z_unit": "elle"}):
        with pytest.raises(UnreadableFile, match=r"'.*elle' is stated in it and not understood"):
            read_profile(write(json.dumps({**more, **SHAPES["x and z"](arc)})))


def test_null_and_nan_are_lost(write):
    path = write('{"x": [0, 1, 2, 3, 4], "z": [-5, null, NaN, "nan", -6]}')
    assert inspect_profiles(path).lost == 3


def test_several_profiles_in_json(write, arc):
    lower = arc - [0, 1]
    for document in (
        [SHAPES["x and z"](arc), SHAPES["x and z"](lower)],
        {"profiles": [arc.tolist(), lower.tolist()]},
        {"scans": [{"part": "A", "points": arc.tolist()}, {"part": "B", "points": lower.tolist()}]},
        {"x": arc[:, 0].tolist(), "z": [arc[:, 1].tolist(), lower[:, 1].tolist()]},
        [{"scan": k, "x": x, "z": z} for k, p in enumerate((arc, lower)) for x, z in p.tolist()],
    ):
        first, second = read_profiles(write(json.dumps(document)))
        npt.assert_allclose(first.points, arc)
        npt.assert_allclose(second.points, lower)
    lines = "\n".join(json.dumps(SHAPES["x and z"](points)) for points in (arc, lower))
    assert len(read_profiles(write(lines))) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"serial": 7, "name": "tube"}', r"its keys are serial, name\): expected"),
        ('{"labels": [1, 1, 1, 0, 0, 2]}', "its keys are labels"),
        ('{"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}', "its keys are rotation"),
        ('{"points": [1, 9, 2, 8, 1, 7, 3]}', "neither pairs x, z nor triples"),
        ('{"profile": [-5.1, -5.2, -5.0, -5.1, -5.3, -5.2]}', "--x0 and --dx"),
        ('{"x": [1, 2, 3], "z": [1, 2]}', "of equal length"),
        ('{"x": [1, 2, ', "JSON that cannot be parsed"),
        ("[" * 5000 + "]" * 5000, "nested too deep|without a list of points"),
        ('{"m": {"type_id": "opencv-matrix", "rows": 9, "data": [1, 2]}}', "missing 'cols'"),
        ('{"m": {"type_id": "opencv-matrix", "rows": 9, "cols": 9, "data": [1]}}', "missing 'dt'"),
        (
            '{"m": {"type_id": "opencv-matrix", "rows": 9, "cols": 9, "dt": "d", "data": [1]}}',
            "9 x 9 x 1 numbers, got 1",
        ),
    ],
)
def test_json_without_points_is_rejected_with_its_keys(write, text, message):
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write(text))


def test_heights_alone_in_json_take_their_x_from_the_options(write):
    path = write('{"profile": [-5.1, -5.2, -5.0, -5.1, -5.3, -5.2]}')
    npt.assert_allclose(read_profile(path, x0=1, dx=0.5).points[2], [2.0, -5.0])


def polar(arc):
    angles = np.linspace(-0.1, 0.1, 61)
    directions = np.column_stack([np.sin(angles), -np.cos(angles)])
    along = directions @ [0.0, -0.15]
    ranges = along - np.sqrt(along**2 - 0.15**2 + 0.02**2)
    return angles, ranges, 1e3 * ranges[:, np.newaxis] * directions


def block(values):
    return "\n" + "\n".join(f"- {value}" for value in values)


@pytest.mark.parametrize("form", ["flow", "block", "long flow", "json", "csv", "two"])
def test_a_laser_scan_becomes_points(write, arc, form):
    angles, ranges, points = polar(arc)
    texts = [f"{value:.6f}" for value in ranges]
    texts[3], texts[5], texts[7], texts[9] = "inf", "nan", "0.0", "40.0"
    message = {
        "angle_min": angles[0], "angle_max": angles[-1], "angle_increment": angles[1] - angles[0],
        "time_increment": 0.0, "scan_time": 0.1, "range_min": 0.02, "range_max": 30.0,
    }  # fmt: skip
    head = "header:\n  seq: 7\n  stamp:\n    secs: 1\n    nsecs: 2\n  frame_id: laser\n"
    head += "".join(f"{key}: {value}\n" for key, value in message.items())
    flow = f"[{', '.join(texts)}]"
    if form == "csv":
        names = ["%time", "field.header.seq", "field.header.frame_id"]
        names += [f"field.{key}" for key in message] + [f"field.ranges{k}" for k in range(61)]
        names += [f"field.intensities{k}" for k in range(61)]
        row = ["1", "7", "laser", *map(str, message.values()), *texts, *["5.0"] * 61]
        text = ",".join(names) + "\n" + ",".join(row) + "\n"
    elif form == "json":
        values = [None if t in ("inf", "nan") else float(t) for t in texts]
        text = json.dumps({"header": {"seq": 7}, **message, "ranges": values, "intensities": []})
    else:
        long = flow.replace(", ", ",\n  ")
        body = {"block": block(texts), "long flow": long}.get(form, flow)
        text = f"{head}ranges: {body}\nintensities: []\n---\n" * (2 if form == "two" else 1)
    file = inspect_profiles(write(text, "scan.txt"))
    assert len(file.profiles) == (2 if form == "two" else 1)
    points[[3, 5, 7, 9]] = np.nan
    npt.assert_allclose(file.profiles[0].points, points, atol=2e-3)
    assert (file.units, file.units_assumed) == ("m", False)


def test_a_laser_scan_in_degrees_is_rejected(write):
    scan = {"angle_min": -45.0, "angle_increment": 1.0, "ranges": [1.0] * 91}
    with pytest.raises(UnreadableFile, match="from -45 to 45, more than a revolution in rad"):
        inspect_profiles(write(json.dumps(scan), "scan.json"))
    scan = {"angle_min": -np.pi, "angle_increment": np.pi / 180, "ranges": [1.0] * 361}
    assert len(inspect_profiles(write(json.dumps(scan), "scan.json")).profiles[0]) == 361


@pytest.mark.parametrize(
    "text",
    [
        "x: [{x}]\nz: [{z}]\n",
        "name: tube\nx: [{x}]\nz: [{z}]\n",
        "# logged\nx:\n{bx}\nz:\n{bz}\n",
        "points:\n{pairs}\n",
        "points: [{flow}]\n",
        "points:\n{maps}\n",
        "%YAML:1.0\n---\nx: [ {x} ]\nz: [ {z} ]\n",
    ],
)
def test_points_are_found_in_plain_yaml(write, arc, text):
    xs, zs = (list(map(str, column)) for column in arc.T.tolist())
    text = text.format(
        x=", ".join(xs), z=", ".join(zs),
        bx="\n".join(f"  - {v}" for v in xs), bz="\n".join(f"  - {v}" for v in zs),
        pairs="\n".join(f"- [{x}, {z}]" for x, z in zip(xs, zs, strict=True)),
        flow=", ".join(f"[{x}, {z}]" for x, z in zip(xs, zs, strict=True)),
        maps="\n".join(f"- x: {x}\n  z: {z}" for x, z in zip(xs, zs, strict=True)),
    )  # fmt: skip
    npt.assert_array_equal(read_profile(write(text, "p.yaml")).points, arc)


def test_a_list_of_numbers_in_opencv_storage_is_no_list_of_points(write):
    numbers = ", ".join(["1", "2", "1", "0"] * 10)
    with pytest.raises(UnreadableFile, match="expected points with rising x under 'labels'"):
        read_profile(write(f"%YAML:1.0\n---\nlabels: [ {numbers} ]\n"))


def test_names_beside_rows_say_the_order_of_columns(write, arc):
    document = {"columns": ["Z [um]", "X [um]"], "data": (1000 * arc[:, ::-1]).tolist()}
    npt.assert_allclose(read_profile(write(json.dumps(document))).points, arc)


def test_units_and_scales_deeper_in_json_are_no_silence(write, arc):
    um = {"x": (1000 * arc[:, 0]).tolist(), "z": (1000 * arc[:, 1]).tolist()}
    for more in ({"meta": {"unit": "um"}}, {"header": {"units": "micrometers"}}):
        npt.assert_allclose(read_profile(write(json.dumps({**more, **um}))).points, arc)
    with pytest.raises(UnreadableFile, match=r"'scale: 0\.001' is stated"):
        read_profile(write(json.dumps({"scale": 0.001, **um})))


def test_bytes_of_a_point_cloud_message_are_no_points(write):
    message = {"height": 1, "width": 2, "fields": [{"name": "x"}], "data": list(range(64))}
    with pytest.raises(UnreadableFile, match="its keys are height, width, fields, data"):
        read_profile(write(json.dumps(message)))


def test_profiles_in_nested_lists_keep_the_attributes_of_each(write):
    parts = [[{"x": x, "z": x * x % 7, "part": part} for x in range(8)] for part in "ab"]
    file = inspect_profiles(write(json.dumps(parts)))
    assert [attributes["part"] for attributes in file.attributes] == ["a", "b"]


@pytest.mark.parametrize("options", [{}, {"format": "opencv"}])
def test_numbers_that_only_opencv_writes_into_json_are_read(write, options):
    data = ", ".join(f"{x}., {x * x % 7}.5" for x in range(19)) + ", 19., .Nan"
    matrix = f'"type_id": "opencv-matrix", "rows": 20, "cols": 2, "dt": "d", "data": [ {data} ]'
    profile = read_profile(write(f'{{"m": {{ {matrix} }}}}'), **options)
    npt.assert_array_equal(profile.points[:2], [[0.0, 0.5], [1.0, 1.5]])
    assert profile.lost == 1


@pytest.mark.parametrize(
    "units", [{"x_unit": "m", "z_unit": "m"}, {"x_unit": "m", "z_unit": "um"}, {"z_unit": "cm"}]
)
def test_units_of_each_axis_beside_a_list_of_points_count(write, arc, units):
    lines = "\n".join(f"{key}: {unit}" for key, unit in units.items())
    pairs = "\n".join(f"- [{x}, {z}]" for x, z in arc.tolist())
    mm = {"m": 1000.0, "um": 1e-3, "cm": 10.0}
    height = mm[units["z_unit"]]
    comments = "\n".join(
        f"# {axis} in {units.get(f'{axis}_unit', units['z_unit'])}" for axis in "xz"
    )
    expected = arc * (mm.get(units.get("x_unit", ""), height), height)
    for content in (
        json.dumps(units | {"points": arc.tolist()}),
        json.dumps(units | {"profile": {"points": arc.tolist()}}),
        f"{lines}\npoints:\n{pairs}\n",
        f"{comments}\npoints:\n{pairs}\n",
    ):
        npt.assert_allclose(read_profile(write(content)).points, expected, rtol=1e-12)


def test_the_unit_beside_an_object_with_heights_counts(write):
    content = json.dumps({"unit": "um", "data": {"z": [-4000, -4100, -4050]}})
    file = inspect_profiles(write(content), dx=0.5)
    npt.assert_allclose(file.profiles[0].points, [[0, -4], [0.5, -4.1], [1, -4.05]], rtol=1e-12)


def test_rows_of_different_length_are_named(write):
    with pytest.raises(UnreadableFile, match="rows of 2 to 3 numbers: write null for lost points"):
        read_profile(write(json.dumps({"z": [[1, 2, 3], [1, 2]]})), dx=0.5)


@pytest.mark.parametrize(
    "wrap",
    [
        lambda points: {"nodata": -130} | points,
        lambda points: {"nodata": "-130"} | points,
        lambda points: {"meta": {"nodata": -130}} | points,
        lambda points: {"profile": {"nodata": -130} | points},
        lambda points: [{"nodata": -130} | points],
    ],
)
def test_a_lost_marker_counts_wherever_it_stands(write, wrap):
    points = {"x": [1, 2, 3, 4], "z": [-129, -130, -131, -130.5]}
    profile = read_profile(write(json.dumps(wrap(points))))
    assert np.isnan(profile.points[:, 0]).tolist() == [False, True, False, False]


def test_lists_beside_x_and_z_are_columns_as_in_a_table(write):
    lists = {"x": [1, 2, 3], "z": [4, 5, 6], "h2": [7, 8, 9], "size": [1, 2], "unit": "mm"}
    path = write(json.dumps(lists))
    npt.assert_array_equal(read_profile(path, columns="x,h2").points, [[1, 7], [2, 8], [3, 9]])
    assert inspect_profiles(path).ignored == ("h2",)
    rows = {"x": [1, 2, 3], "z": [[4, 5, 6], [4, 6, 8]], "part": ["a", "b"], "run": [5, 6]}
    file = inspect_profiles(write(json.dumps(rows)))
    assert file.attributes == ({"run": 5, "part": "a"}, {"run": 6, "part": "b"})


def test_profiles_in_different_units_are_named_as_such(write):
    profiles = [{"unit": unit, "x": [1, 2, 3], "z": [4, 5, 6]} for unit in ("um", "mm")]
    with pytest.raises(UnreadableFile, match="its profiles differ in their units"):
        read_profiles(write(json.dumps(profiles)))
    assert len(read_profiles(write(json.dumps(profiles)), units="mm")) == 2


def test_attributes_that_the_first_of_several_objects_lacks_are_kept(write, arc):
    items = [{"points": arc.tolist()}, {"points": arc.tolist(), "part": "A7", "time": 3}]
    file = inspect_profiles(write(json.dumps(items)))
    assert [dict(row) for row in file.attributes] == [{}, {"part": "A7", "time": 3}]
    points = [{"x": x, "z": z, "quality": "good"} for x, z in arc.tolist()]
    for point in points[:5]:
        del point["quality"]
    assert inspect_profiles(write(json.dumps(points))).ignored == ("quality",)


@pytest.mark.parametrize(
    "wrap", ['{{"points": {0}, {1}}}', '{{"profile": {{"points": {0}, {1}}}}}']
)
def test_entries_beside_the_points_of_one_object_are_its_attributes(write, arc, wrap):
    entries = '"part": "A7", "time": 3, "unit": "um", "nodata": -9999, "list": [1]'
    file = inspect_profiles(write(wrap.format((1000 * arc).tolist(), entries)))
    assert [dict(row) for row in file.attributes] == [{"part": "A7", "time": 3}]
    npt.assert_allclose(file.profiles[0].points, arc)


def test_points_under_further_keys_are_noted(write, arc):
    text = json.dumps({"left": arc.tolist(), "right": {"points": arc.tolist()}, "size": [640, 480]})
    (note,) = inspect_profiles(write(text)).notes
    assert note == "points under left read, those under right left out"


def test_a_list_of_encoder_positions_of_another_length_is_no_column(write, arc):
    columns = {"x": arc[:, 0].tolist(), "z": arc[:, 1].tolist(), "encoder_counts": [1, 2, 3]}
    npt.assert_array_equal(read_profile(write(json.dumps(columns))).points, arc)


def test_numbers_with_an_exponent_of_fortran_are_read_from_json(write):
    text = '{"x": ["1d0", "2D0", 3], "z": ["-4.0d+2", "-399", "-"]}'
    points = read_profile(write(text, "p.json")).points
    npt.assert_array_equal(points, [[1, -400], [2, -399], [np.nan, np.nan]])
