"""Radius and orientation of cylinders from a light section, each number with its uncertainty.

The public names are listed in ``__init__.pyi``. Each is imported from its module on first use, so
that ``lsvision --help`` does not wait for numpy, OpenCV and scipy.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
