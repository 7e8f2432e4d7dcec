"""What is tried with spoilt inputs; each target takes a random generator and a folder.

A target raises what the package does not document, or an AssertionError where a result is
unsound.
"""

import contextlib
import json
import math

import numpy as np
from typer.testing import CliRunner

import lsvision as lsv
from lsvision.cli.app import app
from lsvision.cylinder.fit import CylinderFittingSettings
from lsvision.cylinder.robot_frame import place_section
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import LsvisionError
from lsvision.geometry import Cylinder, Ellipse, Pose
from lsvision.io.camera_file import read_camera
from lsvision.io.images import read_image
from lsvision.io.profiles import FORMATS, MM_PER_UNIT, inspect_profiles
from lsvision.io.robot_conventions import CONVENTIONS
from tests.fuzz import samples
from tests.fuzz.mutation import (
    VALUES,
    json_bytes,
    spoil_array,
    spoil_bytes,
    spoil_document,
    spoilt_json,
)
from tests.laws.test_any_profile import assert_sound


def choose(rng, values):
    return values[rng.integers(len(values))]


def one_line(error):
    text = str(error)
    assert text.strip(), "an error without words"
    assert "Traceback" not in text
    return text


def require_named(error, path):
    """The error about a file is one line that names the file."""
    assert str(path) in one_line(error)


def _read_options(rng):
    """What a user may say of a profile file."""
    options = {}
    if rng.random() < 0.3:
        options["format"] = choose(rng, FORMATS)
    if rng.random() < 0.15:
        options["columns"] = choose(rng, ["0,1", "1,0", "x,z", "0,1,2", (0, 2)])
    if rng.random() < 0.15:
        options["units"] = choose(rng, list(MM_PER_UNIT))
    if rng.random() < 0.2:
        options |= {"dx": choose(rng, [0.5, -1.0, 1e300]), "x0": choose(rng, [0.0, 1e300])}
    if rng.random() < 0.1:
        options |= {"x_start": -1e5, "x_pitch": 1000.0, "z_unit": choose(rng, [100.0, 1e300])}
    if rng.random() < 0.1:
        options["lost"] = choose(rng, ["none", "-9999", "n/a", "0,1e300"])
    if rng.random() < 0.1:
        options["transpose"] = True
    if rng.random() < 0.1:
        options["z_unit"] = choose(rng, ["0.5um", "1mm", 100.0])
    return options


def profiles(rng, folder):
    """Any bytes as a profile file, read as what they look like or as any format."""
    files = samples.profile_files()
    content = choose(rng, files)
    if rng.random() < 0.95:
        content = spoil_bytes(rng, content, files)
    path = folder / f"a{choose(rng, ['.csv', '.txt', '.npy', '.dat', ''])}"
    path.write_bytes(content)
    options = _read_options(rng)
    try:
        file = inspect_profiles(path, **options)
    except LsvisionError as error:
        require_named(error, path)
        return
    assert file.profiles
    for profile in file.profiles:
        assert not np.isinf(profile.points).any()
    assert file.summary
    assert all(map(math.isfinite, file.positions or ())) or file.positions


def poses(rng, folder):
    """Any bytes as a file of robot poses."""
    suffix, content = choose(rng, samples.find_pose_files())
    if suffix in (".json", ".rob") and rng.random() < 0.6:
        content = json_bytes(spoil_document(rng, json.loads(content)))
    else:
        content = spoil_bytes(rng, content, [each for _, each in samples.find_pose_files()])
    path = folder / f"p{suffix}"
    path.write_bytes(content)
    units = {
        "length_unit": choose(rng, [None, "m", "mm"]),
        "angle_unit": choose(rng, [None, "deg"]),
    }
    try:
        read = lsv.read_robot_poses(path, choose(rng, list(CONVENTIONS)), **units)
    except LsvisionError as error:
        require_named(error, path)
        return
    assert all(np.isfinite(pose.matrix).all() for pose in read)


def rigs(rng, folder):
    """Spoilt rig files, and what is measured with those that are accepted."""
    path = folder / "rig.json"
    path.write_bytes(spoilt_json(rng, samples.rig_document()))
    try:
        rig = lsv.LightSection.load(path)
    except LsvisionError as error:
        require_named(error, path)
        return
    pixels = rng.uniform(-1, 1.2, (20, 2)) * np.minimum(rig.camera.size, 5000)
    points = rig.points_from_pixels(pixels)
    assert not np.isinf(points).any()


