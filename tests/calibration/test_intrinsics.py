import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.calibration.intrinsics import CameraSettings, calibrate_camera, fit_camera
from lsvision.calibration.target import Chessboard, TargetView
from lsvision.calibration.views import ViewSources
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.simulate.boards import BoardScene, simulate_boards

SAMPLES = Path(__file__).parents[2] / "../shared/real/opencv-samples"
PUBLISHED = 0.05  # px: tolerance on the published focal length
EXACT_PX = 2e-3  # px: OpenCV takes the corners as float32
SIGMAS = 4.5  # of some hundred comparisons none is expected beyond


def views_of(scene, count, seed):
    boards = simulate_boards(scene, count, rng=np.random.default_rng(seed))
    return [TargetView(board.points, board.pixels, scene.size) for board in boards]


def parameters(camera):
    matrix = camera.matrix
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *camera.distortion])


def test_camera_is_exact_without_noise():
    scene = BoardScene(corner_std=0.0)
    found = fit_camera(views_of(scene, 8, 1))
    np.testing.assert_allclose(found.camera.matrix, scene.matrix, rtol=0, atol=0.05)
    assert found.rms_px < EXACT_PX


@pytest.mark.parametrize("seed", range(4))
def test_error_is_within_the_predicted_std(seed):
    scene = BoardScene()
    found = fit_camera(views_of(scene, 15, seed))
    truth = np.array([2264.0, 2264.0, 639.5, 511.5, *scene.distortion])
    std = np.array(list(found.std.values()))
    free = std > 0
    assert free.tolist() == [True] * 8 + [False]
    assert (np.abs(parameters(found.camera) - truth)[free] < SIGMAS * std[free]).all()
    assert found.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


BENT = BoardScene(bow=(0.05, 0.2), twist=-0.3)


@pytest.mark.parametrize("seed", range(4))
def test_a_bent_board_is_found_and_the_camera_corrected_for_it(seed):
    found = fit_camera(views_of(BENT, 15, seed))
    truth = np.array([2264.0, 2264.0, 639.5, 511.5, *BENT.distortion])
    std = np.array(list(found.std.values()))
    off = np.abs(parameters(found.camera) - truth)
    assert (off[std > 0] < SIGMAS * std[std > 0]).all()
    np.testing.assert_allclose(np.diag(found.covariance) ** 0.5, std, rtol=1e-9)
    bow = found.board_bow - (0.05, 0.2, -0.3)
    assert (np.abs(bow) < SIGMAS * found.board_bow_std).all()
    assert found.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert any("twisted by -0." in text for text in found.warnings)
    assert "board's twist" in str(found)
    assert found.to_dict()["board_bow_mm"] == found.board_bow.tolist()


@pytest.mark.parametrize("bow", [0.0, 0.004])
def test_a_bow_that_does_not_show_does_not_bias_the_camera(bow):
    scene, scores = BoardScene(bow=(bow, bow)), []
    for seed in range(12):
        found = fit_camera(views_of(scene, 10, 7000 + seed))
        scores.append((found.camera.matrix[0, 0] - scene.matrix[0, 0]) / found.std["fx"])
        assert (np.abs(found.board_bow - (bow, bow, 0)) < SIGMAS * found.board_bow_std).all()
        assert found.warnings == ()
    # Of a camera for which the board with a bow is taken as flat: 1.3, and a mean of 1.
    assert np.sqrt(np.mean(np.square(scores))) < 1.1
    assert abs(np.mean(scores)) < 3 / np.sqrt(12)


def test_a_bent_board_is_corrected_for_with_a_fixed_aspect_and_a_tilted_sensor():
    seen = views_of(BENT, 8, 5)
    fixed, tilted = (
        fit_camera(seen, settings)
        for settings in (CameraSettings(fixed_aspect=True), CameraSettings(tilted=True))
    )
    for found in (fixed, tilted):
        assert np.abs(found.board_bow - (0.05, 0.2, -0.3)).max() < 0.02
        assert abs(found.camera.matrix[0, 0] - 2264) < SIGMAS * found.std["fx"]
        assert found.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert fixed.camera.matrix[0, 0] == pytest.approx(fixed.camera.matrix[1, 1], rel=1e-12)


@pytest.mark.parametrize(("count", "bent"), [(5, True), (12, False)])
def test_the_shape_of_the_board_is_not_estimated_from_few_views_or_on_request(count, bent):
    found = fit_camera(views_of(BENT, count, 20), CameraSettings(bent_board=bent))
    assert found.board_bow.tolist() == found.board_bow_std.tolist() == [0, 0, 0]
    assert "twist" not in str(found)


def test_the_shape_of_a_board_of_two_rows_is_not_estimated():
    views = views_of(replace(BENT, columns=3, rows=2, square=40.0), 12, 21)
    found = fit_camera(views)
    assert found.board_bow_std.tolist() == [0, 0, 0]
    assert all(np.isfinite(list(found.std.values())))


