"""Processes killed while they write, full disks, and files that are damaged or somebody else's."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swim_env import (
    Scene,
    SceneError,
    Simulator,
    SwimEnv,
    SwimError,
    Trajectory,
    TrajectoryError,
    load_scene,
)
from swim_env.plots.results import RESULT_FILES
from tests.support import ENVIRONMENT, ROOT, Done, assert_same, files_of

KILLED, TOO_LARGE = -signal.SIGKILL, -signal.SIGXFSZ
PATIENCE = 120.0

# ---- a process whose children are killed, or find the disk full, at any moment -----------------

#: Reads orders, one a line, and lets a child carry out each: a script's arguments, or "save", and
#: when to stop it. Moments are the operations on files below a folder, counted from 1: before the
#: n-th the child kills itself, or finds the disk full. A limit is the largest size of a file in
#: bytes: beyond it, a child is killed or gets an error. A plain order draws an empty picture, which
#: takes less time.
DRIVER = """
import errno, importlib, json, os, resource, signal, sys
import numpy as np
from swim_env import Simulator
from swim_env.envs.assessment import load_assessment
from swim_agents.commands.command_line import run
import swim_env.plots.results
from matplotlib.figure import Figure
load_assessment()
scripts = {{name: importlib.import_module("scripts." + name) for name in ("replay", "stability")}}
RESULTS = {{"runs": [], "onsets": [], "drawn": {{"failures": []}}}}
scripts["stability"].measure_stability = lambda *given: RESULTS
scripts["stability"].stability_tables = lambda results: 1000 * "x"
KINDS = {{"open", "os.rename", "os.mkdir", "os.remove", "os.rmdir"}}

def arm(order):
    count, below = 0, order["below"]

    def watch(event, arguments):
        nonlocal count
        if event not in KINDS or not isinstance(arguments[0], str):
            return
        if not arguments[0].startswith(below) or event == "open" and arguments[1] in ("r", "rb"):
            return
        if "full" in order and event in ("os.remove", "os.rmdir"):
            return  # a full disk does not mind
        count += 1
        if count == order.get("kill"):
            os.kill(os.getpid(), signal.SIGKILL)
        if count == order.get("full"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), arguments[0])

    if "limit" in order:
        what = signal.SIG_IGN if order["error"] else signal.SIG_DFL
        signal.signal(signal.SIGXFSZ, what)
        resource.setrlimit(resource.RLIMIT_FSIZE, (order["limit"], order["limit"]))
    if "kill" in order or "full" in order:
        sys.addaudithook(watch)

def work(order):
    if order.get("plain"):
        swim_env.plots.results.draw_path = lambda trajectory: Figure((1.0, 1.0))
    if order["script"] != "save":
        return run(scripts[order["script"]].main, order["arguments"])
    simulator = Simulator("paper_iv")
    trajectory = simulator.rollout(simulator.prescribed_torques(order["steps"]))
    trajectory.save(order["path"])
    return 0

for line in sys.stdin:
    order = json.loads(line)
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        code = 99
        try:
            os.dup2(theirs, 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            arm(order)
            code = work(order)
        except BaseException as error:
            print(f"Traceback: {{error!r}}", file=sys.stderr)
        finally:
            sys.stderr.flush()
            os._exit(code)
    os.close(theirs)
    with os.fdopen(ours) as pipe:
        errors = pipe.read()
    status = os.waitpid(child, 0)[1]
    print(json.dumps([os.waitstatus_to_exitcode(status), errors]), flush=True)
"""


#: Its answer has a child's exit code, or minus the signal that killed it, and its stderr.
Carry = Callable[..., Done]


@pytest.fixture(scope="module")
def carry() -> Iterator[Carry]:
    """Return a function that gives orders to the driver."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER.format(root=str(ROOT))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**ENVIRONMENT, "NUMBA_NUM_THREADS": "1"},
    )
    assert process.stdin is not None and process.stdout is not None
    stdin, stdout = process.stdin, process.stdout

    def give(script: str, *arguments: object, **order: Any) -> Done:
        given = {"script": script, "arguments": [str(one) for one in arguments], **order}
        stdin.write(json.dumps({"below": "", **given}, default=str) + "\n")
        stdin.flush()
        answer = stdout.readline()
        assert answer, "the driver has died"
        code, err = json.loads(answer)
        return Done(code, "", err)

    yield give
    stdin.close()
    assert process.wait(PATIENCE) == 0
    stdout.close()


