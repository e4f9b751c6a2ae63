"""The composed scheme beside the paper's, and the three ways of measuring strain."""

import functools
import itertools

import numpy as np
import pytest

from swim_env import Scene, SimulationEndedError, Simulator, load_scene
from swim_env.physics.solve.state import KNOWN_INCREMENTS, PARTS
from swim_env.sim.batch import Bodies, minimal_start
from tests.analytic.probes import StepProbe
from tests.analytic.test_derivatives import (
    STEPS,
    Step,
    differentiate,
    generalised_impulse,
    reference_derivatives,
)
from tests.invariants.runs import (
    STRAINS,
    VIOLENT,
    each_scheme,
    each_strain,
    largest,
    orders,
    passive,
    with_scheme,
)
from tests.support import Array, assert_same, held_torques, rollout

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
    own = {"integrator.tolerance": TOLERANCE, **(soft if base == "paper_i" else {})}
    return load_scene(base, {**own, **with_scheme(scheme, strain), **changes})


# ---- order -------------------------------------------------------------------------------------

DURATION = 2.0
INSTANTS = 20
#: Steps in the whole run, 0.02 s to 0.00125 s each.
COARSE_TO_FINE = (100, 200, 400, 800, 1600)


@functools.cache
def _run(case: str, scheme: str, strain: str, steps: int) -> tuple[dict[str, Array], float]:
    """Return path, angles and energy at common instants, and the error of the energy's balance."""
    changes = {**CASES[case], "integrator.time_step": DURATION / steps}
    scene = _scene(scheme, strain, changes)
    run = rollout(scene, Simulator(scene).prescribed_torques(steps))
    assert (run.parts == 1).all(), "steps were cut"
    every = steps // INSTANTS
    found = {name: getattr(run, name)[::every] for name in ("path", "angles", "energy")}
    assert largest(np.diff(found["angles"], axis=1)) > 0.15, "hardly bends"
    return found, run.summary()["energy_drift"]


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
    one, other = (_run(case, "composed", strain, COARSE_TO_FINE[-1])[0] for strain in SOFT_STRAINS)
    limit, other_limit = (_limit(case, strain) for strain in SOFT_STRAINS)
    for name in ("path", "angles", "energy"):
        apart = largest(one[name] - other[name])
        in_limit = largest(limit[name] - other_limit[name])
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
    assert largest(half.coordinates - there) < 1e-12
    assert largest(half.velocity() + speed) < 1e-11 * largest(speed)


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


@each_strain
@pytest.mark.parametrize("case", REVERSIBLE)
def test_the_composed_scheme_runs_back_to_its_start(case: str, strain: str) -> None:
    changes = {**BENT, **REVERSIBLE[case]}
    for driven in (False, True):
        place, speed = _there_and_back(_scene("composed", strain, changes), 100, driven)
        # 200 steps to a tolerance of 1e-13, whose errors the motion carries on. Found: 3e-12 m and
        # 1e-9 of the velocity without a fluid, where the mass is small; 1e-14 m and 1e-11 with one.
        assert place < 1e-10, f"{place:.2g} from the start"
        assert speed < 1e-8, f"velocity off by {speed:.2g} of it"
    # The paper's scheme does so without a fluid only.
    place, _ = _there_and_back(_scene("paper", strain, changes), 100, False)
    assert (place < 1e-10) if case == "none" else (place > 1e-3), f"{place:.2g} from the start"


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
    assert largest(found.residual - (step.p + first + 0.5 * force)) < 1e-12 * scale
    assert largest(found.change - (first + second + force)) < 1e-12 * scale
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
def test_the_poses_matrix_is_newtons_but_for_the_increment(name: str, strain: str) -> None:
    step = _with_strain(STEPS[name](), strain)
    still = step._replace(z=np.zeros(len(step.z)))
    scale = largest(still.probe().pose)
    for adjoint in (False, True):
        found = still.probe(adjoint=adjoint)
        assert largest(found.pose - found.jacobian) < 1e-14 * scale
    # An increment matters, in proportion to its size.
    probes = [step._replace(z=size * step.z).probe() for size in (1.0, 1e-2, 1e-3)]
    errors = [largest(found.pose - found.jacobian) for found in probes]
    assert errors[0] > 1e-4 * scale
    assert abs(orders(errors[1:], ratio=10.0)[0] - 1.0) < 0.05, f"errors {errors}"


