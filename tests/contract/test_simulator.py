"""The simulator's public surface: shapes, errors, prescribed torques, trajectories and files."""

import copy
import dataclasses
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swim_env import (
    EFFECTS,
    FLUID_MODELS,
    Initial,
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
from tests.support import assert_same, full_disk, refuses, run_python, uniform


@pytest.fixture
def simulator() -> Simulator:
    """A fresh paper_i."""
    return Simulator("paper_i")


def test_names_of_scene_and_kernels_agree():
    assert set(FLUID_MODELS) == set(FLUID_MODEL_NAMES)
    assert EFFECTS == EFFECT_NAMES


# ---- start -------------------------------------------------------------------------------------


def test_start_is_the_reference_pose(simulator):
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
    bend = tuple(0.1 * np.sin(np.arange(8)))
    initial = Initial(position=(2.0, -1.0), heading=0.7, joint_angles=bend, velocity=(0.3, -0.2))
    scene = load_scene("paper_i").replace("initial", initial)
    simulator = Simulator(scene)
    centres, angles = initial.pose(scene.beam)
    np.testing.assert_allclose(simulator.centres, centres, atol=1e-14)
    np.testing.assert_allclose(simulator.angles, angles, atol=1e-14)
    np.testing.assert_allclose(simulator.velocity(), [0.3, -0.2, *np.zeros(9)], atol=1e-12)
    assert simulator.energy() > 0.0


def test_a_velocity_slope_turns_all_elements():
    scene = load_scene("paper_x", ["initial.velocity_slope=0.4"])
    velocity = Simulator(scene).velocity()
    np.testing.assert_allclose(velocity, [0.1, 1e-4 + 0.2, 0.4, 0.4, 0.4], atol=1e-13)


def test_a_reset_takes_another_start_for_once_and_refuses_one_that_does_not_fit(simulator):
    first = simulator.rollout(simulator.prescribed_torques(5))
    simulator.reset(Initial(heading=1.0))
    assert simulator.angles == pytest.approx(np.ones(9))
    with refuses(SceneError, "joint_angles must list one value per joint"):
        simulator.reset(Initial(joint_angles=(0.1, 0.2)))
    with refuses(SceneError, "break inextensibility"):
        simulator.reset(Initial(turning_rate=1.0))
    simulator.reset()
    assert_same(simulator.rollout(simulator.prescribed_torques(5)), first)


def test_a_scene_is_given_as_object_name_or_path(tmp_path):
    scene = load_scene("paper_iv")
    scene.save(tmp_path / "mine.yaml")
    for given in (scene, "paper_iv", tmp_path / "mine.yaml", str(tmp_path / "mine.yaml")):
        assert Simulator(given).scene == scene


# ---- torques -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("torques", "part"),
    [
        (np.zeros(7), "must have shape (8,), got (7,)"),
        (np.zeros((1, 8)), "must have shape (8,), got (1, 8)"),
        (0.0, "must have shape (8,), got ()"),
        ([0.0] * 7 + [np.nan], "must be finite, got nan at joint 7"),
        ([np.inf] + [0.0] * 7, "must be finite, got inf at joint 0"),
        (["a"] * 8, "must be numbers of shape"),
        ([None] * 8, "must be numbers of shape"),
        ([[0.0], [0.0, 1.0]], "must be numbers of shape"),
        (np.zeros(8, dtype=complex), "must be numbers of shape"),
        (np.zeros(8, dtype=bool), "must be numbers of shape"),
    ],
)
def test_bad_torques_are_refused_with_the_time_and_change_nothing(simulator, torques, part):
    twin = Simulator("paper_i")
    for each in (simulator, twin):
        each.step(each.prescribed_torques(1)[0])
    with refuses(TorqueError, part, "t = 0.01 s") as caught:
        simulator.step(torques)
    assert isinstance(caught.value, ValueError)
    for each in (simulator, twin):
        each.step(each.prescribed_torques(1)[0])
    np.testing.assert_array_equal(simulator.centres, twin.centres)


