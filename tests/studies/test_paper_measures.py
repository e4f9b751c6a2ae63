"""What the paper's study measures: rates, frequencies, moments, forces, means and maps."""

import math

import numpy as np
import pytest

from studies.kirchhoff import RigidMass, growth_rate, rigid_mass
from studies.paper.constants import (
    RESOLVED,
    internal_figures,
    internal_forces,
    joint_moments,
    momentum_figures,
    resolved,
)
from studies.paper.maps import LARGEST_BEND, is_verified
from studies.paper.modes import bending_orders, modes_figures
from studies.paper.onset import (
    PAPER_BODIES,
    PAPER_TIMES,
    fitted_rate,
    implied_rate,
    measure_onset,
    onset_by_kirchhoff,
    onset_units,
    perturbed,
    rate_for_onset,
)
from studies.paper.runs import first_crossing, played, run_figures
from studies.paper.variants import of_variant, with_halved_turning
from swim_env import load_scene
from swim_env.analysis.modes import mass_matrix, natural_frequencies
from swim_env.sim.simulator import Simulator


def test_a_sloped_start_turns_the_body_about_its_fifth_element():
    scene = perturbed(9, 4, 5.0, "sloped")
    velocities, rates = scene.initial.velocities(scene.beam)
    np.testing.assert_allclose(velocities[:, 1], (3.5 - np.arange(9) - 0.5) * 1e-5, atol=1e-18)
    np.testing.assert_allclose(rates, -9e-5)


@pytest.mark.parametrize("rate", [0.1, 0.35])
@pytest.mark.parametrize("start", [1e-3, 1e-9])
def test_a_rate_is_found_again(rate, start):
    time = np.linspace(0.0, 12.0 / rate, 3000)
    angle = start * (np.cosh(rate * time) - 1.0) - 0.3 * start * np.sinh(rate * time)
    found = fitted_rate(time, angle, 0.15)
    assert found == pytest.approx(rate, rel=2e-3)
    assert fitted_rate(time, 0.0 * angle, 0.15) is None


def test_pairs_of_the_papers_times_need_these_rates():
    found = [
        implied_rate(PAPER_TIMES[*body, "epsilon"], PAPER_TIMES[*body, "small"])
        for body in PAPER_BODIES.values()
    ]
    assert [round(one, 2) for one in found] == [0.81, 0.36, 0.35]


def test_a_short_onset_is_kirchhoffs():
    unit = next(one for one in onset_units() if one.name == "onset_small_3_12_5")
    figures, _ = measure_onset(unit)
    assert figures["time"] == pytest.approx(figures["expected"], rel=0.01)
    assert figures["rate"] == pytest.approx(figures["kirchhoff"], rel=0.02)


def test_frequencies_and_masses_are_those_that_are_known():
    scene = load_scene("paper_i")
    first, second = natural_frequencies(scene, 2)
    assert (round(first, 1), round(second, 1)) == (5.1, 15.7)
    mass = rigid_mass(mass_matrix(Simulator(scene)))
    assert mass.along == pytest.approx(0.31)
    assert mass.across == pytest.approx(0.31 + 10.0 * math.pi / 4.0, rel=0.08)
    assert growth_rate(mass, 0.1) == pytest.approx(0.1, rel=0.05)
    assert growth_rate(mass, 0.2) == pytest.approx(2.0 * growth_rate(mass, 0.1))
    assert bending_orders(scene)["order"] == pytest.approx(2.0, abs=0.05)
    # Finer panels beside them, for their error.
    found = modes_figures(scene)
    change = [abs(b / a - 1.0) for a, b in zip(found["frequencies"], found["fine"], strict=True)]
    assert len(change) == 3 and 1e-3 < max(change) < 0.03


def test_halved_turning_is_lighter_in_turning_alone():
    scene = of_variant(load_scene("paper_x"), "halved")
    whole = rigid_mass(mass_matrix(Simulator(scene)))
    halved = rigid_mass(mass_matrix(with_halved_turning(scene)))
    assert halved.across == pytest.approx(whole.across)
    assert 0.5 * whole.inertia < halved.inertia < 0.97 * whole.inertia


