"""Remedies in messages on images: what the command at hand has, and nothing that it lacks."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.main import get_command

from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_views
from lsvision.cli.app import app
from tests.calibration.test_laser_line_on_board import CAMERA, TARGET, board_and_line

RIG = Path(__file__).parents[2] / "fixtures" / "images" / "rig.json"
JOB = """
name = "tube"
RIG
[[part]]
name = "tube"
order = 1
radius_mm = { max = 21 }
"""
PARAMETERS = ("laser_off", "channel", "min_contrast", "sigma", "bayer ")
"""Names of the library's parameters, which no command has."""


def options_of(command):
    found = get_command(app)
    for word in command.split():
        found = found.get_command(None, word)
    return {option for parameter in found.params for option in parameter.opts}


def grey(folder):
    return np.full((600, 800), 4, np.uint8)


def coloured(folder):
    image = np.zeros((600, 800, 3), np.uint8)
    image[300:303] = (10, 20, 250)
    return image


@pytest.fixture
def failure(run, tmp_path):
    """Returns the message of a command on an image, with the options or the job's rig given."""

    def fail(command, image, given=(), rig=f'[rig]\nlight_section = "{RIG}"\n'):
        path, job = tmp_path / "image.png", tmp_path / "job.toml"
        cv2.imwrite(str(path), image(tmp_path))
        job.write_text(JOB.replace("RIG", rig))
        words = {
            "line": ("line", path),
            "measure": ("measure", path, "--light-section", RIG),
            "inspect": ("inspect", job, path),
        }
        done = run(*words[command], *given)
        assert done.exit_code == 1, done.output
        assert "image.png" in done.stderr
        return done.stderr

    return fail


def assert_only_what_is_there(message, command):
    assert set(re.findall(r"--[a-z0-9-]+", message)) <= options_of(command)
    assert not [name for name in PARAMETERS if name in message]


@pytest.mark.parametrize("command", ["line", "measure", "inspect"])
@pytest.mark.parametrize("image", [grey, coloured])
def test_a_message_on_an_image_names_only_what_its_command_has(failure, command, image):
    assert_only_what_is_there(failure(command, image), command)


@pytest.mark.parametrize("command", ["line", "measure"])
def test_options_that_help_to_find_the_line_are_named(failure, command):
    message = failure(command, grey)
    assert "no laser line runs through the 800 x 600 px" in message
    assert "--laser-off" in message
    assert "--laser" in message.replace("--laser-off", "")


def test_a_job_names_its_own_table(failure):
    assert 'laser = "red" in [rig]' in failure("inspect", coloured)
    assert "[rig]" in failure("inspect", grey)
    without_colours = 'laser = "red"\n'
    rig = f'[rig]\nlight_section = "{RIG}"\n{without_colours}'
    message = failure("inspect", grey, rig=rig)
    assert "has no colours" in message
    assert 'laser = "red" out of [rig]' in message
    assert_only_what_is_there(message, "inspect")


def test_an_image_without_the_rig_of_its_job_is_answered_with_the_table(failure):
    message = failure("inspect", grey, rig="")
    assert "light_section" in message
    assert "[rig]" in message
    assert_only_what_is_there(message, "inspect")


@pytest.mark.parametrize("command", ["calibrate laser-plane", "calibrate capture"])
def test_a_board_without_a_line_is_answered_with_options_of_the_calibrations(command):
    board, line = board_and_line((0.1, 0.4, 0.0), 270)
    dark = np.full_like(line, 5)
    _, sources = find_laser_views(CAMERA, TARGET, [board], [dark], LineOnBoardSettings())
    (rejected,) = sources.rejected
    assert "no laser line" in rejected.reason
    assert "(--laser)" in rejected.reason
    assert set(re.findall(r"--[a-z0-9-]+", rejected.reason)) <= options_of(command)
    assert "laser_off" not in rejected.reason
    assert "min_contrast" not in rejected.reason


@pytest.mark.parametrize(
    ("command", "given"),
    [
        ("measure", ()),
        ("scan", ("--feed", "0,0,1", "--step", "1")),
        ("study repeat", ("--reference", "9")),
        ("job new", ()),
    ],
)
def test_an_image_in_place_of_a_profile_is_answered_with_the_command_that_reads_it(
    run, tmp_path, command, given
):
    (tmp_path / "shots").mkdir()
    path = tmp_path / "shots" / "image.png"
    cv2.imwrite(str(path), grey(tmp_path))
    places = [path] if command == "job new" else [path, path.parent]
    for place in places:
        done = run(*command.split(), place, *given)
        assert done.exit_code == 1
        message = done.stderr.replace("lsvision measure --light-section", "")
        assert set(re.findall(r"--[a-z0-9-]+", message)) <= options_of(command)
