"""Comparison of what a program prints with what a text shows of it."""

import re
from decimal import Decimal
from itertools import zip_longest

NUMBER = re.compile(r"[-+]?\d+\.\d+")


def differing(printed, shown):
    """Return the pairs of words or lines that differ.

    Texts and whole numbers, which are counts, compare exactly. A number with decimals may differ by
    one unit of its last digit: on the edge of rounding, processors differ in the last bits.

    Parameters
    ----------
    printed, shown : sequence of str
        Words or lines.
    """
    pairs = zip_longest(printed, shown, fillvalue="")
    return [(found, expected) for found, expected in pairs if not _alike(found, expected)]


def _alike(found, expected):
    if NUMBER.sub(_decimals, found) != NUMBER.sub(_decimals, expected):
        return False
    pairs = zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True)
    return all(abs(Decimal(a) - Decimal(b)) <= _last_unit(b) for a, b in pairs)


def _decimals(number):
    return "#." + "#" * (-Decimal(number[0]).as_tuple().exponent)


def _last_unit(number):
    return Decimal(1).scaleb(Decimal(number).as_tuple().exponent)
