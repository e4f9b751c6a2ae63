"""The discrete momentum map changes by impulses from outside alone, whatever the torques do."""

import itertools

import numpy as np
import pytest

from swim_env import Scene, Simulator, load_scene
from tests.invariants.runs import (
    MODELS,
    STRAINS,
    VIOLENT,
    assert_balanced,
    fluid_changes,
    largest,
    with_scheme,
)
from tests.support import held_torques, rollout

SCENES: dict[str, tuple[str, dict[str, object]]] = {
    "fluid": ("paper_i", {}),
    "none": ("paper_i", {"fluid": None}),
    "axial": ("paper_i", {"axial_added_mass": {}}),
    "damped": ("swimmer", {}),
    "three elements": ("paper_iv", {}),
    "stiffness that varies": ("paper_vii", {}),
    "damped, axial, more panels": (
        "swimmer",
        {"axial_added_mass": {}, "fluid.panels_per_element": 8, "fluid.cap_panels": 2},
    ),
    "mean angles": ("paper_i", {"integrator.strain": "mean_angles"}),
    "composed": ("paper_i", with_scheme("composed")),
    "composed, none": ("paper_i", {**with_scheme("composed"), "fluid": None}),
    "composed, mean angles, damped, axial": (
        "swimmer",
        {**with_scheme("composed", "mean_angles"), "axial_added_mass": {}},
    ),
}
#: Every fluid model on few and many elements, whose torques are smaller.
LADDER: dict[str, tuple[str, dict[str, object]]] = {
    f"{model}, {n} elements": ("paper_i", {**fluid_changes(model), "beam.elements": n})
    for model in MODELS
    for n in (2, 5, 9)
}
TOLERANCES = (1e-6, 1e-10, 1e-13)
MOVING = {"position": (0.4, -1.5), "heading": 0.7, "velocity": (0.3, -0.2)}


def _scene(name: str, tolerance: float, changes: dict[str, object] | None = None) -> Scene:
    base, others = (SCENES | LADDER)[name]
    return load_scene(base, {**others, **(changes or {}), "integrator.tolerance": tolerance})


@pytest.mark.parametrize("moving", [False, True], ids=["from rest", "moving"])
@pytest.mark.parametrize(
    ("name", "tolerance"),
    [*itertools.product(SCENES, TOLERANCES), *((name, 1e-12) for name in LADDER)],
)
def test_torques_leave_the_momentum_alone(name: str, tolerance: float, moving: bool) -> None:
    scene = _scene(name, tolerance, {"initial": MOVING} if moving else {})
    run = Simulator(scene).rollout(held_torques(scene, 300, 1, 0.2 if name in LADDER else 1.0))
    assert run.steps >= 100, f"only {run.steps} steps were taken"
    assert np.abs(run.angles - run.angles[0]).max() > 0.01, "the torques hardly moved the beam"
    begin = run.momentum[0]
    if moving:
        assert np.abs(begin).min() > 0.01, begin
    else:
        assert np.array_equal(begin, np.zeros(3)), begin
    assert not run.impulse.any()
    assert_balanced(run, tolerance)


DRAG = {"cross_flow_drag": {"coefficient": 3.0}}
STREAM = {"stream": {"velocity": (-0.2, 0.5)}}
OUTSIDE: dict[str, dict[str, object]] = {
    "drag": DRAG,
    "stream": STREAM,
    "drag, stream": {**DRAG, **STREAM},
}


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("effects", OUTSIDE)
@pytest.mark.parametrize(
    "name",
    [
        "fluid",
        "damped, axial, more panels",
        "strip, 9 elements",
        "composed, mean angles, damped, axial",
    ],
)
def test_momentum_changes_by_the_impulse_from_outside(
    name: str, effects: str, tolerance: float
) -> None:
    start = {**MOVING, "velocity": (0.3, -0.4)}
    scene = _scene(name, tolerance, {"initial": start, **OUTSIDE[effects]})
    run = Simulator(scene).rollout(held_torques(scene, 200, 5))
    assert run.steps >= 100, f"only {run.steps} steps were taken"
    moved = np.abs(run.momentum - run.momentum[0]).max(axis=0)
    # A stream alone carries a momentum along, which swings about the origin.
    felt = moved if "drag" in effects else moved[2:]
    assert felt.min() > 0.1, f"the momentum changed by {moved} only"
    assert_balanced(run, tolerance)
    assert run.summary()["momentum_drift"] < 1e-5


CUT: dict[str, dict[str, object]] = {
    "paper": {},
    **{
        f"composed, {strain}, axial": {**with_scheme("composed", strain), "axial_added_mass": {}}
        for strain in STRAINS
    },
    "drag, stream": OUTSIDE["drag, stream"],
    "composed, drag, stream": OUTSIDE["drag, stream"] | with_scheme("composed"),
}


@pytest.mark.parametrize("name", CUT)
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_steps_cut_into_parts_keep_momentum_and_books(tolerance: float, name: str) -> None:
    changes = {
        "initial": {"position": (0.4, -1.5), "velocity": (0.2, 0.1)},
        "integrator.time_step": 0.01,
        "integrator.tolerance": tolerance,
    }
    scene = load_scene("swimmer", {**changes, **CUT[name]})
    torques = held_torques(scene, 200, 3)
    torques[::20] = VIOLENT
    run = rollout(scene, torques)
    cut = int((run.parts > 1).sum())
    assert cut >= (10 if "composed" in name else 5), f"{cut} steps were cut"
    for field in ("centres", "angles", "energy", "momentum", "work", "residual"):
        assert np.isfinite(getattr(run, field)).all(), field
    assert_balanced(run, tolerance)
    change = np.diff(np.diff(run.angles, axis=1), axis=0)
    assert largest(run.work - (torques * change).sum(axis=1)) < 1e-12 * largest(run.work)
    assert run.dissipated.min() >= 0.0


def test_momentum_at_the_start_is_that_of_body_and_fluid() -> None:
    # Along itself a straight body without axial added mass carries its own mass alone; across
    # itself the fluid's comes on top (4 to 7 % above pi l^2/4 of a plate).
    simulator = Simulator(load_scene("paper_i", {"initial.velocity": (0.1, 0.2)}))
    along, across, _ = simulator.momentum()
    assert abs(along - 0.31 * 0.1) < 1e-15, f"momentum along the body {along!r}, expected 0.031"
    ratio = (across / 0.2 - 0.31) / (10.0 * np.pi / 4.0)
    assert 1.04 < ratio < 1.07, f"lateral added mass {ratio:.4f} of a plate's"
    velocity = simulator.velocity()
    assert largest(velocity - np.concatenate([[0.1, 0.2], np.zeros(9)])) < 1e-12


def test_without_fluid_the_momentum_is_mass_times_the_centres_velocity() -> None:
    scene = _scene("none", 1e-12, {"initial": MOVING})
    run = Simulator(scene).rollout(held_torques(scene, 200, 4))
    moved = run.displacement / run.duration
    assert largest(run.momentum[-1, :2] - 0.31 * moved) < 1e-12
