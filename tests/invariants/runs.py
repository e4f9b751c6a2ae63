"""What tests of motions share: every fluid model, orders of errors, the balance of momentum."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from swim_env import Scene, Trajectory, load_scene
from tests.support import Array, rollout

#: Fluid blocks of a scene by name. These are the same on both sides of the body.
CLOSED: dict[str, dict[str, object]] = {
    "strip": {"model": "strip"},
    "frozen": {"model": "frozen"},
    "expansion": {"model": "expansion"},
    "panels": {"model": "panels"},
    "panels, caps in proportion": {
        "model": "panels",
        "panels_per_element": 12,
        "cap_panels": "proportional",
    },
}
#: Sources on one side of the centre line. By variant: the factor of a turning element's arm, and
#: where the arm begins on the element, in element lengths from the centre.
VARIANTS = {
    "consistent": (1.0, 0.0),
    "printed_factor": (0.5, 0.0),
    "arm_from_start": (1.0, -0.5),
    "printed_factor_arm_from_start": (0.5, -0.5),
}
MODELS = CLOSED | {name: {"model": "centreline", "variant": name} for name in VARIANTS}
each_model = pytest.mark.parametrize("name", MODELS)
each_size = pytest.mark.parametrize("elements", [2, 5, 9])

SCHEMES = ("paper", "composed")
STRAINS = ("averaged_directors", "mean_angles", "joint_angle")
each_scheme = pytest.mark.parametrize("scheme", SCHEMES)
each_strain = pytest.mark.parametrize("strain", STRAINS)

#: Torques (N m) under which the swimmer's elements would turn by more than half a radian in a step
#: of 0.01 s, so that the step is cut.
VIOLENT = 20.0 * np.tile([1.0, -1.0], 4)


def fluid_changes(model: str) -> dict[str, object]:
    """Return the changes that give a scene one of MODELS."""
    return {"fluid": {"density": 10.0, **MODELS[model]}}


def largest(values: Array) -> float:
    """Return the largest absolute value."""
    return float(np.abs(values).max())


def with_scheme(scheme: str, strain: str = "averaged_directors") -> dict[str, object]:
    """Return the changes that give a scene a scheme and a strain."""
    return {"integrator.scheme": scheme, "integrator.strain": strain}


def orders(errors: Sequence[float] | Array, ratio: float = 2.0) -> Array:
    """Return observed orders of convergence of errors at steps that fall by a ratio."""
    sizes = np.abs(errors)
    return np.asarray(np.log(sizes[:-1] / sizes[1:]) / np.log(ratio))


def stiff_scene(drag: float, time_step: float, changes: Mapping[str, object]) -> Scene:
    """Return a body that bends by less than 1e-6 rad where fluid and drag load it unevenly."""
    integrator = {"time_step": time_step, "tolerance": 1e-13}
    stiff = {"actuation": None, "beam.bending_stiffness": 1e5, "cross_flow_drag.coefficient": drag}
    return load_scene("paper_i", {**stiff, "integrator": integrator, **changes})


def passive(scene: Scene, duration: float) -> Trajectory:
    """Return a run of some seconds without torques."""
    steps = round(duration / scene.integrator.time_step)
    return rollout(scene, np.zeros((steps, scene.beam.elements - 1)))


def normals_of(angles: Array) -> Array:
    """Return d1 (..., 2) of element angles (rad)."""
    return np.stack([-np.sin(angles), np.cos(angles)], axis=-1)


def bend_of(run: Trajectory) -> float:
    """Return the largest joint angle (rad) of a run."""
    return float(np.abs(np.diff(run.angles, axis=1)).max())


def assert_balanced(run: Trajectory, tolerance: float) -> None:
    """Compare |J_n - J_0 - impulses| with 10 tolerances plus 1e-15 n times the size of J's terms.

    Impulses from outside are terms as well, and so is what they swing about the origin.
    """
    change = run.momentum - run.momentum[0]
    change[1:] -= np.cumsum(run.impulse, axis=0)
    drift = np.linalg.norm(change, axis=1)
    linear = np.maximum.accumulate(np.hypot(*run.momentum[:, :2].T))
    whole = np.maximum.accumulate(np.linalg.norm(run.momentum, axis=1))
    terms = np.maximum(whole, np.linalg.norm(run.path, axis=1) * linear)
    terms[1:] += np.cumsum(np.linalg.norm(run.impulse, axis=1))
    bound = 10.0 * tolerance + 1e-15 * np.arange(len(drift)) * terms
    worst = int(np.argmax(drift - bound))
    assert drift[worst] <= bound[worst], (
        f"|J_n - J_0 - impulses| = {drift[worst]:.3g} at step {worst}, allowed {bound[worst]:.3g} "
        f"(largest {drift.max():.3g})"
    )
