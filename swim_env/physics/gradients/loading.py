"""Loads the kernels of gradients, see `swim_env.physics.runtime.loading`."""

from __future__ import annotations

import functools

import numpy as np

from swim_env.physics.fluid.layout import motion_count
from swim_env.physics.gradients.planar_sweep import (
    begin_half,
    new_sweep,
    pull_back,
    push_forward,
)
from swim_env.physics.gradients.planar_variation import vary
from swim_env.physics.gradients.spatial_sweep import (
    begin_spatial_half,
    new_spatial_sweep,
    pull_back_spatial,
    push_forward_spatial,
)
from swim_env.physics.gradients.spatial_variation import vary_spatial
from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.loading import KernelGroup, Loads, entry, linked
from swim_env.physics.solve.constants import SAMPLE_SCENE
from swim_env.physics.solve.state import new_member
from swim_env.physics.spatial.constants import SAMPLE_SPATIAL_SCENE
from swim_env.physics.spatial.layout import new_spatial_member
from swim_env.physics.spatial.loading import load_spatial_kernels


def _planar_kernels() -> Loads:
    beam, fluid, solver = SAMPLE_SCENE
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    words = np.zeros(1, np.int64)
    given = (rows, steps, rows, 0.1, words, words[None], words)
    m, sweep = new_member(fluid), new_sweep(2, motion_count(fluid))
    return [
        linked(
            *(vary, row, row, 0.1, row, row, row, 0.1, True, beam, fluid, m, m),
            *(sweep.variation, row, row, row),
        ),
        entry(pull_back, *given, rows, rows, rows, rows, row),
        entry(push_forward, *given, row, rows, steps),
        linked(begin_half, row, 0.1, beam, fluid, solver, m, sweep),
    ]


def _spatial_kernels() -> Loads:
    scene = SAMPLE_SPATIAL_SCENE
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    words = np.zeros(1, np.int64)
    given = (rows, steps, steps, words, words[None], words)
    directions = (row, 0.1, row, row, row, rows, rows, True, True)
    m, sweep = new_spatial_member(scene.surface), new_spatial_sweep(2)
    return [
        linked(
            *(vary_spatial, *directions, scene.beam, scene.fluid, m.body, sweep.variation),
            *(row, row, rows, row),
        ),
        entry(pull_back_spatial, *given, rows, rows, rows, steps, row),
        entry(push_forward_spatial, *given, row, steps, steps),
        linked(begin_spatial_half, row, row, rows, 0.1, True, scene, m, sweep),
    ]


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
