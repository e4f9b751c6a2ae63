"""The parts of a run's energy: body, fluid and elastic, by hand and from the kernels."""

from typing import Any

import numpy as np
import pytest

from swim_env import OptionError, Simulator, SwimError, Trajectory, load_scene
from swim_env.analysis.energy import (
    elastic_energy,
    elastic_moments,
    split_energy,
    velocity_of_start,
)
from swim_env.scene import STRAIN_NAMES
from tests.support import refuses


@pytest.fixture(scope="module")
def run() -> Trajectory:
    simulator = Simulator("swimmer")
    return simulator.rollout(simulator.prescribed_torques(50))


@pytest.mark.parametrize("aside", [0.0, 0.05])
def test_the_parts_of_the_energy_are_those_of_rigid_motion(aside: float) -> None:
    """Half mass times speed squared; fluid moves where the straight body moves across itself."""
    scene = load_scene("paper_xi", {"initial.velocity": [0.1, aside]})
    simulator = Simulator(scene)
    start = simulator.velocity()
    run = simulator.rollout(np.zeros((3, scene.beam.elements - 1)))
    split = split_energy(run, start, [0])
    body = 0.5 * scene.beam.line_density * scene.beam.length * (0.1**2 + aside**2)
    assert split.body == pytest.approx([body], rel=1e-9)
    assert split.elastic == pytest.approx([0.0], abs=1e-15)
    assert split.fluid == pytest.approx([run.energy[0] - body], rel=1e-9)
    assert (split.fluid[0] > 0.1 * body) == (aside > 0.0)


@pytest.mark.parametrize("name", ["swimmer", "paper_i"])
def test_the_parts_of_the_energy_follow_the_velocities(name: str) -> None:
    """The body's part by hand from the simulator's velocities, the sum to the last digit."""
    scene = load_scene(name)
    instants = [0, 1, 7, 150, 300]
    simulator = Simulator(scene)
    run = Simulator(scene).rollout(simulator.prescribed_torques(300))
    split = split_energy(run, simulator.velocity(), instants)
    assert split.time == pytest.approx(run.time[instants])
    assert split.body + split.fluid + split.elastic == pytest.approx(run.energy[instants])
    assert split.elastic == pytest.approx(elastic_energy(run)[instants], rel=1e-12)
    mass = scene.beam.line_density * scene.beam.element_length
    inertia = scene.beam.rotary_inertia * scene.beam.element_length
    half = 0.5 * scene.beam.element_length
    for row, instant in enumerate(instants):
        while simulator.steps < instant:
            simulator.step(run.torques[simulator.steps])
        rates = simulator.velocity()
        turning = rates[2:]
        normals = np.stack([-np.sin(simulator.angles), np.cos(simulator.angles)], axis=-1)
        arms = half * turning[:, None] * normals
        speeds = np.concatenate([[np.zeros(2)], np.cumsum(arms[:-1] + arms[1:], axis=0)])
        speeds += rates[:2] - speeds.mean(axis=0)
        by_hand = 0.5 * mass * (speeds**2).sum() + 0.5 * inertia * (turning**2).sum()
        assert split.body[row] == pytest.approx(by_hand, rel=1e-9, abs=1e-15)
        assert split.fluid[row] >= 0.0


@pytest.mark.parametrize("strain", STRAIN_NAMES)
def test_elastic_energy_is_that_of_the_body_at_rest(strain: str) -> None:
    """The formula is that of the kernels, for every law of strain and varying stiffness."""
    scene = load_scene(
        "swimmer",
        {"integrator.strain": strain, "beam.bending_stiffness": list(np.linspace(1.0, 5.0, 8))},
    )
    simulator = Simulator(scene)
    joint_angles = np.linspace(-0.3, 0.4, 8)
    simulator.reset_to(np.concatenate([np.zeros(3), joint_angles]), np.zeros(11))
    moments, energies = elastic_moments(scene, joint_angles)
    assert energies.sum() == pytest.approx(simulator.energy(), rel=1e-12)
    assert (np.sign(moments) == np.sign(joint_angles)).all()
    assert elastic_energy(simulator.rollout(np.zeros((1, 8))))[0] == pytest.approx(energies.sum())


def test_the_velocity_of_a_saved_start_is_the_scenes_or_unknown(run: Trajectory) -> None:
    assert velocity_of_start(run) == pytest.approx(np.zeros(11))
    simulator = Simulator(run.scene)
    simulator.reset_to(simulator.coordinates, np.full(11, 0.1))
    assert velocity_of_start(simulator.rollout(np.zeros((5, 8)))) is None
    simulator.reset_to(np.full(11, 0.1), np.zeros(11))
    assert velocity_of_start(simulator.rollout(np.zeros((5, 8)))) is None


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        # The last step was taken and is the last that may be.
        (
            "paper_i",
            {"integrator.energy_tolerance": 1e-9, "integrator.energy_excess": "end"},
            "energy_unexplained",
        ),
        ("swimmer", {"fluid": None}, ""),
    ],
)
def test_the_energy_is_split_to_the_end_of_a_run(
    name: str, changes: dict[str, Any], reason: str
) -> None:
    simulator = Simulator(load_scene(name, changes))
    start = simulator.velocity()
    run = simulator.rollout(simulator.prescribed_torques(50))
    assert run.termination_reason == reason
    split = split_energy(run, start)
    assert split.body + split.fluid + split.elastic == pytest.approx(run.energy, rel=1e-12)
    if "fluid" in changes:
        assert split.fluid == pytest.approx(np.zeros(51), abs=1e-12)


def test_another_velocity_than_the_starts_is_refused(run: Trajectory) -> None:
    with pytest.raises(SwimError, match="not the one that the run started with"):
        split_energy(run, np.full(11, 0.3), [0, 20])


def test_a_run_from_the_middle_of_another_is_split_within_its_scenes_tolerance():
    """Its first steps were guessed from those before it; played again they err within tolerance."""
    loose = {"integrator.tolerance": 1e-4, "integrator.scheme": "composed"}
    simulator = Simulator(load_scene("paper_i", loose))
    simulator.rollout(simulator.prescribed_torques(20))
    start = simulator.velocity()
    run = simulator.rollout(simulator.prescribed_torques(30))
    again = Simulator(run.scene)
    again.reset_to(np.concatenate([run.path[0], run.angles[0, :1], np.diff(run.angles[0])]), start)
    replayed = again.rollout(run.torques)
    assert 1e-6 < np.abs(np.diff(replayed.angles - run.angles, axis=1)).max() < 1e-5
    split = split_energy(run, start)
    assert split.body + split.fluid + split.elastic == pytest.approx(run.energy, rel=1e-12)
    for off in (1.0, -1.0):
        with pytest.raises(SwimError, match="not the one that the run started with"):
            split_energy(run, start + off * 1e-3)


def test_angles_and_instants_of_another_run_are_refused():
    """A joint's angle would be taken for every joint's, and a negative instant for a late one."""
    scene = load_scene("swimmer")
    for shape in ((), (1,), (5, 1), (5, 9)):
        with refuses(OptionError, "joint_angles must have shape (..., 8) in scene swimmer"):
            elastic_moments(scene, np.zeros(shape))
    simulator = Simulator(scene)
    start = simulator.velocity()
    run = simulator.rollout(np.zeros((3, 8)))
    for instants in ([-1], [0, 4], [1.0], [True]):
        with refuses(OptionError, "instants must be whole numbers of 0 to 3"):
            split_energy(run, start, instants)
