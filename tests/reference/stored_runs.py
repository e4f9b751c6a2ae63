"""Short runs of many scenes, stored as bits, to compare with what they give now.

A change that is not meant to change results, such as moving code, must not change a bit of them: no
fluid model, effect, scheme or strain, no step that is cut and no run that ends early. On the
processor and with the compiler that the file was made with, runs are compared to the last bit;
elsewhere, where products and sums are fused in another order, to a tight tolerance.

``python -m tests.reference.stored_runs`` writes the file anew. That is right only where the solver
was changed on purpose, where a case was added, or on a new machine whose bits are to be kept; never
to make a test pass that fails for a reason nobody knows. It first says which of the stored runs are
others now.
"""

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numpy.typing import NDArray

from swim_env import Scene, Simulator, Trajectory, load_scene
from tests.support import PAPERS_STEPS

STORED = Path(__file__).parent / "stored_runs.npz"
STEPS = 60

Array = NDArray[np.float64]

COMPOSED = {"integrator.scheme": "composed"}
#: Bends by half a radian at the joints.
SOFT = {"beam.bending_stiffness": 0.5, "damping.retardation_time": 0.005}
BENT = (0.1, -0.2, 0.05, 0.3, -0.1, 0.2, 0.15, -0.25)


class Case(NamedTuple):
    """A scene and the torques that it is run with."""

    scene: Scene
    torques: Array


class Run(NamedTuple):
    """What is stored of a run.

    Attributes
    ----------
    numbers : (K,) array
        Last centres, angles and momentum; energies, work, loss and residual of the last steps; the
        last internal forces, where there are any.
    counts : (3, T) array
        Newton corrections, evaluations and parts of every step.
    digests : (F,) array of str
        ``name:digest`` for every array of the trajectory, and the reason why it ended early.
    """

    numbers: Array
    counts: NDArray[np.int32]
    digests: NDArray[np.str_]


@functools.cache
def cases() -> Mapping[str, Case]:
    """Return all cases by name."""
    return {
        **{name: Case(scene, torques(scene)) for name, scene in scenes().items()},
        **{name: Case(scene, _kicks(scene)) for name, scene in violent_scenes().items()},
        "ends_in_contact": _curling(),
    }


