"""Spoilt inputs: bytes, JSON documents and arrays, each decided by its random generator."""

import copy
import json

import numpy as np

TOKENS = [
    b"",
    b"nan",
    b"NaN",
    b"-inf",
    b"1e308",
    b"1e999",
    b"-1",
    b"0",
    b"1e-320",
    b"9" * 400,
    b"-",
    b"99999999999",
    b"4294967295",
    b"-2147483648",
    b"2147483648",
    b"[",
    b"]",
    b"{",
    b"}",
    b'"',
    b"'",
    b",",
    b";",
    b"\t",
    b" ",
    b"\n",
    b"\r",
    b"\0",
    b"\xff",
    b"\xc2\xb5",
    b"#",
    b"%",
    b":",
    b"*a",
    b"&a",
    b"!!int",
    b"!!binary",
    b"- ",
    b"? ",
    b"<a>",
    b"&lt;",
    b"<!ENTITY",
    b"\xe2\x80\xa8",
    b"[" * 500,
    b"( " * 300,
    b"{a: " * 100,
    b"x,z",
    b"[um]",
    b"mm",
    b"1,2",
    b"1 2 3\n",
    b"end_header\n",
    b"\x1b[31m",
    b"=1+1",
    b"\xed\xa0\x80",
    b".Nan",
    b".5",
    b"1_0",
    b"0x1f",
    b"True",
    b"null",
    b"~",
]
VALUES = [
    None,
    True,
    0,
    -1,
    1,
    1e9,
    1e308,
    -1e308,
    1e-308,
    10**30,
    "",
    "nan",
    "x",
    "1e5",
    [],
    {},
    [[]],
    [0],
    [1, 2],
    [[1.0]],
    {"x": 1},
    [None],
    "\udcff",
    "\x1b[0m",
    -0.0,
    2**31,
    2**63,
    3,
    0.5,
    float("nan"),
    float("inf"),
]


def spoil_bytes(rng, content, others=()):
    """The bytes after one to six random changes."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 7)):
        data = _CHANGES[rng.integers(len(_CHANGES))](rng, data, others)
        if len(data) > 200_000:
            del data[200_000:]
    return bytes(data)


def _flip(rng, data, _):
    for place in rng.integers(0, max(len(data), 1), rng.integers(1, 9)):
        if place < len(data):
            data[place] = rng.integers(256)
    return data


def _cut(rng, data, _):
    return data[: rng.integers(0, len(data) + 1)]


def _remove(rng, data, _):
    start = rng.integers(0, len(data) + 1)
    del data[start : start + rng.integers(1, 60)]
    return data


def _insert(rng, data, _):
    place = rng.integers(0, len(data) + 1)
    data[place:place] = TOKENS[rng.integers(len(TOKENS))]
    return data


def _replace_word(rng, data, _):
    """A number or word of the first 2000 bytes by a token."""
    head = bytes(data[:2000])
    starts = [
        k
        for k in range(1, len(head))
        if head[k : k + 1].isalnum() and not head[k - 1 : k].isalnum()
    ]
    if not starts:
        return data
    start = starts[rng.integers(len(starts))]
    stop = start
    while stop < len(data) and bytes(data[stop : stop + 1]).isalnum():
        stop += 1
    data[start:stop] = TOKENS[rng.integers(len(TOKENS))]
    return data


def _repeat(rng, data, _):
    start = rng.integers(0, len(data) + 1)
    piece = data[start : start + rng.integers(1, 200)]
    data[start:start] = piece * int(rng.integers(1, 40))
    return data


def _swap_lines(rng, data, _):
    lines = bytes(data).split(b"\n")
    first, second = rng.integers(0, len(lines), 2)
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))


def _splice(rng, data, others):
    if not others:
        return data
    other = others[rng.integers(len(others))]
    return data[: rng.integers(0, len(data) + 1)] + other[rng.integers(0, len(other) + 1) :]


_CHANGES = (
    _flip,
    _cut,
    _remove,
    _insert,
    _insert,
    _replace_word,
    _replace_word,
    _repeat,
    _swap_lines,
    _splice,
)


def spoil_document(rng, document):
    """A JSON document with one to three of its values replaced, removed or repeated."""
    document = copy.deepcopy(document)
    for _ in range(rng.integers(1, 4)):
        node, parents = document, []
        while isinstance(node, (dict, list)) and node and (rng.random() < 0.8 or not parents):
            keys = list(node) if isinstance(node, dict) else range(len(node))
            key = keys[rng.integers(len(keys))]
            parents.append((node, key))
            node = node[key]
        if not parents:
            return VALUES[rng.integers(len(VALUES))]
        parent, key = parents[-1]
        choice = rng.random()
        if choice < 0.15:
            del parent[key]
        elif choice < 0.3 and isinstance(parent, list):
            parent.insert(key, copy.deepcopy(parent[key]))
        elif choice < 0.5 and isinstance(parent[key], float):
            parent[key] *= float(rng.choice([-1, 1e-6, 1e6, 1e12, 1 + 1e-9]))
        else:
            parent[key] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    return document


def json_bytes(document):
    return json.dumps(document).encode("utf-8", "surrogatepass")


def spoil_array(rng, array):
    """An array with some numbers of another kind, order, type or shape."""
    array = np.array(array)
    with np.errstate(all="ignore"):
        for _ in range(rng.integers(0, 4)):
            array = _SPOILERS[rng.integers(len(_SPOILERS))](rng, array)
    return array


def _put(rng, array):
    array = array.astype(float)
    special = [np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-300, 1e15, 1e9, 5e-324]
    places = rng.random(array.shape) < rng.choice([0.01, 0.2, 1.0])
    return np.where(places, special[rng.integers(len(special))], array)


def _scale(rng, array):
    return array * rng.choice([0.0, -1.0, 1e-12, 1e-6, 1e3, 1e8, 1e150])


def _shift(rng, array):
    return array + rng.choice([1.0, 1e3, 1e8, 1e12])


def _take(rng, array):
    return array[: rng.integers(0, len(array) + 1)] if array.ndim else array


def _repeat_rows(rng, array):
    if not (array.ndim and len(array)):
        return array
    return array[np.sort(rng.integers(0, len(array), len(array)))]


def _shuffle(rng, array):
    return rng.permutation(array) if array.ndim and len(array) else array


def _flatten_axis(rng, array):
    if array.ndim < 2 or not array.shape[-1]:
        return array
    array = array.copy()
    array[..., rng.integers(array.shape[-1])] = rng.choice([0.0, 1.0, -400.0])
    return array


def _round(rng, array):
    return np.round(array, int(rng.integers(-2, 3)))


def _reshape(rng, array):
    return [array.ravel(), array[..., :1], array[None], array.T, array[:0]][rng.integers(5)]


_SPOILERS = (
    _put,
    _put,
    _scale,
    _shift,
    _take,
    _repeat_rows,
    _shuffle,
    _flatten_axis,
    _round,
    _reshape,
)


def spoilt_json(rng, document):
    """Bytes of a JSON file with wrong values in its fields, or with wrong bytes."""
    if rng.random() < 0.8:
        return json_bytes(spoil_document(rng, document))
    return spoil_bytes(rng, json_bytes(document))
