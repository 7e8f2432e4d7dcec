"""The image fixtures: what their recipe makes, and cylinders measured in them, against truth."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from lsvision.io.images import read_image
from lsvision.measure import measure_cylinders
from lsvision.sensors.light_section import LightSection
from tests.scripts import import_script

IMAGES = Path(__file__).parents[1] / "fixtures" / "images"
NAMES = ("single", "pair", "clutter")
MAX_PNG_BYTES = 300_000  # bytes
FOUR_SIGMA = 4
ROUNDED = 1e-3
"""Fraction of pixels that another build of OpenCV or numpy may round to the next number."""
each_name = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(scope="module")
def recipe():
    return import_script(IMAGES / "make.py")


def truth(name):
    return json.loads((IMAGES / f"{name}.truth.json").read_text())


def laser_off(name):
    path = IMAGES / f"{name}_laser_off.png"
    return read_image(path) if path.exists() else None


@pytest.fixture(scope="module")
def rig():
    return LightSection.load(IMAGES / "rig.json")


@pytest.fixture(scope="module")
def rebuilt(recipe, tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    recipe.main(folder)
    return folder


def test_the_recipe_makes_every_file(rebuilt):
    made = sorted(path.name for path in rebuilt.iterdir())
    assert made == sorted(
        path.name for path in IMAGES.iterdir() if path.suffix in (".png", ".json")
    )
    assert len(made) == 4 + 3 + 1
    for name in ("rig.json", *(f"{name}.truth.json" for name in NAMES)):
        assert json.loads((rebuilt / name).read_text()) == json.loads((IMAGES / name).read_text())
    for path in rebuilt.glob("*.png"):
        off = np.abs(read_image(path).astype(int) - read_image(IMAGES / path.name))
        assert off.max() <= 1
        assert (off > 0).mean() <= ROUNDED


@each_name
def test_an_image_is_small_and_its_truth_names_seed_and_command(name):
    assert (IMAGES / f"{name}.png").stat().st_size < MAX_PNG_BYTES
    values = truth(name)
    assert values["schema"] == "lsvision.simulated_image/1"
    assert (values["kind"], values["command"]) == (name, "python fixtures/images/make.py")


@each_name
def test_the_line_lies_where_the_rig_sees_the_true_sections(name, rig):
    v = np.array([math.nan if x is None else x for x in truth(name)["line_v_px"]])
    points = rig.points_from_pixels(np.column_stack([np.arange(len(v)), v]))
    for tube in truth(name)["tubes"]:
        turn, relative = tube["theta_rad"], points - tube["centre_mm"]
        along = relative @ (math.cos(turn), math.sin(turn))
        across = relative @ (-math.sin(turn), math.cos(turn))
        off = np.hypot(along * math.cos(tube["phi_rad"]), across) - tube["radius_mm"]
        assert (np.abs(off) < 0.005).sum() > 100


@each_name
def test_each_cylinder_is_found_within_four_sigma_of_its_truth(name, rig):
    profile = rig.profile(read_image(IMAGES / f"{name}.png"), laser_off=laser_off(name))
    found = measure_cylinders(profile).cylinders
    for cylinder, tube in zip(found, truth(name)["tubes"], strict=True):
        assert abs(cylinder.radius - tube["radius_mm"]) < FOUR_SIGMA * cylinder.radius_std
        assert abs(cylinder.phi - tube["phi_rad"]) < FOUR_SIGMA * cylinder.phi_std
        assert abs(cylinder.theta - tube["theta_rad"]) < FOUR_SIGMA * cylinder.theta_std
        sigmas = np.sqrt(np.diag(cylinder.covariance)[:2])
        assert (np.abs(np.subtract(cylinder.centre, tube["centre_mm"])) < FOUR_SIGMA * sigmas).all()
