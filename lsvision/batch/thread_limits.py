"""Limit of the threads of linear algebra.

Matrices of a profile are small: more threads only wait for each other, a third of the processor
time of a short command.
"""

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the threads, read when numpy is imported."""
