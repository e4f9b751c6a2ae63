"""The visualise command, --record of the others, and rerun's viewer itself."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from swim_agents.policies import run_label

from swim_env import Simulator, SwimError, load_scene
from swim_env.recording import open_viewer, read_recording, take_picture
from tests.support import call_script


@pytest.fixture
def command(capsys, monkeypatch, tmp_path):
    """Return a function that runs a script's main in this process, without a display."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    return lambda script, *arguments: call_script(capsys, script, *arguments)


def test_agent_beside_the_wave(command, tmp_path):
    """Both on one time line, figures in the last line, what to do without a display."""
    file = tmp_path / "new" / "both.rrd"
    done = command(
        "visualise", "--policy", "tuned_wave", "--compare-with", "paper_wave", "--duration",
        "0.4", "--noise", "0", "--flow-rate", "10", "--output", file, "--view", "--json",
    )  # fmt: skip
    figures = done.figures()
    assert figures.keys() >= {"file", "flow_frames", "logging_seconds", "flow_seconds", "schema"}
    assert figures["bytes"] == file.stat().st_size and figures["frames"] == 42
    assert f"rerun {file}" in done.err and f"visualise --recording {file} --web" in done.err
    read = read_recording(file)
    assert list(read.swimmers) == ["tuned_wave", "paper_wave"]
    for one in read.swimmers.values():
        assert one.time[-1] == pytest.approx(0.4)
        assert one.series["return"][-1] == pytest.approx(one.series["progress"][-1], abs=1e-12)


def test_prescribed_torque_and_saved_trajectory(command, tmp_path):
    """By default the scene's own torque, without rewards; a saved run gives the same numbers."""
    assert command("visualise", "--scene", "paper_i", "--duration", "0.5", "--no-flow").code == 0
    (file,) = (tmp_path / "results" / "recordings").glob("paper_i-prescribed-*.rrd")
    one = read_recording(file).swimmers["prescribed"]
    simulator = Simulator("paper_i")
    played = simulator.rollout(simulator.prescribed_torques(50))
    assert (one.series["energy"][:, 3] == played.energy).all()
    assert "reward" not in one.series and not one.flow_time.size
    saved, output = tmp_path / "saved.npz", tmp_path / "saved.rrd"
    played.save(saved)
    look = ("--colour", "moment", "--flow-rate", "4", "--compare-with", "zero")
    done = command("visualise", "--trajectory", saved, "--output", output, *look)
    assert done.code == 0, done.err
    assert "recording" in done.out
    # The program's name, or its path where that is not on the search path.
    typed = rf"look at it with: (\S*/)?rerun {re.escape(str(output))}$"
    assert re.search(typed, done.err, re.M)
    other, zero = read_recording(output).swimmers.values()
    assert (other.nodes[0] == zero.nodes[0]).all(), "the policy's start has noise"
    for group, values in one.series.items():
        assert (other.series[group] == values).all(), group
    assert other.flow_time.size == 3


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--scene", "swimer"], "unknown scene 'swimer'"),
        (["--policy", "papr_wave"], "unknown policy 'papr_wave'"),
        (["--trajectory", "none.npz"], "cannot read the trajectory"),
        (["--trajectory", "x.npz", "--policy", "zero"], "--policy has no meaning"),
        (["--trajectory", "x.npz", "--scene", "swimmer"], "--scene has no meaning"),
        (["--trajectory", "x.npz", "--set", "beam.elements=5"], "--set has no meaning"),
        (["--trajectory", "x.npz", "--duration", "1"], "--duration has no meaning"),
        (["--trajectory", "x.npz", "--task", "forward"], "--task needs --policy"),
        (["--no-flow", "--flow-rate", "5"], "--flow-rate has no meaning with --no-flow"),
        (["--flow-rate", "0"], "--flow-rate must be above 0"),
        (["--frame-rate", "nan"], "--frame-rate must be above 0"),
        (["--duration", "-1"], "must be a positive number"),
        (["--at", "1"], "--at needs --picture"),
        (["--picture", "none/x.png"], "no such folder for the picture"),
        (["--picture", "x.gif"], "a picture's name ends with .png, .jpg, .jpeg"),
        (["--picture", "folder.png"], "a picture is a file"),
        (["--picture", "x.png", "--at", "nan"], "--at must be a time of at least 0"),
        (["--picture", "x.png", "--at", "3", "--duration", "2"], "at most the run's end, 2 s"),
        (["--noise", "0"], "--noise needs --policy or --compare-with"),
        (["--seed", "0"], "--seed needs --policy or --compare-with"),
        (["--set", "fluid=null", "--flow-rate", "5"], "there is no flow to record"),
        (["--recording", "none.rrd", "--web", "--port", "0"], "cannot read the recording: No such"),
        (["--recording", "none.rrd"], "--recording needs --view, --web or --picture"),
        (["--recording", "x.rrd", "--web", "--port", "0", "--no-flow"], "--no-flow has no meaning"),
        (["--recording", "x.rrd", "--view", "--seed", "0"], "--seed has no meaning"),
        (["--port", "1"], "--port needs --web"),
        (["--web", "--port", "-1"], "a port is a number from 0 to 65535, got -1"),
        (["--output", "x.txt"], "ends with .rrd"),
        (["--output", "folder.rrd"], "this is a folder"),
        (["--task", "fly", "--policy", "zero"], "unknown task 'fly'"),
        (["--task-option", "reach=2"], "--task-option needs --policy"),
        (
            ["--task", "turn", "--task-option", "toleranc=1", "--policy", "zero"],
            "unknown option 'toleranc' of task turn (nearest: tolerance)",
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(command, tmp_path, arguments, part):
    """Nothing is played and nothing is left."""
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "folder.rrd").mkdir()
    command("visualise", *arguments).assert_refused(part)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.skipif(os.name != "posix", reason="the stand-in is a shell script")
