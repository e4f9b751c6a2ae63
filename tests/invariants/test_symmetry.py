"""Symmetries of the motion: mirror, turn and shift, head and tail, time, units, geometry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from swim_env import Scene, Simulator, Trajectory, load_scene

TOLERANCE = 1e-13
BASES = ("paper_i", "swimmer", "paper_iv", "paper_v", "paper_vii")
# Newton stops where the residual is small, not where both runs are: what is left of it, and
# rounding, grows along with the motion.
AGREEMENT = 1e-11


def _scene(base: str, changes: Mapping[str, object] | None = None) -> Scene:
    return load_scene(base, {"integrator.tolerance": TOLERANCE, **(changes or {})})


def _torques(scene: Scene, steps: int = 200, seed: int = 5) -> np.ndarray:
    """Return a smooth torque without symmetry: waves both ways and a bias."""
    rng = np.random.default_rng(seed)
    t = np.arange(steps)[:, None] * scene.integrator.time_step
    place = scene.beam.joint_fractions
    a, b, c, d = rng.uniform(0.2, 0.5, 4)
    ahead = a * np.cos(6.0 * t - 6.0 * place) + b * np.sin(9.0 * t + 4.0 * place)
    return np.asarray(ahead + c * (1.0 - np.exp(-t)) + d * np.sin(3.0 * t) * place)


def _play(scene: Scene, torques: np.ndarray) -> Trajectory:
    trajectory = Simulator(scene).rollout(torques)
    assert trajectory.steps == len(torques), trajectory.termination_reason
    return trajectory


def _assert_same(
    found: tuple[np.ndarray, np.ndarray], wanted: tuple[np.ndarray, np.ndarray], what: str
) -> None:
    (centres, angles), (centres2, angles2) = found, wanted
    bend = np.abs(np.diff(angles, axis=1)).max()
    assert bend > 0.02, f"a joint angle of {bend:.2g} rad is no test"
    position = np.abs(centres - centres2).max()
    turn = np.abs(angles - angles2).max()
    assert position < AGREEMENT, f"{what}: centres differ by {position:.2g} m"
    assert turn < AGREEMENT, f"{what}: angles differ by {turn:.2g} rad"


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("base", BASES)
def test_mirrored_torques_give_the_mirrored_path(base: str) -> None:
    scene = _scene(base)
    torques = _torques(scene)
    one = _play(scene, torques)
    other = _play(scene, -torques)
    assert np.abs(one.displacement).max() > 1e-6, one.displacement
    _assert_same(
        (one.centres, one.angles), (other.centres * [1.0, -1.0], -other.angles), f"{base} mirrored"
    )


def test_mirroring_holds_with_a_bent_moving_start_and_axial_added_mass() -> None:
    bend = np.linspace(0.2, -0.1, 8)
    runs = []
    for sign in (1.0, -1.0):
        scene = _scene(
            "swimmer",
            {
                "axial_added_mass": {},
                "initial.joint_angles": [float(sign * a) for a in bend],
                "initial.velocity": (0.2, sign * 0.1),
            },
        )
        runs.append(_play(scene, sign * _torques(scene)))
    one, other = runs
    _assert_same(
        (one.centres, one.angles), (other.centres * [1.0, -1.0], -other.angles), "mirrored"
    )


@pytest.mark.parametrize("base", ["paper_i", "swimmer", "paper_iv"])
@pytest.mark.parametrize("angle", [0.5 * np.pi, 2.3, -1.1])
def test_turning_and_shifting_the_start_turns_and_shifts_the_path(base: str, angle: float) -> None:
    start = {"joint_angles": 0.05, "velocity": (0.15, -0.1)}
    scene = _scene(base, {"initial": start})
    torques = _torques(scene)
    one = _play(scene, torques)
    turn = _rotation(angle)
    shift = np.array([3.0, -7.0])
    moved = {
        **start,
        "position": [float(x) for x in shift],
        "heading": angle,
        "velocity": [float(v) for v in turn @ start["velocity"]],
    }
    other = _play(_scene(base, {"initial": moved}), torques)
    _assert_same(
        (other.centres, other.angles),
        (one.centres @ turn.T + shift, one.angles + angle),
        f"{base} turned by {angle:.2f}",
    )


@pytest.mark.parametrize("changes", [{}, {"damping": {"retardation_time": 0.001}}, {"fluid": None}])
def test_head_and_tail_are_alike(changes: dict[str, object]) -> None:
    # Counted from the other end every element points the other way, so th_k becomes
    # th_{N+1-k} + pi and joint angles and joint torques change sign and order.
    stiffness = [5.0, 6.0, 8.0, 7.0, 5.0, 4.0, 3.0, 4.0]
    bend = np.linspace(0.1, -0.05, 8)
    changes = {**changes, "beam.bending_stiffness": stiffness}
    scene = _scene("paper_i", {**changes, "initial.joint_angles": [float(a) for a in bend]})
    torques = 0.3 * _torques(scene)
    one = _play(scene, torques)
    backwards = {
        **changes,
        "beam.bending_stiffness": stiffness[::-1],
        "initial.joint_angles": [float(-a) for a in bend[::-1]],
        "initial.heading": float(one.angles[0, -1] + np.pi),
        "initial.position": [float(x) for x in one.nodes[0, -1]],
    }
    other = _play(_scene("paper_i", backwards), -torques[:, ::-1])
    _assert_same(
        (other.centres, other.angles),
        (one.centres[:, ::-1], one.angles[:, ::-1] + np.pi),
        "from tail to head",
    )


@pytest.mark.parametrize("base", ["paper_i", "swimmer"])
def test_the_motion_does_not_depend_on_when_it_starts(base: str) -> None:
    scene = _scene(base)
    torques = _torques(scene)
    now = _play(scene, torques)
    later = _play(scene, np.concatenate([np.zeros((37, scene.beam.elements - 1)), torques]))
    rest = np.abs(later.centres[:38] - later.centres[0]).max()
    assert rest == 0.0, f"a beam at rest moved by {rest:.2g} m without torques"
    _assert_same((later.centres[37:], later.angles[37:]), (now.centres, now.angles), "37 steps on")


def test_units_do_not_matter() -> None:
    # Lengths times a, times times b, densities times c: the same motion in other units.
    a, b, c = 2.5, 0.4, 3.0
    scene = _scene("swimmer")
    torques = _torques(scene)
    one = _play(scene, torques)
    beam = scene.beam
    # Depth stays a unit length: mass per length and per depth go as c a, energies as c a^4/b^2.
    other_scene = _scene(
        "swimmer",
        {
            "beam.length": a * beam.length,
            "beam.half_thickness": a * beam.half_thickness,
            "beam.line_density": c * a * beam.line_density,
            "beam.rotary_inertia": c * a**3 * beam.rotary_inertia,
            "beam.bending_stiffness": c * a**5 / b**2 * 5.0,
            "fluid.density": c * 10.0,
            "damping.retardation_time": b * 0.001,
            "integrator.time_step": b * scene.integrator.time_step,
        },
    )
    other = _play(other_scene, c * a**4 / b**2 * torques)
    _assert_same((other.centres / a, other.angles), (one.centres, one.angles), "other units")


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

    def test_with_momentum_it_goes_on(self) -> None:
        # What the test above would miss: the fluid must not act as friction.
        scene = _scene(
            "swimmer", {"damping.retardation_time": 0.02, "initial.velocity": (0.0, 0.1)}
        )
        trajectory = _play(scene, np.zeros((1000, 8)))
        way = float(trajectory.displacement[1])
        assert abs(way / (0.1 * trajectory.duration) - 1.0) < 1e-3, f"{way:.6f} m sideways in 5 s"

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
            way[kind] = float(np.hypot(*_play(scene, stroke).displacement))
        assert way["scallop"] < 0.05 * way["wave"], f"displacements {way} m"
