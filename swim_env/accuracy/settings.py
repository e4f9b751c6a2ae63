"""How a scene is computed, apart from what it is: the axes of the study of accuracy and cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from swim_env.analysis.continuous import METHODS
from swim_env.scene import Scene

__all__ = ["PAPER_SETTINGS", "Settings", "lists_values", "settings_of"]


@dataclass(frozen=True)
class Settings:
    """One way to compute a scene.

    Attributes
    ----------
    fluid_model : str
        `fluid.model`; of no meaning in a scene without a fluid.
    elements : int
        `beam.elements`.
    panels_per_element : int
        `fluid.panels_per_element`.
    cap_panels : int or str
        `fluid.cap_panels`.
    time_step : float
        `integrator.time_step` (s).
    scheme, strain : str
        `integrator.scheme` and `integrator.strain`; or, as a scheme, one of
        `swim_env.analysis.continuous.METHODS`, SciPy's solvers of the equations in continuous time.
    tolerance : float
        `integrator.tolerance`, or the solver's relative tolerance.
    """

    fluid_model: str = "panels"
    elements: int = 9
    panels_per_element: int = 4
    cap_panels: int | str = 1
    time_step: float = 0.01
    scheme: str = "paper"
    strain: str = "averaged_directors"
    tolerance: float = 1e-10

    @property
    def solver(self) -> str | None:
        """The solver of SciPy that the scheme names; None where it is one of the kernels'."""
        return self.scheme if self.scheme in METHODS else None

    def apply(self, scene: Scene) -> Scene:
        """Return a scene that is computed in this way.

        What belongs to a solver of SciPy, its name and tolerance, is no matter of a scene: that
        keeps its own.

        Raises
        ------
        SceneError
            If that is not possible, for example because the scene lists a stiffness for every
            joint of another number of them.
        """
        changes: dict[str, object] = {
            "beam.elements": self.elements,
            "integrator.time_step": self.time_step,
            "integrator.strain": self.strain,
        }
        if self.solver is None:
            changes |= {
                "integrator.scheme": self.scheme,
                "integrator.tolerance": self.tolerance,
            }
        if scene.fluid is not None and scene.fluid.present:
            changes |= {
                "fluid.model": self.fluid_model,
                "fluid.panels_per_element": self.panels_per_element,
                "fluid.cap_panels": self.cap_panels,
            }
            if self.fluid_model != scene.fluid.model:
                changes |= {"fluid.added_mass_per_length": None, "fluid.variant": None}
        return scene.replace(changes)

    @property
    def label(self) -> str:
        """A short text for tables: model, N x panels/caps, step, what departs from the default."""
        caps = "p" if isinstance(self.cap_panels, str) else self.cap_panels
        text = f"{self.fluid_model} {self.elements}x{self.panels_per_element}/{caps}"
        if self.solver is not None:
            return f"{text} {self.solver} rtol {self.tolerance:g}"
        text += f" {1e3 * self.time_step:g} ms {self.scheme}"
        if self.strain != "averaged_directors":
            text += f" {self.strain}"
        return text if self.tolerance == 1e-10 else f"{text} tol {self.tolerance:g}"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Settings:
        """Return what `to_dict` was made of; other entries are passed over."""
        return cls(**{spec.name: data[spec.name] for spec in fields(cls)})


#: What the paper computes with.
PAPER_SETTINGS = Settings()


def settings_of(scene: Scene) -> Settings:
    """Return how a scene is computed."""
    fluid = scene.fluid
    return Settings(
        fluid.model if fluid else "none",
        scene.beam.elements,
        fluid.panels_per_element if fluid else 4,
        fluid.cap_panels if fluid else 1,
        scene.integrator.time_step,
        scene.integrator.scheme,
        scene.integrator.strain,
        scene.integrator.tolerance,
    )


def lists_values(scene: Scene) -> bool:
    """Tell whether a scene lists values for each element or joint, and so fixes their number."""
    initial = scene.initial
    lists = (scene.beam.bending_stiffness, initial.joint_angles, initial.turning_rate)
    return any(isinstance(one, tuple) for one in (*lists, initial.velocity[0]))
