"""Loads the kernels of the spatial physics, see `swim_env.physics.runtime.loading`."""

from __future__ import annotations

import functools

import numpy as np

from swim_env.physics.runtime.loading import KernelGroup, Loads, entry, linked
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.spatial.advance import advance_spatial, spatial_energy, spatial_momentum
from swim_env.physics.spatial.constants import SAMPLE_SPATIAL_SCENE
from swim_env.physics.spatial.equations import evaluate_spatial_step
from swim_env.physics.spatial.layout import new_spatial_member
from swim_env.physics.spatial.matrix import inertia_columns, spatial_jacobian
from swim_env.physics.spatial.newton import spatial_newton
from swim_env.physics.spatial.panels.influence import influence, lay_panels
from swim_env.physics.spatial.panels.mass import (
    new_panel_work,
    panel_added_mass,
    panel_mass,
    panel_shape_force,
)
from swim_env.physics.spatial.panels.surface import surface_of_sections
from swim_env.physics.spatial.prepare import prepare_spatial
from swim_env.physics.spatial.step import spatial_step


def _beam_kernels() -> Loads:
    scene = SAMPLE_SPATIAL_SCENE
    m = new_spatial_member(scene.surface)
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    words, held, body = np.zeros(1, np.int64), np.zeros((1, 1, 1, 1)), (*scene[:2], m.body)
    return [
        linked(evaluate_spatial_step, row, row, rows, row, 0.01, True, *body, m.newton),
        linked(spatial_step, m, rows, scene, row),
        linked(inertia_columns, 0.01, True, True, *body, m.newton, rows),
        linked(spatial_jacobian, 0.01, True, *body, m.newton),
        linked(spatial_newton, m, rows, 0.01, True, scene, True),
        linked(prepare_spatial, m, scene),
        entry(
            advance_spatial,
            *(words, words[None], held, 1, words, steps, steps, rows, words[None]),
        ),
        entry(spatial_energy, row, words, words),
        entry(spatial_momentum, row, words, words),
    ]


def _panel_kernels() -> Loads:
    width = np.ones(3)
    surface = surface_of_sections(1.0, width, width, elements=2, around=4)
    given = Referenced(surface), Referenced(new_panel_work(surface))
    directors = np.zeros((2, 3, 3))
    row, rows, layers = directors[0, 0], directors[0], directors
    return [
        linked(panel_added_mass, directors, *given, rows),
        linked(panel_shape_force, directors, row, *given, rows),
        entry(influence, rows, rows, 3, True, rows, rows, layers),
        entry(lay_panels, rows, surface.faces, rows, rows),
        entry(panel_mass, directors, *given, rows),
    ]


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
