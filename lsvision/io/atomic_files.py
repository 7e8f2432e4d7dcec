"""Files that are written whole or not at all: the name that the modules of `io` import."""

from lsvision.files.atomic_files import write_atomic

__all__ = ["write_atomic"]