def hand_eyes(rng, folder):
    """Spoilt hand-eye files, and a section placed with those that are accepted."""
    path = folder / "hand_eye.json"
    path.write_bytes(spoilt_json(rng, samples.hand_eye_document()))
    try:
        hand_eye = lsv.load_hand_eye(path)
    except LsvisionError as error:
        require_named(error, path)
        return
    assert np.isfinite([hand_eye.working_point_std, hand_eye.residual_rms]).any()
    _ = hand_eye.warnings
    if (hand_eye.mounting, hand_eye.sensor) == ("eye_in_hand", "section"):
        for placed in place_section(_section(), hand_eye, Pose()):
            assert np.isfinite(placed.covariance).all()
            assert np.isfinite([*placed.point, *placed.point_std, placed.direction_std]).all()


_SECTIONS = []


def _section():
    if not _SECTIONS:
        _SECTIONS.extend(lsv.measure_cylinders(lsv.Profile(samples.pipe_points())).cylinders)
    return _SECTIONS[0]


def cameras(rng, folder):
    """Spoilt camera files of lsvision, OpenCV and ROS."""
    path = folder / "camera.yaml"
    content = choose(rng, samples.camera_files())
    path.write_bytes(spoil_bytes(rng, content, samples.camera_files()))
    try:
        camera = read_camera(path, size=choose(rng, [None, (320, 240)]))
    except LsvisionError as error:
        require_named(error, path)
        return
    assert np.isfinite(camera.matrix).all()
    assert not np.isinf(camera.rays([[10.0, 20.0], [300.0, 2.0]])).any()


def images(rng, folder):
    """Spoilt image files, and the line in those that are accepted."""
    suffix, content = choose(rng, samples.image_files())
    path = folder / f"i{suffix}"
    if rng.random() < 0.5:  # most of what matters is in the header
        head = int(rng.integers(8, 80))
        content = spoil_bytes(rng, content[:head]) + content[head:]
    else:
        content = spoil_bytes(rng, content, [each for _, each in samples.image_files()])
    path.write_bytes(content)
    try:
        image = read_image(path)
    except LsvisionError as error:
        require_named(error, path)
        return
    assert image.size
    if image.size < 200_000 and rng.random() < 0.1:
        _extract(rng, image)


def lines(rng, _):
    """Arrays of any kind as images of a line."""
    dtype = choose(rng, [np.uint8, np.uint8, np.uint16])
    shape = rng.integers(1, 70, 2)
    kind = rng.random()
    if kind < 0.4:
        image = samples.line_image(*shape, dtype)
    elif kind < 0.7:
        image = rng.integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)
    else:
        image = np.full(shape, choose(rng, [0, 9, np.iinfo(dtype).max]), dtype)
    if rng.random() < 0.3:
        image[tuple(rng.integers(0, shape, (3, 2)).T)] = np.iinfo(dtype).max
    if rng.random() < 0.2:
        image = spoil_array(rng, image)
    _extract(rng, image)


def _extract(rng, image):
    colour = np.ndim(image) == 3
    settings = lsv.LineSettings(
        channel=choose(rng, ["red", "white"] if colour else ["grey"]),
        method=choose(rng, ["derivative", "gaussian", "steger"]),
        sigma=float(choose(rng, [1.0, 1.5, 4.0])),
    )
    try:
        line = lsv.extract_laser_line(image, settings)
    except (LsvisionError, ValueError, TypeError) as error:
        require_documented(error)
        return
    known = np.isfinite(line.pixels).all(axis=1)
    assert np.isfinite(line.std[known]).all()


def _points(rng):
    kind = rng.random()
    if kind < 0.5:
        points = samples.pipe_points(int(rng.integers(3, 150)), choose(rng, [1.0, 20.0, 300.0]))
    elif kind < 0.7:
        points = rng.normal(size=(rng.integers(0, 120), 2)) * choose(rng, [1e-6, 1.0, 50.0])
    else:
        x = np.linspace(-50, 50, rng.integers(2, 120))
        points = np.column_stack(
            [x, choose(rng, [0 * x, x, np.abs(x), np.floor(x / 9), x**2 / 90])]
        )
    return spoil_array(rng, points)


