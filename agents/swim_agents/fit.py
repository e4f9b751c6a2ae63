"""What a scene must share with the one that a policy was made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.scene import Beam, Scene, SpatialBeam, SpatialScene
from swim_env.scene.block import plain

__all__ = ["AGENT_FIELDS", "TUNED_FIELDS", "difference", "is_similar"]

Array = NDArray[np.float64]

#: What an agent learned: the body, its fluid, its joints and its clock; a scene has those of its
#: dimension.
AGENT_FIELDS = (
    "dimension",
    *dict.fromkeys(f"beam.{spec.name}" for block in (Beam, SpatialBeam) for spec in fields(block)),
    "fluid.model",
    "fluid.density",
    "fluid.added_mass_per_length",
    "fluid.matrix",
    "axial_added_mass",
    "cross_flow_drag",
    "stream",
    "axes",
    "torque_limit",
    "actuation.active_until",
    "episode.control_interval",
)

#: What a wave that sees nothing was tuned to: also the damping. It has its own axes and torques
#: and takes no share of a limit.
TUNED_FIELDS = (
    *(name for name in AGENT_FIELDS if name not in ("torque_limit", "axes")),
    "damping",
)


#: Models in space that compute the flow about a body from its surface, or from its sections.
_MODELS_OF_A_FLUID = ("strip", "frozen", "panels")

#: Of AGENT_FIELDS those with a unit: powers of the body length, the mass per length and the control
#: interval.
_UNITS = {
    "beam.length": (1, 0, 0),
    "beam.half_thickness": (1, 0, 0),
    "beam.line_density": (0, 1, 0),
    "beam.rotary_inertia": (2, 1, 0),
    "beam.bending_stiffness": (4, 1, -2),
    "fluid.density": (-1, 1, 0),
    "fluid.added_mass_per_length": (0, 1, 0),
    "stream": (1, 0, -1),
    "torque_limit": (3, 1, -2),
    "episode.control_interval": (0, 0, 1),
}
#: Rounding of numbers in body units.
_ROUNDING = 1e-9


def is_similar(own: Scene, scene: Scene) -> bool:
    """Return whether two scenes are dynamically similar for an agent: equal in body units.

    Actions and observations then mean the same: lengths are counted in body lengths, masses in that
    of the body, times in control intervals.
    """
    paths: Sequence[str] = AGENT_FIELDS
    if isinstance(own, SpatialScene) and isinstance(scene, SpatialScene):
        if not _alike_in_space(own, scene):
            return False
        paths = [path for path in paths if not path.startswith("beam.")]
    return all(_alike(own, scene, path) for path in paths)


def _alike_in_space(own: SpatialScene, scene: SpatialScene) -> bool:
    """Return whether two bodies are equal in body units, however their scenes describe them."""
    if own.beam.elements != scene.beam.elements:
        return False
    return all(
        np.allclose(one, other, rtol=_ROUNDING, atol=0.0)
        for one, other in zip(_in_body_units(own), _in_body_units(scene), strict=True)
    )


def _in_body_units(scene: SpatialScene) -> list[Array]:
    """Return what a body in space is: section, inertia, stiffness and natural curvature."""
    beam = scene.beam
    s, _ = beam.gauss_points()
    mass, *rotary = scene.inertia_per_length().T
    found = [
        (beam.half_width_at(s), (1, 0, 0)),
        (beam.half_height_at(s), (1, 0, 0)),
        (mass, (0, 1, 0)),
        *((one, (2, 1, 0)) for one in rotary),
        (beam.stiffness_at_joints(), (4, 1, -2)),
        (beam.natural_curvature_at_joints(), (-1, 0, 0)),
    ]
    return [one / _unit(scene, powers) for one, powers in found]


def _alike(own: Scene, scene: Scene, path: str) -> bool:
    first, second = _value(own, path), _value(scene, path)
    if path == "beam.bending_stiffness":
        first, second = (one.beam.stiffness_at_joints() for one in (own, scene))
    elif path == "stream" and first and second:
        first, second = first["velocity"], second["velocity"]
    if path not in _UNITS or first is None or second is None:
        return bool(first == second)
    powers = _UNITS[path]
    if path == "fluid.density" and own.dimension == 3:  # per volume, and not per area of the plane
        powers = (-2, 1, 0)
    here, there = (
        np.atleast_1d(one) / _unit(of, powers) for one, of in ((first, own), (second, scene))
    )
    return here.shape == there.shape and np.allclose(here, there, rtol=_ROUNDING, atol=0.0)


def _unit(scene: Scene, powers: tuple[int, int, int]) -> float:
    """Return what a body unit of these powers of length, mass per length and time is in SI."""
    beam = scene.beam
    units = (beam.length, scene.mass / beam.length, scene.episode.control_interval)
    return float(np.prod([unit**power for unit, power in zip(units, powers, strict=True)]))


def difference(own: Scene, scene: Scene, paths: Sequence[str], made: str) -> str:
    """Return what differs in a scene from the one that a policy was `made` on, empty if nothing.

    That is the first field with its values as a file would have them, None inside an absent block,
    and how many others there are.
    """
    found = [path for path in paths if _value(own, path) != _value(scene, path)]
    if not found:
        return ""
    before, now = (_value(one, found[0]) for one in (own, scene))
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return f"{found[0]} is {now}, it was {before} in {made}{more}"


def _value(scene: Scene, path: str) -> Any:
    if path == "fluid.model" and scene.dimension == 3 and scene.fluid is not None:
        # These compute the same fluid, and `fine_scene` tells how well.
        model = scene.fluid.model
        return "strip, frozen or panels" if model in _MODELS_OF_A_FLUID else model
    value: Any = scene
    for name in path.split("."):
        value = getattr(value, name, None)
    return plain(value)
