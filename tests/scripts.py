"""Scripts of the repository outside of its packages, imported from their paths."""

import importlib.util


def import_script(path):
    """Return the module in a file."""
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
