"""Loads the kernels of the planar physics, see `swim_env.physics.runtime.loading`."""

from __future__ import annotations

import functools

import numpy as np

from swim_env.physics.fluid.models import MODELS, added_mass, linked_kernels, shape_force
from swim_env.physics.fluid.sources import influence, normal_influence
from swim_env.physics.planar.chain import centres, centres_of_trajectory
from swim_env.physics.planar.equations import evaluate_step
from swim_env.physics.planar.matrix import adjoint_jacobian, step_jacobian
from swim_env.physics.runtime.loading import KernelGroup, Loads, entry, linked
from swim_env.physics.solve.advance import advance, energy_and_velocity, momentum_of_velocity
from swim_env.physics.solve.constants import SAMPLE_SCENE
from swim_env.physics.solve.newton import newton_in_passes, newton_with_shortening
from swim_env.physics.solve.outer_step import outer_step
from swim_env.physics.solve.prepare import prepare
from swim_env.physics.solve.state import new_member


def _kernels() -> Loads:
    beam, fluid, solver = SAMPLE_SCENE
    m = new_member(fluid)
    words, words_of_each = np.zeros(1, dtype=np.int64), np.zeros((1, 1), dtype=np.int64)
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    whole, scene = (beam, fluid, solver), (beam, fluid, m.body)
    mass = m.body.mass.added

    of_a_state = (row, words, words)
    of_models = {name: linked_kernels(name) for name in MODELS}  # declares all, for calls of them
    panel_mass, panel_force = of_models["panels"]
    return [
        panel_mass.load,
        linked(evaluate_step, row, row, row, 0.01, True, True, *scene, m.fluid_work),
        linked(outer_step, m, row, *whole, row),
        linked(newton_in_passes, m, row, 0.01, True, *whole, True),
        linked(step_jacobian, 0.01, 0.0, *scene, m.fluid_work, m.newton),
        panel_force.load,
        linked(prepare, m.state, *whole, m.body, m.fluid_work, m.newton, m.step.effort),
        linked(newton_with_shortening, m, row, 0.01, True, *whole),
        entry(
            advance,
            *(words, words_of_each, steps, 1, words),
            *(steps, steps, rows, words_of_each),
        ),
        linked(adjoint_jacobian, 0.01, *scene, m.newton),
        entry(momentum_of_velocity, *of_a_state),
        linked(added_mass, row, fluid, m.fluid_work, mass),
        linked(shape_force, row, fluid, m.fluid_work, row),
        entry(energy_and_velocity, *of_a_state),
        entry(centres, row, 0.5, rows),
        entry(centres_of_trajectory, rows, 0.5, steps),
        entry(influence, rows, 3, 1.0, row, steps),
        entry(normal_influence, rows, 3, steps, rows),
    ]


KERNELS = KernelGroup(__name__, "KERNELS", "physics kernels", "compiled", _kernels)


def _kernels_of_model(name: str) -> Loads:
    return [one.load for one in linked_kernels(name)]


#: Kernels of the fluid models that few scenes have. Flows need those of `panels` as well.
OF_MODELS = {
    name: KernelGroup(
        *(__name__, f"OF_MODELS[{name!r}]", f"kernels of the fluid model {name}"),
        *(f"compiled_model_{name}", functools.partial(_kernels_of_model, name)),
    )
    for name, model in MODELS.items()
    if name != "panels" and hasattr(model.added_mass, "linked")
}


@functools.cache
def load_kernels() -> None:
    """Load the kernels of planar physics except those of `OF_MODELS`."""
    KERNELS.load()


@functools.cache
def load_model(name: str) -> None:
    """Load the kernels of planar physics with a fluid model; call this before calling one."""
    load_kernels()
    if name in OF_MODELS:
        OF_MODELS[name].load()
