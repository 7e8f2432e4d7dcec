"""PLY files hold what was written, read back by a reader that shares no code with the writer."""

import struct
from pathlib import Path

import numpy as np
import pytest

from lsvision.errors import UnwritableFile
from lsvision.io.ply import write_ply

POINTS = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, -400.25], [0.0, 2.0, 1000.0]])
COLOURS = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.2, 0.4, 1.0]])


def read_back(path: Path) -> tuple[list[str], list[tuple[float, ...]], list[tuple[int, ...]]]:
    """Header, vertices and faces, value by value."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element")}
    vertex = struct.Struct("<fffBBB")
    vertices = [vertex.unpack_from(body, k * vertex.size) for k in range(counts["vertex"])]
    rest, face = body[counts["vertex"] * vertex.size :], struct.Struct("<Biii")
    faces = [face.unpack_from(rest, k * face.size) for k in range(counts.get("face", 0))]
    assert len(rest) == len(faces) * face.size
    return lines, vertices, faces


def test_points_come_back_with_their_colours(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", POINTS, COLOURS)
    lines, vertices, faces = read_back(tmp_path / "a.ply")
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    np.testing.assert_allclose([v[:3] for v in vertices], POINTS, rtol=0, atol=1e-4)
    assert [v[3:] for v in vertices] == [(255, 0, 0), (0, 128, 0), (51, 102, 255)]
    assert not faces


def test_triangles_come_back(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", POINTS, COLOURS, np.array([[0, 1, 2], [2, 1, 0]]))
    assert read_back(tmp_path / "a.ply")[2] == [(3, 0, 1, 2), (3, 2, 1, 0)]


def test_a_surface_without_triangles_is_a_whole_file(tmp_path: Path) -> None:
    nothing = np.zeros((0, 3))
    write_ply(tmp_path / "a.ply", nothing, nothing, nothing.astype(int))
    assert read_back(tmp_path / "a.ply")[1:] == ([], [])


@pytest.mark.parametrize(
    ("points", "colours", "triangles", "message"),
    [
        (POINTS[:, :2], COLOURS, None, r"expected \(n, 3\) points and colours, got \(3, 2\)"),
        (POINTS, COLOURS[:2], None, r"got \(3, 3\), \(2, 3\)"),
        (POINTS, 255 * COLOURS, None, "colours from 0 to 1"),
        (np.nan * POINTS, COLOURS, None, "finite points"),
        (POINTS, COLOURS, np.array([[0, 1, 3]]), "rows from 0 to below 3, got 0 to 3"),
        (POINTS, COLOURS, np.array([[0, 1, -1]]), "got -1 to 1"),
        (POINTS, COLOURS, np.array([0, 1, 2]), r"\(m, 3\) whole numbers as triangles, got \(3,\)"),
        (POINTS, COLOURS, np.array([[0, 1, 2, 1]]), r"as triangles, got \(1, 4\)"),
        (POINTS, COLOURS, np.array([[0, 1, 1.5]]), "whole numbers as triangles"),
        (POINTS + 1e39, COLOURS, None, "finite points"),
    ],
)
def test_what_is_no_cloud_is_rejected(
    tmp_path: Path,
    points: np.ndarray,
    colours: np.ndarray,
    triangles: np.ndarray | None,
    message: str,
) -> None:
    with pytest.raises(ValueError, match=message):
        write_ply(tmp_path / "a.ply", points, colours, triangles)
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(UnwritableFile, match="its folder does not exist"):
        write_ply(tmp_path / "no" / "a.ply", POINTS, COLOURS)
