"""Symmetries of the motion: mirror, turn and shift, head and tail, time, geometry."""

import itertools
from collections.abc import Mapping

import numpy as np
import pytest

from swim_env import Scene, Simulator, Trajectory, load_scene
from tests.invariants.runs import (
    CLOSED,
    MODELS,
    SCHEMES,
    STRAINS,
    VARIANTS,
    bend_of,
    each_model,
    fluid_changes,
    largest,
    with_scheme,
)
from tests.support import Array, rollout

# Newton stops where the residual is small, not where both runs are: what is left of it, and
# rounding, grows along with the motion.
AGREEMENT = 1e-11

#: A scene and what is changed in it.
CASES: dict[str, tuple[str, dict[str, object]]] = {
    **{base: (base, {}) for base in ("paper_i", "swimmer", "paper_iv", "paper_v", "paper_vii")},
    "no fluid": ("paper_i", {"fluid": None}),
    "axial": ("swimmer", {"axial_added_mass": {}}),
    **{
        ", ".join(pair): ("swimmer", with_scheme(*pair))
        for pair in itertools.product(SCHEMES, STRAINS)
    },
    **{model: ("paper_i", fluid_changes(model)) for model in MODELS},
}


def _scene(name: str, changes: Mapping[str, object] | None = None) -> Scene:
    base, others = CASES[name]
    return load_scene(base, {"integrator.tolerance": 1e-13, **others, **(changes or {})})


def _torques(scene: Scene, steps: int = 200, seed: int = 5) -> Array:
    """Return a smooth torque without symmetry: waves both ways and a bias."""
    rng = np.random.default_rng(seed)
    t = np.arange(steps)[:, None] * scene.integrator.time_step
    place = scene.beam.joint_fractions
    a, b, c, d = rng.uniform(0.2, 0.5, 4)
    ahead = a * np.cos(6.0 * t - 6.0 * place) + b * np.sin(9.0 * t + 4.0 * place)
    return np.asarray(ahead + c * (1.0 - np.exp(-t)) + d * np.sin(3.0 * t) * place)


def _gap(run: Trajectory, centres: Array, angles: Array) -> float:
    """Return the largest difference (m, rad) of a bent run from where it should be."""
    bend = bend_of(run)
    assert bend > 0.02, f"a joint angle of {bend:.2g} rad is no test"
    return float(max(np.abs(run.centres - centres).max(), np.abs(run.angles - angles).max()))


@pytest.mark.parametrize("name", CASES)
def test_mirrored_torques_give_the_mirrored_path(name: str) -> None:
    runs = []
    for sign in (1.0, -1.0):
        bend = sign * np.linspace(0.1, -0.05, _scene(name).beam.elements - 1)
        start = {"joint_angles": [float(a) for a in bend], "velocity": (0.2, sign * 0.1)}
        scene = _scene(name, {"initial": start})
        runs.append(rollout(scene, sign * _torques(scene)))
    one, other = runs
    gap = _gap(one, other.centres * [1.0, -1.0], -other.angles)
    if name in VARIANTS:
        # The fluid is on one side: some per cent of the bend, no rounding.
        assert gap > 1e-4, f"off by {gap:.2g} only"
    else:
        assert gap < AGREEMENT, f"off by {gap:.2g}"


@pytest.mark.parametrize(
    ("name", "angle"), [*((name, 2.3) for name in CASES), ("paper_i", 0.5 * np.pi), ("axial", -1.1)]
)
def test_turning_and_shifting_the_start_turns_and_shifts_the_path(name: str, angle: float) -> None:
    start = {"joint_angles": 0.05, "velocity": (0.15, -0.1)}
    scene = _scene(name, {"initial": start})
    torques = _torques(scene)
    one = rollout(scene, torques)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    shift = np.array([3.0, -7.0])
    moved = {
        **start,
        "position": [float(x) for x in shift],
        "heading": angle,
        "velocity": [float(v) for v in turn @ start["velocity"]],
    }
    other = rollout(_scene(name, {"initial": moved}), torques)
    gap = _gap(other, one.centres @ turn.T + shift, one.angles + angle)
    assert gap < AGREEMENT, f"off by {gap:.2g}"


