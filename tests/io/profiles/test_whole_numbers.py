"""Whole numbers without a unit: counts of a sensor, in whatever words the file explains them."""

import json

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles
from lsvision.io.profiles.reading import require_plausible_units

X = np.linspace(-60, 60, 401)
Z = np.where(np.abs(X) < 18, np.sqrt(np.maximum(20.0**2 - X**2, 0)) - 275, -290.0)
Z += np.random.default_rng(11).normal(0, 0.03, len(X))
COUNTS = np.round(np.column_stack([X, Z]) * 10)  # of 0.1 mm
REJECTION = r"whole numbers without a unit.*--units 0\.1mm, or --units mm if it is correct"


def text(head, points=COUNTS):
    return f"{head}\nx,z\n" + "\n".join(f"{x:.6g},{z:.6g}" for x, z in points) + "\n"


def read(tmp_path, content, name="counts.csv", **options):
    path = tmp_path / name
    path.write_text(content)
    file = inspect_profiles(path, **options)
    require_plausible_units(file)
    return file


@pytest.mark.parametrize(
    "words",
    [
        "Gain;0.1",
        "Nachkommastellen: 1",
        "# raw ADC values",
        "# fixed point, one decimal",
        "",
    ],
)
def test_counts_are_rejected_whatever_explains_them(tmp_path, words):
    with pytest.raises(UnreadableFile, match=REJECTION):
        read(tmp_path, text(words))


@pytest.mark.parametrize("key", ["resolution", "zGain"])
def test_counts_in_json_are_rejected(tmp_path, key):
    x, z = COUNTS.T.tolist()
    with pytest.raises(UnreadableFile, match=REJECTION):
        read(tmp_path, json.dumps({key: 0.1, "x": x, "z": z}), "counts.json")


def test_a_formula_is_rejected_with_its_line(tmp_path):
    line = "# value[mm] = raw * 0.1"
    with pytest.raises(UnreadableFile, match=r"value\[mm\] = raw \* 0.1.*--units 0\.1mm"):
        read(tmp_path, text(line))


def test_the_length_of_a_count_is_their_unit(tmp_path):
    x, z = COUNTS.T.tolist()
    for content in (
        text("# mm_per_count=0.1"),
        text("# 1 count = 0.1 mm"),
        json.dumps({"mm_per_count": 0.1, "x": x, "z": z}),
        json.dumps({"counts_per_mm": 10, "x": x, "z": z}),
    ):
        points = read(tmp_path, content).profiles[0].points
        np.testing.assert_allclose(points, COUNTS * 0.1)


def test_a_stated_unit_resolves_it(tmp_path):
    for options in ({"units": "0.1mm"}, {"units": "mm"}):
        points = read(tmp_path, text(""), **options).profiles[0].points
        np.testing.assert_allclose(points, COUNTS * (0.1 if options["units"] != "mm" else 1.0))
    assert not read(tmp_path, text("# unit: mm")).unit_warnings


def test_heights_with_decimals_or_few_steps_are_not_counts(tmp_path):
    assert not read(tmp_path, text("", np.add(COUNTS, [0, 0.5]))).unit_warnings
    steps = np.column_stack([X, np.round(X / 40) * 10 - 300])
    assert not read(tmp_path, text("", steps)).unit_warnings
