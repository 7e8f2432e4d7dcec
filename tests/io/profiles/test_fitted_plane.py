"""Points of a tilted plane are read with ``plane="fit"``: truth from points placed by the test."""

import json

import numpy as np
import numpy.testing as npt
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import lsvision as lsv
from lsvision.cli.app import app
from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile
from lsvision.io.profiles.streaming import iterate_profiles
from tests.tolerances import MACHINE

NOISE = 0.02  # mm, each coordinate
K_SIGMA = 4.0  # 3 numbers of 12 rigs: by chance once in 400 runs
RIGS = range(12)


def rig(seed):
    """A laser plane that a camera sees at 20 to 60 deg, rolled by up to 60 deg, and a pipe.

    Returns camera_from_section as rotation and translation of the test's own section, whose y is
    opposite to the optical axis but turned in the plane, and the pipe's radius and axis in it.
    """
    rng = np.random.default_rng([907, seed])
    angle, roll, pan = rng.uniform([20, -60, -10], [60, 60, 10])
    turn = Rotation.from_euler("ZX", [roll, 180 - angle], degrees=True)
    view = Rotation.from_euler("y", pan, degrees=True)
    towards = np.array([0.0, 0.0, rng.uniform(200, 500)])
    tilt, heading = np.radians(rng.uniform(5, 30)), rng.uniform(0, 2 * np.pi)
    axis = np.array([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)])
    return (view * turn).as_matrix(), towards, rng.uniform(10, 30), axis, rng


def points_on_pipe(radius, axis, sensor, rng, count=400):
    """Points where the plane z = 0 meets a pipe about the origin, on the side of the sensor."""
    across = np.linalg.svd(axis[None])[2][1:]
    sight = across @ sensor
    turn = np.arctan2(sight[1], sight[0]) + np.linspace(-1.1, 1.1, count)
    surface = radius * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
    section = surface - axis * (surface[:, 2] / axis[2])[:, None]
    assert np.abs(section[:, 2]).max() < MACHINE
    return section + rng.normal(0, NOISE, section.shape) * (1, 1, 0)


def table(points):
    return "x,y,z\n" + "".join(f"{x:.6f},{y:.6f},{z:.6f}\n" for x, y, z in points.tolist())


def seen(seed):
    """Camera coordinates of the points of a rig, with its truth."""
    rotation, translation, radius, axis, rng = rig(seed)
    sensor = -rotation.T @ translation
    points = points_on_pipe(radius, axis, sensor, rng) @ rotation.T + translation
    return points, rotation[:, 2], float(rotation[:, 2] @ translation), radius, rotation @ axis


@pytest.mark.parametrize("seed", RIGS)
def test_plane_radius_tilt_and_axis_are_found_in_the_camera_frame(write, seed):
    points, normal, distance, radius, axis = seen(seed)
    file = inspect_profiles(write(table(points)), plane="fit")
    pose = file.file_from_section
    sign = np.sign(pose.rotation[:, 2] @ normal)
    npt.assert_allclose(pose.rotation[:, 2], sign * normal, atol=1e-6)
    assert pose.rotation[:, 2] @ pose.translation == pytest.approx(sign * distance, abs=1e-4)
    (cylinder,) = lsv.measure_cylinders(file.profiles[0], radius=(5, 60)).cylinders
    assert abs(cylinder.radius - radius) < K_SIGMA * cylinder.radius_std
    phi = np.arccos(abs(axis @ normal))
    assert abs(cylinder.phi - phi) < K_SIGMA * cylinder.phi_std
    directions = cylinder.axis_candidates @ pose.rotation.T
    cosine = np.abs(directions @ axis).max()
    spread = np.hypot(cylinder.phi_std, np.sin(phi) * cylinder.theta_std)
    assert np.arccos(min(cosine, 1.0)) < K_SIGMA * spread