def _elastic(step: Step) -> StepProbe:
    """Return what the stiffness adds."""
    loose = step.beam._replace(joint_stiffness=np.zeros_like(step.beam.joint_stiffness))
    pairs = zip(step.probe(), step._replace(beam=loose).probe(), strict=True)
    return StepProbe(*(one - other for one, other in pairs))


@each_strain
@pytest.mark.parametrize("name", STEPS)
def test_what_the_stiffness_adds_is_the_derivative_of_the_strains_energy(
    name: str, strain: str
) -> None:
    step = _with_strain(STEPS[name](), strain)
    found = _elastic(step)
    slopes = -differentiate(lambda z: _elastic(step._replace(z=z)).residual, step.z)
    assert largest(found.jacobian - slopes) < 1e-10 * largest(slopes)
    if strain == "averaged_directors":
        return  # The energy of these is part of the reference's L_d, see test_derivatives.
    ends = np.array([np.cumsum(step.q[2:]), np.cumsum((step.q + step.z)[2:])], dtype=complex)
    exact = np.zeros((2, len(step.z)))
    for which, k in np.ndindex(*ends.shape):
        angles = ends.copy()
        angles[which, k] += 1e-30j
        bend = np.diff(angles.mean(axis=0))
        measure = bend if strain == "joint_angle" else np.sin(bend)
        # h W = h dl/2 sum EI K^2, and the joints' stiffness is EI/dl.
        weight = 0.5 * step.h * (step.beam.joint_stiffness * measure**2).sum()
        exact[which, 2 + k] = -weight.imag / 1e-30
    scale = largest(exact)
    # Differences of residuals whose terms are some hundred times as large.
    assert largest(found.residual - exact[0]) < 1e-12 * scale
    assert largest(found.change - exact.sum(axis=0)) < 1e-12 * scale


# ---- Newton's method, cut steps, steps that fail -----------------------------------------------


@each_scheme
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"fluid.density": 1000.0},
        {"beam.elements": 3},
        {"beam.elements": 27},
        {"fluid.model": "expansion"},
    ],
    ids=str,
)
def test_a_step_errs_by_less_than_its_tolerance(
    scheme: str, tolerance: float, changes: dict[str, object]
) -> None:
    # Also where the shape force, or the added mass of the end, was not evaluated once more.
    settings = {"integrator.scheme": scheme, "integrator.tolerance": tolerance}
    scene = load_scene("swimmer", {**settings, **changes})
    bodies = Bodies(scene)
    exact = Bodies(scene.replace({"integrator.tolerance": 1e-12}))
    bodies.start(0, *minimal_start(scene, scene.initial))
    torques = np.sign(held_torques(scene, 150, 3))
    for torque in torques:
        exact.states[:] = bodies.states
        for one in (bodies, exact):
            one.advance(torque[None, None], 1, one.new_record(1))
        missed = (bodies.coordinates - exact.coordinates)[0]
        turns = np.cumsum(missed[2:])
        shift = missed[:2] / scene.beam.element_length
        assert max(np.abs(turns).max(), np.abs(shift).max()) <= 0.25 * tolerance


@each_scheme
@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_the_residual_is_met(scheme: str, tolerance: float) -> None:
    changes: dict[str, object] = {"integrator.tolerance": tolerance}
    scene = _scene(scheme, "averaged_directors", changes, base="swimmer")
    trajectory = rollout(scene, held_torques(scene, 300, 9))
    assert 0.0 < trajectory.residual.max() <= tolerance


@each_scheme
def test_a_residual_that_rounding_keeps_up_is_reported(scheme: str) -> None:
    # Momenta of a body that moves this fast cancel in the balance of its joints.
    changes = {"fluid": None, "integrator.tolerance": TOLERANCE, "initial.velocity": [1e4, 0.0]}
    scene = load_scene("paper_i", changes)
    scene = scene.replace("integrator.scheme", scheme)
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
    assert one.parts.tolist() == [1.0], "the first half must succeed"
    cut = whole.rollout(violent[None])
    two = halves.rollout(np.tile(violent, (2, 1)))
    assert cut.parts.tolist() == [2.0]
    assert two.parts.tolist() == [1.0, 1.0]
    # Nothing of the half that was taken back is left, to the bit.
    assert np.array_equal(whole.coordinates, halves.coordinates)
    assert np.array_equal(whole.momentum(), halves.momentum())
    assert whole.energy() == halves.energy()
    for name in ("work", "dissipated", "impulse"):
        apart = getattr(cut, name).sum(axis=0) - getattr(two, name).sum(axis=0)
        assert largest(apart) < 1e-13 * float(two.work.sum()), name
    assert cut.residual[0] == two.residual.max()


