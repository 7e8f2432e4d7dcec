"""Profiles that real sensors wrote: they are read, whole and the right way up."""

from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile
from lsvision.profile import Profile

REAL = Path(__file__).parents[4] / "shared" / "real"
SPHERE_RADIUS_MM = 40.0  # nominal, of sphere-robot/main
ARC_SCATTER_MM = 0.1  # the arcs are clean to 0.02 mm; some have a short false flat end

pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="real profiles are not shipped: put them in ../shared/real"
)


def circle(points):
    """Centre and radius of the algebraic circle through points, Kasa's least squares."""
    design = np.column_stack([2 * points, np.ones(len(points))])
    x, y, c = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    return np.array([x, y]), float(np.sqrt(c + x * x + y * y))


def test_all_labelled_sphere_profiles_are_read_with_the_sphere_towards_the_sensor():
    files = sorted((REAL / "sphere-profiles").glob("*.csv"))
    assert len(files) == 125
    for path in files:
        table = np.loadtxt(path, delimiter=",")
        points = read_profile(path).points
        npt.assert_array_equal(points, table[:, :2])
        arc = points[table[:, 2] == 1]
        centre, radius = circle(arc)
        assert arc[:, 1].mean() > centre[1]
        assert 5 < radius < 40.5


def test_all_profiles_of_the_robot_are_read_with_their_lost_points():
    expected = {"main": 15, "ball": 10, "board": 12}
    for folder, count in expected.items():
        files = sorted((REAL / "sphere-robot" / folder).glob("*.yml"))
        assert len(files) == count
        for path in files:
            file = inspect_profiles(path)
            words = path.read_text().split("[", 1)[1]
            assert file.lost == words.count(".Nan")
            assert 3 * len(file.profiles[0]) == words.count(",") + 1


def test_a_section_of_the_sphere_bulges_towards_the_sensor():
    for path in (REAL / "sphere-robot" / "main").glob("*.yml"):
        profile: Profile = read_profile(path)
        centre, radius = circle(profile.points)
        assert radius < SPHERE_RADIUS_MM
        assert profile.points[:, 1].mean() > centre[1]
        scatter = np.abs(np.hypot(*(profile.points - centre).T) - radius)
        assert np.median(scatter) < ARC_SCATTER_MM


def test_the_gocator_surface_is_a_profile_a_row():
    (path,) = (REAL / "gocator-csv").glob("*.csv")
    file = inspect_profiles(path)
    assert (file.reader, file.units, file.units_assumed) == ("gocator", "mm", False)
    assert [len(profile) for profile in file.profiles] == [452] * 428
    assert file.positions is not None
    npt.assert_allclose(np.diff(file.positions), 0.3, atol=1e-9)
    cells = path.read_text().split("Y\\X,")[1].splitlines()[1:429]
    valid = sum(bool(cell) for row in cells for cell in row.split(",")[1:])
    assert file.lost == 428 * 452 - valid


def test_the_reference_points_of_nist_are_a_cloud_and_no_profile():
    with pytest.raises(UnreadableFile, match="--columns"):
        read_profile(REAL / "nist-cylinders" / "cyl1.ds")
