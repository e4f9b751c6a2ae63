"""The simulator's public surface: shapes, errors, prescribed torques, trajectories and files."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

import swim_env
from swim_env import (
    EFFECTS,
    FLUID_MODELS,
    Initial,
    Scene,
    SceneError,
    SimulationEndedError,
    Simulator,
    SwimError,
    TorqueError,
    Trajectory,
    TrajectoryError,
    load_scene,
)
from swim_env.scene import EFFECT_NAMES, FLUID_MODEL_NAMES


@pytest.fixture
def simulator() -> Simulator:
    """A fresh paper_i."""
    return Simulator("paper_i")


def test_names_of_scene_and_kernels_agree():
    """What a scene may name is what the kernels' table has."""
    assert set(FLUID_MODELS) == set(FLUID_MODEL_NAMES)
    assert EFFECTS == EFFECT_NAMES


def test_start_is_the_reference_pose(simulator):
    """Straight along +x, head at the origin, at rest."""
    dl = 1 / 9
    expected = np.stack([(np.arange(9) + 0.5) * dl, np.zeros(9)], axis=1)
    np.testing.assert_allclose(simulator.centres, expected, atol=1e-15)
    assert simulator.centres.shape == (9, 2)
    np.testing.assert_array_equal(simulator.angles, np.zeros(9))
    assert simulator.angles.shape == (9,)
    assert simulator.time == 0.0
    assert simulator.energy() == 0.0
    np.testing.assert_array_equal(simulator.momentum(), np.zeros(3))


def test_initial_pose_and_velocity_are_met():
    """A bent, turned, moving start is what the simulator starts from."""
    bend = tuple(0.1 * np.sin(np.arange(8)))
    initial = Initial(position=(2.0, -1.0), heading=0.7, joint_angles=bend, velocity=(0.3, -0.2))
    scene = load_scene("paper_i").replace("initial", initial)
    simulator = Simulator(scene)
    centres, angles = initial.pose(scene.beam)
    np.testing.assert_allclose(simulator.centres, centres, atol=1e-14)
    np.testing.assert_allclose(simulator.angles, angles, atol=1e-14)
    np.testing.assert_allclose(simulator.velocity(), [0.3, -0.2, *np.zeros(9)], atol=1e-12)
    assert simulator.energy() > 0.0


def test_spin_about_the_head_is_met():
    """A lateral velocity linear in x with the elements turning at its slope."""
    scene = load_scene("paper_x", ["initial.velocity_slope=0.4"])
    velocity = Simulator(scene).velocity()
    np.testing.assert_allclose(velocity, [0.1, 1e-4 + 0.2, 0.4, 0.4, 0.4], atol=1e-13)


def test_reset_with_another_start(simulator):
    """A reset takes another start for once and refuses one that does not fit."""
    first = simulator.rollout(simulator.prescribed_torques(5))
    simulator.reset(Initial(heading=1.0))
    assert simulator.angles == pytest.approx(np.ones(9))
    with pytest.raises(SceneError, match="joint_angles must list one value per joint"):
        simulator.reset(Initial(joint_angles=(0.1, 0.2)))
    with pytest.raises(SceneError, match="break inextensibility"):
        simulator.reset(Initial(turning_rate=1.0))
    simulator.reset()
    again = simulator.rollout(simulator.prescribed_torques(5))
    np.testing.assert_array_equal(again.centres, first.centres)


@pytest.mark.parametrize(
    ("torques", "part"),
    [
        (np.zeros(7), r"must have shape \(8,\), got \(7,\)"),
        (np.zeros((1, 8)), r"must have shape \(8,\), got \(1, 8\)"),
        (0.0, r"must have shape \(8,\), got \(\)"),
        ([0.0] * 7 + [np.nan], r"must be finite, got nan at joint 7"),
        ([np.inf] + [0.0] * 7, r"must be finite, got inf at joint 0"),
        (["a"] * 8, "must be numbers of shape"),
        ([None] * 8, "must be numbers of shape"),
        ([[0.0], [0.0, 1.0]], "must be numbers of shape"),
        (np.zeros(8, dtype=complex), "must be numbers of shape"),
        (np.zeros(8, dtype=bool), "must be numbers of shape"),
    ],
)
def test_bad_torques_change_nothing(simulator, torques, part):
    """Bad torques get a TorqueError with the time, and the run goes on as if nothing had been."""
    twin = Simulator("paper_i")
    for each in (simulator, twin):
        each.step(each.prescribed_torques(1)[0])
    with pytest.raises(TorqueError, match=part) as caught:
        simulator.step(torques)
    assert "t = 0.01 s" in str(caught.value)
    assert isinstance(caught.value, ValueError)
    for each in (simulator, twin):
        each.step(each.prescribed_torques(1)[0])
    np.testing.assert_array_equal(simulator.centres, twin.centres)