@pytest.mark.parametrize("code", [0, 1])
def test_a_display_that_does_not_answer(tmp_path, monkeypatch, code):
    """The viewer ends with an error: what to type instead. Where it hands over, nothing."""
    program = tmp_path / "rerun"
    program.write_text(f"#!/bin/sh\nexit {code}\n")
    program.chmod(0o755)
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr("swim_env.recording.viewer.rerun_command", lambda: str(program))
    line = open_viewer("some.rrd")
    if code == 0:
        assert line is None
    else:
        assert "no display answers" in line and "visualise --recording some.rrd --web" in line


def test_replay_records(command, tmp_path):
    """--record writes a file beside the figures, into a folder or under its name."""
    brief = ("replay", "--scene", "swimmer", "--duration", "0.2", "--json", "--record")
    figures = command(*brief, tmp_path).figures()
    named = tmp_path / "episode.rrd"
    (file,) = tmp_path.glob("swimmer-prescribed-*.rrd")
    assert figures["recording"]["file"] == str(file)
    place = read_recording(file).swimmers["prescribed"].path
    assert place[-1] - place[0] == pytest.approx(figures["displacement"], abs=1e-6)
    figures = command(*brief, named, "--env", "--policy", "random").figures()
    assert figures["recording"]["file"] == str(named)
    assert read_recording(named).swimmers["random"].series["reward"].shape == (10, 1)


@pytest.mark.parametrize(
    "usual", ["visualise --output", "replay --env --record", "compare --record"], ids=str.split
)
def test_unlike_runs_are_kept_apart_in_one_folder_and_a_repetition_replaces(
    command, tmp_path, usual
):
    script, *rest = usual.split()
    policies = "--policies zero" if script == "compare" else "--policy zero"
    seed = "--seeds" if script == "compare" else "--seed"
    changes = [
        "", policies.replace("zero", "random"), f"{seed} 3", "--noise 0", "--task target",
        "--set beam.elements=8", "--duration 0.06",
    ]  # fmt: skip
    if script == "visualise":
        changes += ["--flow-rate 20", "--frame-rate 25", "--colour moment", "--compare-with random"]
    usually = {"--scene": "swimmer", "--duration": "0.04", policies.split()[0]: "zero", seed: "1"}
    folder = tmp_path / "folder"
    for repetition in range(2):
        for count, change in enumerate(changes, 1):
            option, _, value = change.partition(" ")
            given = {**usually, **({option: value} if option else {})}
            options = [word for pair in given.items() for word in pair]
            assert command(script, *options, *rest, folder).code == 0
            assert len(list(folder.iterdir())) == (len(changes) if repetition else count), change


def test_a_run_as_usual_has_a_plain_name(tmp_path):
    scene = load_scene("swimmer")
    assert run_label(scene, ["ppo_forward"]) == "swimmer-ppo_forward"
    assert run_label(scene, ["zero", "random"], "target", 7) == "swimmer-target-zero-random-seed_7"
    assert run_label(scene, ["zero"], noise=None) == "swimmer-zero"
    assert run_label(scene, ["zero"], noise=0.0) != run_label(scene, ["zero"], noise=0.5)


