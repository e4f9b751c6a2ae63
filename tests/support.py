"""What several test modules need: small environments, exact comparison, refusals, commands."""

import dataclasses
import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray

from swim_env import Scene, Simulator, SwimEnv, SwimVectorEnv, Trajectory
from swim_env.envs.episodes import LastObservations, Reasons

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
#: For commands in processes of their own: the packages of this tree, wherever they are started.
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "agents")))}

FORWARD = "swim_env/KirchhoffSwimmer-v0"
TARGET = "swim_env/KirchhoffSwimmerTarget-v0"
TASKS = (FORWARD, TARGET)
FORWARD_3D = "swim_env/KirchhoffSwimmer3D-v0"
TARGET_3D = "swim_env/KirchhoffSwimmer3DTarget-v0"
SPATIAL_TASKS = (FORWARD_3D, TARGET_3D)
each_task = pytest.mark.parametrize("task", TASKS, ids=("forward", "target"))
each_mode = pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)

#: Changes of a learning scene to the paper's first-order steps and ends, at the default tolerance.
PAPERS_STEPS: dict[str, object] = {
    "integrator.scheme": "paper",
    "integrator.time_step": 0.005,
    "integrator.tolerance": 1e-10,
    "fluid.cap_panels": 1,
}
#: Cheap and calm.
SMALL: dict[str, object] = {"beam.elements": 3, "fluid.panels_per_element": 2}
#: Cheap, and bent beyond what the panels can follow by random actions within a second or so.
LIVELY: dict[str, object] = {
    "beam.elements": 4,
    "beam.bending_stiffness": 1.0,
    "fluid.panels_per_element": 2,
    "damping.retardation_time": 0.005,
    "integrator.time_step": 0.01,
    "actuation.torque_limit": 2.0,
}


# ---- environments, actions and runs ------------------------------------------------------------


def make(task: str = FORWARD, scene: Any = "swimmer", **arguments: Any) -> SwimEnv:
    """Make a single environment without the wrappers around it."""
    env = gymnasium.make(task, scene=scene, **arguments).unwrapped
    assert isinstance(env, SwimEnv)
    return env


def make_batch(task: str = FORWARD, num_envs: int = 3, **arguments: Any) -> SwimVectorEnv:
    """Make a batched environment."""
    envs = gymnasium.make_vec(task, num_envs=num_envs, **arguments)
    assert isinstance(envs, SwimVectorEnv)
    return envs


def make_singles(
    task: str, num_envs: int, mode: AutoresetMode = AutoresetMode.NEXT_STEP, **arguments: Any
) -> SyncVectorEnv:
    """Make as many single environments, which Gymnasium's own loop steps."""

    def make_one() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(task, **arguments)

    return SyncVectorEnv([make_one] * num_envs, autoreset_mode=mode)


def uniform(*shape: int, seed: int = 0, size: float = 1.0) -> Array:
    """Return random numbers in [-size, size], such as actions."""
    return np.random.default_rng(seed).uniform(-size, size, shape)


