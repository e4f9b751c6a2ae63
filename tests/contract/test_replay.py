"""The replay command and the console command: figures, result folder, bad input, interrupts."""

import json
import subprocess
import sys
import time

import pytest
from swim_agents.commands import main as console

from swim_env import Scene, Trajectory, load_scene
from swim_env.plots.results import RESULT_FILES, write_results
from swim_env.sim.replay import replay, steps_of
from tests.support import (
    ENVIRONMENT,
    ROOT,
    call_script,
    files_of,
    interrupt_script,
    run_python,
    run_script,
)

KEYS = {
    "scene", "duration", "steps", "displacement", "heading_change", "mean_speed",
    "positive_work", "energy_drift", "momentum_drift", "max_residual",
    "newton_iterations_mean", "wall_seconds", "termination_reason",
}  # fmt: skip


def test_json_line(tmp_path):
    """The last line on stdout is one JSON object with the figures; nothing is written."""
    figures = run_script(
        "replay", "--scene", "paper_i", "--set", "beam.elements=5", "--duration", "0.5", "--json",
        cwd=tmp_path,
    ).figures()  # fmt: skip
    assert figures.keys() >= KEYS
    assert (figures["scene"], figures["steps"]) == ("paper_i", 50)
    assert figures["duration"] == pytest.approx(0.5)
    run, expected = replay(load_scene("paper_i", ["beam.elements=5"]), 0.5)
    assert figures["displacement"] == expected["displacement"]
    assert figures["heading_change"] == run.heading_change
    assert list(tmp_path.iterdir()) == []


def test_result_folder(tmp_path, capsys):
    """One command, one folder: summary, data, scene and a picture; a second run replaces it."""
    folder = tmp_path / "out" / "run"
    arguments = ("--scene", "swimmer", "--duration", "0.2", "--output", folder, "--json")
    summary = call_script(capsys, "replay", *arguments).figures()
    assert sorted(path.name for path in folder.iterdir()) == sorted(RESULT_FILES)
    trajectory = Trajectory.load(folder / "trajectory.npz")
    assert trajectory.steps == summary["steps"] == 10 * trajectory.scene.steps_per_action
    assert load_scene(folder / "scene.yaml") == trajectory.scene == load_scene("swimmer")
    assert (folder / "path.png").read_bytes().startswith(b"\x89PNG")
    assert call_script(capsys, "replay", *arguments).code == 0
    assert [path.name for path in folder.parent.iterdir()] == ["run"]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--scene", "paper_one"], "unknown scene 'paper_one'"),
        (["--scene", "no/such.yaml"], "no such scene file: no/such.yaml"),
        (["--set", "beam.elemnts=3"], "beam.elemnts"),
        (["--set", "beam.length"], "must read block.field=value"),
        (["--duration", "-1"], "must be a positive number of seconds"),
        (["--duration", "nan"], "must be a positive number of seconds"),
        (["--duration", "1e-5"], "at least one time step, 0.01 s"),
        (["--duration", "1e300"], "at most 2,000,000 time steps"),
        (["--set", "integrator.time_step=1e-320"], "at most 2,000,000"),
        (["--set", "beam.elements=100000"], "elements must be at most 1000"),
        (["--set", "fluid.panels_per_element=800"], "at most 5000 panels"),
        (["--set", "initial.velocity=[1e200, 1e200]"], "state_not_finite"),
        (["--set", "initial.joint_angles=3"], "outline_degenerate"),
        (["--seed", "0"], "--seed needs --env"),
        (["--record-video", "x"], "--record-video needs --env"),
        (["--policy", "zero"], "--policy needs --env"),
        (["--env", "--accuracy", "0.1"], "has no meaning with --env"),
        (["--env", "--policy", "nobody"], "unknown policy 'nobody'"),
        (["--env", "--task", "sideways"], "unknown task 'sideways'"),
        (["--task-option", "reach=2"], "--task-option needs --env"),
        (["--env", "--task-option", "reach"], "--task-option must read NAME=VALUE, as in reach=2"),
        (["--env", "--task", "turn", "--task-option", "tolerance=-1"], "tolerance must be above 0"),
        (["--env", "--seed", "-1"], "seed"),
        (["--env", "--noise", "-2"], "noise"),
        (["--env", "--set", "episode.control_interval=0.012"], "whole number of steps"),
        (["--duration", "x"], "invalid float value"),
    ],
)
def test_bad_input_is_one_line_and_code_2(tmp_path, capsys, arguments, part):
    """Bad input: exit code 2, the fault named, no traceback, no file."""
    brief = ("--scene", "paper_i", "--output", tmp_path / "run")
    done = call_script(capsys, "replay", *brief, *arguments)
    if done.err.startswith("usage"):
        assert done.code == 2 and part in done.err.splitlines()[-1]
    else:
        done.assert_refused(part)
    assert done.out == ""
    assert list(tmp_path.iterdir()) == []