def measurements(rng, _):
    """Arrays of any kind as profiles, with any prior and sensor."""
    options = {
        "radius": choose(rng, [None, None, 20.0, (5.0, 50.0), (1e-9, 1e9)]),
        "known_radius": choose(rng, [None, None, 20.0, (20.0, 0.1), (20.0, 1e-9)]),
        "known_phi": choose(rng, [None, None, 0.0, (0.3, 0.01)]),
        "sensor": choose(rng, [None, None, lsv.LPS36, lsv.LPS36HI]),
    }
    if rng.random() < 0.1:
        options[choose(rng, list(options))] = VALUES[rng.integers(len(VALUES))]
    try:
        profile = lsv.Profile(_points(rng))
        measured = lsv.measure_cylinders(profile, **options)
    except (LsvisionError, ValueError, TypeError) as error:
        require_documented(error)
        return
    assert_sound(measured, profile)


def scans(rng, _):
    """A few profiles and poses of any kind as a scan."""
    count = int(rng.integers(1, 4))
    made = [_points(rng) for _ in range(count)]
    if rng.random() < 0.6:
        made = [samples.pipe_points(60) for _ in range(count)]
    steps = spoil_array(rng, np.arange(count) * 10.0)
    try:
        feed = [Pose.along((0.0, 0.1 * rng.normal(), 1.0), float(step)) for step in np.ravel(steps)]
        found = lsv.measure_scan(
            [lsv.Profile(points) for points in made],
            feed,
            known_radius=choose(rng, [None, 20.0, (20.0, 0.1)]),
            pose_std=choose(rng, [0.0, 0.1, 1e9]),
            feed_std=choose(rng, [0.0, 0.01]),
        )
    except (LsvisionError, ValueError, TypeError) as error:
        require_documented(error)
        return
    for tube in found.cylinders:
        numbers = [*tube.point, *tube.direction, tube.radius, tube.radius_std, tube.direction_std]
        assert np.isfinite(numbers).all()
        assert np.isfinite(tube.covariance).all()


def cylinder_fits(rng, _):
    """Points of any kind in space, with covariances and starts of any kind."""
    angle = rng.uniform(0, choose(rng, [0.1, 2.0, 6.0]), rng.integers(4, 60))
    height = rng.choice([0.0, 10.0, 30.0], len(angle)) * choose(rng, [0.0, 1e-9, 1.0])
    points = np.column_stack([19 * np.cos(angle), 19 * np.sin(angle), height])
    points = spoil_array(rng, points + rng.normal(size=points.shape) * choose(rng, [0, 0.1, 9]))
    covariances = None
    if rng.random() < 0.4:
        covariances = spoil_array(rng, np.tile(np.eye(3) * 0.01, (len(points), 1, 1)))
    try:
        start = None
        if rng.random() < 0.4:
            start = Cylinder(
                spoil_array(rng, np.zeros(3)), (0.1, 0, 1), choose(rng, [19, 1e-6, 1e6])
            )
        known = choose(rng, [None, RadiusPrior(19.0), RadiusPrior(19.0, 0.1)])
        settings = CylinderFittingSettings(truncation=choose(rng, [None, None, 3.0]))
        fit = lsv.fit_cylinder(
            points, covariances, initial_guess=start, known_radius=known, settings=settings
        )
    except (LsvisionError, ValueError, TypeError) as error:
        require_documented(error)
        return
    assert np.isfinite([*fit.cylinder.point, *fit.cylinder.direction, fit.radius]).all()
    assert np.isfinite(fit.covariance).all()


def ellipse_fits(rng, _):
    """Points of any kind on an arc, with covariances and starts of any kind."""
    points = _points(rng)
    covariances = None
    if rng.random() < 0.4 and np.ndim(points) == 2:
        covariances = spoil_array(rng, np.tile(np.eye(2) * 0.01, (len(points), 1, 1)))
    try:
        start = Ellipse((0, -400), choose(rng, [22, 1e6]), choose(rng, [20.0, 1e-3]), 0.3)
        fit = fit_ellipse(points, start, covariances)
    except (LsvisionError, ValueError, TypeError) as error:
        require_documented(error)
        return
    assert np.isfinite([*fit.ellipse.centre, fit.ellipse.semi_major, fit.ellipse.theta]).all()