@pytest.mark.parametrize("name", ["swimmer", "no fluid", "axial", *MODELS])
def test_the_mirror_image_counted_from_the_tail_is_the_same(name: str) -> None:
    # Element k becomes N + 1 - k, its angle pi minus the other's, and a joint's torque stays what
    # it is. That keeps the fluid on d1's side, so the centre line has this symmetry too, unless
    # arms are measured from the elements' heads. Together with the mirror it makes head and tail
    # alike.
    stiffness = [5.0, 6.0, 8.0, 7.0, 5.0, 4.0, 3.0, 4.0]
    bend = np.linspace(0.1, -0.05, 8)
    start = {"joint_angles": [float(a) for a in bend], "velocity": (0.2, 0.1)}
    scene = _scene(name, {"beam.bending_stiffness": stiffness, "initial": start})
    torques = 0.3 * _torques(scene)
    one = rollout(scene, torques)
    flip = np.array([1.0, -1.0])
    backwards = {
        "joint_angles": [float(a) for a in bend[::-1]],
        "heading": float(np.pi - one.angles[0, -1]),
        "position": [float(x) for x in flip * one.nodes[0, -1]],
        "velocity": (0.2, -0.1),
    }
    other = rollout(
        _scene(name, {"beam.bending_stiffness": stiffness[::-1], "initial": backwards}),
        torques[:, ::-1],
    )
    gap = _gap(other, flip * one.centres[:, ::-1], np.pi - one.angles[:, ::-1])
    if name.endswith("arm_from_start"):
        assert gap > 0.01, f"off by {gap:.2g} only"
    else:
        # Second derivatives of the expansion are symmetric to 1e-10 of A only: 2e-12 seen.
        assert gap < (1e-9 if name == "expansion" else AGREEMENT), f"off by {gap:.2g}"


@each_model
@pytest.mark.parametrize("velocity", [(0.1, 0.0), (0.0, 0.1)], ids=["along", "across"])
def test_a_straight_beam_that_drifts_stays_straight(
    name: str, velocity: tuple[float, float]
) -> None:
    scene = _scene(name, {"initial.velocity": velocity, "actuation": None})
    run = rollout(scene, np.zeros((500, 8)))
    if velocity[0]:
        # Nothing presses on it, and Kirchhoff's instability, 0.1 1/s, does not double rounding in
        # 5 s.
        assert largest(run.angles) < 1e-13
        assert largest(run.displacement - [0.5, 0.0]) < 1e-13
    elif name in CLOSED:
        # Rounding, 6e-15 seen.
        assert bend_of(run) < 1e-12, f"bent by {bend_of(run):.2g} rad"
    else:
        # The one-sided sheet presses it to one side: 3e-4 rad and more seen.
        assert bend_of(run) > 1e-5, f"bent by {bend_of(run):.2g} rad only"


@pytest.mark.parametrize("name", ["paper_i", "swimmer"])
def test_the_motion_does_not_depend_on_when_it_starts(name: str) -> None:
    scene = _scene(name)
    torques = _torques(scene)
    now = rollout(scene, torques)
    later = rollout(scene, np.concatenate([np.zeros((37, 8)), torques]))
    rest = np.abs(later.centres[:38] - later.centres[0]).max()
    assert rest == 0.0, f"a beam at rest moved by {rest:.2g} m without torques"
    gap = _gap(now, later.centres[37:], later.angles[37:])
    assert gap < AGREEMENT, f"37 steps later: off by {gap:.2g}"


class TestGeometricSwimming:
    """In potential flow, from rest, the body moves only while its shape changes."""

    def test_a_beam_that_stops_deforming_stops_moving(self) -> None:
        scene = _scene("swimmer", {"damping.retardation_time": 0.02, "actuation.amplitude": 3.0})
        simulator = Simulator(scene)
        driven = simulator.rollout(simulator.prescribed_torques(400))
        fast = np.abs(np.diff(driven.path[-200:], axis=0)).max() / simulator.time_step
        coasting = simulator.rollout(np.zeros((2000, 8)))
        bending = np.abs(np.diff(np.diff(coasting.angles, axis=1)[-20:], axis=0)).max()
        assert bending / simulator.time_step < 1e-6, f"still bends by {bending:.2g} rad a step"
        slow = np.abs(np.diff(coasting.path[-20:], axis=0)).max() / simulator.time_step
        assert fast > 1e-3, f"driven it moves at {fast:.2g} m/s only"
        assert slow < 1e-6, f"moves at {slow:.2g} m/s, {fast:.2g} when driven"
        velocity = np.abs(simulator.velocity()).max()
        assert velocity < 1e-5, f"M^-1 p = {velocity:.2g}"

    def test_a_closed_slow_stroke_back_and_forth_gets_nowhere(self) -> None:
        # One way of bending and back (the scallop) swims nowhere where inertia of the bending
        # itself is negligible: a slow stroke of all joints alike.
        scene = _scene("swimmer", {"integrator.time_step": 0.005})
        way = {}
        for kind in ("scallop", "wave"):
            t = np.arange(3000)[:, None] * 0.005
            phase = 0.0 if kind == "scallop" else 2.0 * np.pi * scene.beam.joint_fractions
            ramp = np.minimum(t / 5.0, 1.0) * np.minimum((15.0 - t) / 5.0, 1.0)
            stroke = ramp * np.sin(2.0 * np.pi * t / 1.0 - phase) + np.zeros((1, 8))
            way[kind] = float(np.hypot(*rollout(scene, stroke).displacement))
        assert way["scallop"] < 0.05 * way["wave"], f"displacements {way} m"
