"""Modules that every process of ``--jobs`` needs: imported once, in the fork server.

Garbage collection is off during the imports, since it would take a seventh of their time.
"""

# ruff: noqa: E402, F401 - imported for the processes that are forked
import gc

gc.disable()

import encodings.utf_8_sig

import cv2
import numpy.ma  # imported by the first `numpy.unique`

import lsvision.batch.measure_group
import lsvision.cli.chunk_results
import lsvision.cli.measure_options
import lsvision.io.profiles.reading
import lsvision.io.profiles.streaming
import lsvision.io.results

gc.enable()
