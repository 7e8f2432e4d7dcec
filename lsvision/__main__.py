"""``python -m lsvision`` is the command ``lsvision``."""

from lsvision.cli import main

if __name__ == "__main__":
    main()
