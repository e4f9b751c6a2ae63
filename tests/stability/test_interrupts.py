"""Processes killed while they write, full disks, and files that are damaged or somebody else's."""

import contextlib
import json
import os
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from swim_env import (
    Scene,
    SceneError,
    Simulator,
    SwimEnv,
    Trajectory,
    TrajectoryError,
    load_scene,
)
from swim_env.plots.results import RESULT_FILES
from tests.support import Done, assert_same, call_script, files_of, refuses, run_python

KILLED = -signal.SIGKILL
Capture = pytest.CaptureFixture[str]

# ---- processes that are stopped at any moment --------------------------------------------------

#: Does WORK in a child again and again. Before the n-th time that the child opens a file below the
#: folder "place" for writing, makes, renames or removes one, it is killed, or finds the disk full.
#: "place/run" is "kept" before each time, and what is left of it afterwards is kept in "left".
STOPPER = """
import errno, json, os, shutil, signal, sys, traceback
from pathlib import Path
from swim_env.envs.assessment import load_assessment
{imports}
load_assessment()
how, here = sys.argv[1], Path(sys.argv[2])
place, codes, END = here / "place", [], 42  # the code where nothing was left to stop

def stop_at(moment, stops):
    count = 0

    def watch(event, arguments):
        nonlocal count
        if event not in ("open", "os.rename", "os.mkdir", "os.remove", "os.rmdir"):
            return
        if event == "open" and arguments[1] in ("r", "rb") or not isinstance(arguments[0], str):
            return
        if how == "full" and event in ("os.remove", "os.rmdir"):
            return  # a full disk does not mind
        count += arguments[0].startswith(str(place))
        if count == moment and not stops:
            stops.append(moment)
            if how == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), arguments[0])

    sys.addaudithook(watch)

def work():
    {work}

for moment in range(1, 100):
    shutil.rmtree(place / "run", ignore_errors=True)
    if (here / "kept").exists():
        shutil.copytree(here / "kept", place / "run")
    child = os.fork()
    if not child:
        code, stops = 99, []
        try:
            sys.stderr = open(here / "left" / f"{{moment}}.err", "w")
            stop_at(moment, stops)
            code = work() or (0 if stops else END)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    if (place / "run").exists():
        shutil.copytree(place / "run", here / "left" / str(moment))
    if codes[-1] == END:
        codes[-1] = 0
        break
print(json.dumps(codes))
"""
REPLAY = {
    "imports": """
import matplotlib.figure, swim_env.plots.results
from scripts.replay import main
from swim_agents.commands.command_line import run
swim_env.plots.results.draw_path = lambda trajectory: matplotlib.figure.Figure((1.0, 1.0))
""",
    "work": "return run(main, ['--scene', 'paper_iv', '--duration', '0.2', '--output',"
    " str(place / 'run')])",
}
SAVE = {
    "imports": "import numpy as np\nfrom swim_env import Simulator",
    "work": "Simulator('paper_iv').rollout(np.ones((20, 2))).save(place / 'run' / 'run.npz');"
    " return 0",
}


class Left(NamedTuple):
    """What a stopped process came to, and the folder that it left."""

    done: Done
    folder: Path


def stopped(how: str, work: dict[str, str], place: Path) -> list[Left]:
    """Stop some work at every moment."""
    for name in ("place", "left"):
        (place / name).mkdir()
    codes = run_python("-c", STOPPER.format(**work), how, place, NUMBA_NUM_THREADS="1").out
    left = place / "left"
    return [
        Left(Done(code, "", (left / f"{moment}.err").read_text()), left / str(moment))
        for moment, code in enumerate(json.loads(codes.splitlines()[-1]), start=1)
    ]


def replay(capsys: Capture, folder: Path, steps: int) -> Done:
    options = ("--scene", "paper_iv", "--duration", f"{0.01 * steps}", "--output", folder)
    return call_script(capsys, "replay", *options)


def steps_of_results(folder: Path) -> int:
    """Return the steps of a result folder, which must be whole and of one run; 0 without one."""
    if not folder.exists():
        return 0
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


