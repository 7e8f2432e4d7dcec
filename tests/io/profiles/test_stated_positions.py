"""x of heights without x, stated as start and step beside them; and what matrices mention."""

import json

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles

X = -3 + 0.1 * np.arange(60)
Z = np.random.default_rng(3).normal(0, 0.02, 60).round(4) - 17 - 0.1 * X**2
COLUMN = "".join(f"{z:.5f}\n" for z in Z)
ROW = ",".join(f"{z:.5f}" for z in Z) + "\n"
NUMBERED = "".join(f"{k},{z:.5f}\n" for k, z in enumerate(Z))
NOTE = "x of the heights by x0 = -3 mm and dx = 0.1 mm in the file"


def check(file):
    assert NOTE in file.notes
    assert not any("offset" in note for note in file.notes)
    np.testing.assert_allclose(file.profiles[0].points, np.column_stack([X, Z]), atol=1e-4)


@pytest.mark.parametrize(
    "lines",
    [
        "# x0=-3, dx=0.1\n",
        "# x0 = -3 mm\n# dx = 0.1 mm\n",
        "# x_start: -3\n# x_step: 0.1\n",
        "XStart;-3\nXPitch;0.1\n",
        "# X offset [um]: -3000\n# lateral spacing [um]: 100\n",
        "# unit: mm\n# start x = -3, step x = 0.1\n",
        "# x resolution: 0.1 mm\n# x start: -3\n",
        "Lateral resolution [mm];0.1\nLateral offset [mm];-3\n",
    ],
)
@pytest.mark.parametrize("body", [f"z\n{COLUMN}", COLUMN, ROW, f"index,z\n{NUMBERED}"])
def test_start_and_step_in_a_text_are_used(write, lines, body):
    check(inspect_profiles(write(lines + body)))


@pytest.mark.parametrize(
    "entries",
    [
        {"x0": -3, "dx": 0.1, "z": Z.tolist()},
        {"x_start": -3, "x_step": 0.1, "heights": Z.tolist()},
        {"x": {"start": -3, "step": 0.1}, "z": Z.tolist()},
        {"meta": {"x0": -3, "xPitch": 0.1}, "profile": Z.tolist()},
        {"x0": -3, "dx": 0.1, "z [mm]": Z.tolist(), "index": list(range(60))},
        {"x0": -3, "x_resolution": 0.1, "z": Z.tolist(), "intensity": [5] * 60},
    ],
)
def test_start_and_step_in_json_are_used(write, entries):
    check(inspect_profiles(write(json.dumps(entries), "a.json")))


@pytest.mark.parametrize(
    "lines",
    [
        "# y0=-3, dy=0.1\n",
        "# x0 = -3\n",
        "# dx = 0.1\n# dx = 0.2\n",
        "# unit: um\n# x0=-3, dx=0.1\n",
    ],
)
def test_others_are_rejected_as_before(write, lines):
    with pytest.raises(UnreadableFile, match="--dx"):
        inspect_profiles(write(f"{lines}z\n{COLUMN}"))


def test_x_of_the_file_or_the_user_goes_before_them(write):
    points = "".join(f"{x:.1f},{z:.5f}\n" for x, z in zip(X, Z, strict=True))
    (profile,) = inspect_profiles(write(f"# x0=5, dx=0.2\nx,z\n{points}")).profiles
    np.testing.assert_allclose(profile.points[:, 0], X)
    (profile,) = inspect_profiles(write(f"# x0=5, dx=0.2\n{ROW}"), x0=-3, dx=0.1).profiles
    np.testing.assert_allclose(profile.points[:, 0], X)


@pytest.mark.parametrize("line", ["# heights in 100 counts per mm", "# saved in um, ACME"])
def test_a_matrix_that_mentions_a_unit_is_rejected(write, line):
    path = write(f"{line}\n{ROW}{ROW}")
    with pytest.raises(UnreadableFile, match="mentions a unit that is not understood"):
        inspect_profiles(path, dx=0.1)
    assert inspect_profiles(path, dx=0.1, units="mm").profiles
    assert inspect_profiles(write(f"# x: 0.1 mm/px\n{ROW}{ROW}"), dx=0.1).profiles


def test_a_numbered_range_turns_the_heights(write):
    points = "".join(f"{x:.1f},{-z:.5f}\n" for x, z in zip(X, Z, strict=True))
    assert inspect_profiles(write(f"x,Distance1 [mm]\n{points}")).flipped