def test_foreign_folder_is_left_alone(tmp_path, capsys):
    """A folder with other files is refused before the run, and a file; by `compare` as well."""
    file = tmp_path / "thesis.tex"
    file.write_text("dear")
    (tmp_path / "comparison.json").write_text("{}")
    other = "holds other files than earlier results, for example "
    for place, problem in ((tmp_path, other), (file, "this is a file")):
        brief = ("--scene", "paper_i", "--duration", "0.1", "--output", place)
        call_script(capsys, "replay", *brief).assert_refused(problem)
    brief = ("--policies", "zero", "--duration", "0.1", "--output", tmp_path)
    call_script(capsys, "compare", *brief).assert_refused(other + "thesis.tex")
    assert files_of(tmp_path) == {"comparison.json": b"{}", "thesis.tex": b"dear"}


def test_a_rename_that_is_interrupted_leaves_the_old_results(tmp_path, monkeypatch):
    """Errors of the disk at any moment are in tests/stability/test_interrupts.py."""
    trajectory, summary = replay(load_scene("paper_iv"), 0.1)
    folder = tmp_path / "run"
    write_results(trajectory, summary, folder)
    before, rename = files_of(folder), type(folder).rename

    def breaks(self, target):
        if self.name == "new":
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(type(folder), "rename", breaks)
    with pytest.raises(KeyboardInterrupt):
        write_results(trajectory, {**summary, "scene": "other"}, folder)
    assert files_of(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_link_stays_a_link(tmp_path):
    """Results go into the folder that a link points to."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    write_results(*replay(load_scene("paper_iv"), 0.1), tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in (tmp_path / "real").iterdir()) == sorted(RESULT_FILES)


def test_unusable_output_is_one_line(tmp_path, capsys):
    """A name that the file system refuses, and a full standard output."""
    brief = ("--scene", "paper_iv", "--duration", "0.1")
    done = call_script(capsys, "replay", *brief, "--output", tmp_path / ("x" * 300))
    done.assert_refused("File name too long")
    with open("/dev/full", "w") as full:
        process = subprocess.run(
            [sys.executable, str(ROOT / "scripts" / "replay.py"), *brief, "--json"],
            stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT,
            env={**ENVIRONMENT, "PYTHONUNBUFFERED": ""},
        )  # fmt: skip
    assert process.returncode == 1
    assert process.stderr == "error: No space left on device\n"


def test_early_end_is_reported(capsys):
    """A run that ends early says so on stderr and in the figures."""
    done = call_script(
        capsys, "replay", "--scene", "paper_i", "--set", "actuation.amplitude=60", "--duration",
        "5", "--json",
    )  # fmt: skip
    figures = done.figures()
    assert figures["termination_reason"] != ""
    assert f"the run ended early at t = {figures['duration']:g} s" in done.err


def test_interrupt_leaves_nothing(tmp_path):
    """Ctrl-C in the middle of a run: exit code 130, no file, no traceback."""
    begin = time.monotonic()
    done = interrupt_script(
        "replay", "--scene", "paper_xii", "--set", "beam.elements=54", "--duration", "2000",
        "--output", tmp_path / "run", when=lambda: time.monotonic() - begin > 6.0,
    )  # fmt: skip
    assert done.code == 130, done.err
    assert "interrupted" in done.err and "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


def test_durations_round_to_whole_steps():
    """A duration that is no multiple of the step takes the nearest number of steps."""
    scene = load_scene("paper_i")
    assert [steps_of(scene, duration) for duration in (0.104, 0.106, None)] == [10, 11, 10_000]


# ---- the console command -----------------------------------------------------------------------


def test_the_console_command_imports_nothing_for_help():
    """Help and version are there at once; a wrong command is a usage error."""
    code = "import sys; from swim_agents.commands.main import main; main(sys.argv[1:])"
    heavy = "import atexit; atexit.register(lambda: print('numpy' in sys.modules)); "
    done = run_python("-c", code.replace("from", heavy + "from", 1), "--help")
    assert done.code == 0 and done.out.endswith("False\n")
    assert all(f"\n    {name}" in done.out for name in console.COMMANDS)
    done = run_python("-c", code, "--version")
    assert (done.code, done.out.split()[0]) == (0, "swim-env")
    done = run_python("-c", code, "dance")
    assert done.code == 2 and "invalid choice: 'dance'" in done.err


@pytest.mark.parametrize("name", console.COMMANDS)
def test_every_subcommand_has_help(name, capsys):
    """With its options, and what ships by name."""
    with pytest.raises(SystemExit) as caught:
        console.main([name, "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert caught.value.code == 0
    assert text.startswith(f"usage: swim-env {name} ")
    own = {"train": ("CONFIG", "--resume", "ppo_forward"), "warm-up": ("images and clusters",)}
    own["sweep"] = ("SWEEP.yaml", "--output", "--json", "replay, tune")
    own["characterise"] = ("--set", "--json", "paper_xii")
    for word in own.get(name, ("--set", "--output", "--json", "paper_xii")):
        assert word in text


def test_a_misspelt_option_is_named_with_its_nearest(capsys):
    for given, message in (
        (
            ["replay", "--scene", "paper_i", "--polcy", "zero"],
            "unknown option --polcy (nearest: --policy)",
        ),
        (
            ["replay", "--scene", "paper_i", "--polic", "zero"],
            "unknown option --polic (nearest: --policy)",
        ),
        (["replay", "--scene", "paper_i", "--sede=3"], "unknown option --sede (nearest: --se"),
        (["replay", "--scene", "paper_i", "extra"], "unexpected argument extra"),
    ):
        with pytest.raises(SystemExit) as caught:
            console.main(given)
        assert caught.value.code == 2 and message in capsys.readouterr().err


def test_the_accuracy_command_chooses_settings(tmp_path, capsys):
    """The scene is printed, or written into a file, its description saying why."""
    brief = ["accuracy", "--scene", "swimmer", "--tolerance", "0.3", "--duration", "2"]
    assert console.main([*brief, "--keep-elements"]) == 0
    printed = capsys.readouterr()
    (tmp_path / "printed.yaml").write_text(printed.out)
    kept = load_scene(tmp_path / "printed.yaml")
    assert kept.beam.elements == 9 and "Settings chosen for 0.3" in kept.description
    assert "chosen for 0.3 of the displacement" in printed.err
    file = tmp_path / "chosen.yaml"
    assert console.main([*brief, "--json", "--output", str(file)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert Scene.from_dict(data["scene"]) == load_scene(file)
    assert 0.0 <= data["error"] <= 0.3 and data["tried"] >= 1
    assert console.main([*brief, "--output", str(tmp_path / "none" / "x.yaml")]) == 2
    assert console.main(["accuracy", "--scene", "swimmer", "--tolerance", "2"]) == 2
    assert "the tolerance must be 0.001 to 0.3" in capsys.readouterr().err
