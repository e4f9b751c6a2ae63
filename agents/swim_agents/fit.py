"""What a scene must share with the one that a policy was made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from swim_env.scene import Beam, Scene
from swim_env.scene.block import plain

__all__ = ["AGENT_FIELDS", "TUNED_FIELDS", "difference"]

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
