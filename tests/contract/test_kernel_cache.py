"""The kernel cache: which processes fill it, and what invalidates it."""

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.cache import cache_folder, fingerprint
from swim_env.physics.runtime.loading import KernelGroup
from tests.support import ENVIRONMENT, ROOT, Done, run_python


def test_the_fingerprint_sees_every_file_with_kernels_in_folders_of_any_depth(tmp_path):
    package = tmp_path / "swim_env"
    shutil.copytree(ROOT / "swim_env" / "physics", package / "physics")
    for name in ("envs/assessment.py", "scene/fluid.py"):
        (package / name).parent.mkdir()
        shutil.copy(ROOT / "swim_env" / name, package / name)
    sources = sorted(package.rglob("*.py"))
    assert len({path.parent for path in sources}) > 5
    (package / "physics" / "spatial" / "rods").mkdir(parents=True)
    seen = {fingerprint(package)}
    for count, path in enumerate([*sources, package / "physics" / "spatial" / "rods" / "new.py"]):
        with path.open("a") as file:
            file.write("# changed\n")
        seen.add(fingerprint(package))
        assert len(seen) == 2 + count, f"a change of {path} would run old machine code"


def load(cache: Path) -> Done:
    code = "from swim_env.envs.assessment import load_assessment; load_assessment()"
    return run_python("-c", code, timeout=280, NUMBA_CACHE_DIR=str(cache))


@pytest.mark.slow
def test_two_processes_fill_an_empty_cache_without_writing_to_the_same_place(tmp_path):
    """A kernel with two signatures has two files that are numbered as they come.

    Processes that compile at the same time could then take the same number for different code.
    """
    first = load(tmp_path)
    assert first.code == 0, first.err
    assert "compiling the physics kernels" in first.err and "kept in" in first.err
    kept = list(tmp_path.rglob("*.nbc"))
    assert len(kept) > 50
    assert [path.name for path in kept if not path.name.endswith(".1.nbc")] == []
    assert load(tmp_path) == Done(0, "", "")
    assert len(list(tmp_path.rglob("*.nbc"))) == len(kept)


def test_processes_that_compile_share_the_kernels(tmp_path: Path) -> None:
    compiled: list[str] = []
    names = [str(number) for number in range(12)]
    loads = [functools.partial(compiled.append, name) for name in names]
    group = KernelGroup(__name__, "group", "kernels", "compiled", lambda: loads)
    for name in ("1", "11"):
        (tmp_path / name).touch()  # what other processes have begun
    group.compile_share(str(tmp_path))
    rest = [name for name in names if name not in ("1", "11")]
    assert compiled == rest, "in their order, the one that takes longest first"
    group.compile_share(str(tmp_path))
    assert compiled == rest, "nothing is left for a third"


EPISODE = """
import hashlib, swim_env
env = swim_env.SwimVectorEnv(3, num_threads=1)
env.reset(seed=0)
env.action_space.seed(0)
seen = hashlib.sha256()
for _ in range(50):
    seen.update(env.step(env.action_space.sample())[0].tobytes())
print(seen.hexdigest())
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_of_eight_processes_on_an_empty_cache_one_compiles_and_all_agree_to_the_bit(tmp_path):
    environment = {**ENVIRONMENT, "NUMBA_CACHE_DIR": str(tmp_path)}
    started = [
        subprocess.Popen(
            [sys.executable, "-c", EPISODE],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for _ in range(8)
    ]
    done = [process.communicate(timeout=800) for process in started]
    said = [err.splitlines() for _, err in done]
    assert sum("compiling the physics kernels" in lines[0] for lines in said) == 1, said
    assert sum("another process compiles" in lines[0] for lines in said) == 7, said
    assert {out for out, _ in done} == {run_python("-c", EPISODE).out}


KERNEL = """
from swim_env.physics.runtime.compile import entry_kernel

@entry_kernel
def doubled(x):
    return 2.0 * x