def test_bad_torques_of_a_rollout_are_found_before_the_first_step(simulator):
    torques = np.zeros((10, 8))
    torques[4, 2] = np.nan
    with refuses(TorqueError, "got nan at joint 2 for the step at t = 0.04 s"):
        simulator.rollout(torques)
    assert simulator.steps == 0
    with refuses(TorqueError, "must have shape (T, 8), got (8,)"):
        simulator.rollout(np.zeros(8))


def test_integers_views_and_no_torques_at_all_are_taken(simulator):
    assert simulator.rollout(np.zeros((0, 8))).summary()["displacement"] == [0.0, 0.0]
    simulator.step([1, 0, 0, 0, 0, 0, 0, -1])
    wide = np.zeros((6, 16))
    assert simulator.rollout(wide[:, ::2]).steps == 6


def test_prescribed_torques_follow_the_clock(simulator):
    """The wave is sampled at the beginning of each coming step."""
    simulator.rollout(simulator.prescribed_torques(7))
    times = (7 + np.arange(3)) * 0.01
    expected = simulator.scene.actuation.torques(times, simulator.scene.beam)
    np.testing.assert_array_equal(simulator.prescribed_torques(3), expected)
    np.testing.assert_array_equal(Simulator("paper_xi").prescribed_torques(2), np.zeros((2, 8)))


# ---- runs --------------------------------------------------------------------------------------


def test_trajectories_have_the_documented_shapes_and_end_where_the_simulator_is(simulator):
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


def test_progress_sees_every_step_and_watching_changes_nothing(simulator):
    counts: list[int] = []
    watched = simulator.rollout(simulator.prescribed_torques(450), progress=counts.append)
    assert sum(counts) == 450
    assert len(counts) > 1
    simulator.reset()
    alone = simulator.rollout(simulator.prescribed_torques(450))
    np.testing.assert_array_equal(watched.centres, alone.centres)


def test_every_state_of_a_run_has_an_energy():
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


def test_snapshot_of_another_scene_is_refused(simulator):
    snapshot = Simulator("swimmer").snapshot()
    with pytest.raises(SwimError, match=r"belongs to another scene \(swimmer\)"):
        simulator.restore(snapshot)


def test_a_copy_of_a_simulator_is_one_of_its_own():
    first = Simulator("paper_iv")
    second = pickle.loads(pickle.dumps(copy.deepcopy(first)))
    for simulator in (first, second):
        simulator.step([0.5, 0.5])
    assert (second.coordinates == first.coordinates).all()
    assert (second.coordinates != Simulator("paper_iv").coordinates).any()
    second.step([0.5, 0.5])
    assert first.steps == 1


@pytest.mark.release
def test_importing_the_package_takes_under_two_seconds():
    code = "import time; t = time.perf_counter(); import swim_env; print(time.perf_counter() - t)"
    times = [float(run_python("-c", code).out) for _ in range(3)]
    assert min(times) < 2.0, f"import took {times} s"


# ---- files -------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", ["paper_iv", "paper_vi", "swimmer", "internal forces"])
def test_what_was_saved_is_what_is_read(tmp_path, scene):
    forces = scene == "internal forces"
    simulator = Simulator(load_scene("swimmer", {"internal_forces": {}}) if forces else scene)
    run = simulator.rollout(simulator.prescribed_torques(15))
    assert (run.internal_forces is not None) == forces
    file = tmp_path / "run.npz"
    run.save(file)
    assert_same(Trajectory.load(file), run)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    with np.load(file, allow_pickle=False) as arrays:
        assert {"time", "centres", "angles", "torques", "energy", "momentum", "scene"} <= set(
            arrays.files
        )


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return Simulator(load_scene("swimmer", {"internal_forces": {}})).rollout(uniform(5, 8))


