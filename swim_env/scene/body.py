"""The swimming body: a beam as a chain of rigid elements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.scene.block import Block
from swim_env.scene.checks import integer, real
from swim_env.scene.stiffness import Stiffness, check_one_per_joint, check_stiffness, stiffness_at

Floats = NDArray[np.float64]

MOST_ELEMENTS = 1000
"""Largest `Beam.elements`."""


@dataclass(frozen=True)
class Chain(Block, path="beam"):
    """A chain of equal rigid elements with springs at the joints.

    Attributes
    ----------
    length : float
        Length l [m], above 0.
    elements : int
        Number of elements N, 2 to 1000.
    """

    length: Annotated[float, real("m", above=0.0)] = 1.0
    elements: Annotated[int, integer(2, MOST_ELEMENTS)] = 9

    @property
    def element_length(self) -> float:
        """Length of one element, dl = l/N [m]."""
        return self.length / self.elements

    @property
    def joint_fractions(self) -> Floats:
        """Places of the joints as s/l, (N-1,): (k-1)/N for the joint of elements k-1 and k."""
        return np.arange(1, self.elements, dtype=np.float64) / self.elements


@dataclass(frozen=True)
class Beam(Chain, path="beam"):
    """The elastic body in the plane: a chain of equal rigid elements with bending springs.

    Attributes
    ----------
    length : float
        Length l [m], above 0.
    elements : int
        Number of elements N, 2 to 1000.
    half_thickness : float
        Half the thickness in the plane of motion [m], at least 0. Only the fluid sees it; with a
        fluid of panels it must be above 0 and below a quarter of the length. It limits how far the
        body may bend: the inner side of every element keeps a tenth of its length.
    line_density : float
        Mass per length rho_B A [kg/m], above 0.
    rotary_inertia : float
        Rotary inertia per length rho_B I_1 [kg m], at least 0.
    bending_stiffness : float, tuple of float, PiecewiseStiffness or LinearStiffness
        Bending stiffness EI [N m^2], at least 0: one value, one value for each of the N - 1
        joints, or a law in s/l, which means the same at every N. Lists and mappings, as YAML
        has them, are converted. The effect is absent at 0 or null.
    """

    half_thickness: Annotated[float, real("m", at_least=0.0)] = 0.01
    line_density: Annotated[float, real("kg/m", above=0.0)] = 0.31
    rotary_inertia: Annotated[float, real("kg m", at_least=0.0)] = 7.8e-6
    bending_stiffness: Annotated[Stiffness, check_stiffness] = 5.0

    def __post_init__(self) -> None:
        """Check every field, and that a list of stiffnesses has one for each joint."""
        super().__post_init__()
        check_one_per_joint(self.bending_stiffness, self.elements, "beam.bending_stiffness")

    def stiffness_at_joints(self) -> Floats:
        """Bending stiffness at the joints, from head to tail.

        Returns
        -------
        numpy.ndarray
            EI [N m^2], shape (N-1,), float64; entry k-2 belongs to the joint between elements
            k-1 and k, at s = (k-1) dl.
        """
        return stiffness_at(self.bending_stiffness, self.joint_fractions)
