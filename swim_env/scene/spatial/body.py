"""The body in space: its section, its inertia, and its stiffness about three axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import block
from swim_env.scene.body import Chain
from swim_env.scene.checks import Triple, one_or_many, one_value_per, real, vector
from swim_env.scene.spatial.section import Section
from swim_env.scene.stiffness import Stiffness, check_one_per_joint, check_stiffness, stiffness_at

Floats = NDArray[np.float64]

AXIS_NAMES: tuple[str, ...] = ("pitch", "yaw", "roll")
"""Names of the components of a joint's rotation vector and torque: about d1, d2 and d3."""

#: The stiffness about each of the axes.
_STIFFNESSES = ("dorsoventral_stiffness", "lateral_stiffness", "torsional_stiffness")
_GAUSS_POINTS = 8

PerJoint = Triple | tuple[Triple, ...]


def per_joint(value: PerJoint, beam: Chain) -> Floats:
    """Return three components for each joint, (N-1, 3), from one triple for all or one for each."""
    return np.array(np.broadcast_to(value, (beam.elements - 1, 3)), dtype=np.float64)


def check_per_joint(value: PerJoint, beam: Chain, field: str) -> None:
    """Refuse a list of triples that does not have one for each joint."""
    if isinstance(value[0], tuple):
        one_value_per("joint", value, beam.elements - 1, field)


@dataclass(frozen=True)
class SpatialBeam(Chain, path="beam"):
    """The elastic body in space: a chain of equal rigid elements that bend and twist at joints.

    Attributes
    ----------
    length : float
        Length l [m], above 0.
    elements : int
        Number of elements N, 2 to 1000.
    section : Section
        The cross-section along the body.
    density : float or None
        Of the body [kg/m^3], above 0; the fluid's where None.
    line_density, rotary_inertia_1, rotary_inertia_2 : float or None
        Mass per length rho_B A [kg/m], rotary inertias per length rho_B I_1 (of d1, semi-axis
        half_width) and rho_B I_2 (of d2, half_height) [kg m], above 0 and the same along the body;
        what section and density give where None.
    lateral_stiffness, dorsoventral_stiffness, torsional_stiffness : float, tuple or law
        Stiffness about d2 (EI_2, that of yaw and of the plane), d1 (EI_1, of pitch) and d3 (GJ, of
        roll) [N m^2], each in any form of `Beam.bending_stiffness`.
    natural_curvature : tuple of float, or tuple of such triples
        Curvatures K_0 and twist of the body without load about (d1, d2, d3) [1/m]: the same at all
        joints, or one triple for each of the N - 1.
    """

    section: Annotated[Section, block(Section)] = Section("uniform", 0.05, 0.05)
    density: Annotated[float | None, real("kg/m^3", above=0.0)] = None
    line_density: Annotated[float | None, real("kg/m", above=0.0)] = None
    rotary_inertia_1: Annotated[float | None, real("kg m", above=0.0)] = None
    rotary_inertia_2: Annotated[float | None, real("kg m", above=0.0)] = None
    lateral_stiffness: Annotated[Stiffness, check_stiffness] = 5.0
    dorsoventral_stiffness: Annotated[Stiffness, check_stiffness] = 5.0
    torsional_stiffness: Annotated[Stiffness, check_stiffness] = 5.0
    natural_curvature: Annotated[PerJoint, one_or_many(vector("1/m", *AXIS_NAMES))] = (
        0.0,
        0.0,
        0.0,
    )

    def __post_init__(self) -> None:
        """Check every field, and that lists have one entry for each joint."""
        super().__post_init__()
        for name in _STIFFNESSES:
            check_one_per_joint(getattr(self, name), self.elements, f"beam.{name}")
        check_per_joint(self.natural_curvature, self, "beam.natural_curvature")

    def half_width_at(self, s: ArrayLike) -> Floats:
        """Semi-axis of the section along d1 [m] at distances s from the head [m]."""
        return self.section.semi_axes(np.asarray(s, dtype=np.float64) / self.length)[0]

    def half_height_at(self, s: ArrayLike) -> Floats:
        """Semi-axis of the section along d2 [m] at distances s from the head [m]."""
        return self.section.semi_axes(np.asarray(s, dtype=np.float64) / self.length)[1]

    def gauss_points(self) -> tuple[Floats, Floats]:
        """Return the 8 Gauss points of every element, s (N, 8) [m], and their weights (8,), sum 1.

        What varies along an element enters the equations as its mean by these points.
        """
        points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        middles = np.arange(self.elements)[:, None] + 0.5
        return (middles + 0.5 * points) * self.element_length, 0.5 * weights

    def inertia_per_length(self, fluid_density: float | None) -> Floats:
        """Mean inertia of every element, equation (18).

        Parameters
        ----------
        fluid_density : float or None
            The body's density where it has none of its own [kg/m^3].

        Returns
        -------
        numpy.ndarray
            rho_B A [kg/m], rho_B I_1 and rho_B I_2 [kg m], shape (N, 3), float64.

        Raises
        ------
        SceneError
            If there is neither a density nor all three of what overrides it.
        """
        own = (self.line_density, self.rotary_inertia_1, self.rotary_inertia_2)
        density = fluid_density if self.density is None else self.density
        if density is None and None in own:
            raise SceneError(
                "beam.density is missing, a number above 0 in kg/m^3: without a fluid, give it or "
                "all of beam.line_density, beam.rotary_inertia_1 and beam.rotary_inertia_2"
            )
        s, weights = self.gauss_points()
        b, a = self.section.semi_axes(s / self.length)
        area = (density or 0.0) * np.pi * a * b
        found = np.stack([area, area * b**2 / 4.0, area * a**2 / 4.0], axis=-1)
        means: Floats = np.einsum("kgi,g->ki", found, weights)
        for i, value in enumerate(own):
            if value is not None:
                means[:, i] = value
        return means

    def stiffness_at_joints(self) -> Floats:
        """Stiffness at the joints, from head to tail.

        Returns
        -------
        numpy.ndarray
            (EI_1, EI_2, GJ) [N m^2], in the order of `AXIS_NAMES`, shape (N-1, 3), float64; row
            j - 1 belongs to the joint between elements j and j + 1, at s = j dl.
        """
        laws = (getattr(self, name) for name in _STIFFNESSES)
        return np.stack([stiffness_at(law, self.joint_fractions) for law in laws], axis=-1)

    def natural_curvature_at_joints(self) -> Floats:
        """Natural curvature at the joints [1/m], shape (N-1, 3), float64."""
        return per_joint(self.natural_curvature, self)