@pytest.mark.parametrize("earlier", [False, True], ids=["new folder", "earlier results"])
def test_a_replay_killed_at_any_moment_leaves_whole_results_or_none(earlier, tmp_path, capsys):
    """What is left behind stops no later run."""
    if earlier:
        assert replay(capsys, tmp_path / "kept", 10).code == 0
    *killed, last = stopped("kill", REPLAY, tmp_path)
    assert {left.done.code for left in killed} == {KILLED} and last.done.code == 0, last
    found = [steps_of_results(left.folder) for left in killed]
    assert len(found) > 15, f"only {len(found)} moments: {found}"
    assert set(found) == ({0, 10, 20} if earlier else {0, 20}), found
    # Old or nothing, then new; nothing only for the moment of the exchange.
    assert found == sorted(found, key=lambda steps: steps == 20), found
    for left, steps in zip(killed, found, strict=True):
        if steps == 10:
            assert files_of(left.folder) == files_of(tmp_path / "kept"), left
    if earlier:
        assert found.count(0) == 1, f"the old results were away for {found.count(0)} moments"
    assert steps_of_results(last.folder) == 20
    others = [path.name for path in (tmp_path / "place").iterdir() if path.name != "run"]
    assert all(name.startswith(".run.") for name in others), others


@pytest.mark.parametrize("earlier", [False, True], ids=["new file", "earlier file"])
def test_a_saved_trajectory_is_the_old_or_the_new_one_whenever_it_is_killed(earlier, tmp_path):
    (tmp_path / "kept").mkdir()
    old = tmp_path / "kept" / "run.npz"
    if earlier:
        Simulator("paper_iv").rollout(np.ones((3, 2))).save(old)
    found = []
    *killed, last = stopped("kill", SAVE, tmp_path)
    for left in (*killed, last):
        assert left.done.code == (0 if left is last else KILLED), left
        file = left.folder / "run.npz"
        found.append(Trajectory.load(file).steps if file.exists() else 0)
        assert found[-1] == 20 or not earlier or file.read_bytes() == old.read_bytes()
        others = [path.name for path in left.folder.iterdir() if path != file]
        assert all(name.startswith(".run.npz.") and name.endswith(".tmp") for name in others)
    before = 3 if earlier else 0
    assert found[:2] == [before] * 2 and set(found) == {before, 20}, found


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
def test_a_replay_whose_results_do_not_fit_says_so_and_leaves_the_old_ones(limit, tmp_path, capsys):
    """Exit code 1, one line that names the folder, no file of the new results."""
    folder = tmp_path / "run"
    for before in (0, 10):
        if before:
            assert replay(capsys, folder, before).code == 0
        files = files_of(tmp_path)
        with files_of_at_most(limit):
            done = replay(capsys, folder, 20)
        assert_failed(done, "cannot write", "File too large", f"({folder})")
        assert files_of(tmp_path) == files
        assert len(list(tmp_path.iterdir())) == bool(before), "something stays behind"


def test_a_disk_that_is_full_at_any_moment_of_a_replay_costs_no_results(tmp_path, capsys):
    """Every file, folder and renaming is refused in turn."""
    assert replay(capsys, tmp_path / "kept", 10).code == 0
    refused = 0
    for moment, (done, folder) in enumerate(stopped("full", REPLAY, tmp_path), start=1):
        if done.code == 0:  # what was refused was not needed, or nothing was left to refuse
            assert steps_of_results(folder) == 20, f"moment {moment}"
            continue
        refused += 1
        assert_failed(done, "No space left on device", str(tmp_path / "place" / "run"))
        assert files_of(folder) == files_of(tmp_path / "kept"), f"moment {moment}"
    assert refused > 8, f"only {refused} moments"


def test_tables_of_hard_cases_that_do_not_fit_are_one_line(tmp_path, capsys, monkeypatch):
    """What `scripts/stability.py` had written before stays, each file whole."""
    found: dict[str, Any] = {"runs": [], "onsets": [], "drawn": {"failures": []}}
    monkeypatch.setattr("scripts.stability.measure_stability", lambda *given: found)
    monkeypatch.setattr("scripts.stability.stability_tables", lambda results: 1000 * "x")
    arguments = ("stability", "--cases", "thickness", "--draws", "0", "--output", tmp_path)
    assert call_script(capsys, *arguments).code == 0
    before = files_of(tmp_path)
    assert sorted(before) == ["stability.json", "tables.md"]
    size = len(before["stability.json"])
    assert size < len(before["tables.md"]), "the limits below strike one file each"
    for limit in (*range(0, size, 20), size - 1, size):
        name = "stability.json" if limit < size else "tables.md"
        with files_of_at_most(limit):
            done = call_script(capsys, *arguments)
        assert_failed(done, "File too large", f"({tmp_path / name})")
        assert files_of(tmp_path) == before, f"{limit} bytes"