def test_a_cut_step_takes_over_no_lag_from_those_before() -> None:
    """It is two of half the length, bit for bit, that know nothing of longer ones."""
    changes = {"initial.velocity": (0.2, 0.1), "integrator.time_step": 0.02}
    loose = {**changes, "integrator.tolerance": 1e-4}
    whole = Bodies(_scene("composed", "averaged_directors", loose))
    halves = Bodies(
        _scene("composed", "averaged_directors", {**loose, "integrator.time_step": 0.01})
    )
    whole.start(0, *minimal_start(whole.scene, whole.scene.initial))
    whole.advance(held_torques(whole.scene, 12, 3, 0.15)[None], 1, whole.new_record(12))
    assert whole.outcome[0].tolist() == [12, 0]
    halves.states[:] = whole.states
    one, other = (bodies.views(0).state for bodies in (whole, halves))
    assert one.lag.any() and one.counters[KNOWN_INCREMENTS] == 3.0
    other.lag[:] = 0.0
    other.counters[KNOWN_INCREMENTS] = 0.0
    violent = np.array([8.0, -8.0])
    record = whole.new_record(1)
    whole.advance(violent[None, None], 1, record)
    halves.advance(np.tile(violent, (1, 2, 1)), 1, halves.new_record(2))
    assert record[0, 0, PARTS] == 2.0
    for name in ("q", "p", "lag", "inertia"):
        assert_same(getattr(one, name).copy(), getattr(other, name).copy(), name)
    assert one.lag.any()


CUT: dict[str, object] = {"initial.velocity": (0.2, 0.1), "integrator.time_step": 0.01}


@each_scheme
@each_strain
def test_a_step_that_fails_leaves_the_state_as_it_was(scheme: str, strain: str) -> None:
    scene = _scene(scheme, strain, CUT, base="swimmer")
    torques = held_torques(scene, 40, 12)
    simulator = Simulator(scene)
    simulator.rollout(torques[:20])
    kept, before = simulator.snapshot(), simulator.snapshot().state
    # This turns the elements too far in every part of a step, however short.
    with pytest.raises(SimulationEndedError):
        simulator.step(1e6 * VIOLENT)
    assert simulator.snapshot().state == before
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

    def state() -> tuple[Array, Array, float, int]:
        return simulator.coordinates, simulator.momentum(), simulator.energy(), simulator.steps

    simulator.reset_to(simulator.coordinates, [0.0, 0.0, -4.0, 0.0, 4.0])
    with pytest.raises(SimulationEndedError) as caught:
        for _ in range(200):
            before = state()
            simulator.step(np.zeros(2))
    assert simulator.steps > 2
    assert_same(state(), before)
    assert caught.value.reason in ("outline_degenerate", "under_resolved_gap")


# ---- the strain of mean angles -----------------------------------------------------------------


def _frequency(strain: str, amplitude: float, step: float) -> tuple[float, float]:
    """Return the frequency (1/s) of two hinged elements, and the joint's largest turn in a step."""
    scene = load_scene(
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
    trajectory = passive(scene, 25.0)
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


# ---- torques -----------------------------------------------------------------------------------


def test_prescribed_torques_of_the_composed_scheme_are_those_of_the_middle_of_a_step() -> None:
    wave = {"actuation.end_time": 0.5, "actuation.active_until": 0.6, "actuation.phase": 0.3}
    for scheme, into in (("paper", 0.0), ("composed", 0.5)):
        scene = load_scene("swimmer", {**wave, "integrator.scheme": scheme})
        simulator = Simulator(scene)
        simulator.rollout(simulator.prescribed_torques(7))
        found = simulator.prescribed_torques(120)
        place = scene.beam.joint_fractions
        t = (7.0 + np.arange(120)[:, None] + into) * scene.integrator.time_step
        exact = np.cos(2.0 * np.pi * (t - place) + 0.3) * ((place <= 0.6) & (t < 0.5))
        assert largest(found - exact) < 1e-13, scheme
        assert found[0].any() and not found[-1].any()