_WORDS = [
    "-",
    "--json",
    "--csv",
    "--plot",
    "--units",
    "um",
    "mm",
    "--columns",
    "0,1",
    "--radius",
    "20",
    "10:40",
    "--known-radius",
    "20:0.1",
    "--flip",
    "--no-flip",
    "-v",
    "--format",
    "text",
    "npy",
    "--poses",
    "--convention",
    "kuka",
    "ros",
    "--flange-from-section",
    "--light-section",
    "--laser",
    "red",
    "--method",
    "steger",
    "--x0",
    "0",
    "--dx",
    "0.5",
    "--feed",
    "0,0,1",
    "--step",
    "1",
    "nan",
    "1e308",
    "--max-size",
    "1kB",
    "--sensor",
    "lps36",
    "--range-std",
    "0.1",
    "--debug",
    "--pose-std",
    "-1",
    "",
    "\udcff",
    "\x1b[31m",
    "--surface-std",
    "--paper",
    "--frames",
    "2",
    "--laser-off",
    "²",
    "a\0b",
    "n" * 300,
    "--points",
    "--surfaces",
    "*.csv",
    "[",
    "**",
    "--help",
]
_COMMANDS = [
    "measure",
    "measure",
    "measure",
    "scan",
    "scan",
    "line",
    "plan",
    "calibrate",
    "simulate",
]


def commands(rng, folder):
    """Command lines of any words on files of any content."""
    files = _written(rng, folder)
    command = choose(rng, _COMMANDS)
    words = [command, *(choose(rng, files) for _ in range(rng.integers(0, 3)))]
    if command == "scan" and rng.random() < 0.6:
        words += ["--feed", "0,0,1", "--step", "5"]
    for _ in range(rng.integers(0, 5)):
        word = choose(rng, _WORDS)
        words.append(word)
        if word.startswith("--") and rng.random() < 0.5:
            words.append(
                choose(rng, [*files, str(folder / "out.csv"), str(folder / "o.json"), "-"])
            )
    words = [str(word) for word in words]
    with contextlib.chdir(folder):  # patterns reach the files of this input only
        result = CliRunner().invoke(
            app, words, prog_name="lsvision", input="1,2\n", env={"COLUMNS": "90"}
        )
    summary = f"{words}: {result.exit_code} {result.output[-600:]}"
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code in (0, 1, 2), summary
    assert "internal error" not in result.output, summary
    assert "Traceback" not in result.output or "--debug" in words, summary
    assert "--debug" in words or not {"\x1b", "\x07"} & set(result.output), summary
    assert "--help" in words or " nan" not in result.stdout.lower(), summary
    if result.exit_code == 1:
        assert result.stderr.strip(), summary


def _written(rng, folder):
    files = {
        "a.csv": choose(rng, samples.profile_files()),
        "b.csv": samples.profile_files()[0],
        "c.npy": choose(rng, samples.profile_files()),
        "i.png": choose(rng, samples.image_files())[1],
        "p.json": samples.find_pose_files()[3][1],
        "q.csv": samples.find_pose_files()[0][1],
        "rig.json": json_bytes(samples.rig_document()),
        "h.json": json_bytes(samples.hand_eye_document()),
    }
    for name, content in files.items():
        spoilt = spoil_bytes(rng, content) if rng.random() < 0.3 else content
        (folder / name).write_bytes(spoilt)
    return [*(str(folder / name) for name in files), str(folder)]


def require_documented(error):
    """Raise the error again unless the package itself raised it, with a message.

    numpy's LinAlgError and Python's UnicodeError are ValueErrors too, and a ValueError that comes
    out of numpy does not count: only what a module of lsvision raises itself counts.
    """
    if isinstance(error, LsvisionError):
        one_line(error)
        return
    frame = error.__traceback__
    while frame.tb_next is not None:
        frame = frame.tb_next
    ours = "/lsvision/" in frame.tb_frame.f_code.co_filename.replace("\\", "/")
    if type(error) not in (ValueError, TypeError) or not ours:
        raise error
    one_line(error)


TARGETS = {
    target.__name__: target
    for target in (
        profiles,
        poses,
        rigs,
        hand_eyes,
        cameras,
        images,
        lines,
        measurements,
        scans,
        cylinder_fits,
        ellipse_fits,
        commands,
    )
}
SHARES = {
    "profiles": 40,
    "poses": 15,
    "rigs": 8,
    "hand_eyes": 8,
    "cameras": 8,
    "images": 8,
    "lines": 2,
    "measurements": 3,
    "scans": 1,
    "cylinder_fits": 3,
    "ellipse_fits": 3,
    "commands": 2,
}
"""How often each is tried, relative to the others."""
