"""Loads the kernels of the spatial physics, see `swim_env.physics.runtime.loading`."""

from __future__ import annotations

import functools

import numpy as np

from swim_env.physics.runtime.loading import KernelGroup, Loads, entry, linked
from swim_env.physics.solve.constants import SolverConstants
from swim_env.physics.spatial.advance import advance_spatial, spatial_energy, spatial_momentum
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.constants import SpatialConstants, no_surface, pack_constants
from swim_env.physics.spatial.equations import evaluate_spatial_step
from swim_env.physics.spatial.layout import SpatialFluid, member_views, state_size, work_sizes
from swim_env.physics.spatial.matrix import inertia_columns, spatial_jacobian
from swim_env.physics.spatial.newton import spatial_newton
from swim_env.physics.spatial.panels.influence import influence, lay_panels
from swim_env.physics.spatial.panels.mass import (
    panel_added_mass,
    panel_buffers,
    panel_mass,
    panel_shape_force,
)
from swim_env.physics.spatial.panels.surface import surface_of_sections
from swim_env.physics.spatial.prepare import prepare_spatial


def _beam_kernels() -> tuple[Loads, Loads]:
    ones = np.ones((1, 3))
    beam = SpatialBeam(2, 0.5, np.ones(2), np.ones((2, 2)), ones, ones, ones)
    fluid = SpatialFluid(False, False, False, np.zeros(0), np.zeros(3))
    scene = SpatialConstants(beam, fluid, SolverConstants(0.01, 1e-10), no_surface(2))
    constants = pack_constants(scene)
    floats, integers = work_sizes(beam, scene.surface)
    state, numbers, indices = (
        np.zeros(state_size(2)),
        np.zeros(floats),
        np.zeros(integers, np.int64),
    )
    m, _ = member_views(state, 2, numbers, indices)
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    held, many, body = np.zeros((1, 1, 1, 1)), np.zeros((1, 1), np.int64), (beam, fluid, m.body)
    first = [
        linked(evaluate_spatial_step, row, row, rows, row, 0.01, True, *body, m.newton),
        linked(spatial_jacobian, 0.01, True, *body, m.newton),
        linked(spatial_newton, m, rows, 0.01, True, scene, True),
    ]
    second = [
        linked(inertia_columns, 0.01, True, True, *body, m.newton, rows),
        linked(prepare_spatial, m, scene),
        entry(
            advance_spatial,
            *(indices, rows, held, 1, *constants, rows, many, steps, steps, rows, many),
        ),
        entry(spatial_energy, row, row, *constants, row, indices),
        entry(spatial_momentum, row, row, *constants, row, indices),
    ]
    return first, second


def _panel_kernels() -> tuple[Loads, Loads]:
    width = np.ones(3)
    surface = surface_of_sections(1.0, width, width, elements=2, around=4)
    buffers = panel_buffers(surface)
    directors = np.zeros((2, 3, 3))
    row, rows, layers = directors[0, 0], directors[0], directors
    first = [
        linked(panel_added_mass, directors, surface, buffers, rows),
        entry(influence, rows, rows, 3, True, rows, rows, layers),
    ]
    second = [
        linked(panel_shape_force, directors, row, surface, buffers, rows),
        entry(lay_panels, rows, surface.faces, rows, rows),
        entry(panel_mass, directors, surface, buffers, rows),
    ]
    return first, second


BEAM = KernelGroup(__name__, "BEAM", "kernels of the spatial beam", "compiled_beam", _beam_kernels)
PANELS = KernelGroup(
    __name__, "PANELS", "kernels of panels in space", "compiled_panels", _panel_kernels
)


@functools.cache
def load_spatial_kernels(panels: bool = False) -> None:
    """Load the kernels of the spatial beam, and those of panels where there are any.

    Call this before calling one from Python.
    """
    BEAM.load()
    if panels:
        PANELS.load()


@functools.cache
def load_panel_kernels() -> None:
    """Load the kernels of panels in space; call this before calling one of them from Python."""
    PANELS.load()
