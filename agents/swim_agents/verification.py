"""Verification, which asks whether a score survives a finer computation.

Near a resonance the paper's settings do not resolve the motion, and an optimiser will exploit that.
So a score counts only once the same torques, played at a quarter of the time step and with three
times the panels on sides and ends, bring the body about as far, and the energy of both runs adds up
(they are trusted).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swim_agents.rollout import Rollout, score
from swim_env.errors import SceneError
from swim_env.scene import Integrator, Scene
from swim_env.scene.fluid import FLUID_TABLE

__all__ = ["FINE_PANELS", "TIME_STEP_DIVISOR", "TOLERANCE", "Verification", "verify_rollout"]

#: The finer computation: time step divided by this, panels per element at least as many and at
#: least twice the scene's, and how far off a score may be as a share of itself.
TIME_STEP_DIVISOR, FINE_PANELS, TOLERANCE = 4, 12, 0.1
#: Displacements below this (BL) are rounding, and agree with each other.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Verification:
    """A score, compared with the finer computation."""

    #: The score, and what the finer computation gives (BL).
    net_displacement: float
    fine_displacement: float
    #: Their difference as a share of the score.
    difference: float
    #: Whether the difference is at most `tolerance`, the energy of both computations adds up to the
    #: scene's ``energy_tolerance``, and neither was ended by the physics: an episode
    #: that broke down proves nothing.
    verified: bool
    #: The largest difference allowed.
    tolerance: float
    #: Of the finer computation (s); no panels where the scene has none.
    time_step: float
    panels_per_element: int | None
    #: `Trajectory.energy_drift` of the episode and of the finer computation.
    energy_drift: float
    fine_energy_drift: float
    #: Why the episode or, if not, the finer run was ended by the physics; empty where neither was.
    termination_reason: str
    #: How near the finer computation comes to the target (BL); None where there is none. It plays
    #: the torques for as long as the episode lasted.
    fine_distance: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text, for JSON; a difference that is infinite as null."""
        data = asdict(self)
        if self.difference == float("inf"):
            data["difference"] = None
        return data


def fine_scene(scene: Scene) -> Scene:
    """Return a scene with all of its discretisation refined but the elements, which act.

    That is the time step, the tolerance of its equations, and the panels on sides and ends of any
    model that has them, in proportion. What a model leaves out is no discretisation. It is a
    SceneError if a scene has so many panels that more are refused.
    """
    integrator, fluid = scene.integrator, scene.fluid
    changes: dict[str, object] = {
        "integrator.time_step": integrator.time_step / TIME_STEP_DIVISOR,
        "integrator.tolerance": min(integrator.tolerance, Integrator().tolerance),
    }
    if fluid is not None and FLUID_TABLE[fluid.model].panels:
        own, caps = fluid.panels_per_element, fluid.cap_panels
        panels = max(FINE_PANELS, 2 * own)
        changes["fluid.panels_per_element"] = panels
        if FLUID_TABLE[fluid.model].outline and not isinstance(caps, str):
            changes["fluid.cap_panels"] = math.ceil(caps * panels / own)
    try:
        return scene.replace(changes)
    except SceneError as error:
        raise SceneError(
            f"scene {scene.name} is too fine to be verified by a finer one: {error}"
        ) from None


def _panels(scene: Scene) -> int | None:
    """Return a scene's panels per element, None where it has none."""
    fluid = scene.fluid
    return fluid.panels_per_element if fluid and FLUID_TABLE[fluid.model].panels else None


def verify_rollout(
    rollout: Rollout, tolerance: float = TOLERANCE, progress: Callable[[int], object] | None = None
) -> Verification:
    """Replay a recorded torque history with all of the discretisation refined, see `fine_scene`.

    The net displacements may differ by `tolerance` as a share of the score; `progress` is called
    with the number of fine time steps taken since its last call.
    """
    scene = fine_scene(rollout.scene)
    fine = rollout.simulate(scene, progress)
    coarse_score = rollout.net_displacement
    fine_score = score(rollout, fine.path[-1])
    gap = abs(fine_score - coarse_score)
    if gap <= _NOTHING:
        difference = 0.0
    else:
        difference = gap / abs(coarse_score) if coarse_score else float("inf")
    reason = fine.termination_reason
    if rollout.info["termination_reason"] != "target_reached":
        reason = rollout.info["termination_reason"] or reason
    drifts = (float(rollout.info["energy_drift"]), fine.energy_drift)
    trusted = all(drift <= scene.integrator.energy_tolerance for drift in drifts)
    distance = None
    if rollout.goal_is_point:
        away = np.hypot(*(fine.path - rollout.goal).T)
        distance = float(away.min()) / rollout.scene.beam.length
    return Verification(
        net_displacement=coarse_score,
        fine_displacement=fine_score,
        difference=difference,
        verified=not reason and trusted and difference <= tolerance,
        tolerance=tolerance,
        time_step=scene.integrator.time_step,
        panels_per_element=_panels(scene),
        energy_drift=drifts[0],
        fine_energy_drift=drifts[1],
        termination_reason=reason,
        fine_distance=distance,
    )
