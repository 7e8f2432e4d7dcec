"""The command ``lsvision``: one module per command, heavy imports inside the commands."""


def main() -> None:
    """Run the command with the arguments of the process; see `lsvision.cli.app.main`."""
    from lsvision.cli.app import main as run  # not needed by processes that import the script

    run()
