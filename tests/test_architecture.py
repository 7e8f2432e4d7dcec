"""Rules of the architecture and of the style, checked on the source text."""

import ast
import importlib
import inspect
import pickle
import pkgutil
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import lsvision
from lsvision import errors

ROOT = Path(lsvision.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
MAX_MODULE_LINES, MAX_BODY_LINES = 400, 40
FORBIDDEN = {
    "simulate": ("detection", "ellipse", "cylinder", "measure", "scan"),
    "calibration": ("detection", "ellipse", "cylinder", "measure", "scan"),
    "geometry": ("cv2",),
    "profile": ("cv2",),
    "statistics": ("cv2",),
    "ellipse": ("cv2",),
    "cylinder": ("cv2",),
    "measure": ("cv2",),
}


def name_of(path):
    return str(path.relative_to(ROOT))


@cache
def tree_of(path):
    return ast.parse(path.read_text(), name_of(path))


def functions_of(path):
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(tree_of(path)) if isinstance(node, kinds)]


def body_lines(function):
    """Lines from the first statement after the docstring to the end."""
    body = function.body[1:] if ast.get_docstring(function, clean=False) else function.body
    return function.end_lineno - body[0].lineno + 1 if body else 0


def imports_of(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported_modules(path, modules):
    """Modules that a module imports when it runs, those imported inside functions included."""
    tree = tree_of(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            node.body = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from modules & {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                candidates = (f"{node.module}.{alias.name}", node.module)
                yield from [name for name in candidates if name in modules][:1]


def test_no_modules_import_each_other():
    names = {
        ".".join(("lsvision", *path.relative_to(ROOT).with_suffix("").parts)): path
        for path in MODULES
    }
    paths = {name.removesuffix(".__init__"): path for name, path in names.items()}
    imports = {name: set(imported_modules(path, paths.keys())) for name, path in paths.items()}
    assert len(imports["lsvision.measure"]) > 5
    TopologicalSorter(imports).prepare()  # raises CycleError, which names the circle


def calls():
    """Every call of the package, with its place."""
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call):
                yield f"{name_of(path)}:{node.lineno}", node


def test_nothing_prints():
    assert [place for place, call in calls() if getattr(call.func, "id", "") == "print"] == []


def test_equal_values_keep_their_order_in_every_sort():
    """NumPy's default sort leaves it to the processor, and results with it."""
    sorts = [
        place
        for place, call in calls()
        if getattr(call.func, "attr", "") == "argsort"
        and ("kind", "stable") not in keywords_of(call)
    ]
    assert sorts == []


def keywords_of(call):
    return [(keyword.arg, getattr(keyword.value, "value", None)) for keyword in call.keywords]


def test_nothing_is_left_to_do_later():
    words = ("TODO", "FIXME", "XXX", "HACK")
    assert [name_of(p) for p in MODULES if any(word in p.read_text() for word in words)] == []


def test_modules_are_no_longer_than_the_limit():
    lines = {name_of(path): len(path.read_text().splitlines()) for path in MODULES}
    assert {name: count for name, count in lines.items() if count > MAX_MODULE_LINES} == {}


def test_function_bodies_are_no_longer_than_the_limit():
    lines = {f"{name_of(p)} {f.name}": body_lines(f) for p in MODULES for f in functions_of(p)}
    assert {name: count for name, count in lines.items() if count > MAX_BODY_LINES} == {}


def public_nodes(path):
    """Public functions and classes of a module, and the public methods of the latter."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    for node in tree_of(path).body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            yield node.name, node
            for member in node.body if isinstance(node, ast.ClassDef) else ():
                if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                    yield f"{node.name}.{member.name}", member


def test_everything_public_is_documented():
    silent = [name_of(p) for p in MODULES if not ast.get_docstring(tree_of(p))]
    silent += [
        f"{name_of(path)} {name}"
        for path in MODULES
        for name, node in public_nodes(path)
        if not ast.get_docstring(node)
    ]
    assert silent == []


@pytest.mark.parametrize("package", FORBIDDEN)
def test_a_package_does_not_import_what_is_forbidden(package):
    forbidden = [name if name == "cv2" else f"lsvision.{name}" for name in FORBIDDEN[package]]
    for path in MODULES:
        if path.relative_to(ROOT).with_suffix("").parts[0] == package:
            for imported in imports_of(path):
                met = [n for n in forbidden if imported == n or imported.startswith(n + ".")]
                assert not met, f"{name_of(path)} imports {imported}"


def test_every_public_name_is_there_and_documented():
    things = {name: getattr(lsvision, name) for name in lsvision.__all__}
    silent = [
        name
        for name, thing in things.items()
        if not isinstance(thing, lsvision.ProfileSensor) and not inspect.getdoc(thing)
    ]
    assert silent == []


def test_what_is_not_public_is_not_there():
    with pytest.raises(AttributeError, match="lsvision attribute Nothing"):
        _ = lsvision.Nothing
    assert set(lsvision.__all__) <= set(dir(lsvision))


def test_every_module_can_be_imported_and_has_what_its_all_names():
    names = [module.name for module in pkgutil.walk_packages([str(ROOT)], "lsvision.")]
    assert len(names) > 300
    names.remove("lsvision.__main__")  # importing it runs the command line
    modules = {name: importlib.import_module(name) for name in names}
    absent = [
        f"{name}.{public}"
        for name, module in modules.items()
        for public in getattr(module, "__all__", ())
        if not hasattr(module, public)
    ]
    assert absent == []


def raised_without_words(path):
    names = {name for name in vars(errors) if isinstance(getattr(errors, name), type)}
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Raise):
            called = node.exc
            bare = isinstance(called, ast.Name) and called.id in names
            wordless = isinstance(called, ast.Call) and not called.args and not called.keywords
            if bare or (wordless and getattr(called.func, "id", "") in names):
                yield node.lineno


def test_every_error_says_something():
    silent = {name_of(path): list(raised_without_words(path)) for path in MODULES}
    assert {name: lines for name, lines in silent.items() if lines} == {}


def test_every_error_is_one_of_ours():
    ours = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    assert all(issubclass(kind, errors.LsvisionError) for kind in ours)
    assert not issubclass(errors.LsvisionError, ValueError)
    assert all(inspect.getdoc(kind) for kind in ours)


def test_too_few_points_says_what_got_need_and_the_remedy():
    error = errors.TooFewPoints("an arc", 4, 6, "scan slower")
    assert str(error) == "an arc has 4 points and needs 6: scan slower"
    assert (error.got, error.need) == (4, 6)


@pytest.mark.parametrize(
    "error",
    [
        errors.TooFewPoints("an arc", 4, 6, "scan slower"),
        errors.NoLaserLine("two lines", "set max_width_px"),
        errors.InvalidJob("job.toml", ("line 3: unknown key",)),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_survive_the_way_from_another_process(error):
    copied = pickle.loads(pickle.dumps(error))
    assert (type(copied), str(copied), vars(copied)) == (type(error), str(error), vars(error))