def scenes() -> dict[str, Scene]:
    """Return the scenes that are run with small random torques."""
    paper, swimmer = load_scene("paper_i"), load_scene("swimmer", PAPERS_STEPS)

    def fluid(model: str, **more: object) -> dict[str, object]:
        return {"fluid.model": model, **{f"fluid.{name}": value for name, value in more.items()}}

    return {
        "paper_i": paper,
        "paper_vi": load_scene("paper_vi"),
        "paper_xii": load_scene("paper_xii"),
        "swimmer_as_shipped": load_scene("swimmer"),
        "swimmer": swimmer,
        "fine": paper.replace(
            {"beam.elements": 5, "fluid.panels_per_element": 8, "fluid.cap_panels": 2}
        ),
        "axial": paper.replace("axial_added_mass", True),
        "no_fluid": swimmer.replace("fluid", None),
        "no_stiffness": paper.replace("beam.bending_stiffness", 0.0),
        "frozen": paper.replace("fluid.model", "frozen"),
        "composed": swimmer.replace("integrator.scheme", "composed"),
        # Fluid models.
        "strip": paper.replace(fluid("strip")),
        "strip_given_composed": swimmer.replace(
            {**fluid("strip", added_mass_per_length=6.5), **COMPOSED}
        ),
        "expansion": paper.replace(fluid("expansion")),
        "expansion_composed": swimmer.replace({**fluid("expansion"), **COMPOSED}),
        "frozen_composed": swimmer.replace({**fluid("frozen"), **COMPOSED}),
        "centreline": swimmer.replace(fluid("centreline")),
        "centreline_printed": swimmer.replace(
            fluid("centreline", variant="printed_factor_arm_from_start")
        ),
        "centreline_composed": swimmer.replace(
            {**fluid("centreline", variant="arm_from_start"), **COMPOSED}
        ),
        "panels_composed": paper.replace(COMPOSED),
        "no_fluid_composed": swimmer.replace({"fluid": None, **COMPOSED}),
        "proportional_caps": swimmer.replace(
            {"fluid.panels_per_element": 8, "fluid.cap_panels": "proportional"}
        ),
        # Effects.
        "drag": swimmer.replace("cross_flow_drag.coefficient", 1.7),
        "drag_composed": swimmer.replace({"cross_flow_drag.coefficient": 1.7, **COMPOSED}),
        "drag_strip": swimmer.replace({"cross_flow_drag": {}, **fluid("strip")}),
        "stream": swimmer.replace("stream.velocity", (0.3, -0.2)),
        "stream_drag_composed": swimmer.replace(
            {"stream.velocity": (0.3, -0.2), "cross_flow_drag": {}, **COMPOSED}
        ),
        "self_contact": swimmer.replace("self_contact", {}),
        "internal_forces": swimmer.replace({"internal_forces": {}, "cross_flow_drag": {}}),
        "internal_forces_composed": swimmer.replace({"internal_forces": {}, **COMPOSED}),
        "axial_composed": swimmer.replace({"axial_added_mass": True, **COMPOSED}),
        "damping": paper.replace("damping.retardation_time", 0.02),
        "soft": swimmer.replace(SOFT),
        "soft_with_all_effects": swimmer.replace(
            {
                **SOFT,
                "axial_added_mass": True,
                "cross_flow_drag": {},
                "stream.velocity": (0.3, -0.2),
                "self_contact": {},
                "internal_forces": {},
                "recording": {},
            }
        ),
        # Strains.
        "mean_angles": swimmer.replace("integrator.strain", "mean_angles"),
        "mean_angles_composed": swimmer.replace({"integrator.strain": "mean_angles", **COMPOSED}),
        "joint_angle": swimmer.replace("integrator.strain", "joint_angle"),
        "joint_angle_composed": swimmer.replace({"integrator.strain": "joint_angle", **COMPOSED}),
        # Sizes, stiffness and starts.
        "two_elements": swimmer.replace("beam.elements", 2),
        "three_elements_composed": swimmer.replace({"beam.elements": 3, **COMPOSED}),
        "many_elements": swimmer.replace("beam.elements", 27),
        "linear_stiffness": swimmer.replace(
            "beam.bending_stiffness", {"linear": {"head": 8.0, "tail": 2.0}}
        ),
        "bent_start": swimmer.replace(
            {
                "initial.position": (0.4, -1.5),
                "initial.heading": 0.7,
                "initial.joint_angles": BENT,
                "initial.velocity": (0.05, 0.1),
            }
        ),
        "moving_start_composed": paper.replace(
            {"initial.velocity": (0.2, -0.3), "initial.velocity_slope": 0.4, **COMPOSED}
        ),
        "tight": swimmer.replace("integrator.tolerance", 1e-13),
    }


def violent_scenes() -> dict[str, Scene]:
    """Return the scenes that are run with kicks, so that steps are cut or a run ends."""
    coarse = load_scene(
        "swimmer", {**PAPERS_STEPS, "integrator.time_step": 0.01, "internal_forces": {}}
    )
    return {
        "cut_steps": coarse,
        "cut_steps_composed": coarse.replace(COMPOSED),
        "ends_unexplained": coarse.replace(
            {"integrator.energy_excess": "end", "integrator.energy_tolerance": 0.02}
        ),
    }


