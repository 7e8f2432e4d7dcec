"""Long lines cost time in proportion to their length: with its square, each would take minutes."""

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import read_profile

LENGTH = 100_000
ROWS = "\n".join(f"{x},{-400 + x * x / 100}" for x in range(-30, 31))
BLANK_ROWS = ROWS.replace(",", " ")


@pytest.mark.parametrize(
    "text",
    [
        "x" + "[" * LENGTH + ",z\n" + ROWS,
        "x" + " " * LENGTH + "a,z\n" + ROWS,
        "x" + " " * LENGTH + "a z\n" + BLANK_ROWS,
        "a_1" * LENGTH + ",z\n" + ROWS,
        "(" * LENGTH + "\n" + ROWS,
        "#" + "-" * LENGTH + "x\n" + ROWS,
        "1" * LENGTH + "x,z\n" + ROWS,
        ROWS + "\n" + "END " * LENGTH,
    ],
)
def test_points_beside_a_long_line_are_read(write, text):
    points = read_profile(write(text)).points
    np.testing.assert_array_equal(points[:, 0], range(-30, 31))


@pytest.mark.parametrize(
    "text",
    [
        "---\n\n" * 40 + "x",
        '{"a": 1}' + "\n" * LENGTH + "x",
        '{"x": [' + "1" * LENGTH + '], "z": [1]}',
        "x: [1, 2]\na" + " " * LENGTH + "b\n",
        "x: [1, 2]\nz: [1, 2" + " " * LENGTH + "x#b\n",
        "x: " + "[" * LENGTH,
        "%YAML:1.0\n---\nx: [1, 2]\n" + "a: [" * LENGTH,
        "%time,field.angle_min,field.ranges0\n" + '"' + "1" * 200_000 + "\n",
    ],
)
def test_long_texts_without_points_are_rejected(write, text):
    with pytest.raises(UnreadableFile) as message:
        read_profile(write(text))
    assert "\n" not in str(message.value)


@pytest.mark.parametrize(
    "text", ["x,z\n1,2\n2,3\n{}\n", "2,{}\n1,2\n2,3\n", "{} 2\n1 2\n2 3\nend\n"]
)
def test_a_number_of_thousands_of_digits_is_no_count(write, text):
    path = write(text.format("9" * 5000))
    if text.startswith("x"):
        with pytest.raises(UnreadableFile, match="line 4 has 1 cells"):
            read_profile(path)
    else:
        assert read_profile(path).points[1:].tolist() == [[1, 2], [2, 3]]
