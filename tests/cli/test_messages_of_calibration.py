"""Messages of `lsvision calibrate`: options that the command has, and no Python in them."""

import ast
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer

import lsvision
from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid
from lsvision.cli.app import app
from lsvision.io.images import read_image
from lsvision.io.robot_conventions import pose_from_numbers

PACKAGE = Path(lsvision.__file__).parent
EXAMPLE = PACKAGE.parent / "calibration" / "example"
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*")
EVERYWHERE = {"--debug", "--max-size"}  # of the app, taken before and after any command
VIEWS = ("camera", "laser-plane", "hand-eye board")
PROFILES = ("hand-eye sphere", "hand-eye plane")
HAND_EYE = (*PROFILES, "hand-eye board", "hand-eye poses")
ALL = ("target", *VIEWS, *PROFILES, "hand-eye poses", "capture")

# Which commands a module's messages reach: the first pattern that its path matches.
REACHED = [
    ("calibration/laser_*", ("laser-plane",)),
    ("calibration/lens_blur.py", ("laser-plane",)),
    ("calibration/board_outline.py", ("laser-plane",)),
    ("calibration/bundle_*", ("laser-plane",)),
    ("calibration/target*.py", VIEWS),
    ("calibration/sphere_*", ("hand-eye sphere",)),
    ("calibration/plane_*", ("hand-eye plane",)),
    ("calibration/pose_planning.py", PROFILES),
    ("calibration/hand_eye*", HAND_EYE),
    ("calibration/capture_*", ("capture",)),
    ("calibration/*", ("camera", "laser-plane", *HAND_EYE)),
    ("io/pose_*", HAND_EYE[:3]),
    ("io/robot_*", HAND_EYE[:3]),
    ("io/hand_eye_file.py", ("hand-eye poses",)),
    ("io/camera_file.py", ("laser-plane", "hand-eye board")),
    ("io/profiles/*", PROFILES),
]
# A message that also serves other commands than those above may name theirs, saying whose it is.
OF_OTHERS = {("io/profiles/detection.py", "--light-section"),
             ("io/profiles/matrix.py", "--light-section")}  # fmt: skip


