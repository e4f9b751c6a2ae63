"""The replay command: figures, result folder, bad input, interrupts."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from swim_env import SwimError, Trajectory, load_scene
from swim_env.plots.results import RESULT_FILES, write_results
from swim_env.sim.replay import replay, steps_of

ROOT = Path(__file__).parents[2]
KEYS = {
    "scene",
    "duration",
    "steps",
    "displacement",
    "heading_change",
    "mean_speed",
    "positive_work",
    "energy_drift",
    "momentum_drift",
    "max_residual",
    "newton_iterations_mean",
    "wall_seconds",
    "termination_reason",
}


def command(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    """Run scripts/replay.py."""
    return subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "replay.py"), *arguments],
        capture_output=True,
        text=True,
        cwd=options.pop("cwd", ROOT),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=250,
        **options,
    )


def test_json_line(tmp_path):
    """The last line on stdout is one JSON object with the figures of PHYSICS section 5."""
    done = command(
        "--scene", "paper_i", "--set", "beam.elements=5", "--duration", "0.5", "--json",
        cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures.keys() >= KEYS
    assert figures["scene"] == "paper_i"
    assert figures["steps"] == 50
    assert figures["duration"] == pytest.approx(0.5)
    run, expected = replay(load_scene("paper_i", ["beam.elements=5"]), 0.5)
    assert figures["displacement"] == expected["displacement"]
    assert figures["heading_change"] == run.heading_change
    assert list(tmp_path.iterdir()) == []


def test_result_folder(tmp_path):
    """One command, one folder: summary, data, scene and a picture; a second run replaces it."""
    folder = tmp_path / "out" / "run"
    arguments = ("--scene", "swimmer", "--duration", "0.2", "--output", str(folder), "--json")
    first = command(*arguments)
    assert first.returncode == 0, first.stderr
    assert sorted(path.name for path in folder.iterdir()) == sorted(RESULT_FILES)
    summary = json.loads((folder / "summary.json").read_text())
    trajectory = Trajectory.load(folder / "trajectory.npz")
    assert trajectory.steps == summary["steps"] == 40
    assert load_scene(folder / "scene.yaml") == trajectory.scene == load_scene("swimmer")
    assert (folder / "path.png").read_bytes().startswith(b"\x89PNG")
    assert command(*arguments).returncode == 0
    assert [path.name for path in folder.parent.iterdir()] == ["run"]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--scene", "paper_one"], "unknown scene 'paper_one'"),
        (["--scene", "no/such.yaml"], "no such scene file: no/such.yaml"),
        (["--scene", "paper_i", "--set", "beam.elemnts=3"], "beam.elemnts"),
        (["--scene", "paper_i", "--set", "beam.length=-1"], "beam.length must be above 0"),
        (["--scene", "paper_i", "--set", "beam.length"], "must read block.field=value"),
        (["--scene", "paper_i", "--duration", "-1"], "must be a positive number of seconds"),
        (["--scene", "paper_i", "--duration", "nan"], "must be a positive number of seconds"),
        (["--scene", "paper_i", "--duration", "1e-5"], "at least one time step, 0.01 s"),
        (["--scene", "paper_i", "--duration", "1e300"], "at most 2,000,000 time steps"),
        (["--scene", "paper_i", "--set", "integrator.time_step=1e-320"], "at most 2,000,000"),
        (["--scene", "paper_i", "--set", "beam.elements=100000"], "elements must be at most 1000"),
        (["--scene", "paper_i", "--set", "fluid.panels_per_element=800"], "at most 5000 panels"),
        (["--scene", "paper_i", "--set", "initial.velocity=[1e200, 1e200]"], "state_not_finite"),
        (["--scene", "paper_i", "--duration", "x"], "invalid float value"),
        ([], "--scene"),
        (["--scene", "paper_i", "--set", "initial.joint_angles=3"], "outline_degenerate"),
    ],
)
def test_bad_input_is_one_line_and_code_2(tmp_path, arguments, part):
    """Bad input: exit code 2, the fault named, no traceback, no file."""
    done = command(*arguments, "--output", str(tmp_path / "run"))
    assert done.returncode == 2
    assert part in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
    if not done.stderr.startswith("usage"):
        lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1


def test_foreign_folder_is_left_alone(tmp_path):
    """A folder with other files is refused before the run, and a file as well."""
    (tmp_path / "thesis.tex").write_text("dear")
    done = command("--scene", "paper_i", "--duration", "0.1", "--output", str(tmp_path))
    assert done.returncode == 2
    assert "holds other files than earlier results, for example thesis.tex" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    done = command("--scene", "paper_i", "--output", str(tmp_path / "thesis.tex"))
    assert done.returncode == 2
    assert "this is a file" in done.stderr


def test_failing_write_leaves_old_results(tmp_path, monkeypatch):
    """Results that cannot be written whole leave the older folder as it was."""
    trajectory, summary = replay(load_scene("paper_iv"), 0.1)
    folder = tmp_path / "run"
    write_results(trajectory, summary, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def full_disk(stream, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(SwimError, match="No space left on device"):
        write_results(trajectory, summary, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
def test_failing_exchange_puts_old_results_back(tmp_path, monkeypatch, error):
    """Even the last rename may fail: the older folder is back in its place."""
    trajectory, summary = replay(load_scene("paper_iv"), 0.1)
    folder = tmp_path / "run"
    write_results(trajectory, summary, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    rename = Path.rename

    def breaks(self, target):
        if self.name == "new":
            raise error
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", breaks)
    with pytest.raises(SwimError if isinstance(error, OSError) else KeyboardInterrupt):
        write_results(trajectory, {**summary, "scene": "other"}, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_link_stays_a_link(tmp_path):
    """Results go into the folder that a link points to."""
    trajectory, summary = replay(load_scene("paper_iv"), 0.1)
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    write_results(trajectory, summary, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in (tmp_path / "real").iterdir()) == sorted(RESULT_FILES)


def test_unusable_output_is_one_line(tmp_path):
    """A name that the file system refuses, and a full standard output."""
    done = command(
        "--scene", "paper_iv", "--duration", "0.1", "--output", str(tmp_path / ("x" * 300))
    )
    assert done.returncode == 2
    assert "File name too long" in done.stderr
    assert "Traceback" not in done.stderr
    with open("/dev/full", "w") as full:
        process = subprocess.run(
            [sys.executable, str(ROOT / "scripts" / "replay.py"), "--scene", "paper_iv", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
    assert process.returncode == 1
    assert "No space left on device" in process.stderr
    assert "Traceback" not in process.stderr


def test_early_end_is_reported():
    """A run that ends early says so on stderr and in the figures."""
    done = command(
        "--scene", "paper_i", "--set", "actuation.amplitude=60", "--duration", "5", "--json"
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["termination_reason"] != ""
    assert f"ended early at t = {figures['duration']:g} s" in done.stderr


def test_interrupt_leaves_nothing(tmp_path):
    """Ctrl-C in the middle of a run: exit code 130, no file, no traceback."""
    process = subprocess.Popen(
        [
            sys.executable, str(ROOT / "scripts" / "replay.py"), "--scene", "paper_xii",
            "--set", "beam.elements=54", "--duration", "2000", "--output", str(tmp_path / "run"),
        ],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background jobs, and what they start, ignore the signal.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    time.sleep(6.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert list(tmp_path.iterdir()) == []


def test_durations_round_to_whole_steps():
    """A duration that is no multiple of the step takes the nearest number of steps."""
    scene = load_scene("paper_i")
    assert steps_of(scene, 0.104) == 10
    assert steps_of(scene, 0.106) == 11
    assert steps_of(scene) == 10_000


def test_help_tells_the_options():
    """--help works and lists the shipped scenes."""
    done = command("--help")
    assert done.returncode == 0
    for word in ("--scene", "--set", "--duration", "--output", "--json", "paper_xii", "swimmer"):
        assert word in done.stdout