def test_bad_rollout_torques_name_their_step(simulator):
    """NaN in the middle of a rollout is found before the first step."""
    torques = np.zeros((10, 8))
    torques[4, 2] = np.nan
    with pytest.raises(TorqueError, match=r"got nan at joint 2 for the step at t = 0.04 s"):
        simulator.rollout(torques)
    assert simulator.steps == 0
    with pytest.raises(TorqueError, match=r"must have shape \(T, 8\), got \(8,\)"):
        simulator.rollout(np.zeros(8))


def test_integer_and_strided_torques_are_taken(simulator):
    """Integers and views that are not contiguous are ordinary torques."""
    simulator.step([1, 0, 0, 0, 0, 0, 0, -1])
    wide = np.zeros((6, 16))
    assert simulator.rollout(wide[:, ::2]).steps == 6


def test_empty_rollout(simulator):
    """A rollout of no step is the present state."""
    trajectory = simulator.rollout(np.zeros((0, 8)))
    assert trajectory.steps == 0
    summary = trajectory.summary()
    assert summary["displacement"] == [0.0, 0.0]
    assert summary["mean_speed"] == 0.0


def test_folded_start_is_refused():
    """A body folded onto itself cannot be simulated: the reason and the time."""
    fold = load_scene("paper_i", ["initial.joint_angles=2.9"])
    with pytest.raises(SimulationEndedError, match="t = 0 s: outline_degenerate") as caught:
        Simulator(fold)
    assert (caught.value.reason, caught.value.time) == ("outline_degenerate", 0.0)
    ring = load_scene("paper_i", [f"initial.joint_angles={2 * np.pi / 9}"])
    with pytest.raises(SimulationEndedError, match="under_resolved_gap"):
        Simulator(ring)


def test_prescribed_torques_follow_the_clock(simulator):
    """The wave is sampled at the beginning of each coming step."""
    simulator.rollout(simulator.prescribed_torques(7))
    times = (7 + np.arange(3)) * 0.01
    expected = simulator.scene.actuation.torques(times, simulator.scene.beam)
    np.testing.assert_array_equal(simulator.prescribed_torques(3), expected)
    np.testing.assert_array_equal(Simulator("paper_xi").prescribed_torques(2), np.zeros((2, 8)))


def test_trajectory_shapes_and_units(simulator):
    """Arrays of a rollout have the shapes that they claim, and agree with the simulator."""
    trajectory = simulator.rollout(simulator.prescribed_torques(20))
    assert trajectory.time.shape == (21,)
    assert trajectory.centres.shape == (21, 9, 2)
    assert trajectory.angles.shape == (21, 9)
    assert trajectory.torques.shape == (20, 8)
    assert trajectory.momentum.shape == (21, 3)
    assert trajectory.energy.shape == (21,)
    assert trajectory.nodes.shape == (21, 10, 2)
    np.testing.assert_array_equal(trajectory.centres[-1], simulator.centres)
    np.testing.assert_array_equal(trajectory.angles[-1], simulator.angles)
    np.testing.assert_array_equal(trajectory.momentum[-1], simulator.momentum())
    assert trajectory.energy[-1] == simulator.energy()
    assert trajectory.time[-1] == simulator.time == 0.2
    gaps = np.diff(trajectory.nodes, axis=1)
    np.testing.assert_allclose(np.hypot(gaps[..., 0], gaps[..., 1]), 1 / 9, rtol=1e-12)
    assert (trajectory.residual <= 1e-10).all()
    assert (trajectory.parts == 1).all()