def test_order_of_views_does_not_matter():
    seen = views_of(BoardScene(), 8, 2)
    forth, back = fit_camera(seen), fit_camera(seen[::-1])
    np.testing.assert_allclose(
        parameters(forth.camera), parameters(back.camera), rtol=1e-5, atol=1e-4
    )
    assert forth.views[0].rms_px == pytest.approx(back.views[-1].rms_px, rel=1e-4)


def test_the_same_views_give_the_same_digits_with_several_threads():
    views = views_of(BoardScene(), 15, 3)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(4)
    try:
        matrices = {fit_camera(views).camera.matrix.tobytes() for _ in range(4)}
        assert cv2.getNumThreads() == 4
    finally:
        cv2.setNumThreads(threads)
    assert len(matrices) == 1


def test_tilted_sensor_is_estimated_if_enabled():
    lens = np.array([-0.12, 0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, np.radians(10), 0.0])
    seen = views_of(BoardScene(distortion=lens), 20, 3)
    plain = fit_camera(seen)
    tilted = fit_camera(seen, CameraSettings(tilted=True))
    assert plain.rms_px > 1.05 * tilted.rms_px
    tau = tilted.camera.distortion[12]
    assert abs(tau - np.radians(10)) < SIGMAS * tilted.std["tau_x"]
    assert tilted.std["k4"] == tilted.std["s1"] == 0


def test_disabled_parameters_stay_fixed():
    seen = views_of(BoardScene(), 6, 4)
    held = fit_camera(seen, CameraSettings(radial_terms=1, tangential=False, fixed_aspect=True))
    assert held.camera.distortion[1:].tolist() == [0, 0, 0, 0]
    assert held.camera.matrix[0, 0] == held.camera.matrix[1, 1]
    assert held.std["fx"] == held.std["fy"] > 0
    for terms in (4, 2.0):
        with pytest.raises(ValueError, match=f"0 to 3 radial_terms, a whole number, got {terms}"):
            CameraSettings(radial_terms=terms)


def test_good_set_gives_no_warning():
    assert fit_camera(views_of(BoardScene(), 20, 6)).warnings == ()


def test_view_with_large_residuals_is_an_outlier():
    seen = views_of(BoardScene(), 10, 5)
    rng = np.random.default_rng(0)
    spoilt = seen[3].pixels + rng.normal(0, 1.0, seen[3].pixels.shape)
    seen[3] = replace(seen[3], pixels=spoilt)
    outlier = fit_camera(seen, sources=ViewSources(tuple(range(10, 20)))).outliers
    assert [view.index for view in outlier] == [13]
    assert "px rms where the median view has" in outlier[0].reason


@pytest.mark.parametrize(
    ("scene", "count", "match"),
    [
        (BoardScene(tilt=np.radians(12)), 15, "tilted by .* deg at most"),
        (BoardScene(), 5, "5 views: take 10"),
        (BoardScene(tilt=np.radians(5)), 4, "focal length is determined to"),
    ],
)
def test_weak_sets_give_warnings(scene, count, match):
    warnings = "\n".join(fit_camera(views_of(scene, count, 7)).warnings)
    assert re.search(match, warnings)


def test_corners_in_half_of_the_image_give_a_warning():
    seen = []
    for view in views_of(BoardScene(), 15, 7):
        left = view.pixels[:, 0] < 500
        if left.sum() > 20:
            seen.append(TargetView(view.points[left], view.pixels[left], view.size))
    assert any("% of the image" in warning for warning in fit_camera(seen).warnings)


def test_square_given_in_metres_is_implausible():
    seen = [replace(view, points=view.points / 1000) for view in views_of(BoardScene(), 10, 8)]
    assert any("boards are 0.3" in warning for warning in fit_camera(seen).warnings)


def test_stretched_print_is_implausible():
    seen = [
        replace(view, points=view.points * (1.05, 1, 1)) for view in views_of(BoardScene(), 10, 8)
    ]
    assert any("the print is stretched" in warning for warning in fit_camera(seen).warnings)


def test_parallel_boards_are_rejected():
    with pytest.raises(DegenerateGeometry, match=r"parallel within .* tilt the board by 25 deg"):
        fit_camera(views_of(BoardScene(tilt=np.radians(0.5)), 10, 9))


def test_boards_that_are_exactly_parallel_are_rejected():
    with pytest.raises(DegenerateGeometry, match=r"parallel within 0\.0 deg"):
        fit_camera(views_of(BoardScene(tilt=0.0, corner_std=0.0), 6, 0))


def chessboard_image(size=(480, 640)):
    board = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((30, 30))) * 255
    image = np.full(size, 255, np.uint8)
    image[40 : 40 + 210, 50 : 50 + 300] = board
    return image


def test_views_of_one_row_of_corners_determine_no_camera():
    row = np.column_stack([np.arange(9) * 10.0, np.zeros(9), np.zeros(9)])
    views = [
        TargetView(row, row[:, :2] * (3 + k) + (50 + 10 * k, 60), (640, 480)) for k in range(4)
    ]
    with pytest.raises(CalibrationFailed, match="not consistent with one camera"):
        fit_camera(views)


