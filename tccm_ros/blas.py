"""One thread of BLAS in each process of the command and of the nodes.

Matrices are small here: threads that wait for each other take more processor time than they save,
half as much again in a replay of bags/flat, and keep the processors from other processes.
"""

import os

THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable with the number of threads of OpenBLAS, which reads it when it is loaded."""


def use_one_thread() -> None:
    """Let OpenBLAS have one thread, unless the user chose a number; call it before NumPy loads."""
    os.environ.setdefault(THREADS, "1")
