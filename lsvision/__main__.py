"""``python -m lsvision`` is the command ``lsvision``."""

from lsvision.cli import main

main()
