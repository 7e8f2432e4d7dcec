"""Numbers that are no heights in mm as they stand: wrapped, numbers of points, angles, x again."""

import contextlib

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles

X = np.linspace(-20, 20, 101)
Z = np.sqrt(30.0**2 - X**2) - 27


def read(tmp_path, lines, **options):
    path = tmp_path / "profile.csv"
    path.write_text("\n".join(lines) + "\n")
    return inspect_profiles(path, **options)


@pytest.mark.parametrize("bits", [16, 32])
def test_negative_numbers_without_a_sign_are_rejected(tmp_path, bits):
    counts = np.round(Z * 100).astype(int) % 2**bits
    lines = ["x [mm],z [0.01 mm]", *(f"{x:.3f},{z}" for x, z in zip(X, counts, strict=True))]
    with pytest.raises(UnreadableFile, match=rf"{bits}-bit integers .* subtract {2**bits} from"):
        read(tmp_path, lines)


def test_numbers_on_both_sides_of_the_middle_of_16_bit_are_heights(tmp_path):
    counts = np.round(Z * 100).astype(int) + 32768
    lines = ["x [mm],z [0.01 mm]", *(f"{x:.3f},{z}" for x, z in zip(X, counts, strict=True))]
    assert read(tmp_path, lines).lost == 0


@pytest.mark.parametrize("start", [0, 1])
def test_numbers_of_points_as_x_are_noted_and_replaced(tmp_path, start):
    lines = [f"{k},{z:.3f}" for k, z in enumerate(Z, start)]
    assert any(
        "x is a whole number that rises by 1" in note for note in read(tmp_path, lines).notes
    )
    file = read(tmp_path, lines, x0=-20.0, dx=0.4)
    np.testing.assert_allclose(file.profiles[0].points, np.column_stack([X, Z]), atol=1e-3)
    assert file.notes == ()


@pytest.mark.parametrize(
    "header", ["Winkel;Radius", "bearing;range", "角度;距离", "úhel;vzdálenost"]
)
def test_angles_in_other_languages_are_rejected(tmp_path, header):
    lines = [header, *(f"{x:.3f};{z + 300:.3f}" for x, z in zip(X, Z, strict=True))]
    with pytest.raises(UnreadableFile, match="an angle and no x"):
        read(tmp_path, lines)


def test_rows_of_x_among_rows_of_heights_are_rejected(tmp_path):
    rows = [X, Z, X, Z - 1]
    lines = [",".join(f"{number:.3f}" for number in row) for row in rows]
    with pytest.raises(UnreadableFile, match="row 2 is evenly spaced as row 0, which is x"):
        read(tmp_path, lines)


@pytest.mark.parametrize(("step", "std"), [(1.0, "0.29"), (0.1, "0.029")])
def test_heights_rounded_to_coarse_steps_are_noted(tmp_path, step, std):
    x = np.linspace(-20, 20, 401)
    z = np.round((np.sqrt(25.0**2 - x**2) - 300) / step) * step
    lines = ["x [mm],z [mm]", *(f"{a:.3f},{b:.3f}" for a, b in zip(x, z, strict=True))]
    (note,) = read(tmp_path, lines).notes
    assert f"rounded to {step:g} mm" in note
    assert f"taken to be {std} mm where no sensor is stated" in note


def test_rounding_below_the_noise_is_not_noted(tmp_path):
    noise = np.random.default_rng(8).normal(0, 0.1, len(X))
    z = np.round(Z + noise, 1)
    lines = ["x [mm],z [mm]", *(f"{a:.3f},{b:.1f}" for a, b in zip(X, z, strict=True))]
    assert read(tmp_path, lines).notes == ()


@pytest.mark.parametrize("header", ["t,z", "time,height", "Zeit,Höhe"])
def test_times_are_no_x(tmp_path, header):
    lines = [header, *(f"{x:.3f},{z:.3f}" for x, z in zip(X, Z, strict=True))]
    with pytest.raises(UnreadableFile, match="a time and no x"):
        read(tmp_path, lines)


def test_typographic_dashes_as_signs_are_read(tmp_path):
    lines = [f"{x:.3f},{z - 99:.3f}".replace("-", "–") for x, z in zip(X, Z, strict=True)]
    np.testing.assert_allclose(read(tmp_path, lines).profiles[0].points[0], [-20, -103.639])


@pytest.mark.parametrize("columns", [2, 3, 6, 24])
@pytest.mark.parametrize("header", ["", "x,y,z,a,b,c", "x,z,valid"])
def test_numbers_near_the_largest_float_are_no_warning(tmp_path, columns, header):
    random = np.random.default_rng(columns)
    for _ in range(20):
        numbers = random.choice([0.0, 1e308, -1.7e308, 5.0, 300.25], size=(30, columns))
        lines = [header] * bool(header) + [",".join(map(repr, row.tolist())) for row in numbers]
        with contextlib.suppress(UnreadableFile):
            read(tmp_path, lines, x0=0.0, dx=0.5)
