"""The core's numbers for any commit: ``python -m tests.bench core [--quick]``.

Scenes are made by the tree that this file belongs to, measured by the tree on trial in a process
of its own (`measure_worker`), which sees points and never a truth, and scored here.
"""
