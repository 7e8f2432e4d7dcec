"""What `.github` says of the source is so."""

import importlib.util
import re
from pathlib import Path

import pytest

import lsvision
from tests.scripts import import_script

ROOT = Path(lsvision.__file__).parents[1]
GITHUB = ROOT / ".github"
GUIDE = (GITHUB / "CONTRIBUTING.md").read_text(encoding="utf-8")
CHANGES = (GITHUB / "CHANGELOG.md").read_text(encoding="utf-8")
SUFFIXES = {".md", ".py", ".toml"}
PATHS = re.findall(r"`((?:lsvision|tests|fixtures|calibration|\.ci|\.github)/?[\w./]*)`", GUIDE)


@pytest.fixture(scope="module")
def layers():
    return import_script(GITHUB / "layers.py")


def test_the_picture_of_the_layers_is_the_contract_and_the_docstrings(layers):
    shown = layers.PICTURE.read_text(encoding="utf-8")
    assert shown == layers.draw_layers(), "draw it again: python .github/layers.py"


def test_the_picture_names_every_package(layers):
    drawn = {package for layer in layers.read_layers() for package in layer}
    top = [path for path in (ROOT / "lsvision").iterdir() if not path.name.startswith("_")]
    assert drawn == {path.stem for path in top if path.is_dir() or path.suffix == ".py"} - {"py"}


@pytest.mark.parametrize("path", sorted({path for path in PATHS if "/x/" not in path}))
def test_a_path_that_the_guide_names_exists(path):
    assert (ROOT / path.replace("test_y", "")).exists()


def test_modules_that_the_guide_runs_exist():
    modules = set(re.findall(r"python -m (tests[\w.]*)", GUIDE))
    assert modules == {"tests.bench", "tests.fuzz", "tests.mutations"}
    assert all(importlib.util.find_spec(module) for module in modules)


def test_new_names_in_the_table_of_changes_exist():
    source = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("lsvision/**/*.py"))
    rows = [line.split("|")[1:4] for line in CHANGES.splitlines() if line.startswith("| `")]
    assert len(rows) > 8
    for name, _, now in rows:
        new = re.findall(r"`(\w+)(?:\(\))?`", now) + re.findall(r"now `(\w+)`", name)
        missing = [word for word in new if not re.search(rf"\b{word}\b", source)]
        assert not missing


def test_nothing_refers_to_documents_that_are_not_here():
    """The pages of this repository are its READMEs and those in .github."""
    here = {"README.md", "ACCURACY.md", "CONTRIBUTING.md", "CHANGELOG.md"}
    for folder in ("lsvision", "tests", "calibration", "fixtures", ".github"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in SUFFIXES:
                named = re.findall(r"\b([\w-]+\.md)\b", path.read_text(encoding="utf-8"))
                assert set(named) <= here, path
