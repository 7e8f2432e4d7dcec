from dataclasses import replace

import numpy as np
import pytest

from lsvision.calibration.bundle_adjustment_problem import (
    BundleAdjustmentProblem,
    BundleAdjustmentState,
    LaserView,
    Refinement,
)
from lsvision.calibration.laser_plane import (
    LaserPlaneSettings,
    fit_laser_plane,
)
from lsvision.calibration.laser_plane_checks import list_outside_warnings, measure_pattern_fraction
from lsvision.calibration.laser_plane_initial_guess import fit_plane
from lsvision.calibration.views import ViewSources
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.sensors.camera import Camera
from lsvision.simulate.boards import BoardScene, simulate_boards

SIZE = (1280, 1024)
EXACT = 1e-6  # mm, rad: noise-free and converged
SIGMAS = 4.5  # a predicted spread that a fixed seed keeps to
OFF = [[9, 0, 7], [0, -5, -9], [0, 0, 0]]  # px: a start as calibrate_camera may give
HELD = LaserPlaneSettings(refine_camera_from=99, fit_bow_from=99)


def camera_of(scene):
    return Camera(scene.matrix, scene.distortion, SIZE)


def views_of(scene, count, seed=0):
    boards = simulate_boards(scene, count, rng=np.random.default_rng(seed))
    std = np.full(scene.line_points, 0.1)
    return [LaserView(board.points, board.pixels, board.line_pixels, std) for board in boards]


def assert_same_plane(plane, truth, atol):
    np.testing.assert_allclose(plane.normal, truth.normal, rtol=0, atol=atol / 100)
    assert plane.distance == pytest.approx(truth.distance, abs=atol)


@pytest.mark.parametrize("bow", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (-0.06, 0.04, 0.2)])
def test_plane_camera_and_bow_are_exact_without_noise(bow):
    scene = BoardScene(bow=bow[:2], twist=bow[2], corner_std=0.0, line_std=0.0)
    guess = replace(camera_of(scene), matrix=scene.matrix + np.array(OFF))
    found = fit_laser_plane(guess, views_of(scene, 8))
    assert_same_plane(found.plane, scene.plane, 100 * EXACT)
    np.testing.assert_allclose(found.board_bow, bow, atol=EXACT)
    np.testing.assert_allclose(found.light_section.camera.matrix, scene.matrix, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_error_of_the_plane_is_within_its_covariance(seed):
    scene = BoardScene()
    found = fit_laser_plane(camera_of(scene), views_of(scene, 12, seed))
    pose = found.light_section.camera_from_section
    x, y, z = pose.rotation.T
    off = scene.plane.normal * np.sign(z @ scene.plane.normal)
    # Turning by a about X takes Z to Z - a Y, by b about Y to Z + b X.
    error = [off @ y, -(off @ x), found.plane.distance - scene.plane.distance]
    assert error @ np.linalg.solve(found.covariance, error) < SIGMAS**2
    assert found.line_rms == pytest.approx(0.1, rel=0.1)
    assert found.corner_rms == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def stds_over_those_of_known_noise(scene, seed):
    """Stds of the plane from 20 views over those that the true noise gives."""
    views = views_of(scene, 20, seed)
    found = fit_laser_plane(camera_of(scene), views, HELD)
    poses = tuple(view.camera_from_board for view in found.views)
    state = BundleAdjustmentState(camera_of(scene), found.plane, poses, np.zeros(3))
    exact = [replace(view, line_std=np.full(scene.line_points, scene.line_std)) for view in views]
    fixed = Refinement(camera=False, bow=False)
    problem = BundleAdjustmentProblem(exact, state, fixed, [scene.corner_std] * len(views))
    jacobian = problem.jacobian(np.zeros(problem.size))
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:3, :3]
    return np.sqrt(np.diag(found.covariance) / np.diag(covariance))


@pytest.mark.parametrize("columns", [3, 4])
def test_covariance_from_few_corners_is_that_of_their_noise(columns):
    # The poses fit a third of 18 residuals: their rms is 0.8 times the noise.
    scene = BoardScene(columns=columns, rows=3, square=30.0)
    np.testing.assert_allclose(stds_over_those_of_known_noise(scene, 8), 1, atol=0.1)


def test_covariance_from_short_lines_is_that_of_their_noise():
    # The trend fits three of 8 residuals of a line: their rms is 0.8 times the noise.
    scene = BoardScene(line_points=8, line_std=0.5, corner_std=0.02)
    np.testing.assert_allclose(stds_over_those_of_known_noise(scene, 8), 1, atol=0.12)


