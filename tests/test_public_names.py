"""What ``import lsvision`` gives: names imported on first use, and documented."""

import inspect
import pydoc

import pytest

import lsvision
from lsvision.detection.acceptance import AcceptanceSettings
from tests.scripts import output_of_python


def test_the_import_waits_for_no_heavy_package():
    code = "import sys, lsvision; print(*sys.modules)"
    heavy = {"numpy", "scipy", "cv2", "skimage", "matplotlib", "pandas"}
    assert not heavy & set(output_of_python(code).split())


def test_every_public_name_can_be_imported_by_itself():
    code = (
        f"from lsvision import {', '.join(lsvision.__all__)}; print(measure_cylinders.__module__)"
    )
    assert output_of_python(code) == "lsvision.measure\n"


def test_dir_names_what_is_public():
    assert set(dir(lsvision)) == set(lsvision.__all__)
    assert {"measure_cylinders", "simulate", "Pose"} <= set(lsvision.__all__)


def test_the_version_is_that_of_the_command():
    from typer.testing import CliRunner

    from lsvision.cli.app import app

    shown = CliRunner().invoke(app, ["--version"]).output
    assert shown.split() == ["lsvision", lsvision.__version__]


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nowhere"):
        _ = lsvision.nowhere


def test_settings_show_what_is_not_the_default():
    assert repr(lsvision.Settings()) == "Settings()"
    settings = lsvision.Settings(acceptance=AcceptanceSettings(min_points=9))
    shown = "Settings(acceptance=AcceptanceSettings(min_points=9))"
    assert repr(settings) == shown
    assert repr(lsvision.ScanSettings(section=settings)) == f"ScanSettings(section={shown})"
    assert repr(lsvision.LineSettings(channel="red")) == "LineSettings(channel='red')"


@pytest.mark.parametrize(
    "name", [name for name in lsvision.__all__ if inspect.isfunction(getattr(lsvision, name))]
)
def test_the_signature_of_a_function_fits_a_few_lines(name):
    assert len(str(inspect.signature(getattr(lsvision, name)))) < 450
    head = pydoc.plaintext.document(getattr(lsvision, name)).splitlines()[0]
    assert "object at 0x" not in head
