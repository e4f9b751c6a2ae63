"""The simulator, its trajectories and snapshots for scenes of dimension 3."""

import copy
import json
import pickle

import numpy as np
import pytest

from swim_env import (
    OptionError,
    Scene,
    SimulationEndedError,
    Simulator,
    SwimError,
    TorqueError,
    Trajectory,
    load_scene,
)
from swim_env.errors import TrajectoryError
from swim_env.physics.spatial.invariants import heading_of, rotation_angle
from swim_env.scene.spatial.initial import SpatialInitial
from swim_env.sim.replay import replay
from swim_env.sim.spatial.bodies import SpatialBodies, spatial_start
from swim_env.sim.spatial.simulator import SpatialSimulator
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from tests.support import Array, run_python

FISH = load_scene("fish_3d")
MODELS = ("none", "strip", "frozen", "panels")


def of_model(model: str, **changes: object) -> Scene:
    """Return the fish in a fluid of one of MODELS, few panels, and its density without one."""
    coarse = {"fluid.around": 8, "fluid.rows": 1, "beam.density": 1000.0}
    return FISH.replace({"fluid.model": model, **coarse, **changes})


def random_torques(steps: int, seed: int = 0, size: float = 3.0) -> Array:
    return np.asarray(size * np.random.default_rng(seed).normal(size=(steps, 8, 3)))


