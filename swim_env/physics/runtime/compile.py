"""One decorator for every compiled kernel, and the folder in which compiled code is kept.

numba's own cache looks only at the file that a kernel stands in. A kernel whose *callee* changed
would keep running the old code. Every kernel of this package is therefore cached in a folder
whose name carries a hash of all files with kernels in them, of the versions of numba, llvmlite,
NumPy and Python, of the processor that the code was made for, and of the place of the package.
Where no cache folder can be written, the code is kept in a temporary folder for this process alone.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import config as numba_config
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def fingerprint(package: Path) -> str:
    """Return a hash of everything that the machine code of a package's kernels depends on."""
    digest = hashlib.sha256()
    for source in (
        *sorted((package / "physics").rglob("*.py")),
        package / "envs" / "assessment.py",
    ):
        digest.update(source.relative_to(package).as_posix().encode())
        digest.update(source.read_bytes())
    for part in (
        # numba files kernels under the path of their source, so every installation has its own.
        package.resolve(),
        numba.__version__,
        llvmlite.__version__,
        np.__version__,
        platform.python_version(),
        platform.machine(),
        llvmlite.binding.get_host_cpu_name(),
        llvmlite.binding.get_host_cpu_features().flatten(),
        numba_config.BOUNDSCHECK,
    ):
        digest.update(str(part).encode())
    return digest.hexdigest()[:16]


def _base_folder() -> Path:
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "swim_env"


def _private_temporary_folder(name: str) -> Path:
    """Make a folder that no other user can write to: cached code is trusted when it is loaded."""
    base = tempfile.mkdtemp(prefix="swim_env-")
    atexit.register(shutil.rmtree, base, ignore_errors=True)
    folder = Path(base) / name
    folder.mkdir()
    return folder


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _find_cache_folder() -> Path:
    name = f"kernels-{fingerprint(Path(__file__).parents[2])}"
    try:
        folder = _base_folder() / name
    except RuntimeError:  # no home folder can be told
        return _private_temporary_folder(name)
    return folder if _writable(folder) else _private_temporary_folder(name)


_CACHE_FOLDER = _find_cache_folder()


def cache_folder() -> Path:
    """Return the folder that holds this version's compiled kernels."""
    return _CACHE_FOLDER


def _compile(function: Function, **options: Any) -> Function:
    # The folder is set only while the decorator runs: other packages keep their own cache.
    before = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = str(_CACHE_FOLDER)
    try:
        compiled: Function = numba.njit(
            cache=True,
            nogil=True,
            error_model="numpy",
            boundscheck=False,
            # Every slice of an array would count its references, atomically: a third of the time.
            # Nothing is allocated in a kernel, and callers keep the arrays they hand over.
            _nrt=False,
            no_cfunc_wrapper=True,  # kernels are not called from C, and the wrappers cost a fifth
            **options,
        )(function)
    finally:
        numba_config.CACHE_DIR = before
    return compiled


def kernel(function: Function) -> Function:
    """Compile a kernel for other kernels to call.

    Products may be fused with sums and rounded once; all else is strict. Everything that decides on
    finiteness, convergence or the sign of a mass uses this one. Python cannot call it: what turns
    Python's objects into numbers takes a tenth of the time to compile.
    """
    return _compile(function, fastmath={"contract"}, no_cpython_wrapper=True)


def entry_kernel(function: Function) -> Function:
    """Compile a kernel, strict like `kernel`, that Python calls."""
    return _compile(function, fastmath={"contract"})


def inlined(function: Function) -> Function:
    """Compile a kernel whose text stands in place of its one call.

    Code is optimised again at every level of calls, with everything that is called from there; this
    takes a level out.
    """
    return _compile(function, fastmath={"contract"}, inline="always", no_cpython_wrapper=True)


def shared(function: Function) -> Function:
    """Let Python call a function as it is, and kernels compile it into themselves.

    For what measures sizes and lays out work space: without reference counts a kernel cannot hand
    arrays that it made out of others to Python.
    """
    wrapped: Function = register_jitable(function)
    return wrapped


def vector_kernel(function: Function) -> Function:
    """Compile a kernel whose sums may be reordered so that they run on vector registers.

    NaN and infinity keep their meaning: only contraction, reassociation, reciprocals and the
    sign of zero are given up.
    """
    return _compile(
        function, fastmath={"contract", "reassoc", "arcp", "nsz"}, no_cpython_wrapper=True
    )