def replay_arguments(folder: Path, steps: int) -> list[object]:
    return ["--scene", "paper_iv", "--duration", steps * 0.01, "--output", folder, "--json"]


def steps_of_results(folder: Path) -> int:
    """Return the steps of a result folder, which must be whole and of one run."""
    assert sorted(path.name for path in folder.iterdir()) == sorted(RESULT_FILES)
    summary = json.loads((folder / "summary.json").read_text())
    trajectory = Trajectory.load(folder / "trajectory.npz")
    assert trajectory.steps == summary["steps"], "files of two runs"
    assert load_scene(folder / "scene.yaml") == trajectory.scene
    picture = (folder / "path.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and b"IEND" in picture[-12:], "half a picture"
    return trajectory.steps


def assert_failed(done: Done, *parts: str) -> None:
    """Check that a script ended by itself with one line about the disk."""
    done.assert_refused(*parts, code=1)
    assert "/." not in done.err, f"it names a temporary file: {done.err}"


# ---- killed ------------------------------------------------------------------------------------


@pytest.mark.parametrize("earlier", [False, True], ids=["new folder", "earlier results"])
def test_a_replay_killed_at_any_moment_leaves_whole_results_or_none(
    earlier: bool, carry: Carry, tmp_path: Path
) -> None:
    """Killed before each operation on files in turn; what is left behind stops no later run."""
    folder, kept = tmp_path / "out" / "run", tmp_path / "kept"
    old, new = 10, 20
    if earlier:
        assert carry("replay", *replay_arguments(kept, old)).code == 0
    found = []
    for moment in range(1, 60):
        shutil.rmtree(folder, ignore_errors=True)
        if earlier:
            shutil.copytree(kept, folder)
        else:
            shutil.rmtree(tmp_path / "out", ignore_errors=True)
        done = carry(
            "replay", *replay_arguments(folder, new), kill=moment, below=tmp_path, plain=True
        )
        if done.code == 0:
            break
        assert done.code == KILLED, f"moment {moment}: {done}"
        found.append(steps_of_results(folder) if folder.exists() else 0)
        if earlier and found[-1] == old:
            assert files_of(folder) == files_of(kept), f"moment {moment} changed old results"
    else:
        pytest.fail("it was killed again and again and never came to an end")
    assert len(found) > 15, f"only {len(found)} moments: {found}"
    assert set(found) == {0, old, new} if earlier else set(found) == {0, new}, found
    # Old or nothing, then new; nothing only for the moment of the exchange.
    assert found == sorted(found, key=lambda steps: steps == new), found
    if earlier:
        assert found.count(0) == 1, f"the old results were away for {found.count(0)} moments"
    assert steps_of_results(folder) == new
    left = [path.name for path in folder.parent.iterdir() if path != folder]
    assert all(name.startswith(".run.") for name in left), left
    assert bool(left) == earlier, "kills leave temporary folders, which a later run passes over"


@pytest.mark.parametrize("limit", [0, 200, 1500, 20_000])
def test_a_replay_killed_in_the_middle_of_a_file_leaves_the_old_results(
    limit: int, carry: Carry, tmp_path: Path
) -> None:
    """The kernel kills it at a byte of the summary, the trajectory, or the picture."""
    folder = tmp_path / "run"
    assert carry("replay", *replay_arguments(folder, 10)).code == 0
    before = files_of(folder)
    done = carry("replay", *replay_arguments(folder, 20), limit=limit, error=False)
    assert done.code == TOO_LARGE, done
    assert files_of(folder) == before
    assert carry("replay", *replay_arguments(folder, 20)).code == 0
    assert steps_of_results(folder) == 20


def test_a_saved_trajectory_is_the_old_or_the_new_one_whenever_it_is_killed(
    carry: Carry, tmp_path: Path
) -> None:
    """Killed before every operation and at many bytes while `Trajectory.save` writes."""
    path = tmp_path / "run.npz"

    def save(steps: int, **when: Any) -> Done:
        return carry("save", path=path, steps=steps, below=str(tmp_path), **when)

    assert save(3, kill=1).code == KILLED
    assert not path.exists()
    for moment in (2, 3):
        if save(3, kill=moment).code == 0:
            break
        assert not path.exists() or Trajectory.load(path).steps == 3
    assert save(3).code == 0
    before, moments = path.read_bytes(), []
    while (done := save(9, kill=len(moments) + 1)).code == KILLED:
        moments.append(Trajectory.load(path).steps)
        if moments[-1] == 3:
            assert path.read_bytes() == before
    assert done.code == 0
    assert moments == sorted(moments) and moments[:2] == [3, 3], moments
    after = path.read_bytes()
    path.write_bytes(before)
    for limit in (*range(0, len(after), 500), len(after) - 1):
        assert save(9, limit=limit, error=False).code == TOO_LARGE, f"{limit} bytes"
        assert path.read_bytes() == before, f"killed after {limit} bytes"
    assert save(9).code == 0
    assert Trajectory.load(path).steps == 9
    others = [entry.name for entry in tmp_path.iterdir() if entry != path]
    assert all(name.startswith(".run.npz.") and name.endswith(".tmp") for name in others), others


# ---- full disks --------------------------------------------------------------------------------


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let no file grow beyond a size (bytes): writing more is an OSError, as on a full disk."""
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("limit", [0, 100, 900, 3000, 10_000, 40_000])
def test_a_replay_whose_results_do_not_fit_says_so_and_leaves_the_old_ones(
    limit: int, carry: Carry, tmp_path: Path
) -> None:
    """Exit code 1, one line that names the folder, no file of the new results."""
    folder = tmp_path / "run"
    done = carry("replay", *replay_arguments(folder, 20), limit=limit, error=True)
    assert_failed(done, "cannot write", "File too large", f"({folder})")
    assert list(tmp_path.iterdir()) == [], "something half-written stays behind"
    assert carry("replay", *replay_arguments(folder, 10)).code == 0
    before = files_of(folder)
    done = carry("replay", *replay_arguments(folder, 20), limit=limit, error=True)
    assert_failed(done, "cannot write", "File too large", f"({folder})")
    assert files_of(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_disk_that_is_full_at_any_moment_of_a_replay_costs_no_results(
    carry: Carry, tmp_path: Path
) -> None:
    """Every file, folder and renaming is refused in turn."""
    folder, kept = tmp_path / "run", tmp_path / "kept"
    assert carry("replay", *replay_arguments(folder, 10)).code == 0
    shutil.copytree(folder, kept)
    refused = 0
    for moment in range(1, 40):
        order = {"full": moment, "below": tmp_path, "plain": True}
        done = carry("replay", *replay_arguments(folder, 20), **order)
        if done.code == 0:  # what was refused was not needed, or there was nothing left to refuse
            assert steps_of_results(folder) == 20, f"moment {moment}"
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
            continue
        refused += 1
        assert_failed(done, "No space left on device", str(folder))
        assert files_of(folder) == files_of(kept), f"moment {moment}"
    assert refused > 8, f"only {refused} moments"


def test_tables_of_hard_cases_that_do_not_fit_are_one_line(carry: Carry, tmp_path: Path) -> None:
    """What `scripts/stability.py` had written before stays, each file whole."""
    arguments = ("--cases", "thickness", "--draws", "0", "--workers", "1", "--output", tmp_path)
    assert carry("stability", *arguments).code == 0
    before = files_of(tmp_path)
    assert sorted(before) == ["stability.json", "tables.md"]
    size = len(before["stability.json"])
    assert size < len(before["tables.md"]), "the limits below strike one file each"
    for limit, name in ((0, "stability.json"), (size - 1, "stability.json"), (size, "tables.md")):
        done = carry("stability", *arguments, limit=limit, error=True)
        assert_failed(done, "File too large", f"({tmp_path / name})")
        assert files_of(tmp_path) == before, f"{limit} bytes"
    refused = 0
    for moment in range(1, 12):
        done = carry("stability", *arguments, full=moment, below=tmp_path)
        if done.code:
            refused += 1
            assert_failed(done, "No space left on device", str(tmp_path))
            assert files_of(tmp_path).items() >= before.items(), f"moment {moment}"
    assert refused >= 4, f"only {refused} moments"


def test_a_video_that_does_not_fit_is_an_error(carry: Carry, tmp_path: Path) -> None:
    """Encoders do not tell that their disk was full; half a film is not taken for one."""
    pytest.importorskip("moviepy")
    arguments = ("--scene", "paper_iv", "--duration", "0.1", "--env", "--record-video", tmp_path)
    for limit in (300, 3000):
        done = carry("replay", *arguments, limit=limit, error=True)
        assert done.code == 1, done
        assert "error: cannot write the video: " in done.err, done.err
        assert "Traceback" not in done.err, done.err
        assert list(tmp_path.iterdir()) == []
    assert carry("replay", *arguments).code == 0
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]


def test_saves_that_do_not_fit_leave_the_old_files(tmp_path: Path) -> None:
    """Of a trajectory and of a scene, at every size: an error that names the file, and no other."""
    simulator = Simulator("paper_iv")
    short, longer = (simulator.rollout(np.ones((steps, 2))) for steps in (2, 12))
    scene = load_scene("swimmer")
    pairs: list[tuple[str, Callable[[Path], None], Callable[[Path], None], type[SwimError]]] = [
        ("run.npz", short.save, longer.save, TrajectoryError),
        ("scene.yaml", load_scene("paper_i").save, scene.save, SceneError),
    ]
    for name, save_old, save_new, error in pairs:
        path = tmp_path / name
        save_new(path)
        size = path.stat().st_size
        save_old(path)
        before = path.read_bytes()
        for limit in np.linspace(0, size - 1, 12).astype(int).tolist():
            with files_of_at_most(limit), pytest.raises(error) as caught:
                save_new(path)
            message = str(caught.value)
            assert "cannot write" in message and "File too large" in message, message
            assert message.count(str(path)) == 1 and "\n" not in message, message
            assert path.read_bytes() == before, f"{name} at {limit} bytes"
            assert [entry.name for entry in tmp_path.iterdir()] == [name], f"{limit} bytes"
        save_new(path)
        path.unlink()


def test_names_that_are_none_are_refused_by_saves() -> None:
    with pytest.raises(TrajectoryError, match="cannot write the trajectory"):
        Simulator("paper_iv").rollout(np.ones((2, 2))).save("a\0b.npz")
    with pytest.raises(SceneError, match="name is not valid") as caught:
        load_scene("paper_iv").save("a\0b.yaml")
    assert "\0" not in str(caught.value)


def test_a_recording_outlives_a_disk_that_is_full(tmp_path: Path) -> None:
    """An episode whose recording could not be saved goes on, and is saved whole later."""
    env, twin = (SwimEnv(overrides={"recording": True}) for _ in range(2))
    rng = np.random.default_rng(0)
    path = tmp_path / "episode.npz"
    for each in (env, twin):
        each.reset(seed=7)
    for step, action in enumerate(rng.uniform(-1.0, 1.0, (10, 8))):
        one, other = env.step(action), twin.step(action)
        assert one[0].tobytes() == other[0].tobytes(), f"step {step}"
        with files_of_at_most(1000), pytest.raises(TrajectoryError, match="File too large"):
            env.recorded().save(path)
        assert list(tmp_path.iterdir()) == []
    env.recorded().save(path)
    assert_same(Trajectory.load(path), twin.recorded(), "the recording")


# ---- damaged and foreign files -----------------------------------------------------------------


@pytest.fixture(scope="module")
def run() -> Trajectory:
    """A short run."""
    simulator = Simulator("paper_iv")
    return simulator.rollout(simulator.prescribed_torques(6))


def refused_or_same(path: Path, content: bytes, run: Trajectory, where: str) -> bool:
    """Read a damaged file: a clear error, or the very run; returns whether it was refused."""
    path.write_bytes(content)
    try:
        read = Trajectory.load(path)
    except TrajectoryError as error:
        message = str(error)
        assert message.endswith(f"({path})") and "\n" not in message, f"{where}: {message!r}"
        assert len(message) > len(str(path)) + 20, f"{where}: {message!r} names no cause"
        return True
    except BaseException as error:
        pytest.fail(f"{where}: {error!r}, which is no TrajectoryError")
    assert_same(read, run, where)
    return False


def flips(content: bytes, places: Any, masks: tuple[int, ...]) -> Iterator[tuple[str, bytes]]:
    for at in places:
        for mask in masks:
            where = f"byte {at} of {len(content)} changed by {mask:#x}"
            yield where, content[:at] + bytes([content[at] ^ mask]) + content[at + 1 :]


def test_a_trajectory_cut_off_anywhere_is_refused(run: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    run.save(path)
    content = path.read_bytes()
    sizes = {*range(0, len(content), 61), *range(30), *range(len(content) - 60, len(content))}
    for size in sorted(sizes):
        assert refused_or_same(path, content[:size], run, f"{size} bytes"), f"{size} bytes read"
    assert not refused_or_same(path, content, run, "all of it")


def test_changed_bytes_are_noticed_or_do_not_matter(run: Trajectory, tmp_path: Path) -> None:
    """The archive's directory, at its end, has what makes readers raise the oddest things."""
    path = tmp_path / "run.npz"
    run.save(path)
    content = path.read_bytes()
    directory = content.index(b"PK\x01\x02")
    places = [*range(0, directory, 41), *range(directory, len(content), 7)]
    # The flags, methods, sizes and places of the first member.
    places += range(directory, directory + 46)
    refused = [
        refused_or_same(path, changed, run, where)
        for where, changed in flips(content, places, (0x01, 0x20))
    ]
    assert sum(refused) > 0.4 * len(refused), f"{sum(refused)} of {len(refused)}"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_no_changed_byte_at_all_gives_another_run(run: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    run.save(path)
    content = path.read_bytes()
    for where, changed in flips(content, range(len(content)), (0x01, 0x08, 0x80, 0xFF)):
        refused_or_same(path, changed, run, where)
    for size in range(len(content)):
        assert refused_or_same(path, content[:size], run, f"{size} bytes"), f"{size} bytes read"


def test_a_changed_type_of_a_large_array_is_noticed(tmp_path: Path) -> None:
    """With half as many bytes to a number, half of the array is read, and its checksum never."""
    simulator = Simulator("paper_iv")
    run = simulator.rollout(simulator.prescribed_torques(1500))
    path = tmp_path / "run.npz"
    run.save(path)
    with np.load(path) as file:
        np.savez(path, **dict(file))
    content = path.read_bytes()
    assert not refused_or_same(path, content, run, "not compressed")
    at, found = content.find(b"'<f8'"), 0
    while at >= 0:
        changed = content[: at + 3] + b"4" + content[at + 4 :]
        assert refused_or_same(path, changed, run, f"type at {at}"), f"type at {at}"
        at, found = content.find(b"'<f8'", at + 1), found + 1
    assert found > 10


def foreign_archives(run: Trajectory) -> dict[str, dict[str, Any]]:
    """Return contents of archives that are no trajectories, by what is the matter with them."""
    whole: dict[str, Any] = {
        "format_version": np.array(3),
        "scene": np.array(run.scene.to_yaml()),
        "termination_reason": np.array(""),
        **{
            one.name: value
            for one in fields(Trajectory)
            if isinstance(value := getattr(run, one.name), np.ndarray)
        },
    }
    return {
        "nothing": {},
        "somebody's weights": {"layer.weight": np.zeros((3, 4)), "layer.bias": np.zeros(3)},
        "no scene": {key: value for key, value in whole.items() if key != "scene"},
        "many versions": {**whole, "format_version": np.array([3, 3])},
        "a scene of numbers": {**whole, "scene": np.zeros(3)},
        "another program's scene": {**whole, "scene": np.array("services: {web: {}}")},
        "text for numbers": {**whole, "energy": np.array(["a"] * len(run.energy))},
        "a step too few": {**whole, "work": run.work[1:]},
        "a number for torques": {**whole, "torques": np.array(1.0)},
        "a scene of other elements": {**whole, "scene": np.array(load_scene("swimmer").to_yaml())},
    }


def test_foreign_files_are_refused_as_trajectories(run: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    for kind, arrays in foreign_archives(run).items():
        np.savez(path, **arrays)
        assert refused_or_same(path, path.read_bytes(), run, kind), f"{kind} was read"
    contents = {
        "empty": b"",
        "text": b"time,x,y\n0,0,0\n",
        "picture": b"\x89PNG\r\n\x1a\n" + bytes(200),
        "pickle": b"\x80\x04\x95\x0b\x00\x00\x00\x00\x00\x00\x00}\x94\x8c\x01a\x94K\x01s.",
        "noise": np.random.default_rng(0).bytes(5000),
        "an archive's first bytes": b"PK\x03\x04" + bytes(200),
        "an empty archive": b"PK\x05\x06" + bytes(18),
        "an array": b"\x93NUMPY\x01\x00" + bytes(20),
    }
    for kind, content in contents.items():
        assert refused_or_same(path, content, run, kind), f"{kind} was read"
    path.unlink()
    path.mkdir()
    with pytest.raises(TrajectoryError, match="cannot read the trajectory: Is a directory") as err:
        Trajectory.load(path)
    assert str(path) in str(err.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_files_without_permission_are_refused_by_name(run: Trajectory, tmp_path: Path) -> None:
    trajectory, scene = tmp_path / "run.npz", tmp_path / "scene.yaml"
    run.save(trajectory)
    run.scene.save(scene)
    for path, error in ((trajectory, TrajectoryError), (scene, SceneError)):
        path.chmod(0)
        with pytest.raises(error, match="Permission denied") as caught:
            (Trajectory.load if path is trajectory else Scene.from_yaml)(path)
        assert str(path) in str(caught.value)


SCENES: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "the file is empty"),
    "noise": (np.random.default_rng(1).bytes(4000), "must be UTF-8 text"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(300), "must be UTF-8 text"),
    "zeros": (bytes(4000), "not valid YAML"),
    "two bytes to a letter": ("name: x".encode("utf-16"), "must be UTF-8 text"),
    "many brackets": (b"[" * 3_000, "nested too deeply"),
    "many braces": (b"{a: " * 5_000, "nested too deeply"),
    "many dashes": (b"- " * 5_000 + b"x", "nested too deeply"),
    "deep in a field": (b"beam: {length: " + b"[" * 200 + b"]" * 200 + b"}", "beam.length"),
    "a list in itself": (b"initial: {joint_angles: &a [*a, *a]}", "initial.joint_angles[0]"),
    "a billion laughs": (
        b"a0: &a0 [x, x]\n"
        + b"".join(b"a%d: &a%d [*a%d, *a%d]\n" % (i, i, i - 1, i - 1) for i in range(1, 64)),
        "unknown field a0",
    ),
    "a long value": (b"beam: {length: " + b"x" * 100_000 + b"}", "beam.length must be a number"),
    "containers": (b"services:\n  web:\n    image: nginx\n", "unknown field services"),
    "a playbook": (b"---\n- hosts: all\n  tasks: []\n", "scene must be a mapping"),
    "two documents": (b"name: a\n---\nname: b\n", "not valid YAML, line 2"),
    "JSON of something": (b'{"nodes": [1, 2], "edges": []}', "unknown field nodes"),
    "code": (b"!!python/object/apply:os.system ['true']\n", "not valid YAML, line 1"),
    "a training's settings": (b"algorithm: PPO\nsteps: 1000\n", "unknown field algorithm"),
}


@pytest.mark.parametrize("kind", SCENES)
def test_foreign_files_are_refused_as_scenes(kind: str, tmp_path: Path) -> None:
    content, part = SCENES[kind]
    path = tmp_path / "scene.yaml"
    path.write_bytes(content)
    for read in (load_scene, Scene.from_yaml, SwimEnv):
        with pytest.raises(SceneError) as caught:
            read(path)
        message = str(caught.value)
        assert part in message and message.endswith(f"({path})"), message
        assert "\n" not in message and len(message) < 400 + len(str(path)), message


def test_a_scene_cut_off_or_changed_anywhere_is_refused_or_read(tmp_path: Path) -> None:
    """What is left of a scene's file is a scene by itself, or one clear error."""
    path = tmp_path / "scene.yaml"
    load_scene("swimmer").save(path)
    content = path.read_bytes()
    changed = [content[:size] for size in range(0, len(content), 9)]
    changed += [one for _, one in flips(content, range(0, len(content), 17), (0x01, 0x20, 0x80))]
    refused = 0
    for one in changed:
        path.write_bytes(one)
        try:
            load_scene(path)
        except SceneError as error:
            refused += 1
            assert str(path) in str(error) and "\n" not in str(error), str(error)
    assert 0.2 * len(changed) < refused, f"{refused} of {len(changed)}"
