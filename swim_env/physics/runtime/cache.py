"""The folder in which compiled kernels are kept, and numba's use of it made forgiving.

numba's own cache looks only at the file that a kernel is in. A kernel whose *callee* changed
would keep running the old code. Every kernel of this package is therefore cached in a folder
whose name carries a hash of all files with kernels in them, of the versions of numba, llvmlite,
NumPy and Python, of the processor that the code was made for, and of the place of the package.
Where no cache folder can be written, the code is kept in a temporary folder for this process alone.
A file that cannot be read or written costs a compilation and one line, no more.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any, ClassVar

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import config as numba_config


def fingerprint(package: Path) -> str:
    """Return a hash of everything that the machine code of a package's kernels depends on."""
    digest = hashlib.sha256()
    for source in (
        *sorted((package / "physics").rglob("*.py")),
        package / "envs" / "assessment.py",
        package / "scene" / "fluid.py",  # the names, in the order of the kernels' codes
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
        # Absolute, or it would follow a later change of the working directory.
        return Path(given).absolute()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base.absolute() / "swim_env"


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


def _find_cache_folder() -> tuple[Path, str]:
    """Return the folder, and why it is a temporary one; nothing where it is kept."""
    name = f"kernels-{fingerprint(Path(__file__).parents[2])}"
    try:
        folder = _base_folder() / name
    except RuntimeError:
        return _private_temporary_folder(name), "there is no home folder"
    if _writable(folder):
        return folder, ""
    return _private_temporary_folder(name), f"{folder.parent} cannot be written"


_CACHE_FOLDER, _WHY_TEMPORARY = _find_cache_folder()


def cache_folder() -> Path:
    """Return the folder that holds this version's compiled kernels."""
    return _CACHE_FOLDER


def why_temporary() -> str:
    """Return why compiled kernels are lost when this process ends; nothing where they are kept."""
    return _WHY_TEMPORARY


def say(message: str) -> None:
    """Print a line about the kernels on stderr."""
    if sys.stderr is not None:
        print(f"swim_env: {message}", file=sys.stderr, flush=True)


class ForgivingCache:
    """A cache of numba that a damaged or unwritable file does not stop; it says so once."""

    #: What was said in this process.
    complaints: ClassVar[set[str]] = set()

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, *arguments: Any) -> Any:
        """Return a kernel's code, or None to have it compiled."""
        try:
            return self._cache.load_overload(*arguments)
        # What a damaged file does to an unpickler may raise anything.
        except Exception as error:
            self._complain("a damaged file of the kernel cache is compiled again", error)
            try:
                self._cache.flush()
            except OSError as failure:
                self._complain("the kernel cache cannot be written", failure)
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a kernel's code if possible."""
        try:
            self._cache.save_overload(*arguments)
        except OSError as error:
            self._complain("the kernel cache cannot be written", error)

    def _complain(self, what: str, error: Exception) -> None:
        if what not in self.complaints:
            self.complaints.add(what)
            say(f"{what} ({self._cache.cache_path}): {type(error).__name__}: {error}")
