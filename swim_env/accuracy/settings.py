"""The numerical settings of a scene, as distinct from its physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from swim_env.errors import SwimError
from swim_env.scene import Scene

__all__ = [
    "PAPER_SETTINGS",
    "Settings",
    "duration_for",
    "even",
    "pace_of",
    "paces_of",
    "refuse_lists",
]

#: Where a scene holds them.
_PATHS = {
    "fluid_model": "fluid.model",
    "elements": "beam.elements",
    "panels_per_element": "fluid.panels_per_element",
    "cap_panels": "fluid.cap_panels",
    "time_step": "integrator.time_step",
    "scheme": "integrator.scheme",
    "strain": "integrator.strain",
    "tolerance": "integrator.tolerance",
}


@dataclass(frozen=True)
class Settings:
    """One way to compute a scene, the paper's unless given.

    Attributes are the scene's fields; those of the fluid mean nothing in a scene without one.
    """

    fluid_model: str = "panels"
    elements: int = 9
    panels_per_element: int = 4
    cap_panels: int | str = 1
    time_step: float = 0.01
    scheme: str = "paper"
    strain: str = "averaged_directors"
    tolerance: float = 1e-10

    def apply(self, scene: Scene) -> Scene:
        """Return a scene that is computed in this way.

        SceneError if that is not possible, as where it lists a stiffness for each of other joints.
        """
        changes = {path: getattr(self, name) for name, path in _PATHS.items()}
        if not scene.has_fluid:
            changes = {path: value for path, value in changes.items() if path[:6] != "fluid."}
        elif scene.fluid and self.fluid_model != scene.fluid.model:
            changes |= {"fluid.added_mass_per_length": None, "fluid.variant": None}
        return scene.replace(changes)

    @property
    def label(self) -> str:
        """A short text for tables: model, N x panels/caps, step, what departs from the default."""
        caps = "p" if isinstance(self.cap_panels, str) else self.cap_panels
        text = f"{self.fluid_model} {self.elements}x{self.panels_per_element}/{caps}"
        text += f" {1e3 * self.time_step:g} ms {self.scheme}"
        if self.strain != "averaged_directors":
            text += f" {self.strain}"
        return text if self.tolerance == 1e-10 else f"{text} tol {self.tolerance:g}"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Settings:
        """Return what `to_dict` was made of; other entries are ignored."""
        return cls(**{spec.name: data[spec.name] for spec in fields(cls)})


#: The coarsest step of the measured front (s), and how many there are in a period of its drives.
_COARSEST, _IN_PERIOD = 0.02, 50
#: Most of them in a run on which settings are compared: errors of a steady gait do not grow.
_MOST_COMPARED = 1000
#: Largest factor by which steps may be longer than a drive's period asks for.
_SLOWEST = 5


def pace_of(scene: Scene) -> float:
    """Return what stands for a second of the front, which was measured at a drive of 1 Hz.

    The coarsest step is about a fiftieth of the drive's period, and whole ones make the control
    interval: the same settings then do the same for a body of any size. Without a drive it is the
    control interval.
    """
    return scene.episode.control_interval / _coarsest_in_interval(scene) / _COARSEST


def paces_of(scene: Scene) -> list[float]:
    """Return the pace of a scene, and slower ones that may do where a drive is fast.

    Their coarsest steps make the control interval as well, and are at most about a tenth of the
    period.
    """
    most = _coarsest_in_interval(scene)
    return [factor * pace_of(scene) for factor in range(1, _SLOWEST + 1) if most % factor == 0]


def _coarsest_in_interval(scene: Scene) -> int:
    """Return how many of the coarsest steps make a control interval."""
    frequency = abs(scene.actuation.frequency) / math.tau if scene.actuation else 0.0
    return max(1, round(_IN_PERIOD * frequency * scene.episode.control_interval))


def duration_for(scene: Scene, wanted: float) -> float:
    """Return how long (s) to play for a duration (s): 20 s of the front at most.

    All steps that are compared divide it: it is whole control intervals, unless one is too long.
    """
    step, together = pace_of(scene) * _COARSEST, _coarsest_in_interval(scene)
    if together > _MOST_COMPARED:
        together = 1
    most = _MOST_COMPARED // together
    return min(max(1, round(wanted / step / together)), most) * together * step


#: What the paper computes with.
PAPER_SETTINGS = Settings()


def even(panels: float) -> int:
    """Return the nearest even number of panels, at least 2."""
    return max(2, 2 * round(0.5 * panels))


def refuse_lists(scene: Scene, advice: str) -> None:
    """Raise a SwimError if a scene lists values for each element or joint: their number is fixed.

    The message ends with what that number cannot do, and what would help.
    """
    initial = scene.initial
    lists = (scene.beam.bending_stiffness, initial.joint_angles, initial.turning_rate)
    if any(isinstance(one, tuple) for one in (*lists, initial.velocity[0])):
        raise SwimError(
            f"scene {scene.name} lists values for every joint or element, so their number cannot "
            f"{advice}"
        )