def test_moments_and_forces_balance_on_every_element():
    """Without a fluid: I theta'' = M_front - M_behind + dl/2 n.(F_front + F_behind)."""
    scene = load_scene(
        "paper_i",
        {
            "fluid": None,
            "internal_forces": {},
            "beam.rotary_inertia": 1e-3,
            "beam.bending_stiffness": 0.5,
            "damping.retardation_time": 0.002,
            "actuation.amplitude": 0.2,
            "integrator.time_step": 2e-4,
            "episode.duration": 0.4,
        },
    )
    run = played(Simulator(scene))
    assert run.internal_forces is not None
    dl, step = scene.beam.element_length, scene.integrator.time_step
    total = joint_moments(run)["total"]
    # A joint's moment turns what is behind it; both are means around the instant of the forces.
    at_node = 0.5 * (total[:-1] + total[1:])
    moments = np.pad(at_node, ((0, 0), (1, 1)))
    forces = np.pad(run.internal_forces[1:], ((0, 0), (1, 1), (0, 0)))
    angles = run.angles[1:-1]
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    # What is behind a joint pulls at what is in front of it by F.
    arms = 0.5 * dl * (normals * (forces[:, 1:] + forces[:, :-1])).sum(axis=-1)
    turning = moments[:, :-1] - moments[:, 1:] + arms
    second = np.diff(run.angles, n=2, axis=0) / step**2
    error = np.abs(dl * 1e-3 * second - turning)[5:].max()
    assert error < 0.02 * np.abs(total).max(), f"off by {error:.2g} N m"
    axial, shear = internal_forces(run)
    np.testing.assert_allclose(
        np.hypot(axial, shear), np.linalg.norm(run.internal_forces[1:], axis=-1), atol=1e-12
    )


def test_figures_of_a_run_are_means_over_seconds():
    run = played(Simulator(load_scene("paper_x", {"episode.duration": 3.0})))
    found = run_figures(run)
    assert len(found["path"]) == 3 and len(found["angle"]) == 4
    assert found["displacement"][0] == pytest.approx(0.2, rel=1e-3)
    assert found["speed"] == pytest.approx(0.1, rel=1e-3)
    assert found["left"] is None and found["end"] == ""
    kept = momentum_figures(run)
    assert 0.0 < kept["drift"] < 1e-12 and kept["share"] < 1.0


def test_a_crossing_lies_between_two_instants():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    assert first_crossing(time, np.array([0.0, 1.0, 3.0, 0.0]), 1.5) == pytest.approx(1.25)
    assert first_crossing(time, np.array([2.0, 3.0, 3.0, 3.0]), 1.5) == 0.0
    assert first_crossing(time, np.zeros(4), 1.5) is None


def test_what_steps_resolve_passes_and_the_rest_does_not():
    time = np.arange(0.0, 20.0, 0.01)[:, None]
    slow, fast = np.sin(2.0 * math.pi * time), np.sin(2.0 * math.pi * 30.0 * time)
    middle = slice(100, -100)
    np.testing.assert_allclose(
        resolved(slow + fast, 0.01)[middle], slow[middle], atol=2e-3, rtol=0.0
    )
    run = played(Simulator(load_scene("paper_i", {"internal_forces": {}, "episode.duration": 5.0})))
    found = internal_figures(run)
    axial, shear = internal_forces(run)
    whole = np.sqrt(np.mean(shear**2, axis=0))
    assert len(found["shear"]) == len(found["axial"]) == 8
    assert np.all(np.array(found["shear"]) < whole)
    assert found["peak_shear"] == pytest.approx(np.abs(shear).max())
    # Positive work counts the ringing, and what is spent on the slow motion does not.
    assert 0.0 < found["power"] < run.positive_work.sum() / run.duration
    # More than half of it rings above what is resolved.
    assert 0.5 < found["above"]["shear"] < 0.9 and RESOLVED < 10.0


def test_points_of_a_map_are_verified_or_not():
    good = {"speed": 0.01, "coarse": 0.0105, "panels": None, "checked": False, "bend": 0.1}
    good |= {"trusted": True}
    assert is_verified(good)
    for change in (
        *({"speed": None}, {"coarse": None}, {"coarse": 0.012}, {"trusted": False}),
        *({"bend": 2.0 * LARGEST_BEND}, {"checked": True}, {"checked": True, "panels": -0.01}),
    ):
        assert not is_verified({**good, **change}), change
    assert is_verified({**good, "checked": True, "panels": 0.0101, "bend": 2.0 * LARGEST_BEND})


def test_the_rate_that_a_time_of_onset_needs_is_the_rate_of_that_time():
    mass = RigidMass(0.31, 8.646, 0.2915, 0.0)
    rate = growth_rate(mass, 0.1)
    ours = onset_by_kirchhoff(mass, 0.1, 1e-4, 0.0, 1.0, 0.01)
    assert rate_for_onset(mass, 0.1, 1e-4, 1.0, 0.01, ours - 1e-3) == pytest.approx(rate, rel=1e-2)
    # The paper's times at N = 3 and 9.
    assert rate_for_onset(mass, 0.1, 1e-4, 1.0, 0.01, 2.13) == pytest.approx(0.51, abs=0.01)
    assert rate_for_onset(mass, 0.1, 1e-4, 1.0, 0.01, 4.4) == pytest.approx(0.24, abs=0.01)
