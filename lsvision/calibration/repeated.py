"""Detection of observations that are stored twice and would be taken for a perfect agreement."""

from collections.abc import Iterable


def find_repeated(contents: Iterable[bytes]) -> dict[int, int]:
    """Return the index of each content that equals an earlier one, with the index of the first.

    Parameters
    ----------
    contents : iterable of bytes
        The numbers of each observation, to the last digit, as bytes.

    Returns
    -------
    dict of int to int
        Index of each repeated content: index of the first that equals it; empty if all contents
        differ. Sorted by index.

    Examples
    --------
    >>> find_repeated([b"a", b"b", b"a", b"a"])
    {2: 0, 3: 0}
    """
    first_index: dict[bytes, int] = {}
    repeated = {}
    for index, content in enumerate(contents):
        earlier = first_index.setdefault(content, index)
        if earlier != index:
            repeated[index] = earlier
    return repeated