def test_error_from_three_inconsistent_views_is_within_its_covariance():
    scene, scores = BoardScene(line_points=60), []
    for seed in range(12):
        rng = np.random.default_rng([1, seed])
        shifts = rng.normal(0, 1.5, (3, 2)) @ [np.ones(60), np.linspace(-1, 1, 60)]
        views = [
            replace(view, line_pixels=view.line_pixels + np.outer(shift, [0, 1]))
            for view, shift in zip(views_of(scene, 3, seed), shifts, strict=True)
        ]
        found = fit_laser_plane(camera_of(scene), views, HELD)
        assert any("inconsistent" in text for text in found.warnings)
        error = found.plane.distance - scene.plane.distance
        scores.append(abs(error) / np.sqrt(found.covariance[2, 2]))
    assert max(scores) < 8  # Student's t of three degrees of freedom exceeds it once in 250


def inconsistent_sets(scene, count, size, shape, seeds):
    """Number of sets with a warning, of lines off by normal errors of `size` px times `shape`."""
    found = 0
    for seed in seeds:
        rng = np.random.default_rng([2, seed])
        shifts = [np.outer(rng.normal(0, size) * shape, (0, 1)) for _ in range(count)]
        views = [
            replace(view, line_pixels=view.line_pixels + shift)
            for view, shift in zip(views_of(scene, count, 100 + seed), shifts, strict=True)
        ]
        result = fit_laser_plane(camera_of(scene), views, HELD)
        found += any("inconsistent" in text for text in result.warnings)
    return found


@pytest.mark.parametrize("count", [3, 5])
def test_lines_in_one_plane_are_consistent_with_few_points(count):
    scene = BoardScene(line_points=12)
    assert inconsistent_sets(scene, count, 0.0, np.zeros(12), range(8)) == 0


def test_lines_bent_by_a_few_times_their_noise_are_inconsistent():
    bend = np.linspace(-1, 1, 60) ** 2
    scene = BoardScene(line_points=60)
    assert inconsistent_sets(scene, 3, 0.8, bend, range(8)) == 8


def test_precise_lines_that_move_the_corners_are_inconsistent():
    scene = BoardScene(line_points=60)
    assert inconsistent_sets(scene, 5, 0.8, np.ones(60), range(8)) >= 7


def test_bow_of_a_tenth_of_a_millimetre_is_estimated_and_reported():
    found = fit_laser_plane(camera_of(BoardScene()), views_of(BoardScene(bow=(0.1, 0.0)), 15))
    np.testing.assert_allclose(found.board_bow, (0.1, 0.0, 0.0), atol=0.005)
    assert (np.abs(found.board_bow - (0.1, 0, 0)) < SIGMAS * found.board_bow_std).all()
    assert any("bowed by +0.1" in warning for warning in found.warnings)
    flat = fit_laser_plane(camera_of(BoardScene()), views_of(BoardScene(), 15))
    assert flat.warnings == ()


def views_of_small_pattern(columns, of):
    """Views with the corners of the first of some columns only, which part of the line crosses."""
    scene = BoardScene(columns=of, square=108 / (of - 1))
    corners = np.arange(7 * of) % of < columns
    views = [
        replace(view, points=view.points[corners], pixels=view.pixels[corners])
        for view in views_of(scene, 8)
    ]
    assert measure_pattern_fraction(views) == pytest.approx((columns - 1) / (of - 1), abs=0.03)
    return views


def test_bow_is_fitted_where_two_fifths_of_the_lines_are_on_the_pattern():
    for columns, fitted in ((4, False), (5, True)):
        found = fit_laser_plane(camera_of(BoardScene()), views_of_small_pattern(columns, 10))
        assert bool(found.board_bow_std.any()) == fitted


def test_lines_of_which_a_fifth_is_on_the_pattern_cross_it():
    for columns, crosses in ((3, False), (4, True)):
        assert (
            bool(list_outside_warnings(views_of_small_pattern(columns, 13), margin=3.0)) != crosses
        )


def test_bow_that_is_not_fitted_increases_the_line_residual():
    scene, settings = BoardScene(bow=(0.2, 0.0)), LaserPlaneSettings(fit_bow_from=99)
    found = fit_laser_plane(camera_of(scene), views_of(scene, 12), settings)
    assert found.line_rms > 0.14
    assert found.board_bow.tolist() == found.board_bow_std.tolist() == [0, 0, 0]


def test_two_poses_suffice_with_a_known_camera():
    scene = BoardScene(corner_std=0.0, line_std=0.0)
    found = fit_laser_plane(camera_of(scene), views_of(scene, 2))
    assert_same_plane(found.plane, scene.plane, 1e-4)
    np.testing.assert_array_equal(found.light_section.camera.matrix, scene.matrix)
    assert any("two views cannot check" in warning for warning in found.warnings)


def test_order_of_views_does_not_matter():
    views = views_of(BoardScene(), 6)
    forth = fit_laser_plane(camera_of(BoardScene()), views, HELD)
    back = fit_laser_plane(camera_of(BoardScene()), views[::-1], HELD)
    assert_same_plane(forth.plane, back.plane, 1e-4)


