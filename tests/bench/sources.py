"""Fingerprint of the code that is measured, to tell results of different states apart."""

import hashlib
from pathlib import Path

import lsvision

PACKAGE = Path(lsvision.__file__).parent


def fingerprint():
    """Return eight hexadecimal digits that change with any source file of the package."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]
