"""Which code was measured: numbers of two states of the code are not to be mixed."""

import hashlib
from pathlib import Path

import lsvision

HOUSE = Path(lsvision.__file__).parent


def fingerprint():
    """Eight digits that change with any source file of the package."""
    digest = hashlib.sha256()
    for path in sorted(HOUSE.rglob("*.py")):
        digest.update(path.relative_to(HOUSE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]
