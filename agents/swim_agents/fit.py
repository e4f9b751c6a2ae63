"""What a scene must share with the one that a policy was made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from swim_env.scene import Beam, Scene
from swim_env.scene.block import plain

__all__ = ["AGENT_FIELDS", "TUNED_FIELDS", "first_difference"]

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


def first_difference(own: Scene, scene: Scene, paths: Sequence[str]) -> tuple[str, Any, Any, int]:
    """Return the first field that differs, its values in both scenes, and how many differ.

    The field is empty where none does. Values are as a file would have them, None inside an absent
    block.
    """
    found = [path for path in paths if _value(own, path) != _value(scene, path)]
    if not found:
        return "", None, None, 0
    return found[0], _value(own, found[0]), _value(scene, found[0]), len(found)


def _value(scene: Scene, path: str) -> Any:
    value: Any = scene
    for name in path.split("."):
        value = getattr(value, name, None)
    return plain(value)
