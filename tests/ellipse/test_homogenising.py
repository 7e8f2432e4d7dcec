import numpy as np
import pytest

from lsvision.ellipse.homogenising import (
    HomogenisingSettings,
    homogenise,
    homogenise_profile_paper,
)
from tests.tolerances import MACHINE


def test_new_points_stand_at_equal_steps_from_end_to_end():
    length = np.array([0.0, 1.0, 4.0, 5.0, 9.0, 20.0])
    even, _ = homogenise(length, length)
    assert (even[0], even[-1]) == (0.0, 20.0)
    np.testing.assert_allclose(np.diff(even), 0.5, atol=MACHINE)


def test_cubics_pass_unchanged():
    length = np.sort(np.concatenate([[0, 10], np.linspace(0.3, 9.1, 17) ** 1.01]))
    cubic = 1 + length - 0.2 * length**2 + 0.01 * length**3
    even, values = homogenise(length, cubic)
    np.testing.assert_allclose(values, 1 + even - 0.2 * even**2 + 0.01 * even**3, atol=MACHINE)


@pytest.mark.parametrize(("span", "count"), [(1.0, 8), (30.0, 61), (1000.0, 200)])
def test_there_are_never_too_few_nor_too_many_points(span, count):
    length = np.linspace(0, span, 40)
    assert len(homogenise(length, length, HomogenisingSettings(step_mm=0.5))[0]) == count


def test_the_literal_step_runs_over_x_and_leaves_out_what_does_not_rise():
    x = np.array([0.0, 1.0, 2.0, 1.5, 2.0, 3.0])
    even = homogenise_profile_paper(np.column_stack([x, 2 * x]))
    np.testing.assert_allclose(even[:, 0], np.arange(0, 3, 0.5), atol=MACHINE)
    np.testing.assert_allclose(even[:, 1], 2 * even[:, 0], atol=MACHINE)