@pytest.fixture
def content(run: Trajectory, tmp_path: Path) -> dict[str, NDArray[Any]]:
    """What the file good.npz of a run holds."""
    run.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        return dict(file)


def test_a_file_of_version_2_is_read(tmp_path):
    """It knows nothing of impulses from outside, of which there were none."""
    now = Simulator("swimmer").rollout(uniform(6, 8))
    now.save(tmp_path / "old.npz")
    with np.load(tmp_path / "old.npz") as file:
        content = {**file, "format_version": np.array(2)}
    content.pop("impulse")
    np.savez(tmp_path / "old.npz", **content)
    old = Trajectory.load(tmp_path / "old.npz")
    assert old.impulse.shape == (6, 3) and not old.impulse.any()
    assert_same(old, now)
    assert old.summary() == now.summary()
    old.save(tmp_path / "again.npz")
    assert_same(Trajectory.load(tmp_path / "again.npz"), now)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        *(
            (
                {"format_version": version},
                f"has format version {version}, this version of swim_env reads 2 and 3",
            )
            for version in (0, 1, 4, 99, -2, 2.5, "2", "new")
        ),
        ({"impulse": None}, "it lacks impulse "),
        ({"impulse": None, "torques": None, "format_version": 2}, "it lacks torques"),
        ({"format_version": None}, "it lacks format_version"),
        ({"internal_forces": None}, "it lacks internal_forces"),
        ({"energy": ["a"] * 6}, "holds no numbers"),
        ({"work": np.zeros(3)}, "work must have shape (5,)"),
        ({"angles": np.zeros((2, 2))}, "angles must have shape (6, 9)"),
        ({"internal_forces": np.zeros((5, 7, 2))}, "internal_forces must have shape (5, 8, 2)"),
        ({"termination_reason": "bored"}, "unknown termination_reason 'bored'"),
        ({"scene": "beam: {elements: 1}"}, "beam.elements must be at least 2"),
    ],
)
def test_a_file_with_something_missing_or_wrong_says_what(tmp_path, content, changes, part):
    for name, value in changes.items():
        content.pop(name)
        if value is not None:
            content[name] = np.array(value)
    np.savez(tmp_path / "odd.npz", **content)
    with refuses(TrajectoryError, part, "odd.npz"):
        Trajectory.load(tmp_path / "odd.npz")


def test_what_is_no_trajectory_file_is_refused(tmp_path, content):
    with refuses(TrajectoryError, "cannot read"):
        Trajectory.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "foreign.npz", x=np.zeros(3))
    with refuses(TrajectoryError, "lacks format_version, scene"):
        Trajectory.load(tmp_path / "foreign.npz")
    good = (tmp_path / "good.npz").read_bytes()
    np.save(tmp_path / "single.npy", np.zeros(3))
    single = (tmp_path / "single.npy").read_bytes()
    for data in (b"no arrays here", good[: len(good) // 3], good[:-100], single):
        (tmp_path / "odd.npz").write_bytes(data)
        with refuses(TrajectoryError, "not a trajectory file"):
            Trajectory.load(tmp_path / "odd.npz")


def test_a_failed_save_leaves_the_old_file(tmp_path, run, monkeypatch):
    file = tmp_path / "run.npz"
    run.save(file)
    before = file.read_bytes()
    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with refuses(TrajectoryError, "No space left on device"):
        run.save(file)
    assert file.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    for nowhere in (f"{file}\0", tmp_path / "no" / "such" / "folder.npz"):
        with pytest.raises(TrajectoryError, match="cannot write"):
            run.save(nowhere)


def test_a_trajectory_is_that_of_its_scenes_body():
    run = Simulator("paper_iv").rollout(np.zeros((3, 2)))
    with refuses(TrajectoryError, "centres must have shape (4, 9, 2) in scene paper_i, got"):
        dataclasses.replace(run, scene=load_scene("paper_i"))
