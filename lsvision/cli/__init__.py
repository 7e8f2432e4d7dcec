"""The command ``lsvision``: one module per command, heavy imports inside the commands."""

from lsvision.cli.app import main

__all__ = ["main"]
