"""The command ``lsvision``: one module per command, heavy imports inside the commands."""

import gc
import sys


def main() -> None:
    """Run the command with the arguments of the process; see `lsvision.cli.app.main`."""
    # Not needed by processes that import the script.
    from lsvision.cli.process_settings import prepare_process

    prepare_process(sys.argv[1:])
    from lsvision.cli.app import main as run

    try:
        run()
    finally:
        # Python would search all objects for unreachable ones as it exits, which takes 50 ms.
        gc.freeze()
