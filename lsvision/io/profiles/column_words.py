"""Words of several languages that name x, height and range in the header of a file."""

import re
import unicodedata

# Western, Northern and Central European languages, Russian, Turkish, Chinese, Japanese, Korean.
_WIDTH = """
    width breite largeur ancho anchura larghezza largura breedte bredd bredde leveys szerokość šířka
    ширина szélesség genişlik 宽度 寬度 幅 너비 폭
"""
_HEIGHT = """
    height heights elevation höhe hoehe hauteur altura altezza hoogte höjd højde høyde korkeus
    wysokość výška высота magasság yükseklik 高度 高さ 높이
"""
_RANGE = """
    range ranges distance distances dist abstand messabstand entfernung distanz depth tiefe standoff
    profondeur éloignement distancia profundidad distanza profondità distância profundidade afstand
    diepte avstånd djup avstand dybde etäisyys syvyys odległość głębokość vzdálenost hloubka
    vzdialenosť расстояние дистанция дальность глубина távolság mélység mesafe uzaklık derinlik
    距离 距離 深度 深さ 거리 깊이
"""
_ANGLE = """
    angle angles azimuth bearing alpha theta phi winkel winkelposition angolo ángulo ângulo hoek
    vinkel kulma kąt úhel uhol угол szög açı 角度 角 각도
"""
_AXIS = """
    pos position coord coordinate koordinate value wert axis achse coordonnée coordonnee valeur axe
    posición coordenada valor eje posizione coordinata valore asse posição eixo positie coördinaat
    waarde läge koordinat värde værdi verdi pozycja współrzędna wartość oś poloha pozice souřadnice
    hodnota положение позиция координата значение ось konum koordinatı değer
    坐标 座标 座標 位置 方向 值 値 轴 軸 좌표 위치 값 축
"""


def fold_accents(name: str) -> str:
    """Return a name in lower case without accents, as some exports write it.

    Examples
    --------
    >>> fold_accents("höhe"), fold_accents("distância"), fold_accents("높이")
    ('hohe', 'distancia', '높이')
    """
    if name.isascii():
        return name
    parts = unicodedata.normalize("NFD", name.lower())
    bare = "".join(part for part in parts if not unicodedata.combining(part))
    return unicodedata.normalize("NFC", bare)


def _fold_words(text: str) -> frozenset[str]:
    return frozenset(map(fold_accents, text.split()))


WIDTH_WORDS = _fold_words(_WIDTH)
"""Words that name x."""
HEIGHT_WORDS = _fold_words(_HEIGHT)
"""Words that name heights towards the sensor."""
RANGE_WORDS = _fold_words(_RANGE)
"""Words that name distances from the sensor."""
ANGLE_WORDS = _fold_words(_ANGLE)
"""Words that name an angle."""
AXIS_WORDS = _fold_words(_AXIS)
"""Words that may stand beside x, y or z in the name of a coordinate, such as "x axis"."""
_NON_ASCII_WORDS = frozenset(
    fold_accents(word)
    for word in f"{_WIDTH} {_HEIGHT} {_RANGE} {_ANGLE} {_AXIS}".split()
    if not word.isascii() and len(word) > 1
)
"""Words beyond ASCII that name coordinates, without accents."""
_LETTERS = re.compile(r"[^\W\d_]+")
"""A word of letters."""
# In "x座標" the word follows a Latin letter without a blank.
_LETTERS_BEYOND_LATIN = re.compile(r"[^\W\d_a-z]+")


def count_non_ascii_words(text: str) -> int:
    """Return the number of different words in a text that name coordinates, of those beyond ASCII.

    With the right encoding there are more of them than with a wrong one.

    Examples
    --------
    >>> count_non_ascii_words("X座標;Höhe [mm]"), count_non_ascii_words("H\u0446he [mm]")
    (2, 0)
    """
    folded = fold_accents(text)
    words = {*_LETTERS.findall(folded), *_LETTERS_BEYOND_LATIN.findall(folded)}
    return len(words & _NON_ASCII_WORDS)