def test_a_video_that_does_not_fit_is_an_error(tmp_path, capsys):
    """Encoders do not tell that their disk was full; half a film is not taken for one."""
    pytest.importorskip("moviepy")
    arguments = ("--scene", "paper_iv", "--duration", "0.1", "--env", "--record-video", tmp_path)
    for limit in (300, 3000):
        with files_of_at_most(limit):
            done = call_script(capsys, "replay", *arguments)
        assert done.code == 1, done
        assert "error: cannot write the video: " in done.err, done.err
        assert "Traceback" not in done.err, done.err
        assert list(tmp_path.iterdir()) == []
    assert call_script(capsys, "replay", *arguments).code == 0
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]


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


@pytest.mark.parametrize(
    "every",
    [False, pytest.param(True, marks=[pytest.mark.slow, pytest.mark.timeout(900)])],
    ids=["some bytes", "every byte"],
)
def test_a_trajectory_cut_off_is_refused_and_changed_bytes_are_noticed_or_do_not_matter(
    every, run, tmp_path
):
    """The archive's directory, at its end, has what makes readers raise the oddest things."""
    path = tmp_path / "run.npz"
    run.save(path)
    content = path.read_bytes()
    size, directory = len(content), content.index(b"PK\x01\x02")
    sizes, places, masks = range(size), list(range(size)), (0x01, 0x08, 0x20, 0x80, 0xFF)
    if not every:
        sizes = sorted({*range(0, size, 61), *range(30), *range(size - 60, size)})
        # With the flags, methods, sizes and places of the first member.
        places = [*range(0, directory, 41), *range(directory, size, 7)]
        places, masks = [*places, *range(directory, directory + 46)], (0x01, 0x20)
    for end in sizes:
        assert refused_or_same(path, content[:end], run, f"{end} bytes"), f"{end} bytes read"
    assert not refused_or_same(path, content, run, "all of it")
    refused = [
        refused_or_same(path, other, run, where) for where, other in flips(content, places, masks)
    ]
    assert sum(refused) > 0.4 * len(refused), f"{sum(refused)} of {len(refused)}"


def test_a_changed_type_of_a_large_array_is_noticed(tmp_path):
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


def test_foreign_files_are_refused_as_trajectories(run, tmp_path):
    """Whole archives with one odd thing in them, and what is no archive."""
    path = tmp_path / "run.npz"
    run.save(path)
    with np.load(path) as file:
        whole = dict(file)
    odd: dict[str, dict[str, Any]] = {
        "many versions": {"format_version": np.array([3, 3])},
        "a scene of numbers": {"scene": np.zeros(3)},
        "another program's scene": {"scene": np.array("services: {web: {}}")},
        "a number for torques": {"torques": np.array(1.0)},
        "a scene of other elements": {"scene": np.array(load_scene("swimmer").to_yaml())},
    }
    for kind, arrays in odd.items():
        np.savez(path, **{**whole, **arrays})
        assert refused_or_same(path, path.read_bytes(), run, kind), f"{kind} was read"
    contents = {
        "empty": b"",
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
    with refuses(TrajectoryError, "cannot read the trajectory: Is a directory", str(path)):
        Trajectory.load(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_files_without_permission_are_refused_by_name(run, tmp_path):
    path = tmp_path / "file"
    path.touch(mode=0)
    for read, error in ((Trajectory.load, TrajectoryError), (Scene.from_yaml, SceneError)):
        with refuses(error, "Permission denied", str(path)):
            read(path)


#: Broken YAML is in tests/contract/test_scene.py.
SCENES: dict[str, tuple[bytes, str]] = {
    "noise": (np.random.default_rng(1).bytes(4000), "must be UTF-8 text"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(300), "must be UTF-8 text"),
    "zeros": (bytes(4000), "not valid YAML"),
    "two bytes to a letter": ("name: x".encode("utf-16"), "must be UTF-8 text"),
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
    "JSON of something": (b'{"nodes": [1, 2], "edges": []}', "unknown field nodes"),
}


@pytest.mark.parametrize("kind", SCENES)
def test_foreign_files_are_refused_as_scenes(kind, tmp_path):
    content, part = SCENES[kind]
    path = tmp_path / "scene.yaml"
    path.write_bytes(content)
    for read in (load_scene, Scene.from_yaml, SwimEnv):
        with refuses(SceneError, part) as caught:
            read(path)
        message = str(caught.value)
        assert message.endswith(f"({path})") and len(message) < 400 + len(str(path)), message


def test_a_scene_cut_off_or_changed_anywhere_is_refused_or_read(tmp_path):
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
