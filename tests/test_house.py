"""The house stands as `design.md` section 3 and the style say: read off the source, not run."""

import ast
import importlib
import inspect
import pkgutil
from pathlib import Path

import pytest

import lsvision
from lsvision import errors

ROOT = Path(lsvision.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
LONGEST_MODULE, LONGEST_BODY, MOST_PARAMETERS = 300, 40, 6  # lines, lines; style.md section 0
FORBIDDEN = {
    "simulate": ("recognition", "fitting", "measure", "scan", "literal"),
    "calibrate": ("recognition", "fitting", "measure", "scan", "literal"),
    "shapes": ("cv2",),
    "profile": ("cv2",),
    "fitting": ("cv2",),
    "measure": ("cv2",),
}
OPTIONS_ARE_PARAMETERS = "cli"  # a command has as many parameters as options


def name_of(path):
    return str(path.relative_to(ROOT))


def tree_of(path):
    return ast.parse(path.read_text(), name_of(path))


def functions_of(path):
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(tree_of(path)) if isinstance(node, kinds)]


def body_lines(function):
    """Lines from the first statement after the docstring to the end."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return function.end_lineno - body[0].lineno + 1 if body else 0


def imports_of(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_prints_nothing_and_leaves_no_todo(path):
    calls = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
    printing = [node.lineno for node in calls if getattr(node.func, "id", "") == "print"]
    assert printing == []
    assert not any(word in path.read_text() for word in ("TODO", "FIXME", "XXX"))


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_fits_in_a_head(path):
    assert len(path.read_text().splitlines()) <= LONGEST_MODULE
    for function in functions_of(path):
        assert body_lines(function) <= LONGEST_BODY, function.name


@pytest.mark.parametrize(
    "path", [path for path in MODULES if OPTIONS_ARE_PARAMETERS not in path.parts], ids=name_of
)
def test_a_function_has_few_parameters(path):
    for function in functions_of(path):
        arguments = function.args
        names = [a.arg for a in arguments.posonlyargs + arguments.args + arguments.kwonlyargs]
        count = len([name for name in names if name not in ("self", "cls")])
        assert count <= MOST_PARAMETERS, function.name


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_everything_public_is_documented(path):
    tree = tree_of(path)
    if path.name not in ("__main__.py",):
        assert ast.get_docstring(tree), "module"
    public = [node for node in tree.body if not getattr(node, "name", "_").startswith("_")]
    for node in public:
        assert ast.get_docstring(node), node.name
        for member in node.body if isinstance(node, ast.ClassDef) else ():
            if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                assert ast.get_docstring(member), f"{node.name}.{member.name}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_documented_array_has_its_unit(path):
    """A parameter in words of shapes, (n, 2) or (3,), says mm, rad, px or that it counts."""
    units = ("mm", "rad", "deg", "px", "pixel", "unit", "index", "indices", "int", "bool",
             "matrix", "rotation", "direction", "weight", "ratio", "label", "0 to 255", "grey",
             "1/", "orthonormal", "sigma", "camera", "image")  # fmt: skip
    for function in functions_of(path):
        doc = ast.get_docstring(function) or ""
        if "(n, 2)" in doc and not function.name.startswith("_"):
            assert any(unit in doc for unit in units), function.name


@pytest.mark.parametrize("room", FORBIDDEN)
def test_a_room_does_not_import_what_it_must_not(room):
    forbidden = [name if name == "cv2" else f"lsvision.{name}" for name in FORBIDDEN[room]]
    for path in MODULES:
        if path.relative_to(ROOT).with_suffix("").parts[0] == room:
            for imported in imports_of(path):
                met = [n for n in forbidden if imported == n or imported.startswith(n + ".")]
                assert not met, f"{name_of(path)} imports {imported}"


@pytest.mark.parametrize("name", lsvision.__all__)
def test_a_public_name_is_there_and_documented(name):
    thing = getattr(lsvision, name)
    if not isinstance(thing, lsvision.ProfileSensor):
        assert inspect.getdoc(thing)


def test_what_is_not_public_is_not_there():
    with pytest.raises(AttributeError, match="module 'lsvision' has no attribute 'Nothing'"):
        _ = lsvision.Nothing
    assert set(lsvision.__all__) <= set(dir(lsvision))


@pytest.mark.parametrize(
    "module", [module.name for module in pkgutil.walk_packages([str(ROOT)], "lsvision.")]
)
def test_every_module_can_be_imported_and_keeps_its_promises(module):
    if module == "lsvision.__main__":
        pytest.skip("importing it runs the command line")
    room = importlib.import_module(module)
    for name in getattr(room, "__all__", ()):
        assert hasattr(room, name), name


def raised_without_words(path):
    names = {name for name in vars(errors) if isinstance(getattr(errors, name), type)}
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Raise):
            called = node.exc
            bare = isinstance(called, ast.Name) and called.id in names
            wordless = isinstance(called, ast.Call) and not called.args and not called.keywords
            if bare or (wordless and getattr(called.func, "id", "") in names):
                yield node.lineno


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_every_error_says_something(path):
    assert list(raised_without_words(path)) == []


def test_every_error_is_one_of_ours():
    ours = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    assert all(issubclass(kind, errors.LsvisionError) for kind in ours)
    assert not issubclass(errors.LsvisionError, ValueError)
    assert all(inspect.getdoc(kind) for kind in ours)


def test_too_few_points_says_what_got_need_and_the_mend():
    error = errors.TooFewPoints("an arc", 4, 6, "scan slower")
    assert str(error) == "an arc has 4 points and needs 6: scan slower"
    assert (error.got, error.need) == (4, 6)
