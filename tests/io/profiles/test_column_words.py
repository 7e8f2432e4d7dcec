"""Names of columns and units in languages other than English, as programs of that language write.

The pipe of 20 mm lies 150 mm below the sensor: ranges that are read as heights turn it over.
"""

import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import read_profile


def rows_of(arc, factor=1.0, away=False):
    sign = -1 if away else 1
    return [f"{x * factor:.3f};{sign * z * factor:.3f}" for x, z in arc.tolist()]


def reads(write, head, rows, encoding="utf-8", **options):
    path = write("\n".join([head, *rows, ""]).encode(encoding), "p.csv")
    return read_profile(path, **options).points


@pytest.mark.parametrize(
    ("head", "encoding"),
    [
        ("Breite;Entfernung", "latin-1"),
        ("Position X [mm];Abstand zum Sensor [mm]", "utf-8"),
        ("x (mm);distance to the sensor (mm)", "utf-8"),
        ("Largeur;Profondeur", "utf-8"),
        ("Posición X (mm);Distancia (mm)", "latin-1"),
        ("Posição X (mm);Distância (mm)", "utf-8"),
        ("Posizione X;Distanza", "utf-8"),
        ("Positie X (mm);Afstand (mm)", "utf-8"),
        ("Läge X;Avstånd", "latin-1"),
        ("Pozycja X [mm];Odległość [mm]", "cp1250"),
        ("Poloha X [mm];Vzdálenost [mm]", "cp1250"),
        ("X;Távolság", "cp1250"),
        ("Konum X;Uzaklık", "cp1254"),
        ("Положение X, мм;Расстояние, мм", "cp1251"),
        ("Положение X, мм;Расстояние до датчика, мм", "utf-8"),
        ("X坐标（mm）;距离（mm）", "gb18030"),
        ("X(㎜);距離(㎜)", "cp932"),
        ("X座標;距離", "big5"),
        ("X 위치(mm);거리(mm)", "cp949"),
    ],
)
def test_a_range_is_recognised_in_other_languages(write, arc, head, encoding):
    npt.assert_array_equal(reads(write, head, rows_of(arc, away=True), encoding), arc)


@pytest.mark.parametrize(
    "head",
    ["Hauteur;Largeur", "Altura;Anchura", "Wysokość;Szerokość", "Высота;Ширина", "高度;宽度"],
)
def test_heights_before_x_are_read_by_their_names(write, arc, head):
    rows = [f"{z:.3f};{x:.3f}" for x, z in arc.tolist()]
    npt.assert_array_equal(reads(write, head, rows), arc)


@pytest.mark.parametrize(
    ("head", "encoding"),
    [
        ("Положение X, мкм;Высота, мкм", "cp1251"),
        ("X (мкм);Z (мкм)", "utf-8"),
        ("位置X【μm】;高度【μm】", "gb18030"),
        ("X(㎛);高さ(㎛)", "utf-8"),
        ("单位：微米\nX;Z", "utf-8"),
        ("# 単位: μm\nX;Z", "utf-8"),
        ("# Unidades: micrómetros\nX;Z", "utf-8"),
        ("# Unità: micrometri\nX;Z", "latin-1"),
        ("X [micras];Z [micras]", "utf-8"),
    ],
)
def test_units_of_other_languages_are_read(write, arc, head, encoding):
    points = reads(write, head, rows_of(arc, 1000.0), encoding)
    npt.assert_allclose(points, arc, atol=1e-9)


@pytest.mark.parametrize(
    "comment",
    [
        "所有数据均以微米表示",
        "valores en micras",
        "Все размеры в микрометрах",
        "valori in micrometri",
    ],
)
def test_a_unit_in_a_sentence_of_another_language_is_never_dropped(write, arc, comment):
    path = write("\n".join([f"# {comment}", "X;Z", *rows_of(arc)]))
    with pytest.raises(UnreadableFile, match="mentions a unit that is not understood"):
        read_profile(path)


@pytest.mark.parametrize(
    ("labels", "factor", "away"),
    [
        (("X", "Z"), 1.0, False),
        (("X [um]", "Z [um]"), 1000.0, False),
        (("Breite", "Abstand [mm]"), 1.0, True),
        (("x (mm)", "range (mm)"), 1.0, True),
    ],
)
def test_rows_named_in_their_first_cells_are_read_as_columns(write, arc, labels, factor, away):
    sign = -1 if away else 1
    rows = (factor * arc[:, 0], sign * factor * arc[:, 1])
    lines = [
        ";".join([label, *(f"{value:.3f}" for value in row)])
        for label, row in zip(labels, rows, strict=True)
    ]
    npt.assert_allclose(read_profile(write("\n".join(lines))).points, arc, atol=1e-9)


def test_named_rows_without_heights_are_named(write, arc):
    lines = [";".join([label, *map(str, arc[:, 0])]) for label in ("X", "a", "b")]
    with pytest.raises(UnreadableFile, match="name the columns of x and height"):
        read_profile(write("\n".join(lines)))
