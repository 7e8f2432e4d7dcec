"""Every public name says in numpydoc what it takes and gives, with an example that runs.

The examples themselves are run as doctests (``--doctest-modules`` in pyproject.toml).
"""

import inspect
import re

import pytest

import lsvision

KINDS = {name: getattr(lsvision, name) for name in lsvision.__all__}
FUNCTIONS = {name: kind for name, kind in KINDS.items() if inspect.isfunction(kind)}
CLASSES = {name: kind for name, kind in KINDS.items() if inspect.isclass(kind)}


def public_methods(kind):
    """Methods that our classes define, those of a base of ours too."""
    for base in kind.__mro__:
        if base.__module__.startswith("lsvision"):
            for name, member in vars(base).items():
                plain = inspect.unwrap(getattr(member, "__func__", member))
                if inspect.isfunction(plain) and not name.startswith("_"):
                    yield name, getattr(kind, name)


METHODS = {
    f"{name}.{method}": member
    for name, kind in CLASSES.items()
    for method, member in public_methods(kind)
}


def sections(thing):
    """Sections of a docstring: title to text."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", inspect.getdoc(thing) or "", flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(thing):
    """Names under Parameters."""
    heads = re.findall(r"^(?=\S)(.+?)(?: : .*)?$", sections(thing).get("Parameters", ""), re.M)
    return {name.strip("* ") for head in heads for name in head.split(",")}


def parameters(function):
    names = inspect.signature(function).parameters
    return {name for name in names if name not in ("self", "cls")}


def returns_nothing(function):
    return inspect.signature(function).return_annotation in (None, "None")


def flaws(thing, *, example):
    missing = parameters(thing) - documented(thing)
    found = [f"parameter {name} is not documented" for name in sorted(missing)]
    if not returns_nothing(thing) and "Returns" not in sections(thing):
        found.append("no Returns")
    if example and ">>> " not in sections(thing).get("Examples", ""):
        found.append("no Examples")
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_is_documented_with_an_example(name):
    assert flaws(FUNCTIONS[name], example=True) == []


@pytest.mark.parametrize("name", METHODS)
def test_a_public_method_is_documented(name):
    assert flaws(METHODS[name], example=False) == []


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_class_is_documented_with_an_example(name):
    kind = CLASSES[name]
    assert ">>> " in sections(kind).get("Examples", ""), "no Examples"
    fields = {
        field.name for field in getattr(kind, "__dataclass_fields__", {}).values() if field.init
    }
    assert fields - documented(kind) == set()


def test_no_public_example_is_skipped():
    texts = {name: inspect.getdoc(kind) or "" for name, kind in {**KINDS, **METHODS}.items()}
    assert [name for name, text in texts.items() if "doctest: +SKIP" in text] == []


def test_the_check_finds_what_is_missing():
    def silent(a, b):
        """Say nothing.

        Parameters
        ----------
        a : int
            One.
        """
        return a + b

    assert flaws(silent, example=True) == [
        "parameter b is not documented", "no Returns", "no Examples",
    ]  # fmt: skip