"""


def double(folder: Path, setup: str = "pass") -> Done:
    (folder / "tiny.py").write_text(KERNEL)
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); {setup}; import tiny"
    return run_python("-c", f"{code}; print(tiny.doubled(21.0))", NUMBA_CACHE_DIR=str(folder / "c"))


@pytest.mark.parametrize("length", [0, 10, 60])
@pytest.mark.parametrize("kind", ["nbc", "nbi"])
def test_a_damaged_file_costs_a_compilation_and_one_line(
    tmp_path: Path, kind: str, length: int
) -> None:
    assert double(tmp_path) == Done(0, "42.0\n", "")
    (file,) = tmp_path.rglob(f"tiny.*.{kind}")
    file.write_bytes(file.read_bytes()[:length])
    found = double(tmp_path)
    assert (found.code, found.out, found.err.count("\n")) == (0, "42.0\n", 1)
    assert "a damaged file of the kernel cache is compiled again (" in found.err
    assert double(tmp_path) == Done(0, "42.0\n", ""), "it is whole again"


def test_a_full_disk_costs_one_line(tmp_path: Path) -> None:
    full = (
        "import numba.core.caching as c; "
        "c.IndexDataCacheFile.save = lambda *a: open('/dev/full', 'wb', 0).write(b'x')"
    )
    found = double(tmp_path, full)
    assert (found.code, found.out, found.err.count("\n")) == (0, "42.0\n", 1)
    assert "the kernel cache cannot be written (" in found.err and "No space left" in found.err


def test_a_relative_folder_is_that_of_the_start(tmp_path: Path) -> None:
    code = (
        "import os; from swim_env.physics.runtime.cache import cache_folder; "
        "os.chdir('/'); print(cache_folder().parent)"
    )
    assert run_python("-c", code, NUMBA_CACHE_DIR=".", cwd=tmp_path).out == f"{tmp_path}\n"


def test_where_nothing_can_be_written_it_says_so(tmp_path: Path) -> None:
    code = "from swim_env.physics.runtime.cache import why_temporary; print(why_temporary())"
    file = tmp_path / "file"
    file.touch()
    found = run_python("-c", code, NUMBA_CACHE_DIR=str(file / "under"))
    assert found.out == f"{file / 'under'} cannot be written\n"


def test_processes_wait_for_the_one_that_compiles(tmp_path: Path) -> None:
    load_kernels()
    folder = tmp_path / cache_folder().name
    shutil.copytree(cache_folder(), folder)
    (folder / "compiled").unlink(missing_ok=True)
    with FileLock(folder / "lock"):
        code = "from swim_env.physics.loading import load_kernels; load_kernels()"
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
        process = subprocess.Popen(
            [sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, env=environment
        )
        assert process.stderr is not None
        assert "another process compiles" in process.stderr.readline()
        assert process.poll() is None
        (folder / "compiled").touch()
    assert process.communicate(timeout=60)[1] == "", "it takes what the other one has compiled"
    assert process.returncode == 0


CALLS = """
import inspect
import numpy as np
from swim_env.physics.fluid.models import SAMPLE, added_mass
from swim_env.physics.loading import load_kernels
from swim_env.physics.planar.equations import evaluate_step

def attempt(kernel, *arguments):
    try:
        return kernel(*arguments)
    except RuntimeError as error:
        return error

print(evaluate_step.__name__, *inspect.signature(evaluate_step).parameters)
print(inspect.getdoc(evaluate_step).split()[0])
print(attempt(added_mass, np.zeros(1), SAMPLE, None, np.zeros((4, 4))))
load_kernels()
print(attempt(evaluate_step, np.zeros(4)))
"""


def test_a_linked_kernel_refuses_calls_from_python_that_would_jump_to_nowhere() -> None:
    found = run_python("-c", CALLS)
    assert found.code == 0, found.err
    assert found.out.splitlines() == [
        "evaluate_step p torques z h adjoint held beam fluid body fluid_work",
        "Evaluate",
        "swim_env.physics.fluid.models.added_mass was called before it was loaded; call "
        "load_model of swim_env.physics.loading first, or load_spatial_kernels of "
        "swim_env.physics.spatial.loading",
        "swim_env.physics.planar.equations.evaluate_step is compiled for other kernels to call, "
        "not for Python",
    ]


def test_without_compilation_kernels_run_as_python() -> None:
    code = (
        "import swim_env; s = swim_env.Simulator(swim_env.load_scene('paper_i', "
        "{'beam.elements': 3, 'fluid.panels_per_element': 4})); "
        "print(*s.rollout(s.prescribed_torques(2)).displacement)"
    )
    found = [run_python("-c", code, **jit) for jit in ({}, {"NUMBA_DISABLE_JIT": "1"})]
    assert [one.code for one in found] == [0, 0], found[1].err
    compiled, slow = ([float(x) for x in one.out.split()] for one in found)
    assert slow == pytest.approx(compiled, rel=1e-9, abs=1e-15)
    assert found[1].err.count("\n") == 1 and "NUMBA_DISABLE_JIT is set" in found[1].err
