"""Calls of the spatial kernels that others call at an address, for tests only."""

import numpy as np

from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.spatial.loading import load_panel_kernels
from swim_env.physics.spatial.panels.mass import (
    PanelWork,
    new_panel_work,
    panel_added_mass,
    panel_shape_force,
)
from swim_env.physics.spatial.panels.surface import Surface
from tests.support import Array


@entry_kernel
def _added_mass(directors: Array, surface: Surface, work: PanelWork, out: Array) -> int:
    return panel_added_mass(directors, surface, work, out)


@entry_kernel
def _shape_force(
    directors: Array, motion: Array, surface: Surface, work: PanelWork, out: Array
) -> None:
    panel_shape_force(directors, motion, surface, work, out)


class PanelProbe:
    """Added mass and shape derivative of one body."""

    def __init__(self, surface: Surface) -> None:
        load_panel_kernels()
        self.surface = surface
        self._given = Referenced(surface), Referenced(new_panel_work(surface))

    def status(self, directors: Array) -> int:
        """Return the code of the reason why a shape has no added mass, 0 for none."""
        size = 6 * self.surface.elements
        self._mass = np.full((size, size), np.nan)
        return int(_added_mass(directors, *self._given, self._mass))

    def mass(self, directors: Array) -> Array:
        """Return A (6 N, 6 N)."""
        assert self.status(directors) == 0
        return self._mass

    def derivative(self, directors: Array, motion: Array) -> Array:
        """Return the derivative (N, 3) of V^T A V/2 by the elements' turns."""
        self.mass(directors)
        out = np.full((self.surface.elements, 3), np.nan)
        _shape_force(directors, motion, *self._given, out)
        return out
