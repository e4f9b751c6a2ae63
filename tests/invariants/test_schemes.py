"""The composed scheme beside the paper's, and the three ways of measuring strain."""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swim_env import Scene, SimulationEndedError, Simulator, load_scene
from tests.analytic.probes import StepProbe
from tests.analytic.test_derivatives import (
    STEPS,
    Step,
    differentiate,
    generalised_impulse,
    reference_derivatives,
)
from tests.invariants.runs import STRAINS, VIOLENT, each_scheme, each_strain, orders
from tests.support import held_torques, rollout

Array = NDArray[np.float64]

TOLERANCE = 1e-13
#: Those that soften with the angle, of which the one is the limit of the other.
SOFT_STRAINS = STRAINS[:2]

#: Everything that enters the equations of a step.
CASES: dict[str, dict[str, object]] = {
    "plain": {},
    "damped": {"damping.retardation_time": 0.005},
    "drag": {"cross_flow_drag.coefficient": 2.0},
    "axial": {"axial_added_mass": {}},
    "strip": {"fluid.model": "strip"},
    "frozen": {"fluid.model": "frozen"},
    "all": {
        "damping.retardation_time": 0.005,
        "cross_flow_drag.coefficient": 2.0,
        "axial_added_mass": {},
        "stream.velocity": (0.1, 0.05),
    },
}
each_case = pytest.mark.parametrize("case", CASES)

#: What of it can be run backwards, and the beam without a fluid.
REVERSIBLE: dict[str, dict[str, object]] = {
    "panels": {},
    "axial": {"axial_added_mass": {}},
    "expansion": {"fluid.model": "expansion"},
    "frozen": {"fluid.model": "frozen"},
    "strip": {"fluid.model": "strip"},
    "none": {"fluid": None, "beam.rotary_inertia": 1e-3},
}


def _scene(scheme: str, strain: str, changes: dict[str, object], base: str = "paper_i") -> Scene:
    """Return a scene that differs from a shipped one; of three soft elements if that is i."""
    soft = {"beam.elements": 3, "beam.bending_stiffness": 0.5, "actuation.amplitude": 0.2}
    return load_scene(
        base,
        {
            **(soft if base == "paper_i" else {}),
            "integrator.tolerance": TOLERANCE,
            "integrator.scheme": scheme,
            "integrator.strain": strain,
            **changes,
        },
    )


#: The body of the paper's scene i again; its highest modes are not resolved at 0.01 s.
NINE_STIFF: dict[str, object] = {"beam.elements": 9, "beam.bending_stiffness": 5.0}


# ---- order -------------------------------------------------------------------------------------

DURATION = 2.0
INSTANTS = 20
#: Steps in the whole run, 0.02 s to 0.00125 s each.
COARSE_TO_FINE = (100, 200, 400, 800, 1600)


