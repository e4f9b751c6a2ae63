"""Steps of the package meet the discrete Lagrangian's equations, written out independently."""

import numpy as np
import pytest

from swim_env import Simulator, load_scene
from swim_env.sim.spatial.constants import surface_of
from tests.analytic.spatial_probes import PanelProbe
from tests.invariants.runs import largest
from tests.invariants.spatial_runs import (
    SCHEMES,
    STRAINS,
    momenta,
    pose_of,
    random_scene,
    start_of,
)
from tests.reference.spatial import (
    Body,
    directors_of,
    energy_of,
    free_motions,
    increment,
    momenta_of,
    motions,
    parts_of,
    solve,
    unknowns_between,
)
from tests.support import Array, uniform

#: Of the largest momentum or impulse in the equations; the tolerance of the steps is 1e-12.
BOUND = 1e-11
SEEDS = range(6)


def _unmet(simulator: Simulator, body: Body, torques: Array) -> float:
    """Take a step; return by how much its equations are not met, as a share of their terms."""
    scene = simulator.scene
    q, p, mean = pose_of(simulator, body), momenta(simulator), simulator.coordinates[:3]
    simulator.step(torques)
    *first, last = parts_of(scene, body, torques)
    for part in first:
        dq, p = solve(part, q, p)
        q, mean = q + dq, (q + dq)[:, 0].mean(axis=0)
    after = simulator.coordinates[:3], simulator.directors
    dq = increment(q, unknowns_between(q, mean, *after), body.dl)
    along, ahead = free_motions(q, body.dl), free_motions(q + dq, body.dl)
    scale = np.abs(last.by_start(q, dq, along)).max()
    balance = last.balance(p, q, dq, along)
    change = momenta(simulator) - last.momenta_after(q, dq, ahead)
    return float(max(np.abs(balance).max(), np.abs(change).max()) / scale)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("strain", STRAINS)
def test_steps_meet_the_equations_of_the_discrete_lagrangian(scheme: str, strain: str) -> None:
    worst = 0.0
    for seed in SEEDS:
        scene = random_scene(seed, scheme, strain)
        body, rng = Body.of(scene), np.random.default_rng(seed)
        simulator = Simulator(scene)
        for _ in range(4):
            worst = max(worst, _unmet(simulator, body, rng.uniform(-2.0, 2.0, body.rest.shape)))
    print(f"{scheme}, {strain}: {worst:.1e} of the impulses")
    assert worst < BOUND


def test_the_start_has_the_momenta_of_its_velocity_and_the_energy_is_hamiltons() -> None:
    worst = 0.0
    for seed in SEEDS:
        scene = random_scene(seed, "paper", STRAINS[seed % 2])
        body = Body.of(scene)
        simulator = Simulator(scene)
        q, rate = start_of(scene, body)
        np.testing.assert_allclose(pose_of(simulator, body), q, rtol=0.0, atol=2e-15)
        p = momenta_of(q, rate, body, free_motions(q, body.dl))
        error = np.abs(momenta(simulator) - p).max() / np.abs(p).max()
        simulator.rollout(np.random.default_rng(seed).uniform(-2.0, 2.0, (5, *body.rest.shape)))
        energy = energy_of(pose_of(simulator, body), momenta(simulator), body)
        worst = max(worst, error, abs(simulator.energy() / energy - 1.0))
        space = np.cross(simulator.coordinates[:3], momenta(simulator)[:3])
        total = [momenta(simulator)[:3], space + momenta(simulator)[3:].reshape(-1, 3).sum(0)]
        np.testing.assert_allclose(simulator.momentum(), np.ravel(total), rtol=0.0, atol=1e-13)
    print(f"momenta of the start, energy: {worst:.1e}")
    assert worst < 1e-12


@pytest.mark.parametrize("name", ["eel_3d", "fish_3d", "helix_3d", "paper_i_3d"])
def test_shipped_bodies_have_the_inertia_and_the_strips_of_their_sections(name: str) -> None:
    start = {"velocity": [0.3, -0.2, 0.1], "spin": [1.0, -2.0, 3.0]}
    bend = uniform(load_scene(name).beam.elements - 1, 3, seed=4, size=0.2).tolist()
    scene = load_scene(
        name, {"fluid.model": "strip", "initial": {**start, "joint_rotations": bend}}
    )
    body = Body.of(scene)
    q, rate = start_of(scene, body)
    p = momenta_of(q, rate, body, free_motions(q, body.dl))
    simulator = Simulator(scene)
    error = largest(momenta(simulator) - p) / largest(p)
    error = max(error, abs(simulator.energy() / energy_of(q, p, body) - 1.0))
    print(f"{name}: {error:.1e}, {body.inertia[:, 0].sum():.3f} kg")
    assert error < 1e-13


