"""The decorator of kernels."""

import os
import re
import subprocess
import sys
from pathlib import Path

import tccm_ros
from tccm_ros.kernel_cache import KernelCache
from tccm_ros.kernels import kernel


def test_a_kernel_is_compiled_without_the_lock_and_kept():
    @kernel
    def twice(x):
        return 2 * x

    assert twice(3) == 6
    assert twice.targetoptions["nogil"]
    assert isinstance(twice._cache, KernelCache)


def test_options_go_to_numba():
    @kernel(error_model="numpy")
    def inverse(x):
        return 1.0 / x

    assert inverse(0.0) == float("inf")


def test_without_compiling_a_kernel_is_a_python_function():
    program = "from tccm_ros.union_find import find_root; print(type(find_root).__name__)"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "function"


def test_each_kernel_of_the_package_is_made_by_the_decorator():
    """Another would be kept by numba's own cache, which can be stale."""
    root = Path(tccm_ros.__file__).parent
    others = [
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        if re.search(r"\bn?jit\b|\bvectorize\b", path.read_text()) and path.name != "kernels.py"
    ]
    assert others == []