def held_torques(scene: Scene, steps: int, seed: int, size: float = 1.0, hold: int = 4) -> Array:
    """Return random torques (steps, N - 1) in N m, each held for some steps."""
    return np.repeat(
        uniform(steps // hold + 1, scene.beam.elements - 1, seed=seed, size=size), hold, axis=0
    )[:steps]


def rollout(scene: Scene, torques: Array) -> Trajectory:
    """Return a simulator's run under torques (T, N - 1), which must not end early."""
    trajectory = Simulator(scene).rollout(torques)
    assert trajectory.steps == len(torques), trajectory.termination_reason
    return trajectory


def state_of(env: SwimEnv | SwimVectorEnv) -> dict[str, Any]:
    """Return all that an environment's future depends on, and what it has recorded."""
    recorder = env.episodes.bodies.recorder
    return {
        "snapshot": env.snapshot(),
        "someone ended": env.episodes.someone_ended,
        "recorded": recorder and [recorder.kept(member) for member in env.episodes.all_members],
        "tape": [getattr(recorder, "over", {}).copy(), getattr(recorder, "begun", []).copy()],
    }


# ---- exact comparison --------------------------------------------------------------------------


def assert_same(left: Any, right: Any, where: str = "", *, leave_out: Sequence[str] = ()) -> None:
    """Compare nested results: types, shapes and every bit.

    Goes into mappings, sequences, dataclasses (but the fields to be left out) and arrays of
    objects. Arrays and numbers must agree in type and bits: NaN is the same as NaN, and -0.0 is
    not the same as 0.0.
    """
    # These are the arrays of objects that Gymnasium makes of them, but for PyTorch.
    own = (Reasons, LastObservations)
    left, right = (np.asarray(one) if type(one) in own else one for one in (left, right))
    assert type(left) is type(right), f"{where}: {type(left)} and {type(right)}"
    if isinstance(left, np.ndarray):
        assert left.dtype == right.dtype, f"{where}: {left.dtype} and {right.dtype}"
        assert left.shape == right.shape, f"{where}: {left.shape} and {right.shape}"
        if left.dtype == object:
            assert_same(left.tolist(), right.tolist(), where)
        elif left.tobytes() != right.tobytes():
            np.testing.assert_array_equal(left, right, err_msg=where)
            pytest.fail(f"{where}: zeros of other signs, or other kinds of NaN")
    elif isinstance(left, Mapping):
        assert left.keys() == right.keys(), where
        for key in left:
            assert_same(left[key], right[key], f"{where}[{key!r}]")
    elif isinstance(left, (tuple, list)):
        assert len(left) == len(right), f"{where}: {len(left)} and {len(right)} items"
        for i, (one, other) in enumerate(zip(left, right, strict=True)):
            assert_same(one, other, f"{where}[{i}]")
    elif dataclasses.is_dataclass(left):
        for name in (field.name for field in dataclasses.fields(left)):
            if name not in leave_out:
                assert_same(getattr(left, name), getattr(right, name), f"{where}.{name}")
    elif isinstance(left, float):
        assert left.hex() == right.hex(), f"{where}: {left!r} and {right!r}"
    else:
        assert left == right, f"{where}: {left!r} and {right!r}"


# ---- refusals ----------------------------------------------------------------------------------


def assert_one_line(text: str, *parts: str) -> None:
    """Check that a message is one line that holds these parts."""
    assert text.strip() and "\n" not in text, f"not one line: {text!r}"
    for part in parts:
        assert part in text, f"{part!r} is not in {text!r}"


@contextmanager
def refuses(
    error: type[Exception] | tuple[type[Exception], ...],
    *parts: str,
    leaving: SwimEnv | SwimVectorEnv | None = None,
) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error whose message is one line with these parts, and an environment unchanged."""
    before = None if leaving is None else state_of(leaving)
    with pytest.raises(error) as caught:
        yield caught
    assert_one_line(str(caught.value), *parts)
    if leaving is not None:
        assert_same(state_of(leaving), before, "after a refusal")


def full_disk(stream: Any, *_: object, **__: object) -> NoReturn:
    """Write a little and then find the disk full: in place of a writer such as numpy.savez."""
    if hasattr(stream, "write"):
        stream.write(b"half")
    raise OSError(28, "No space left on device")


# ---- commands ----------------------------------------------------------------------------------


class Done(NamedTuple):
    """What a command came to."""

    code: int
    out: str
    err: str

    def figures(self) -> dict[str, Any]:
        """Return the JSON object in the last line, of a command that went well."""
        assert self.code == 0, self.err
        figures: dict[str, Any] = json.loads(self.out.splitlines()[-1])
        return figures

    def assert_refused(self, *parts: str, code: int = 2) -> None:
        """Check that the command ended with one line of error with these parts, and no output.

        A progress bar, which ends in carriage returns, may come before it.
        """
        assert (self.code, self.out) == (code, ""), self
        assert self.err.count("error") == 1 and "Traceback" not in self.err, self.err
        assert self.err.count("\n") == 1 and self.err.endswith("\n"), self.err
        line = self.err.replace("\r", "\n").strip().splitlines()[-1]
        assert line.startswith("error: "), self.err
        assert_one_line(line, *parts)


def run_python(
    *arguments: str | Path, cwd: Path = ROOT, timeout: float = 250.0, **environment: str
) -> Done:
    """Run Python in a process of its own."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env={**ENVIRONMENT, **environment},
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    return Done(done.returncode, done.stdout, done.stderr)


def run_script(name: str, *arguments: str | Path, **options: Any) -> Done:
    """Run scripts/NAME.py in a process of its own; options are those of `run_python`."""
    return run_python(ROOT / "scripts" / f"{name}.py", *arguments, **options)


def call_script(capsys: pytest.CaptureFixture[str], name: str, *arguments: str | Path) -> Done:
    """Run scripts/NAME.py in this process, which takes no time to start."""
    from swim_agents.commands.command_line import run

    capsys.readouterr()
    main = importlib.import_module(f"scripts.{name}").main
    try:
        code = run(main, [str(each) for each in arguments])
    except SystemExit as error:  # argparse
        code = int(error.code or 0)
    return Done(code, *capsys.readouterr())


def hear_interrupts() -> None:
    """Undo that a shell's background jobs, and what they start, ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupt_script(
    name: str,
    *arguments: str | Path,
    when: Callable[[], bool],
    patience: float = 120.0,
    cwd: Path = ROOT,
    how: int = signal.SIGINT,
) -> Done:
    """Press Ctrl-C in a terminal that runs scripts/NAME.py, or kill it, once something is so."""
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "scripts" / f"{name}.py"), *map(str, arguments)],
        cwd=cwd,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a terminal interrupts all processes of a command
        preexec_fn=hear_interrupts,
    )
    try:
        limit = time.monotonic() + patience
        while not when():
            assert process.poll() is None, "the command ended before it was interrupted"
            assert time.monotonic() < limit, "the command does not come to the point"
            time.sleep(0.01)
        os.killpg(process.pid, how)
        out, err = process.communicate(timeout=patience)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return Done(process.returncode, out, err)


# ---- files -------------------------------------------------------------------------------------


def files_of(folder: Path, leave_out: Sequence[str] = ()) -> dict[str, bytes]:
    """Return the bytes of all files below a folder, by their paths in it."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in leave_out
    }


def assert_is_a_picture(path: Path, at_least: int = 300) -> None:
    """Check that a file is a PNG of a sensible size with more on it than a frame and a title."""
    from PIL import Image

    with Image.open(path) as picture:
        assert picture.format == "PNG", path
        pixels = np.asarray(picture.convert("RGB"))
    height, width = pixels.shape[:2]
    assert at_least < min(width, height) and max(width, height) < 4000, f"{path}: {width}x{height}"
    colours = len(np.unique(pixels.reshape(-1, 3), axis=0))
    assert colours > 20, f"{path} has {colours} colours"
    inked = float((pixels.min(axis=2) < 250).mean())
    assert 0.01 < inked < 0.9, f"{path}: {inked:.1%} is drawn on"