def test_a_scene_in_space_has_a_simulator_in_space():
    simulator = Simulator("fish_3d")
    assert simulator.elements == 9
    assert simulator.centres == pytest.approx(
        np.stack([(np.arange(9) + 0.5) / 9, np.zeros(9), np.zeros(9)], axis=1), abs=1e-15
    )
    # Columns d1, d2, d3: yaw turns about d2 = e_z, the body lies along e_x.
    assert np.array_equal(simulator.directors[4], [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    assert not simulator.joint_rotations.any()
    assert simulator.joint_rotations.shape == (8, 3)
    assert (simulator.momentum() == 0.0).all()
    assert simulator.momentum().shape == (6,)
    assert simulator.energy() == simulator.energy_drift() == 0.0
    for name in ("angles", "joint_angles"):
        with pytest.raises(AttributeError, match="directors|joint_rotations"):
            getattr(simulator, name)
    assert isinstance(Simulator("paper_i").rollout(np.zeros((1, 8))), Trajectory)


def test_the_scene_decides_on_the_class_but_for_classes_that_have_chosen():
    class Own(Simulator):
        def __init__(self, scene: str, note: str) -> None:
            super().__init__(scene)
            self.note = note

    assert type(Simulator(scene="fish_3d")) is SpatialSimulator
    assert SpatialSimulator("fish_3d").elements == 9
    assert Own("paper_i", note="mine").note == "mine"
    with pytest.raises(SwimError, match="needs a scene of dimension 3, got paper_i"):
        SpatialSimulator("paper_i")
    with pytest.raises(SwimError, match="needs a scene of dimension 2, got fish_3d"):
        Own("fish_3d", note="mine")
    assert pickle.loads(pickle.dumps(Simulator(FISH))).elements == 9


@pytest.mark.parametrize(
    ("name", "message"), [("recorded", "nothing was recorded"), ("panel_condition", "plane only")]
)
def test_what_there_is_in_the_plane_alone_says_so(name, message):
    with pytest.raises(OptionError, match=message):
        getattr(Simulator(FISH), name)()


@pytest.mark.parametrize(("scene", "other"), [("fish_3d", "paper_i"), ("paper_i", "fish_3d")])
def test_a_start_of_the_other_dimension_is_refused(scene, other):
    simulator = Simulator(scene)
    with pytest.raises(SwimError, match="initial must be of class (Spatial)?Initial, got"):
        simulator.reset(load_scene(other).initial)


def test_a_start_needs_quaternions_of_unit_length():
    simulator = Simulator(FISH)
    coordinates = simulator.coordinates
    simulator.reset_to(coordinates, np.zeros(30))
    coordinates[3:7] *= 2.0
    with pytest.raises(SwimError, match="must have unit length, got .2.0, 1.0"):
        simulator.reset_to(coordinates, np.zeros(30))


@pytest.mark.parametrize("profile", ["uniform", "ellipsoid"])
@pytest.mark.parametrize("model", MODELS)
def test_two_elements_with_one_row_of_panels_and_limp_joints_move(profile, model):
    fluid = {"model": model} | ({} if model == "none" else {"density": 1000.0})
    scene = Scene.from_dict(
        {
            "dimension": 3,
            "beam": {
                "elements": 2,
                "section": {"profile": profile, "half_width": 0.05, "half_height": 0.08},
                "density": 1000.0,
                "lateral_stiffness": 0.0,
                "torsional_stiffness": 0.0,
            },
            "fluid": fluid | ({"rows": 1, "around": 8} if model in ("frozen", "panels") else {}),
            "integrator": {"time_step": 0.005},
        }
    )
    run = Simulator(scene).rollout(0.05 * random_torques(50)[:, :1])
    assert run.termination_reason == ""
    assert np.abs(run.momentum).max() < 1e-15
    assert np.ptp(run.joint_rotations, axis=0).min() > 1e-4


def test_steps_and_a_rollout_are_the_same_to_the_bit():
    one, many = Simulator(FISH), Simulator(FISH)
    torques = random_torques(20)
    for row in torques:
        one.step(row)
    run = many.rollout(torques)
    assert np.array_equal(one.coordinates, many.coordinates)
    assert np.array_equal(run.centres[-1], one.centres)
    assert np.array_equal(run.directors[-1], one.directors)
    assert np.array_equal(run.joint_rotations[-1], one.joint_rotations)
    assert np.array_equal(run.momentum[-1], one.momentum())
    assert run.energy[-1] == one.energy()
    assert run.time[-1] == one.time == 20 * 0.005


def test_evaluations_are_those_of_the_whole_residual():
    passes = Simulator(of_model("panels")).rollout(random_torques(10))
    assert (passes.evaluations < passes.iterations).all(), "most hold the shape force"
    whole = Simulator(FISH).rollout(random_torques(10))
    assert (whole.evaluations > whole.iterations).all()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("scheme", ["paper", "composed"])
def test_a_restored_run_continues_bit_for_bit(model, scheme):
    scene = of_model(model, **{"integrator.scheme": scheme})
    torques = random_torques(12)
    simulator = Simulator(scene)
    simulator.rollout(torques[:6])
    snapshot = pickle.loads(pickle.dumps(simulator.snapshot()))
    simulator.rollout(torques[6:])
    other = Simulator(scene)
    other.rollout(random_torques(3, seed=1))
    other.restore(snapshot)
    twin = copy.deepcopy(other)
    for one in (other, twin):
        one.rollout(torques[6:])
        assert np.array_equal(one.coordinates, simulator.coordinates)
        assert one.energy() == simulator.energy()


@pytest.mark.parametrize("model", MODELS)
def test_members_of_a_batch_are_single_bodies(model):
    scene = of_model(model)
    torques = np.stack([random_torques(6, seed) for seed in range(3)])
    batch = SpatialBodies(scene, 3)
    for member in range(3):
        batch.start(member, *spatial_start(scene, scene.initial))
    batch.advance(torques, 2, batch.new_record(12), threads=2)
    for member in range(3):
        single = Simulator(scene)
        single.rollout(np.repeat(torques[member], 2, axis=0))
        assert np.array_equal(batch.coordinates[member], single.coordinates)


def test_a_start_has_the_head_at_the_origin_and_turns_as_one():
    rotations = [[0.1, 0.2, -0.3]] * 8
    initial = SpatialInitial(
        velocity=(1.0, 0.0, 0.5), spin=(1.0, 2.0, 3.0), joint_rotations=rotations
    )
    simulator = Simulator(FISH)
    simulator.reset(initial)
    assert simulator.joint_rotations == pytest.approx(np.array(rotations), abs=1e-15)
    assert simulator.centres[0] - simulator.directors[0, :, 2] / 18 == pytest.approx(np.zeros(3))
    velocity = simulator.velocity()
    assert velocity[:3] == pytest.approx([1.0, 0.0, 0.5])
    assert velocity[3:].reshape(-1, 3) == pytest.approx(np.tile([1.0, 2.0, 3.0], (9, 1)))
    with pytest.raises(SwimError, match="one value per joint, 8, got 2"):
        simulator.reset(SpatialInitial(joint_rotations=rotations[:2]))


@pytest.mark.parametrize(
    ("torques", "message"),
    [
        (np.zeros((8, 2)), r"must have shape \(8, 3\), got \(8, 2\)"),
        (np.zeros(24), r"must have shape \(8, 3\), got \(24,\)"),
        (np.full((8, 3), np.nan), "must be finite, got nan at joint 0"),
        ("none", "must be numbers"),
    ],
)
def test_wrong_torques_are_refused(torques, message):
    simulator = Simulator(FISH)
    with pytest.raises(TorqueError, match=message):
        simulator.step(torques)
    assert simulator.steps == 0
    with pytest.raises(SwimError, match="39 finite numbers"):
        simulator.reset_to(np.zeros(3), np.zeros(30))


def test_a_run_that_bends_too_far_ends_with_its_reason():
    scene = FISH.replace({"beam.lateral_stiffness": 0.01, "damping": None})
    simulator = Simulator(scene)
    torques = np.zeros((400, 8, 3))
    torques[:, 4, 1] = 50.0
    run = simulator.rollout(torques)
    assert run.termination_reason == simulator.termination_reason == "outline_degenerate"
    assert 0 < run.steps < 400
    assert np.isfinite(run.centres).all()
    with pytest.raises(SimulationEndedError, match="outline_degenerate"):
        simulator.step(torques[0])


def test_replay_and_files(tmp_path):
    run, summary = replay(FISH, 0.5)
    assert summary["displacement"] == run.displacement.tolist()
    assert len(summary["displacement"]) == 3
    assert summary["trusted"]
    assert json.loads(json.dumps(summary))["steps"] == 100
    assert run.nodes.shape == (101, 10, 3)
    assert np.linalg.norm(np.diff(run.nodes, axis=1), axis=-1) == pytest.approx(1 / 9)
    assert np.array_equal(run.torques[:, :, [0, 2]], np.zeros((100, 8, 2))), "a wave of yaw"
    file = tmp_path / "run.npz"
    run.save(file)
    again = Trajectory.load(file)
    assert isinstance(again, SpatialTrajectory)
    assert again.scene == FISH
    for name in ("centres", "directors", "joint_rotations", "momentum", "torques", "energy"):
        assert np.array_equal(getattr(again, name), getattr(run, name)), name
    with np.load(file) as content:
        arrays = dict(content)
    arrays["directors"] = arrays["directors"][:, :4]
    np.savez(file, **arrays)
    with pytest.raises(TrajectoryError, match=r"directors must have shape \(101, 9, 3, 3\)"):
        Trajectory.load(file)


def test_heading_is_that_of_the_mean_directors():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert heading_of(np.stack([turn, turn])) == pytest.approx(turn)
    assert rotation_angle(turn) == pytest.approx(np.pi / 2)
    assert rotation_angle(np.diag([-1.0, -1.0, 1.0])) == pytest.approx(np.pi)


def test_neither_dimension_compiles_the_other():
    code = (
        "from swim_env import Simulator; Simulator({!r}); "
        "from swim_env.physics.spatial.equations import evaluate_spatial_step as spatial; "
        "from swim_env.physics.spatial.panels.mass import panel_added_mass as panels; "
        "from swim_env.physics.planar.equations import evaluate_step as planar; "
        "print(*(len(one.linked.compiled.overloads) for one in (planar, spatial, panels)))"
    )
    assert run_python("-c", code.format("paper_i")).out == "1 0 0\n"
    assert run_python("-c", code.format("fish_3d")).out == "0 1 0\n"