def test_images_without_board_are_listed_in_the_error():
    empty = np.full((480, 640), 255, np.uint8)
    with pytest.raises(
        CalibrationFailed, match=r"1 view shows .*; image 1: no chessboard of 9 x 6"
    ):
        calibrate_camera([chessboard_image(), empty], Chessboard(9, 6, 10.0))


def test_a_reason_that_many_images_share_is_told_once():
    empty = [np.full((480, 640), 255, np.uint8)] * 4
    with pytest.raises(CalibrationFailed) as caught:
        calibrate_camera([chessboard_image(), *empty], Chessboard(9, 6, 10.0))
    assert "; image 1, image 2, image 3, image 4: no chessboard" in str(caught.value)
    assert str(caught.value).count("no chessboard") == 1
    assert "\n" not in str(caught.value)


def test_a_photo_that_is_there_twice_counts_once():
    image = chessboard_image()
    with pytest.raises(CalibrationFailed, match="image 2: the same photo as image 0"):
        calibrate_camera([image, image.copy(), image], Chessboard(9, 6, 10.0))


def test_no_view_of_a_very_good_set_is_an_outlier():
    rng = np.random.default_rng(5)
    seen = [
        replace(view, pixels=view.pixels + rng.normal(0, std, view.pixels.shape))
        for view, std in zip(
            views_of(BoardScene(corner_std=0.0), 10, 3), [0.01] * 9 + [0.07], strict=True
        )
    ]
    found = fit_camera(seen)
    assert found.views[9].rms_px > 2.5 * np.median([view.rms_px for view in found.views])
    assert found.outliers == ()


def test_images_of_mixed_size_are_rejected():
    images = [chessboard_image(), chessboard_image(), chessboard_image((500, 640))]
    with pytest.raises(
        CalibrationFailed, match=r"image 2 is 640 x 500 px and image 0 640 x 480 px"
    ):
        calibrate_camera(images, Chessboard(9, 6, 10.0))


def test_views_of_mixed_size_are_rejected():
    first, *others = views_of(BoardScene(), 6, 3)
    with pytest.raises(CalibrationFailed, match="image 1 is 1280 x 1024 px and image 0 640 x 480"):
        fit_camera([replace(first, size=(640, 480)), *others])


def test_names_of_files_are_no_images():
    with pytest.raises(TypeError, match=r"image 0 as an array, got .a\.png.: .*read_image"):
        calibrate_camera(["a.png", "b.png"], Chessboard())


def test_empty_list_of_images_is_rejected():
    with pytest.raises(CalibrationFailed, match="0 views show the target and 3 are needed"):
        calibrate_camera([], Chessboard())


@pytest.fixture(scope="module")
def samples():
    paths = sorted(SAMPLES.glob("left*.jpg"))
    if not paths:
        pytest.skip(f"{SAMPLES} is not here")
    return [cv2.imread(str(path)) for path in paths]


def corners_as_published(image):
    """Corners by OpenCV's finder and refinement, with the window that its sample program uses."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    _, corners = cv2.findChessboardCorners(grey, (9, 6), flags=flags)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.1)
    pixels = cv2.cornerSubPix(grey, corners.reshape(-1, 1, 2), (11, 11), (-1, -1), stop)
    return TargetView(Chessboard(9, 6, 25.0).points, pixels.reshape(-1, 2), grey.shape[::-1])


def test_camera_of_the_opencv_samples_agrees_with_the_published_one(samples):
    views = [corners_as_published(image) for image in samples]
    settings = CameraSettings(fixed_aspect=True, radial_terms=3, bent_board=False)
    found = fit_camera(views, settings)
    assert found.camera.matrix[0, 0] == pytest.approx(535.91573, abs=PUBLISHED)
    np.testing.assert_allclose(found.camera.matrix[:2, 2], (342.28315, 235.57083), atol=PUBLISHED)
    assert found.camera.distortion[0] == pytest.approx(-0.26637, abs=1e-4)
    assert found.rms_px == pytest.approx(0.39259, abs=1e-3)
    assert [view.index for view in found.outliers] == [1]


def test_two_cameras_find_the_same_bow_of_the_board_of_the_opencv_samples(samples):
    paths = sorted(SAMPLES.glob("right[0-9]*.jpg"))
    board, model = Chessboard(9, 6, 25.0), CameraSettings(fixed_aspect=True)
    others = [cv2.imread(str(path)) for path in paths]
    left, right = (calibrate_camera(images, board, model) for images in (samples, others))
    std = np.hypot(left.board_bow_std, right.board_bow_std)
    assert (np.abs(left.board_bow - right.board_bow) < SIGMAS * std).all()
    assert left.board_bow[1] < -0.1 > right.board_bow[1]


def test_corner_refinement_halves_the_residual_of_the_opencv_samples(samples):
    found = calibrate_camera(samples, Chessboard(9, 6, 25.0))
    assert found.rms_px < 0.2
    assert found.outliers == ()
