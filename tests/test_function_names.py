"""Functions start with a verb; .github/CONTRIBUTING.md states the exceptions."""

import ast
from itertools import pairwise
from pathlib import Path

import pytest

import lsvision
import lsvision.simulate

ROOT = Path(lsvision.__file__).parent
PUBLIC = {*lsvision.__all__, *lsvision.simulate.__all__}
VERBS = {
    "accept", "add", "adjust", "advance", "analyse", "append", "apply", "assign", "associate",
    "backtrack", "begin", "bend", "block", "blur", "build", "cache", "calibrate", "capture",
    "catch", "change", "check", "choose", "classify", "clear", "clip", "close", "collect",
    "colour", "combine", "compare", "complete", "compute", "concatenate", "connect", "convert",
    "correct", "count", "create", "cut", "decide", "decode", "decompose", "demonstrate",
    "describe", "detect", "differentiate", "distort", "draw", "drop", "encode", "end", "escape",
    "estimate", "evaluate", "exclude", "expand", "explain", "export", "expose", "extract",
    "extrapolate", "fail", "fill", "find", "finish", "fit", "flatten", "fold", "follow",
    "format", "freeze", "get", "group", "grow", "guess", "hash", "homogenise", "identify",
    "import", "include", "increase", "infer", "inspect", "integrate", "interleave",
    "interpolate", "interrupt", "intersect", "invert", "invoke", "iterate", "join", "judge",
    "keep", "label", "lay", "leave", "limit", "linearise", "list", "load", "locate", "lock",
    "log", "lose", "make", "map", "mark", "mask", "match", "measure", "minimise", "mirror",
    "move", "multiply", "name", "normalise", "note", "open", "order", "orient", "pad", "pair",
    "parse", "perturb", "pickle", "place", "plan", "pool", "precompute", "predict", "prepare",
    "print", "project", "propagate", "quote", "raise", "rank", "read", "receive", "record",
    "refine", "refit", "reject", "relate", "relocate", "remove", "render", "repeat", "replace",
    "report", "require", "resample", "rescale", "resolve", "restart", "restore", "rewrite",
    "rotate", "round", "run", "sample", "save", "scale", "score", "screen", "search", "select",
    "separate", "set", "shorten", "show", "shrink", "simulate", "smooth", "solve", "sort",
    "space", "split", "stack", "start", "step", "strip", "study", "subtract", "suggest", "sum",
    "summarise", "suppress", "tabulate", "take", "terminate", "test", "tilt",
    "time", "transform", "translate", "transpose", "triangulate", "turn", "undistort", "unpack",
    "unwrap", "update", "validate", "wait", "warn", "whiten", "widen", "write",
}  # fmt: skip
PREDICATES = {
    "allows", "are", "begins", "cannot", "contains", "crosses", "differs", "ends", "exceeds",
    "exists", "has", "have", "holds", "identifies", "interrupts", "is", "may", "mentions",
    "names", "numbers", "overlap", "passes", "seems", "separates", "shows", "states", "uses",
    "varies",
}  # fmt: skip
# Quantities of mathematics and statistics: what a function with such a name returns needs no verb.
QUANTITIES = {
    "angle", "autocorrelation_time", "bound", "chi2", "correlation", "covariance", "distance",
    "factor", "gradient", "interval", "jacobian", "median", "normal", "p_value", "probability",
    "quantile", "ratio", "residual", "rms", "std", "variance",
}  # fmt: skip
CONVERSIONS = {"as", "of", "to", "with", "without"}
PREPOSITIONS = {
    "about", "along", "at", "between", "beyond", "by", "from", "in", "of", "outside", "to", "with",
}  # fmt: skip
COMMANDS = ("command", "callback")
OTHERS = {
    "cli.main",  # entry point of the script
    "cli.app.main",
    "results.result.Result._repr_html_",  # of notebooks
    "simulate.scene.TubeSolid.local_cylinder",  # a method of public solids
}


def singular(noun):
    plurals = {"axes": "axis", "matrices": "matrix"}
    return plurals.get(noun, noun if noun in QUANTITIES else noun.removesuffix("s"))


def follows_the_rule(name):
    first, *_ = words = name.strip("_").split("_")
    if first in VERBS | PREDICATES | CONVERSIONS or "from" in words:
        return True
    ends = [k for k, word in enumerate(words) if word in PREPOSITIONS and k] or [len(words)]
    noun = words[: ends[0]]
    return singular(noun[-1]) in QUANTITIES or singular("_".join(noun[-2:])) in QUANTITIES


def decorators_of(function):
    return [
        ast.unparse(decorator).split("(")[0].split(".")[-1] for decorator in function.decorator_list
    ]


def is_free(function, owner):
    """Whether a function may have any name: a public one, a property, a constructor, a command."""
    decorators = decorators_of(function)
    free = {"property", "cached_property", "classmethod", *COMMANDS}
    return (
        (function.name.startswith("__") and function.name.endswith("__"))
        or bool(free.intersection(decorators))
        or (owner is None and function.name in PUBLIC)
        or (owner in PUBLIC and not function.name.startswith("_"))
    )


def functions_in(body, owner=None):
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield from functions_in(node.body, node.name)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield owner, node


def names_against_the_rule():
    for path in sorted(ROOT.rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for owner, function in functions_in(ast.parse(path.read_text()).body):
            name = ".".join(filter(None, (module, owner, function.name)))
            is_command = name == f"cli.{function.name}.{function.name}"
            free = is_free(function, owner) or is_command or name in OTHERS
            if not (free or follows_the_rule(function.name)):
                yield name


def test_functions_start_with_a_verb():
    assert list(names_against_the_rule()) == []


@pytest.mark.parametrize(
    ("name", "follows"),
    [
        ("fit_track", True),
        ("_is_lost", True),
        ("ellipse_from_parameters", True),
        ("orthogonal_residuals", True),
        ("_outlier_p_values", True),
        ("covariance_at", True),
        ("_rows", False),
        ("error_table", False),
        ("rms_of_rows", True),
        ("rows_of_rms", False),
    ],
)
def test_the_rule_tells_verbs_from_nouns(name, follows):
    assert follows_the_rule(name) is follows


def test_no_word_is_allowed_in_vain():
    """A verb or noun that no function uses any more leaves the list."""
    words, nouns = set(), set()
    for path in ROOT.rglob("*.py"):
        for _, function in functions_in(ast.parse(path.read_text()).body):
            first, *_ = parts = function.name.strip("_").split("_")
            words.add(first)
            nouns |= set(map(singular, (*parts, *map("_".join, pairwise(parts)))))
    assert (VERBS | PREDICATES) - words == set()
    assert QUANTITIES - nouns == set()