def test_work_is_torque_times_joint_turn(simulator):
    """Work and its positive part, from the trajectory's own angles."""
    trajectory = simulator.rollout(simulator.prescribed_torques(50))
    turns = np.diff(np.diff(trajectory.angles, axis=1), axis=0)
    work = trajectory.torques * turns
    np.testing.assert_allclose(trajectory.work, work.sum(axis=1), atol=1e-14)
    np.testing.assert_allclose(
        trajectory.positive_work, np.maximum(work, 0).sum(axis=1), atol=1e-14
    )


def test_progress_sees_every_step(simulator):
    """The progress callback's counts add up, and watching changes nothing."""
    counts: list[int] = []
    watched = simulator.rollout(simulator.prescribed_torques(450), progress=counts.append)
    assert sum(counts) == 450
    assert len(counts) > 1
    simulator.reset()
    alone = simulator.rollout(simulator.prescribed_torques(450))
    np.testing.assert_array_equal(watched.centres, alone.centres)


def test_every_state_handed_out_can_be_weighed():
    """The step that would reach a pose beyond the panels' limits is the one that ends the run."""
    simulator = Simulator("paper_i")
    rng = np.random.default_rng(2)
    with pytest.raises(SimulationEndedError) as caught:
        while simulator.time < 10.0:
            torques = rng.choice([-1.0, 1.0], 8)
            for _ in range(2):
                simulator.step(torques)
                assert np.isfinite(simulator.energy())
    assert caught.value.time == simulator.time
    assert np.isfinite(simulator.energy())
    assert np.isfinite(simulator.velocity()).all()


def test_a_start_beyond_floating_point_is_refused():
    """A velocity whose energy overflows is refused by name."""
    scene = load_scene("paper_i").replace("initial.velocity", (1e200, 1e200))
    with pytest.raises(SimulationEndedError, match="state_not_finite"):
        Simulator(scene)


def test_early_end_is_told(simulator):
    """A run that cannot go on keeps its last good state, and says why until it is reset."""
    torques = np.full((2000, 8), 40.0)
    trajectory = simulator.rollout(torques)
    assert 0 < trajectory.steps < 2000
    assert trajectory.termination_reason in {"", *swim_env.TERMINATION_REASONS}
    assert trajectory.termination_reason == simulator.termination_reason != ""
    assert np.isfinite(trajectory.centres).all()
    np.testing.assert_array_equal(trajectory.centres[-1], simulator.centres)
    summary = trajectory.summary()
    assert summary["termination_reason"] == trajectory.termination_reason
    assert np.isfinite(summary["energy_drift"])
    with pytest.raises(SimulationEndedError, match=f"t = {simulator.time:.6g} s"):
        simulator.step(np.zeros(8))
    with pytest.raises(SimulationEndedError):
        simulator.rollout(np.zeros((1, 8)))
    simulator.reset()
    assert simulator.termination_reason == ""
    simulator.step(np.zeros(8))


def test_snapshot_of_another_scene_is_refused(simulator):
    """Snapshots go back only into the very same scene."""
    snapshot = Simulator("swimmer").snapshot()
    with pytest.raises(SwimError, match=r"belongs to another scene \(swimmer\)"):
        simulator.restore(snapshot)


@pytest.mark.parametrize("scene", ["paper_iv", "paper_vi", "swimmer"])
def test_trajectory_file_round_trip(tmp_path, scene):
    """What was saved is what is read, scene and all; the file has ordinary permissions."""
    simulator = Simulator(scene)
    trajectory = simulator.rollout(simulator.prescribed_torques(15))
    file = tmp_path / "run.npz"
    trajectory.save(file)
    read = Trajectory.load(file)
    assert read.scene == trajectory.scene
    assert read.summary() == trajectory.summary()
    for name in ("time", "centres", "angles", "torques", "energy", "momentum", "dissipated"):
        np.testing.assert_array_equal(getattr(read, name), getattr(trajectory, name))
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    with np.load(file, allow_pickle=False) as arrays:
        assert {"time", "centres", "angles", "torques", "energy", "momentum", "scene"} <= set(
            arrays.files
        )


