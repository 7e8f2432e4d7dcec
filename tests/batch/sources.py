"""Files of profiles for batches, with known pipes in them."""

from decimal import Decimal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lsvision.simulate import random_section

FIRST_SEED = 871_000


def profiles(count, kind="single"):
    """Points (n, 2) of so many sections; the third holds no point."""
    sections = [random_section(kind, FIRST_SEED + k).profile.points.copy() for k in range(count)]
    if count > 2:
        sections[2][:] = np.nan
    return sections


def write_parquet(path, count=5, first_id=10**15, empty=()):
    """One profile per row, with an id that no float holds, a text and a time beside it."""
    points = profiles(count)
    for index in empty:
        points[index][:] = np.nan
    table = pa.table(
        {
            "part_id": pa.array([first_id + k for k in range(count)], pa.int64()),
            "x": [p[:, 0] for p in points],
            "z": [p[:, 1] for p in points],
            "station": [f"line {k % 2}" for k in range(count)],
            "taken": pa.array(range(count), pa.timestamp("ms")),
        }
    )
    pq.write_table(table, path)
    return points


def write_nested(path, count=5):
    """Columns of lists, structures and maps, of which one has a value for each point."""
    points = profiles(count)
    nested = {
        "tags": pa.array([["a"], [], None, ["b", "c"], [None]]),
        "rgb": pa.array([[1, 2, 3]] * 4 + [None]),
        "machine": pa.array([{"name": "m", "line": 1}] * 5),
        "settings": pa.array([[("gain", 2)]] * 5, pa.map_(pa.string(), pa.int64())),
        "corners": pa.array([[[1, 2], [3]], [], None, [[]], [[4]]]),
        "class": pa.array(list("abaab")).dictionary_encode(),
        "length": pa.array([Decimal("1.25")] * 5),
    }
    coordinates = {"x": [p[:, 0] for p in points], "z": [p[:, 1] for p in points]}
    intensities = {"intensity": [np.arange(len(p)) for p in points]}
    pq.write_table(pa.table(coordinates | intensities | nested), path)
    return list(nested)