@pytest.mark.parametrize("seed", RIGS)
def test_y_points_to_the_sensor_and_points_come_back(write, seed):
    points, *_ = seen(seed)
    file = inspect_profiles(write(table(points)), plane="fit")
    pose, profile = file.file_from_section, file.profiles[0]
    npt.assert_allclose(pose.apply(profile.points), points, atol=2e-6)
    assert pose.rotation[2, 1] < 0  # opposite to the optical axis
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    arc = profile.points - profile.points.mean(axis=0)
    assert arc[len(arc) // 2, 1] > arc[[0, -1], 1].min()  # the crown is nearer than an end


def test_points_of_a_light_section_come_back_as_its_profile(write):
    camera = lsv.Camera([[2264, 0, 640], [0, 2264, 512], [0, 0, 1]], [], (1280, 1024))
    section = lsv.LightSection(camera, lsv.Plane((0.1, 0.8, 0.5), 150.0))
    profile = np.column_stack([np.linspace(-20, 20, 90), -260 + 5 * np.cos(np.linspace(0, 7, 90))])
    points = section.camera_from_section.apply(profile)
    npt.assert_allclose(read_profile(write(table(points)), plane="fit").points, profile, atol=1e-4)


def test_heights_below_the_sensor_have_y_along_z(write):
    turn = Rotation.from_euler("x", 25, degrees=True).as_matrix()
    arc = np.column_stack([np.linspace(-9, 9, 80), np.zeros(80), np.linspace(-9, 9, 80) ** 2 / -9])
    points = (arc - (0, 0, 200)) @ turn.T
    file = inspect_profiles(write(table(points)), plane="fit")
    npt.assert_allclose(
        file.profiles[0].points, np.column_stack([arc[:, 0], arc[:, 2] - 200]), atol=1e-5
    )
    assert inspect_profiles(write(table(points)), plane="fit", flip=True).profiles[0].points[
        0, 1
    ] == pytest.approx(209, abs=1e-5)


def test_note_states_plane_and_residual(write):
    points, normal, distance, *_ = seen(3)
    rng = np.random.default_rng(55)
    points = points + rng.normal(0, 0.05, len(points))[:, None] * normal
    note = inspect_profiles(write(table(points)), plane="fit").notes[-1]
    assert note.startswith("plane fitted to 400 points: normal (")
    assert f"{abs(distance):.1f}" in note
    rms = float(note.split("residual rms ")[1].split()[0])
    assert rms == pytest.approx(0.05, rel=0.15)  # 400 points: 4 sigma


@pytest.mark.parametrize(
    ("lost", "marked"), [("0,0,0", "0, 0, 0"), ("-9999,-9999,-9999", "-9999"), (",,", "")]
)
def test_lost_points_do_not_pull_the_plane(write, lost, marked):
    points, *_ = seen(5)
    rows = table(points).splitlines()
    for row in range(20, 60, 2):
        rows[row] = lost
    file = inspect_profiles(write("\n".join(rows)), plane="fit")
    assert file.lost == 20
    assert marked in file.summary
    assert "residual rms" in file.notes[-1]
    assert float(file.notes[-1].split("rms ")[1].split()[0]) < 1e-5


def test_profiles_of_one_file_lie_in_one_plane(write):
    points, *_ = seen(7)
    flat = points[:2].mean(axis=0) + np.linspace(0, 1, 30)[:, None] * (points[9] - points[0])
    clouds = [points, flat]  # the second alone would fit any plane
    rows = [f"{k}, {x}, {y}, {z}" for k, c in enumerate(clouds) for x, y, z in c.tolist()]
    file = inspect_profiles(write("profile, x, y, z\n" + "\n".join(rows)), plane="fit")
    assert [len(profile) for profile in file.profiles] == [400, 30]
    npt.assert_allclose(file.file_from_section.apply(file.profiles[1].points), flat, atol=1e-5)


def test_units_and_named_columns(write):
    points, *_ = seen(2)
    rows = "".join(f"{x / 1e3},{i},{y / 1e3},{z / 1e3}\n" for i, (x, y, z) in enumerate(points))
    metres = read_profile(write("a [m],n,b [m],c [m]\n" + rows), plane="fit", columns="a,b,c")
    npt.assert_allclose(
        metres.points, read_profile(write(table(points)), plane="fit").points, atol=1e-3
    )


def test_array_of_points_in_space_is_one_part(tmp_path):
    points, *_ = seen(8)
    np.save(tmp_path / "p.npy", np.stack([points, points[::-1]]))
    (part,) = iterate_profiles(tmp_path / "p.npy", 1, plane="fit")
    npt.assert_allclose(part.file.profiles[0].points, part.file.profiles[1].points[::-1])


LINE = "x,y,z\n" + "".join(f"{k},{2 * k},{300 + k}\n" for k in range(30))
BLOB = "x,y,z\n" + "".join(f"{k % 5},{k // 5 % 5},{300 + k // 25}\n" for k in range(125))


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (LINE, {}, r"on a line \(rms .* fits any plane .* needs a curved section"),
        (BLOB, {}, r"do not lie in a plane \(rms 1.41 mm .* one laser plane"),
        ("x,z\n0,1\n1,2\n2,5\n", {}, "needs x, y and z of each point, got x, z: name three"),
        ("0 1\n1 2\n2 5\n", {}, "needs x, y and z of each point, got none of them"),
        (BLOB, {"columns": "x,z"}, "needs x, y and z of each point, got x, z"),
        ("x,y,z\n0,1,2\n1,1,3\n4,2,2\n", {}, "3 valid points, --plane fit needs at least 5"),
        ("x [mm],y [m],z [mm]\n" + BLOB[6:], {}, r"different units \(mm, m\): state one"),
        (
            "x,y,z\n" + "".join(f"{k},{k * k},1e200\n" for k in range(9)),
            {"lost": "none"},
            r"coordinates reach 1e\+200 mm: .* --lost, or the unit",
        ),
        (" ".join(map(str, range(30))) + "\n", {"dx": 0.1}, "got x and height: leave --plane out"),
    ],
    ids=["line", "blob", "xz", "two", "columns", "few", "units", "huge", "heights"],
)
def test_points_without_a_plane_are_rejected(write, content, options, message):
    with pytest.raises(UnreadableFile, match=message):
        inspect_profiles(write(content), plane="fit", **options)