def test_unreadable_trajectories(tmp_path, simulator):
    """Missing, foreign, truncated and outdated files: one clear error each."""
    good = tmp_path / "good.npz"
    simulator.rollout(simulator.prescribed_torques(5)).save(good)
    with pytest.raises(TrajectoryError, match="cannot read"):
        Trajectory.load(tmp_path / "missing.npz")
    text = tmp_path / "text.npz"
    text.write_text("no arrays here")
    with pytest.raises(TrajectoryError, match="not a trajectory file"):
        Trajectory.load(text)
    for share in (0.3, 0.9):
        cut = tmp_path / "cut.npz"
        cut.write_bytes(good.read_bytes()[: int(share * good.stat().st_size)])
        with pytest.raises(TrajectoryError, match="not a trajectory file"):
            Trajectory.load(cut)
    foreign = tmp_path / "foreign.npz"
    np.savez(foreign, x=np.zeros(3))
    with pytest.raises(TrajectoryError, match="lacks format_version, scene"):
        Trajectory.load(foreign)
    single = tmp_path / "single.npy"
    np.save(single, np.zeros(3))
    with pytest.raises(TrajectoryError, match="not a trajectory file"):
        Trajectory.load(single)
    with np.load(good) as file:
        content = dict(file)
    for key, value, part in (
        ("format_version", np.array(99), "format version 99"),
        ("format_version", np.array("new"), "format version new"),
        ("energy", np.array(["a"] * 6), "holds no numbers"),
        ("work", np.zeros(3), r"work must have shape \(5,\)"),
        ("termination_reason", np.array("bored"), "unknown termination_reason 'bored'"),
        ("angles", np.zeros((2, 2)), r"angles must have shape \(6, 9\)"),
        ("scene", np.array("beam: {elements: 1}"), "beam.elements must be at least 2"),
    ):
        np.savez(foreign, **{**content, key: value})
        with pytest.raises(TrajectoryError, match=part):
            Trajectory.load(foreign)


def test_failed_save_leaves_the_old_file(tmp_path, simulator, monkeypatch):
    """A write that breaks off keeps the older file and leaves nothing half-written."""
    trajectory = simulator.rollout(simulator.prescribed_torques(5))
    file = tmp_path / "run.npz"
    trajectory.save(file)
    before = file.read_bytes()

    def full_disk(stream, **arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(TrajectoryError, match="No space left on device"):
        trajectory.save(file)
    assert file.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    with pytest.raises(TrajectoryError, match="cannot write"):
        trajectory.save(f"{file}\0")
    with pytest.raises(TrajectoryError, match="cannot write"):
        trajectory.save(tmp_path / "no" / "such" / "folder.npz")


def test_scene_can_be_given_as_object_name_or_path(tmp_path):
    """All three ways lead to the same run."""
    scene = load_scene("paper_iv")
    scene.save(tmp_path / "mine.yaml")
    runs = [
        Simulator(given).rollout(np.zeros((3, 2)))
        for given in (scene, "paper_iv", tmp_path / "mine.yaml")
    ]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.centres, runs[0].centres)
    assert isinstance(Simulator(Scene()).scene, Scene)


def test_import_is_light():
    """Importing the package takes under 2 s and pulls in no learning or plotting library."""
    code = (
        "import time; start = time.perf_counter(); import swim_env, sys; "
        "print(time.perf_counter() - start, sorted({'torch', 'matplotlib', 'rerun', "
        "'stable_baselines3'} & set(sys.modules)))"
    )
    times = []
    for _ in range(3):
        out = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        seconds, modules = out.split(" ", 1)
        assert modules.strip() == "[]"
        times.append(float(seconds))
    assert min(times) < 2.0, f"import took {times} s"


def test_a_copy_of_a_simulator_is_one_of_its_own():
    first = Simulator("paper_iv")
    second = pickle.loads(pickle.dumps(copy.deepcopy(first)))
    for simulator in (first, second):
        simulator.step([0.5, 0.5])
    assert (second.coordinates == first.coordinates).all()
    assert (second.coordinates != Simulator("paper_iv").coordinates).any()
    second.step([0.5, 0.5])
    assert first.steps == 1