def test_compare_records(command, tmp_path):
    """Everybody's first start in one recording, the references last."""
    file = tmp_path / "contest.rrd"
    brief = ("--policies", "zero", "--duration", "0.2", "--seeds", "3", "--json")
    record = command("compare", *brief, "--record", file).figures()
    read = read_recording(file)
    assert list(read.swimmers) == ["zero", "paper_wave", "tuned_wave"]
    for name, one in read.swimmers.items():
        gained = record["net_displacement"][name][0]
        assert one.series["progress"][-1, 0] == pytest.approx(gained, abs=1e-12)


def test_train_records_every_evaluation_of_every_run_in_one_folder(command, tmp_path):
    """A file an evaluation, under its number of steps; a prolonged run goes on in its folder."""
    from swim_agents.learning.logs import read_log

    seen = tmp_path / "seen"

    def train(output: str, *more: str) -> set[Path]:
        """Return the folders of recordings that are new."""
        before = set(seen.glob("*"))
        done = command(
            "train", "demo", "--set", "evaluation.every=128", "evaluation.episodes=2", "members=8",
            "ppo.minibatch=128", "ppo.rollout=16", "scene.episode.duration=0.2", *more,
            "--output", tmp_path / output, "--record", seen,
        )  # fmt: skip
        assert done.code == 0, done.err
        return set(seen.glob("*")) - before

    def steps_of(output: str) -> set[str]:
        steps = read_log(tmp_path / output / "seed_0" / "evaluations.csv")["steps"]
        return {f"evaluation-{int(n)}.rrd" for n in steps}

    (first,) = train("run", "steps=256")
    assert first.name.startswith("swimmer-") and "-demo-seed_0-" in first.name
    kept = {path.name: path.read_bytes() for path in first.iterdir()}
    assert kept.keys() == steps_of("run") and len(kept) >= 2
    (one,) = read_recording(next(first.iterdir())).swimmers.values()
    assert one.time[-1] == pytest.approx(0.2)
    # Another place, and another configuration in the place of a run that was removed.
    assert len(train("other", "steps=128")) == 1
    shutil.rmtree(tmp_path / "other")
    assert len(train("other", "steps=128", "ppo.epochs=1")) == 1
    assert {path.name: path.read_bytes() for path in first.iterdir()} == kept
    assert not train("run", "steps=384", "--resume")
    assert {path.name for path in first.iterdir()} == steps_of("run") > kept.keys()


@pytest.mark.slow
@pytest.mark.ci_slice
def test_reruns_viewer_shows_it(tmp_path, monkeypatch):
    """In the real viewer, without a window: no complaints, the body and its colours are there."""
    from PIL import Image

    from swim_env.recording import Swimmer, write_recording

    scene = load_scene("swimmer")
    torques = np.tile([[1.0] * 4 + [-1.0] * 4], (100, 1))
    played = Simulator(scene).rollout(torques)
    file, picture = tmp_path / "seen.rrd", tmp_path / "seen.png"
    write_recording(file, [Swimmer("wave", played)], flow_rate=25.0)
    # As in a virtual environment that is called by its path, without being on the search path.
    monkeypatch.setenv("PATH", "/usr/local/bin:/usr/bin:/bin")
    try:
        complaints = take_picture(file, picture, 0.3)
    except SwimError as error:
        if "cannot be started" in str(error):
            pytest.skip(str(error))
        raise
    assert complaints == []
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    # The upper left part follows the body, whose middle is in its middle.
    height, width = pixels.shape[:2]
    view = pixels[int(0.07 * height) : int(0.52 * height), : int(0.58 * width)]
    for colour in ((217, 72, 1), (8, 81, 156), (44, 58, 75)):
        near = np.abs(view - colour).max(axis=-1) <= 12
        assert near.sum() > 400, colour
    rows, columns = np.nonzero(np.abs(view - (217, 72, 1)).max(axis=-1) <= 12)
    assert abs(rows.mean() / view.shape[0] - 0.5) < 0.2
    # Torque turns from + to - in the middle: the front half, on the left, is orange.
    assert columns.mean() < 0.5 * view.shape[1]
    assert np.unique(pixels.reshape(-1, 3), axis=0).shape[0] > 500
