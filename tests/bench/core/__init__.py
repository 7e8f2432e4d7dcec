"""The core's numbers for any commit: ``python -m tests.bench core [--quick]``.

Scenes are made by the source tree that this file belongs to. The tree under test measures them in a
separate process (`measure_worker`), which gets the points, but not the truth. Scores are computed
here.
"""