def torques(scene: Scene) -> Array:
    """Return torques that are random, small and held over four steps."""
    rng = np.random.default_rng(7)
    limit = 1.0 if scene.beam.stiffness_at_joints().any() else 0.003
    held = rng.uniform(-limit, limit, (STEPS // 4, scene.beam.elements - 1))
    return np.repeat(held, 4, axis=0)


def _kicks(scene: Scene) -> Array:
    """Return small random torques with one step in twenty of 20 N m."""
    kicked = 0.5 * torques(scene)
    kicked[7::20] = 20.0 * np.where(np.arange(scene.beam.elements - 1) % 2, -1.0, 1.0)
    return kicked


def _curling() -> Case:
    """Return a thick, soft body that is curled up until it touches itself."""
    changes: dict[str, object] = {
        **PAPERS_STEPS,
        **SOFT,
        "beam.half_thickness": 0.03,
        "beam.rotary_inertia": 1e-3,
        "fluid": None,
        "self_contact": {},
    }
    return Case(load_scene("swimmer", changes), np.tile(np.linspace(0.0, 30.0, STEPS), (8, 1)).T)


def trajectory_of(case: Case) -> Trajectory:
    """Return the run of a case."""
    return Simulator(case.scene).rollout(case.torques)


def run(case: Case) -> Run:
    """Return what is to be compared of a case."""
    trajectory = trajectory_of(case)
    assert trajectory.steps == STEPS or trajectory.termination_reason
    parts = [
        trajectory.centres[-1],
        trajectory.angles[-1],
        trajectory.momentum[-1],
        trajectory.energy[-8:],
        trajectory.work[-8:],
        trajectory.dissipated[-8:],
        trajectory.residual[-8:],
    ]
    if trajectory.internal_forces is not None:
        parts.append(trajectory.internal_forces[-1])
    counts = [trajectory.iterations, trajectory.evaluations, trajectory.parts]
    return Run(
        np.concatenate([part.ravel() for part in parts]),
        np.array(counts).astype(np.int32),
        np.array(_digests(trajectory)),
    )


def _digests(trajectory: Trajectory) -> list[str]:
    found = [f"termination_reason:{trajectory.termination_reason}"]
    for field in fields(trajectory):
        value = getattr(trajectory, field.name)
        if isinstance(value, np.ndarray):
            content = np.ascontiguousarray(value).tobytes()
            found.append(f"{field.name}:{hashlib.sha256(content).hexdigest()[:16]}")
    return found


def machine() -> str:
    """Return what the bits of a result depend on, besides this package."""
    return " ".join(
        (
            llvmlite.binding.get_host_cpu_name(),
            llvmlite.binding.get_host_cpu_features().flatten(),
            numba.__version__,
            llvmlite.__version__,
            np.__version__,
        )
    )


# ---- the file ----------------------------------------------------------------------------------


def stored() -> tuple[dict[str, Run], str]:
    """Return the stored runs by name, and the machine that made them."""
    with np.load(STORED) as file:
        content = dict(file)
    made_by = str(content.pop("machine"))
    names = [name for name in content if "." not in name]
    return {
        name: Run(content[name], content[f"{name}.counts"], content[f"{name}.digests"])
        for name in names
    }, made_by


def store(runs: Mapping[str, Run]) -> None:
    """Write runs, whole."""
    content: dict[str, Any] = {"machine": np.array(machine())}
    for name, one in runs.items():
        content[name] = one.numbers
        content[f"{name}.counts"] = one.counts
        content[f"{name}.digests"] = one.digests
    np.savez_compressed(STORED, **content)


def difference(found: Run, wanted: Run) -> str:
    """Say in words in which bits two runs differ, empty where they are the same."""
    if found.numbers.shape != wanted.numbers.shape:
        return f"{found.numbers.size} numbers instead of {wanted.numbers.size}"
    said = []
    if not np.array_equal(found.numbers, wanted.numbers):
        said.append(f"numbers by {np.abs(found.numbers - wanted.numbers).max():.2g}")
    if not np.array_equal(found.counts, wanted.counts):
        said.append("counts")
    others = sorted(set(found.digests.tolist()) ^ set(wanted.digests.tolist()))
    said += dict.fromkeys(text.partition(":")[0] for text in others)
    return ", ".join(said)


if __name__ == "__main__":
    results = {name: run(case) for name, case in cases().items()}
    before: dict[str, Run] = {}
    if STORED.exists():
        before, _ = stored()
    for name, one in results.items():
        what = difference(one, before[name]) if name in before else "new"
        if what:
            print(f"{name}: {what}")
    store(results)
