"""What a scene must share with the one that a policy was made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from swim_env.scene import Beam, Scene
from swim_env.scene.block import plain

__all__ = ["AGENT_FIELDS", "TUNED_FIELDS", "difference", "is_similar"]

#: What an agent learned: the body, its fluid, its joints and its clock.
AGENT_FIELDS = (
    *(f"beam.{spec.name}" for spec in fields(Beam)),
    "fluid.model",
    "fluid.density",
    "fluid.added_mass_per_length",
    "axial_added_mass",
    "cross_flow_drag",
    "stream",
    "torque_limit",
    "actuation.active_until",
    "episode.control_interval",
)

#: What a wave that sees nothing was tuned to: also the damping. It has its own torques and takes no
#: share of a limit.
TUNED_FIELDS = (*(name for name in AGENT_FIELDS if name != "torque_limit"), "damping")


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
    return all(_alike(own, scene, path) for path in AGENT_FIELDS)


def _alike(own: Scene, scene: Scene, path: str) -> bool:
    first, second = _value(own, path), _value(scene, path)
    if path == "beam.bending_stiffness":
        first, second = (one.beam.stiffness_at_joints() for one in (own, scene))
    elif path == "stream" and first and second:
        first, second = first["velocity"], second["velocity"]
    if path not in _UNITS or first is None or second is None:
        return bool(first == second)
    here, there = (
        np.atleast_1d(one) / _unit(of, path) for one, of in ((first, own), (second, scene))
    )
    return here.shape == there.shape and np.allclose(here, there, rtol=_ROUNDING, atol=0.0)


def _unit(scene: Scene, path: str) -> float:
    """Return what a quantity of 1 is in body units."""
    units = (scene.beam.length, scene.beam.line_density, scene.episode.control_interval)
    return float(np.prod([unit**power for unit, power in zip(units, _UNITS[path], strict=True)]))


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
    value: Any = scene
    for name in path.split("."):
        value = getattr(value, name, None)
    return plain(value)
