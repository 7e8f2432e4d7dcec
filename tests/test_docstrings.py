"""Every public name is documented in numpydoc's format, with an example that runs.

The format is checked by numpydoc; the examples are run as doctests (``--doctest-modules`` in
pyproject.toml). A property needs no example of its own: it is a value, described in words and unit.
"""

import importlib
import inspect
import re
from functools import cached_property
from pathlib import Path

from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate

import lsvision

ROOT = Path(lsvision.__file__).parent

IGNORED = {
    "ES01",  # the first line may be enough
    "SA01",  # related names stand in backticks where they matter
    "EX01",  # examples are required below, where they make sense
    "PR04",  # parameters "as for `another_function`" have no type of their own
    "PR08",  # a description may begin with a symbol: u, v
    "RT04",
    "RT02",  # the parts of a tuple have names
}

KINDS = {name: getattr(lsvision, name) for name in lsvision.__all__}
FUNCTIONS = {name: kind for name, kind in KINDS.items() if inspect.isfunction(kind)}
CLASSES = {name: kind for name, kind in KINDS.items() if inspect.isclass(kind)}


def public_members(kind):
    """Methods and properties that our classes define, those of a base of ours too."""
    for base in kind.__mro__:
        if base.__module__.startswith("lsvision"):
            for name, member in vars(base).items():
                plain = inspect.unwrap(getattr(member, "__func__", member))
                is_property = isinstance(member, property | cached_property)
                if not name.startswith("_") and (is_property or inspect.isfunction(plain)):
                    yield name, member if is_property else getattr(kind, name)


MEMBERS = {
    f"{name}.{member}": value
    for name, kind in CLASSES.items()
    for member, value in public_members(kind)
}
METHODS = {name: member for name, member in MEMBERS.items() if callable(member)}
DOCUMENTED = FUNCTIONS | CLASSES | MEMBERS


def example(thing):
    """Example in a docstring; empty if there is none."""
    parts = re.split(r"^Examples\n-{3,}\n", inspect.getdoc(thing) or "", flags=re.MULTILINE)
    return parts[1] if len(parts) > 1 and ">>> " in parts[1] else ""


def examples_of_class(kind):
    return "".join(map(example, [kind, *(member for _, member in public_members(kind))]))


def flaws(thing):
    if isinstance(thing, cached_property):
        thing = property(thing.func)
    errors = validate(get_doc_object(thing))["errors"]
    return [f"{code}: {message}" for code, message in errors if code not in IGNORED]


NOT_CALLED = {"NoiseModel", "Decision", "Job"}
"""Classes whose signature no user calls: a Protocol, an enumeration, and the content of a file."""


def test_every_public_name_is_documented_in_numpydoc_format():
    found = {name: flaws(DOCUMENTED[name]) for name in DOCUMENTED if name not in NOT_CALLED}
    assert len(found) > 100
    assert {name: errors for name, errors in found.items() if errors} == {}


def test_every_public_name_has_an_example():
    assert [name for name in FUNCTIONS | CLASSES if not example(KINDS[name])] == []


def stands_in_an_example(name):
    kind, _, method = name.partition(".")
    return example(METHODS[name]) or f".{method}(" in examples_of_class(CLASSES[kind])


def test_every_public_method_stands_in_an_example_of_its_own_or_of_its_class():
    assert [name for name in METHODS if not stands_in_an_example(name)] == []


def test_no_public_example_is_skipped():
    texts = {name: inspect.getdoc(thing) or "" for name, thing in DOCUMENTED.items()}
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

    assert flaws(silent) == [
        "PR01: Parameters {'b'} not documented",
        "RT01: No Returns section found",
    ]
    assert not example(silent)


MODULES = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")
    for path in ROOT.rglob("*.py")
}


def exists(reference):
    """Whether a dotted name is a module of the package, or something in one."""
    parts = reference.split(".")
    for count in range(len(parts), 0, -1):
        if (module := ".".join(parts[:count])) in MODULES:
            thing = importlib.import_module(module)
            for part in parts[count:]:
                thing = getattr(thing, part, None)
            return thing is not None
    return False


def test_modules_that_docstrings_and_comments_name_exist():
    """A renamed module or function is renamed in the texts that refer to it, too."""
    references = {
        (path.name, reference)
        for path in ROOT.rglob("*.py")
        for reference in re.findall(r"`(lsvision\.[\w.]+)`", path.read_text(encoding="utf-8"))
    }
    assert len(references) > 50
    assert [pair for pair in sorted(references) if not exists(pair[1])] == []
    assert not exists("lsvision.detection.count_end_points")