def test_mixed_up_images_are_rejected():
    views = views_of(BoardScene(), 10)
    views[4], views[7] = (
        replace(views[4], line_pixels=views[7].line_pixels),
        replace(views[7], line_pixels=views[4].line_pixels),
    )
    found = fit_laser_plane(
        camera_of(BoardScene()), views, sources=ViewSources(tuple(range(20, 30)))
    )
    assert [view.index for view in found.rejected] == [24, 27]
    assert "images mixed up" in found.rejected[0].reason
    assert_same_plane(found.plane, BoardScene().plane, 0.5)


def test_outlying_line_is_reported_and_does_not_change_the_plane():
    views = views_of(BoardScene(), 10)
    noise = np.random.default_rng(1).normal(0, 1.0, (100, 2))
    views[4] = replace(views[4], line_pixels=views[4].line_pixels + noise)
    found = fit_laser_plane(camera_of(BoardScene()), views)
    assert [view.index for view in found.outliers] == [4]
    assert "laser line off by" in found.outliers[0].reason
    assert_same_plane(found.plane, BoardScene().plane, 0.5)


def test_outlying_corners_are_reported_with_the_rms_of_the_table():
    scene, rng = BoardScene(), np.random.default_rng(9)
    views = views_of(scene, 8)
    noise = rng.normal(0, 0.6, views[3].pixels.shape)
    views[3] = replace(views[3], pixels=views[3].pixels + noise)
    found = fit_laser_plane(camera_of(scene), views, HELD)
    (outlier,) = found.outliers
    only = replace(found, views=(found.views[3],))
    assert outlier.reason.startswith(f"corners off by {only.corner_rms:.2f} px rms")


def test_boards_with_small_tilt_give_a_warning():
    scene = BoardScene(tilt=np.radians(10))
    found = fit_laser_plane(camera_of(scene), views_of(scene, 10))
    assert any("deg at most, expected 25 deg" in warning for warning in found.warnings)


def test_one_view_is_rejected():
    scene = BoardScene()
    with pytest.raises(CalibrationFailed, match=r"1 view shows .* 2 are needed, best 15"):
        fit_laser_plane(camera_of(scene), views_of(scene, 1))


def test_repeated_pose_is_rejected():
    scene = BoardScene()
    with pytest.raises(DegenerateGeometry, match="lie on one line"):
        fit_laser_plane(camera_of(scene), views_of(scene, 1) * 4)


def test_parallel_boards_are_rejected_if_the_camera_is_refined():
    scene = BoardScene(tilt=0.0)
    with pytest.raises(DegenerateGeometry, match=r"all boards are parallel within 0\.0 deg"):
        fit_laser_plane(camera_of(scene), views_of(scene, 8))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"line_pixels": np.full((4, 2), np.nan), "line_std": np.ones(4)}, "leave lost points out"),
        ({"pixels": np.full((70, 2), np.nan)}, "leave lost points out"),
        (
            {"line_pixels": np.eye(2), "line_std": np.ones(2)},
            "at least 4 points and line_pixels, got 70 and 2",
        ),
        ({"line_std": np.zeros(100)}, "expected positive line_std"),
        ({"line_std": np.ones(3)}, r"line_std of shape \(100\), got \(3,\)"),
        ({"pixels": np.zeros((3, 2))}, r"pixels of shape \(70, 2\)"),
    ],
)
def test_invalid_views_are_rejected(change, match):
    with pytest.raises(ValueError, match=match):
        replace(views_of(BoardScene(), 1)[0], **change)


@pytest.mark.parametrize("count", [4, 8])
def test_the_covariance_of_another_camera_is_rejected_whether_it_is_used_or_not(count):
    views = views_of(BoardScene(), count)
    for covariance, match in ((np.eye(3), "9 intrinsics"), (np.full((9, 9), np.nan), "got nan")):
        with pytest.raises(ValueError, match=match):
            fit_laser_plane(camera_of(BoardScene()), views, camera_covariance=covariance)


def test_a_camera_without_rays_for_some_corners_is_named_as_the_cause():
    scene = BoardScene()
    camera = Camera(scene.matrix, [-3.5, 0, 0, 0, 0], scene.size)
    with pytest.raises(CalibrationFailed, match=r"not invertible at \d+ of 170 corners and line"):
        fit_laser_plane(camera, views_of(scene, 8))


def test_plane_fitted_to_coplanar_points_contains_them():
    rng = np.random.default_rng(1)
    points = rng.normal(0, 30, (50, 3)) * (1, 1, 0) + (0, 0, 200)
    found = fit_plane(points)
    np.testing.assert_allclose(found.signed_distances(points), 0, atol=1e-9)
    assert found.distance == pytest.approx(200)
