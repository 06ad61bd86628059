"""Runs of scripts with kernels, in processes forked from one that has compiled a kernel.

A new process takes two seconds to import numba and start its compiler, and then compiles a small
kernel in a tenth of that.
"""

import io
import multiprocessing
import os
import runpy
import sys
import tempfile
import traceback
from collections.abc import Mapping
from contextlib import redirect_stdout
from multiprocessing.connection import Connection
from pathlib import Path

import numba

from tccm_ros import kernels  # noqa: F401  imported once for all forks


@numba.njit
def _twice(x):
    return 2.0 * x


_twice(1.0)


def run_forked(script: Path, environment: Mapping[str, str]) -> str:
    """Run a script as ``python script`` does, and return what it prints.

    Parameters
    ----------
    script
        Path of the script; it imports modules beside it.
    environment
        All environment variables of the process.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(script, dict(environment), theirs))
    process.start()
    theirs.close()
    printed, error = ours.recv()
    process.join()
    assert not error, error
    return printed


def _run(script: Path, environment: dict[str, str], answers: Connection) -> None:
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = None
    numba.config.reload_config()
    sys.path.insert(0, str(script.parent))
    sys.dont_write_bytecode = True
    printed, error = io.StringIO(), ""
    try:
        with redirect_stdout(printed):
            runpy.run_path(str(script), run_name="__main__")
    except BaseException:
        error = traceback.format_exc()
    answers.send((printed.getvalue(), error))
