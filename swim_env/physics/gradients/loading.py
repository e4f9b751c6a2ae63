"""Loads the kernels of gradients, see `swim_env.physics.runtime.loading`."""

from __future__ import annotations

import functools

import numpy as np

from swim_env.physics.fluid.layout import motion_count
from swim_env.physics.fluid.models import SAMPLE
from swim_env.physics.gradients.planar_sweep import (
    begin_half,
    pull_back,
    push_forward,
    sweep_sizes,
    sweep_views,
)
from swim_env.physics.gradients.planar_variation import vary
from swim_env.physics.gradients.spatial_sweep import (
    begin_spatial_half,
    pull_back_spatial,
    push_forward_spatial,
    spatial_sweep_sizes,
    spatial_sweep_views,
)
from swim_env.physics.gradients.spatial_variation import vary_spatial
from swim_env.physics.loading import load_kernels
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.runtime.loading import KernelGroup, Loads, entry, linked
from swim_env.physics.solve.constants import SolverConstants, pack_constants
from swim_env.physics.solve.state import member_views, state_size, work_sizes
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.constants import SpatialConstants, no_surface
from swim_env.physics.spatial.constants import pack_constants as pack_spatial_constants
from swim_env.physics.spatial.layout import SpatialFluid
from swim_env.physics.spatial.layout import member_views as spatial_member_views
from swim_env.physics.spatial.layout import state_size as spatial_state_size
from swim_env.physics.spatial.layout import work_sizes as spatial_work_sizes
from swim_env.physics.spatial.loading import load_spatial_kernels


def _planar_kernels() -> tuple[Loads, Loads]:
    beam = BeamConstants(2, 0.5, 0.1, 1e-3, np.ones(1), np.zeros(1))
    solver = SolverConstants(0.01, 1e-10)
    constants = pack_constants(beam, SAMPLE, solver)
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    numbers, integers = np.zeros(1, np.complex128), np.zeros((1, 1), np.int64)
    given = (rows, steps, rows, 0.1, *constants, rows, rows, integers, numbers, row)
    sizes = sweep_sizes(2, motion_count(SAMPLE))
    sweep, v, _, _ = sweep_views(
        np.zeros(sizes[0], np.complex128), np.zeros(sizes[1]), 2, motion_count(SAMPLE)
    )
    work = work_sizes(beam, SAMPLE)
    m, _ = member_views(
        *(np.zeros(state_size(2)), beam, SAMPLE, np.zeros(work[0]), np.zeros(work[1], np.int64))
    )
    return (
        [
            linked(begin_half, row, 0.1, beam, SAMPLE, solver, m, sweep),
            entry(pull_back, *given, rows, rows, rows, rows, row),
        ],
        [
            linked(
                *(vary, row, row, 0.1, row, row, row, 0.1, True, beam, SAMPLE, m, m, v),
                *(row, row, row),
            ),
            entry(push_forward, *given, row, rows, steps),
        ],
    )


def _spatial_kernels() -> tuple[Loads, Loads]:
    ones = np.ones((1, 3))
    beam = SpatialBeam(2, 0.5, np.ones(2), np.ones((2, 2)), ones, ones, ones)
    fluid = SpatialFluid(False, False, False, np.zeros(0), np.zeros(3))
    scene = SpatialConstants(beam, fluid, SolverConstants(0.01, 1e-10), no_surface(2))
    constants = pack_spatial_constants(scene)
    sizes = spatial_sweep_sizes(2)
    sweep, v, _, _ = spatial_sweep_views(np.zeros(sizes[0], np.complex128), np.zeros(sizes[1]), 2)
    work = spatial_work_sizes(beam, scene.surface)
    m, _ = spatial_member_views(
        *(np.zeros(spatial_state_size(2)), 2, np.zeros(work[0]), np.zeros(work[1], np.int64))
    )
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    numbers, integers = np.zeros(1, np.complex128), np.zeros((1, 1), np.int64)
    given = (rows, steps, steps, *constants, rows, rows, integers, numbers, row)
    directions = (row, 0.1, row, row, row, rows, rows, True, True)
    return (
        [
            linked(begin_spatial_half, row, row, rows, 0.1, True, scene, m, sweep),
            entry(pull_back_spatial, *given, rows, rows, rows, steps, row),
        ],
        [
            linked(vary_spatial, *directions, beam, fluid, m.body, v, row, row, rows, row),
            entry(push_forward_spatial, *given, row, steps, steps),
        ],
    )


PLANAR = KernelGroup(
    __name__, "PLANAR", "kernels of gradients", "compiled_gradients", _planar_kernels
)
SPATIAL = KernelGroup(
    *(__name__, "SPATIAL", "kernels of gradients in space", "compiled_spatial_gradients"),
    _spatial_kernels,
)


@functools.cache
def load_planar_gradients() -> None:
    """Load the kernels of planar gradients, after those of the physics."""
    load_kernels()
    PLANAR.load()


@functools.cache
def load_spatial_gradients() -> None:
    """Load the kernels of gradients in space, after those of the physics."""
    load_spatial_kernels()
    SPATIAL.load()