@functools.cache
def _run(case: str, scheme: str, strain: str, steps: int) -> tuple[dict[str, Array], float]:
    """Return path, angles and energy at common instants, and the error of the energy's balance."""
    changes = {**CASES[case], "integrator.time_step": DURATION / steps}
    simulator = Simulator(_scene(scheme, strain, changes))
    trajectory = simulator.rollout(simulator.prescribed_torques(steps))
    assert trajectory.steps == steps, trajectory.termination_reason
    assert (trajectory.parts == 1).all(), "steps were cut"
    every = slice(None, None, steps // INSTANTS)
    found = {
        "path": trajectory.path[every],
        "angles": trajectory.angles[every],
        "energy": trajectory.energy[every],
    }
    assert np.abs(np.diff(found["angles"], axis=1)).max() > 0.15, "hardly bends"
    return found, trajectory.summary()["energy_drift"]


def _limit(case: str, strain: str) -> dict[str, Array]:
    """Extrapolate the two finest composed runs, whose error falls by four."""
    (one, _), (other, _) = (_run(case, "composed", strain, n) for n in COARSE_TO_FINE[-2:])
    return {name: (4.0 * other[name] - one[name]) / 3.0 for name in one}


@each_strain
@each_case
def test_composed_steps_are_of_second_order(case: str, strain: str) -> None:
    runs = [_run(case, "composed", strain, n) for n in COARSE_TO_FINE]
    sizes = np.log2(DURATION / np.array(COARSE_TO_FINE))
    for name in ("path", "angles", "energy"):
        pairs = itertools.pairwise(run[name] for run, _ in runs)
        changes = np.array([np.abs(b - a).max() for a, b in pairs])
        slope = np.polyfit(sizes[:-1], np.log2(changes), 1)[0]
        last = np.log2(changes[-2] / changes[-1])
        text = f"{name}: slope {slope:.3f}, of the last three {last:.3f}, changes {changes}"
        assert abs(slope - 2.0) < 0.1, text
        assert abs(last - 2.0) < 0.02, text
    balance = np.array([drift for _, drift in runs])
    slope = np.polyfit(sizes, np.log2(balance), 1)[0]
    text = f"balance of the energy: slope {slope:.3f}, errors {balance}"
    assert abs(slope - 2.0) < 0.1, text
    # A thousandth of the energy at the coarsest step: the slope is not one of something large.
    assert balance[0] < 1e-3, text


@pytest.mark.parametrize(
    ("case", "strain"),
    [*((case, STRAINS[0]) for case in CASES), ("plain", STRAINS[1]), ("plain", STRAINS[2])],
)
def test_the_papers_steps_are_of_first_order_and_have_the_same_limit(
    case: str, strain: str
) -> None:
    limit = _limit(case, strain)
    one, other = (_run(case, "paper", strain, n)[0] for n in (3200, 6400))
    for name, wanted in limit.items():
        errors = [float(np.abs(run[name] - wanted).max()) for run in (one, other)]
        order = np.log2(errors[0] / errors[1])
        assert abs(order - 1.0) < 0.1, f"{name}: order {order:.3f}, errors {errors}"
        # The part of first order taken off, a tenth is left, of second order.
        left = float(np.abs(2.0 * other[name] - one[name] - wanted).max())
        assert left < 0.15 * errors[1], f"{name}: limits differ by {left:.2g}, errors {errors}"


@each_case
def test_both_strains_have_the_same_limit(case: str) -> None:
    finest = {
        strain: _run(case, "composed", strain, COARSE_TO_FINE[-1])[0] for strain in SOFT_STRAINS
    }
    limits = {strain: _limit(case, strain) for strain in SOFT_STRAINS}
    for name in ("path", "angles", "energy"):
        apart = float(np.abs(np.subtract(*(finest[one][name] for one in SOFT_STRAINS))).max())
        in_limit = float(np.abs(np.subtract(*(limits[one][name] for one in SOFT_STRAINS))).max())
        # The terms of fourth order that extrapolation leaves.
        assert in_limit < 0.01 * apart, f"{name}: {in_limit:.2g} in the limit, {apart:.2g} before"
        assert apart > 1e-8, f"{name}: {apart:.2g}, hardly two strains"


# ---- the adjoint, and symmetry in time ---------------------------------------------------------

BENT: dict[str, object] = {
    "initial": {"joint_angles": (0.5, -0.3), "velocity": (0.2, 0.1), "heading": 0.7},
    "integrator.time_step": 0.01,
}


@each_strain
@pytest.mark.parametrize("case", REVERSIBLE)
def test_a_step_is_half_a_step_of_the_papers_and_one_that_the_papers_takes_back(
    case: str, strain: str
) -> None:
    changes = {**BENT, **REVERSIBLE[case]}
    composed = Simulator(_scene("composed", strain, changes))
    half = Simulator(_scene("paper", strain, {**changes, "integrator.time_step": 0.005}))
    torques = np.array([0.15, -0.2])
    composed.step(torques)
    half.step(torques)
    there, speed = half.coordinates, half.velocity()
    half.reset_to(composed.coordinates, -composed.velocity())
    half.step(torques)
    assert np.abs(composed.coordinates - there).max() > 1e-3, "hardly moves"
    # What the tolerance leaves of momenta below 1, over masses above 0.01, is some 1e-11.
    gap = float(np.abs(half.coordinates - there).max())
    assert gap < 1e-12, f"{case}: back to the middle but for {gap:.2g}"
    gap = float(np.abs(half.velocity() + speed).max() / np.abs(speed).max())
    assert gap < 1e-11, f"{case}: velocity there off by {gap:.2g}"


def _there_and_back(scene: Scene, steps: int, driven: bool) -> tuple[float, float]:
    """Run, turn the velocity round, and run as long; return how far it ends from the start."""
    simulator = Simulator(scene)
    start, speed = simulator.coordinates, simulator.velocity()
    torques = held_torques(scene, steps, 6, 0.15 if driven else 0.0)
    there = simulator.rollout(torques)
    turned = simulator.coordinates
    simulator.reset_to(turned, -simulator.velocity())
    back = simulator.rollout(torques[::-1])
    for run in (there, back):
        assert run.steps == steps, run.termination_reason
        assert (run.parts == 1).all(), "steps were cut"
    assert np.abs(turned - start).max() > 0.1, "hardly moves"
    scale = float(np.abs(speed).max())
    gap = float(np.abs(simulator.coordinates - start).max())
    return gap, float(np.abs(simulator.velocity() + speed).max()) / scale


@pytest.mark.parametrize("driven", [False, True], ids=["passive", "driven"])
@each_strain
@pytest.mark.parametrize("case", REVERSIBLE)
def test_the_composed_scheme_runs_back_to_its_start(case: str, strain: str, driven: bool) -> None:
    scene = _scene("composed", strain, {**BENT, **REVERSIBLE[case]})
    place, speed = _there_and_back(scene, 100, driven)
    # 200 steps to a tolerance of 1e-13, whose errors the motion carries on. Found: 3e-12 m and 1e-9
    # of the velocity without a fluid, where the mass is small; 1e-14 m and 1e-11 with one.
    assert place < 1e-10, f"{case}: {place:.2g} from the start"
    assert speed < 1e-8, f"{case}: velocity off by {speed:.2g} of it"


@each_strain
def test_the_papers_scheme_does_so_without_a_fluid_only(strain: str) -> None:
    for case, changes in REVERSIBLE.items():
        place, _ = _there_and_back(_scene("paper", strain, {**BENT, **changes}), 100, False)
        if case == "none":
            assert place < 1e-10, f"{case}: {place:.2g} from the start"
        else:
            assert place > 1e-3, f"{case}: {place:.2g} from the start"


def test_a_symmetric_scheme_has_even_orders_only() -> None:
    # Extrapolated once, the error falls by sixteen; in a scheme with odd terms by eight.
    runs = [_run("all", "composed", "averaged_directors", n)[0]["angles"] for n in COARSE_TO_FINE]
    better = [(4.0 * b - a) / 3.0 for a, b in itertools.pairwise(runs)]
    changes = [float(np.abs(b - a).max()) for a, b in itertools.pairwise(better)]
    observed = orders(changes)
    assert np.abs(observed - 4.0).max() < 0.3, f"orders {observed}, changes {changes}"


@pytest.mark.parametrize("name", STEPS)
def test_the_adjoints_equations_are_those_of_the_lagrangian_from_end_to_start(name: str) -> None:
    # L_d*(q_n, q_{n+1}) is L_d with the pose at the other end: each derivative is the other one.
    step = STEPS[name]()
    reverse = step._replace(q=step.q + step.z)
    second, first = reference_derivatives(reverse, -step.z)
    found = step.probe(adjoint=True)
    force = generalised_impulse(step, step.z)
    scale = float(np.abs(first).max())
    error = float(np.abs(found.residual - (step.p + first + 0.5 * force)).max()) / scale
    assert error < 1e-12, f"{name}: p + D1 L_d* + h F/2 off by {error:.1e} of |D1 L_d*|"
    error = float(np.abs(found.change - (first + second + force)).max()) / scale
    assert error < 1e-12, f"{name}: D1 L_d* + D2 L_d* + h F off by {error:.1e} of |D1 L_d*|"
    gap = float(np.abs(found.residual - step.probe().residual).max()) / scale
    assert (gap > 1e-3) == (name != "no fluid"), f"{name}: adjoint and itself differ by {gap:.1e}"


# ---- Newton's matrices -------------------------------------------------------------------------


def _with_strain(step: Step, strain: str) -> Step:
    beam = step.beam._replace(
        strain_of_angles=strain != "averaged_directors", linear_strain=strain == "joint_angle"
    )
    return step._replace(beam=beam)


@each_strain
@pytest.mark.parametrize("name", STEPS)
def test_the_poses_matrix_is_newtons_at_a_vanishing_increment(name: str, strain: str) -> None:
    step = _with_strain(STEPS[name](), strain)
    still = step._replace(z=np.zeros(len(step.z)))
    scale = float(np.abs(still.probe().pose).max())
    for adjoint in (False, True):
        found = still.probe(adjoint=adjoint)
        error = float(np.abs(found.pose - found.jacobian).max()) / scale
        assert error < 1e-14, f"{name}, adjoint {adjoint}: off by {error:.1e}"
    # It is not of use because the increment does not matter.
    moved = step.probe()
    gap = float(np.abs(moved.pose - moved.jacobian).max()) / scale
    assert gap > 1e-4, f"{name}: an increment changes it by {gap:.1e} only"


@each_strain
@pytest.mark.parametrize("name", STEPS)
def test_the_poses_matrix_is_off_in_proportion_to_the_increment(name: str, strain: str) -> None:
    step = _with_strain(STEPS[name](), strain)
    errors = []
    for size in (1e-2, 1e-3):
        found = step._replace(z=size * step.z).probe()
        errors.append(float(np.abs(found.pose - found.jacobian).max()))
    order = np.log10(errors[0] / errors[1])
    assert abs(order - 1.0) < 0.05, f"{name}: order {order:.3f}, errors {errors}"


def _elastic(step: Step) -> StepProbe:
    """Return what the stiffness adds."""
    loose = step.beam._replace(joint_stiffness=np.zeros_like(step.beam.joint_stiffness))
    pairs = zip(step.probe(), step._replace(beam=loose).probe(), strict=True)
    return StepProbe(*(one - other for one, other in pairs))


@pytest.mark.parametrize("strain", STRAINS[1:])
@pytest.mark.parametrize("name", STEPS)
def test_the_strain_of_angles_is_that_of_the_mean_over_dl(name: str, strain: str) -> None:
    step = _with_strain(STEPS[name](), strain)
    found = _elastic(step)
    n = len(step.z)
    start = np.cumsum(step.q[2:])
    end = np.cumsum((step.q + step.z)[2:])
    exact = np.zeros((2, n))
    for j in range(n - 2):
        for which in range(2):
            angles = np.array([start, end], dtype=complex)
            angles[which, j] += 1e-30j
            bend = np.diff(angles.mean(axis=0))
            measure = bend if strain == "joint_angle" else np.sin(bend)
            # h W = h dl/2 sum EI K^2, and the joints' stiffness is EI/dl.
            weight = 0.5 * step.h * (step.beam.joint_stiffness * measure**2).sum()
            exact[which, 2 + j] = -weight.imag / 1e-30
    scale = float(np.abs(exact).max())
    # Differences of residuals whose terms are some hundred times as large.
    error = float(np.abs(found.residual - exact[0]).max()) / scale
    assert error < 1e-12, f"{name}: - h dW/dq at the start off by {error:.1e}"
    error = float(np.abs(found.change - exact.sum(axis=0)).max()) / scale
    assert error < 1e-12, f"{name}: both ends' sum off by {error:.1e}"


@each_strain
@pytest.mark.parametrize("name", STEPS)
def test_the_elastic_part_of_newtons_matrix_is_the_derivative(name: str, strain: str) -> None:
    step = _with_strain(STEPS[name](), strain)
    found = _elastic(step).jacobian
    exact = -differentiate(lambda z: _elastic(step._replace(z=z)).residual, step.z)
    error = float(np.abs(found - exact).max() / np.abs(exact).max())
    assert error < 1e-10, f"{name}: off by {error:.1e}"


# ---- Newton's method, cut steps, steps that fail -----------------------------------------------


@each_scheme
@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_the_residual_is_met(scheme: str, tolerance: float) -> None:
    changes: dict[str, object] = {"integrator.tolerance": tolerance}
    scene = _scene(scheme, "averaged_directors", changes, base="swimmer")
    trajectory = rollout(scene, held_torques(scene, 300, 9))
    worst = float(trajectory.residual.max())
    assert worst <= tolerance, f"residual {worst:.2g}"
    assert worst > 0.0


@each_scheme
def test_a_residual_that_rounding_keeps_up_is_reported(scheme: str) -> None:
    scene = _scene(scheme, "averaged_directors", {**NINE_STIFF, "fluid": None})
    trajectory = rollout(scene, held_torques(scene, 100, 3))
    above = trajectory.residual > TOLERANCE
    assert above.any(), "rounding met the tolerance everywhere"
    silent = int((above & (trajectory.at_round_off == 0.0)).sum())
    assert silent == 0, f"{silent} of {int(above.sum())} steps say nothing of it"


@each_strain
@pytest.mark.parametrize("case", ["plain", "all"])
def test_a_step_whose_second_half_fails_is_two_of_half_the_length(case: str, strain: str) -> None:
    changes = {**CASES[case], "initial.velocity": (0.2, 0.1), "integrator.time_step": 0.02}
    shorter = {**changes, "integrator.time_step": 0.01}
    whole = Simulator(_scene("composed", strain, changes))
    first_half = Simulator(_scene("paper", strain, shorter))
    halves = Simulator(_scene("composed", strain, shorter))
    # In the second half of the step the elements would turn by more than half a radian.
    violent = np.array([10.0, -10.0])
    one = first_half.rollout(violent[None])
    assert one.parts.tolist() == [1.0], "the first half was to be taken"
    cut = whole.rollout(violent[None])
    two = halves.rollout(np.tile(violent, (2, 1)))
    assert cut.parts.tolist() == [2.0]
    assert two.parts.tolist() == [1.0, 1.0]
    # Nothing of the half that was taken back is left, to the bit.
    assert np.array_equal(whole.coordinates, halves.coordinates)
    assert np.array_equal(whole.momentum(), halves.momentum())
    assert whole.energy() == halves.energy()
    for name in ("work", "dissipated", "impulse"):
        apart = np.abs(getattr(cut, name).sum(axis=0) - getattr(two, name).sum(axis=0))
        gap = float(np.max(apart))
        assert gap < 1e-13 * float(two.work.sum()), f"{name} differs by {gap:.2g}"
    assert cut.residual[0] == two.residual.max()


CUT: dict[str, object] = {"initial.velocity": (0.2, 0.1), "integrator.time_step": 0.01}


def _state(simulator: Simulator) -> list[Any]:
    return [
        simulator.coordinates.tolist(),
        simulator.velocity().tolist(),
        simulator.momentum().tolist(),
        simulator.energy(),
        simulator.steps,
    ]


@each_scheme
@each_strain
def test_a_step_that_fails_leaves_the_state_as_it_was(scheme: str, strain: str) -> None:
    scene = _scene(scheme, strain, CUT, base="swimmer")
    torques = held_torques(scene, 40, 12)
    simulator = Simulator(scene)
    simulator.rollout(torques[:20])
    kept, before = simulator.snapshot(), _state(simulator)
    # This turns the elements too far in every part of a step, however short.
    with pytest.raises(SimulationEndedError):
        simulator.step(1e6 * VIOLENT)
    assert _state(simulator) == before
    # Nothing of it is left in the work space either.
    simulator.restore(kept)
    after = simulator.rollout(torques[20:])
    calm = Simulator(scene)
    wanted = calm.rollout(torques)
    assert np.array_equal(after.centres, wanted.centres[20:])
    assert np.array_equal(after.energy, wanted.energy[20:])
    assert simulator.snapshot() == calm.snapshot()


@each_scheme
def test_a_step_into_a_fold_ends_the_run_at_its_beginning(scheme: str) -> None:
    # Both outer elements turn towards the middle one until the outline gives out in a step.
    changes: dict[str, object] = {"beam.bending_stiffness": 0.0, "initial.joint_angles": 1.0}
    simulator = Simulator(_scene(scheme, "averaged_directors", changes))
    simulator.reset_to(simulator.coordinates, [0.0, 0.0, -4.0, 0.0, 4.0])
    with pytest.raises(SimulationEndedError) as caught:
        for _ in range(200):
            before = _state(simulator)
            simulator.step(np.zeros(2))
    assert simulator.steps > 2
    assert _state(simulator) == before
    assert caught.value.reason in ("outline_degenerate", "under_resolved_gap")


# ---- the strain of mean angles -----------------------------------------------------------------


@functools.cache
def _frequency(strain: str, amplitude: float, step: float) -> tuple[float, float]:
    """Return the frequency (1/s) of two hinged elements, and the joint's largest turn in a step."""
    simulator = Simulator(
        load_scene(
            "paper_i",
            {
                "fluid": None,
                "actuation": None,
                "beam.elements": 2,
                "beam.bending_stiffness": 0.1,
                "beam.rotary_inertia": 1e-3,
                "initial.joint_angles": amplitude,
                "integrator": {"time_step": step, "tolerance": 1e-12, "strain": strain},
            },
        )
    )
    trajectory = simulator.rollout(np.zeros((round(25.0 / step), 1)))
    assert (trajectory.parts == 1).all(), "steps were cut"
    joint = np.diff(trajectory.angles, axis=1)[:, 0]
    up = np.flatnonzero((joint[:-1] < 0.0) & (joint[1:] >= 0.0))
    crossings = trajectory.time[up] - step * joint[up] / (joint[up + 1] - joint[up])
    cycles = len(crossings) - 1
    assert cycles > 80, f"{cycles} cycles"
    return cycles / float(crossings[-1] - crossings[0]), float(np.abs(np.diff(joint)).max())


@pytest.mark.parametrize("step", [0.004, 0.008])
def test_averaged_directors_soften_as_their_factors_say(step: float) -> None:
    # The elements turn by d/2 each where the joint turns by d, so W takes a factor
    # cos(d/4)^4 = 1 - d^2/8. That adds k a^2 d^2/16 to the discrete Lagrangian, as an inertia that
    # is larger by a^2 (omega h)^2/8 would, and lowers the frequency of a small amplitude by d^2/32
    # for the largest d. Found: 3 % less at an amplitude of 0.1 rad.
    averaged, turn = _frequency("averaged_directors", 0.1, step)
    plain, _ = _frequency("mean_angles", 0.1, step)
    wanted = -(turn**2) / 32.0
    found = averaged / plain - 1.0
    assert abs(found / wanted - 1.0) < 0.05, f"{found:.3e} lower, not {wanted:.3e}"


def test_averaged_directors_are_softer_the_further_a_joint_turns_in_a_step() -> None:
    lower, turns = [], []
    for step in (0.008, 0.016, 0.032):
        averaged, turn = _frequency("averaged_directors", 0.4, step)
        plain, _ = _frequency("mean_angles", 0.4, step)
        lower.append(1.0 - averaged / plain)
        turns.append(turn)
    text = f"lower by {lower}, turns {turns} rad"
    # With the square of the step, roughly at last, and visibly at 0.3 rad a step.
    assert turns[-1] > 0.3, text
    assert lower[-1] > 1.5e-3, text
    assert 3.0 < lower[1] / lower[0] < 5.0, text
    assert 2.0 < lower[2] / lower[1] < 5.0, text


# ---- torques -----------------------------------------------------------------------------------


def test_prescribed_torques_of_the_composed_scheme_are_those_of_the_middle_of_a_step() -> None:
    changes: dict[str, object] = {
        "actuation.end_time": 0.5,
        "actuation.active_until": 0.6,
        "actuation.phase": 0.3,
    }
    for scheme, into in (("paper", 0.0), ("composed", 0.5)):
        scene = _scene(scheme, "averaged_directors", changes, base="swimmer")
        simulator = Simulator(scene)
        h = scene.integrator.time_step
        taken = 7
        simulator.rollout(simulator.prescribed_torques(taken))
        found = simulator.prescribed_torques(120)
        place = scene.beam.joint_fractions
        for n, row in enumerate(found):
            t = (taken + n + into) * h
            wave = np.cos(2.0 * np.pi * (t - place) + 0.3)
            wanted = np.where((place <= 0.6) & (t < 0.5), wave, 0.0)
            assert np.abs(row - wanted).max() < 1e-13, f"{scheme}: step {taken + n}"
        assert found[0].any() and not found[-1].any()