@cache
def options_of(words):
    command = typer.main.get_command(app)
    for word in ("calibrate", *words.split()):
        command = command.get_command(typer.Context(command), word)
    return {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | EVERYWHERE


def messages_of(path):
    """The text of a module's string literals, without its docstrings."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    statements = {node.value for node in nodes if isinstance(node, ast.Expr)}
    strings = [n for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return " ".join(node.value for node in strings if node not in statements)


def named_options():
    """Module, option and commands of each option that a message names."""
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE)
        commands = next((c for pattern, c in REACHED if name.match(pattern)), ())
        for option in sorted(set(OPTION.findall(messages_of(path)))) if commands else ():
            if (str(name), option) not in OF_OTHERS:
                for command in commands:
                    yield str(name), command, option


def test_an_option_that_a_message_names_is_one_of_the_command():
    named = list(named_options())
    assert {"--margin", "--columns", "--x-start", "--convention"} <= {
        option for *_, option in named
    }
    foreign = [each for each in named if each[2] not in options_of(each[1])]
    assert foreign == []


@pytest.mark.parametrize("words", ALL)
def test_an_option_that_the_help_names_is_one_of_a_calibration_or_of_the_command(run, words):
    known = set().union(*(options_of(command) for command in ALL))
    named = set(OPTION.findall(run("calibrate", *words.split(), "--help").stdout))
    assert named - known - {"--help"} == set()


PYTHON = re.compile(
    r"\w\(\w+=|\w+\('|array\(|\[\s*-?\d+\.\s|\(\d+, \d+\) px|<[\w.]+ object|\b(?:None|True|False)\b"
    r"|\bnp\.|eye_(?:in|to)_hand"
)


@pytest.mark.parametrize(
    ("target", "printed"),
    [
        (ChArUco(), "ChArUco board of 11 x 8 squares of 15 mm (markers of 11 mm, DICT_4X4_100)"),
        (Chessboard(7, 6, 25.5), "chessboard of 7 x 6 inner corners 25.5 mm apart"),
        (CircleGrid(), "asymmetric grid of 4 x 11 discs, rows 15 mm apart"),
        (
            CircleGrid(9, 6, 20.0, 8.0, asymmetric=False),
            "symmetric grid of 9 x 6 discs 20 mm apart",
        ),
    ],
)
def test_a_target_is_described_in_words(target, printed):
    assert str(target) == printed


@pytest.mark.parametrize(
    "numbers", [[1, 2, 3, 4, 5, np.nan], [1, 2, 3, 4, 5, 1e12], [0, 0, 0, 2, 0, 0, 0], [1.0] * 16]
)
def test_numbers_that_are_no_pose_are_shown_as_numbers(numbers):
    convention = {6: "kuka", 7: "ros", 16: "matrix"}[len(numbers)]
    with pytest.raises(ValueError, match="expected") as printed:
        pose_from_numbers(numbers, convention)
    assert not PYTHON.search(str(printed.value))


@pytest.fixture
def spoilt(tmp_path):
    """Board images: two of one size, one without a board, one of another size."""
    import cv2

    folder = tmp_path / "boards"
    folder.mkdir()
    board = read_image(EXAMPLE / "boards" / "board_00.jpg")
    for name, image in (("a", board), ("b", np.full_like(board, 90)), ("c", board)):
        cv2.imwrite(str(folder / f"{name}.png"), image)
    cv2.imwrite(str(tmp_path / "small.png"), board[:200, :300])
    return folder


@pytest.mark.parametrize(
    ("boards", "target"),
    [
        ("boards", ()),
        # Images of another board, in each of which it is looked for long.
        ("boards/board_00.jpg", ("--target", "chessboard", "--counts", "7x6", "--square", 9)),
    ],
)
def test_error_messages_and_results_hold_no_python(run, spoilt, tmp_path, boards, target):
    options = ("--out", tmp_path / "camera.json", *target)
    messages = run("calibrate", "camera", EXAMPLE / boards, *options).output
    messages += run("calibrate", "camera", spoilt, tmp_path / "small.png", *options).output
    messages += run("calibrate", "camera", spoilt, *options).output
    messages += run("calibrate", "target", "--out", tmp_path / "t.svg", *target).output
    assert len(messages.splitlines()) >= 4
    assert PYTHON.findall(messages) == []


def test_a_colour_that_images_lack_is_reported_without_a_foreign_option(run, tmp_path):
    messages = run("calibrate", "laser-plane", "--boards", EXAMPLE / "boards", "--lines",
               EXAMPLE / "lines", "--camera", camera_file(tmp_path), "--laser", "red",
               "--out", tmp_path / "rig.json").stderr  # fmt: skip
    assert "has no colours: leave --laser red out" in messages
    assert set(OPTION.findall(messages)) <= options_of("laser-plane")


def camera_file(folder):
    path = folder / "camera.yaml"
    path.write_text("image_width: 640\nimage_height: 480\nK: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n"
                    "D: [0, 0, 0, 0, 0]\n")  # fmt: skip
    return path


def test_wrong_mounting_is_described_in_words(run, tmp_path):
    words = ("hand-eye", "sphere", EXAMPLE / "sphere", "--poses", EXAMPLE / "sphere_poses.csv")
    more = ("--convention", "kuka", "--out", tmp_path / "h.json")
    messages = run("calibrate", *words, *more, "--mounting", "eye-to-hand").output
    assert "mounting" in messages
    assert PYTHON.findall(messages) == []
    page = tmp_path / "h.html"
    assert run("calibrate", *words, *more, "--report", page).exit_code == 0
    text = re.sub(r"<svg.*?</svg>|<style>.*?</style>", "", page.read_text(), flags=re.DOTALL)
    assert PYTHON.findall(text) == []