def test_work_and_losses_of_a_step_are_those_of_the_joints_rotation_vectors() -> None:
    for seed in SEEDS:
        scene = random_scene(seed, SCHEMES[0], STRAINS[seed % 2])
        body = Body.of(scene)
        torques = uniform(20, *body.rest.shape, seed=seed, size=2.0)
        run = Simulator(scene).rollout(torques)
        assert (run.parts == 1.0).all()
        turned = np.diff(run.joint_rotations, axis=0)
        work = (torques * turned).sum(axis=(1, 2))
        loss = (body.damping * turned**2).sum(axis=(1, 2)) / scene.integrator.time_step
        np.testing.assert_allclose(run.work, work, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(run.dissipated, loss, rtol=0.0, atol=1e-13)


PANELS = {"fluid": {"model": "panels", "density": 1000.0, "rows": 1, "around": 8}}


def test_steps_with_panels_have_the_derivative_of_every_shapes_mass() -> None:
    """It is taken by differences here, of the added mass of the shapes to both sides."""
    worst = least = 0.0
    for seed in SEEDS[1::2]:  # bodies without flat ends
        scene = random_scene(seed, "paper", "averaged_directors", **PANELS)
        bare, simulator = Body.of(scene), Simulator(scene)
        probe = PanelProbe(surface_of(scene))
        rng = np.random.default_rng(seed)
        for _ in range(3):
            q, p, mean = pose_of(simulator, bare), momenta(simulator), simulator.coordinates[:3]
            body = bare._replace(added=probe.mass(np.ascontiguousarray(directors_of(q))))
            torques = rng.uniform(-2.0, 2.0, body.rest.shape)
            simulator.step(torques)
            after = simulator.coordinates[:3], simulator.directors
            dq = increment(q, unknowns_between(q, mean, *after), body.dl)
            along, ahead = free_motions(q, body.dl), free_motions(q + dq, body.dl)
            (step,) = parts_of(scene, body, torques)
            moved, width = motions(q, dq), 1e-5
            shape = np.zeros(len(p))
            for i in range(3, len(p)):
                turn = width * np.eye(len(p))[i]
                sides = []
                for sign in (1.0, -1.0):
                    # A turn about an axis of space, on the element's own axes.
                    own = sign * turn[3:].reshape(-1, 3)
                    own = np.einsum("kxi,kx->ki", directors_of(q), own)
                    there = q + increment(q, np.concatenate([turn[:3], own.ravel()]), body.dl)
                    sides.append(
                        moved @ probe.mass(np.ascontiguousarray(directors_of(there))) @ moved
                    )
                shape[i] = (sides[0] - sides[1]) / (4.0 * width * step.h)
            scale = largest(step.by_start(q, dq, along))
            balance = step.balance(p, q, dq, along) + shape
            change = momenta(simulator) - step.momenta_after(q, dq, ahead)
            worst = max(worst, largest(balance) / scale, largest(change) / scale)
            least = max(least, largest(shape) / scale)
    print(f"panels: {worst:.1e} of the impulses, to which the derivative adds {least:.1e}")
    assert least > 1e-4
    assert worst < 1e-8


def test_both_schemes_come_to_the_same_motion_with_panels() -> None:
    ends = {}
    for scheme, step in (("paper", 2e-4), ("paper", 1e-4), ("composed", 1e-4)):
        scene = random_scene(3, scheme, "averaged_directors", **PANELS)
        simulator = Simulator(scene.replace("integrator.time_step", step))
        run = simulator.rollout(np.zeros((round(0.2 / step), simulator.elements - 1, 3)))
        assert not run.termination_reason
        ends[scheme, step] = np.concatenate([run.centres[-1].ravel(), run.directors[-1].ravel()])
    coarse, fine, second = ends.values()
    first_order, left = largest(coarse - fine), largest(2.0 * fine - coarse - second)
    print(f"panels: first-order error {first_order:.1e}, {left:.1e} after extrapolation")
    assert first_order > 1e-5
    assert left < 0.05 * first_order