def test_unknown_plane_is_a_slip_of_the_caller(write):
    with pytest.raises(ValueError, match="expected plane among fit, got 'xz'"):
        inspect_profiles(write(BLOB), plane="xz")


def test_command_measures_points_of_a_plane(write):
    points, _, _, radius, _ = seen(4)
    path = write(table(points), "pipe.csv")
    found = CliRunner().invoke(
        app, ["measure", str(path), "--plane", "fit", "--radius", "5:60", "--json", "-"]
    )
    assert found.exit_code == 0, found.output
    assert "plane fitted to 400 points" in found.stderr
    record = json.loads(found.stdout)
    (cylinder,) = record["measurements"][0]["cylinders"]
    assert cylinder["radius_mm"] == pytest.approx(radius, abs=1.0)
    wrong = CliRunner().invoke(app, ["measure", str(path), "--plane", "xz"])
    assert wrong.exit_code == 2
    assert "expected plane among fit" in wrong.stderr


def test_coordinates_that_overflow_in_mm_are_rejected(write):
    content = "x,y,z\n" + "".join(f"{k}e306,{k * k},1\n" for k in range(9))
    with pytest.raises(UnreadableFile, match="coordinates reach inf mm"):
        inspect_profiles(write(content), plane="fit", units="m", lost="none")


@pytest.mark.parametrize("flip", [True, False])
def test_points_of_flipped_heights_come_back_to_the_frame_of_the_file(write, flip):
    points, *_ = seen(RIGS[0])
    file = inspect_profiles(write(table(points)), plane="fit", flip=flip)
    npt.assert_allclose(file.file_from_section.apply(file.profiles[0].points), points, atol=2e-6)
    assert file.flipped is flip


@pytest.mark.parametrize("z", [1e-9, 0.0, -1e-9])
def test_points_in_the_plane_z_0_have_y_along_y_whatever_the_sign_of_a_rounding_error(write, z):
    x = np.linspace(-9, 9, 80)
    points = np.column_stack([x, -200 - x**2 / 9, np.full_like(x, z)])
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in points.tolist())
    profile = read_profile(write(f"x,y,z\n{rows}\n"), plane="fit")
    npt.assert_allclose(profile.points, points[:, :2], atol=1e-6)
