"""The table of fluid models, and the kernels that look a scene's model up in it.

A model is a file of this folder with its name, and a line in the scene's list of names
(`swim_env.scene.fluid`); docs/howto/extending.md shows one. A name without a file, or a
file without what `Model` asks for, is an error when the package is imported.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import SAMPLE, FluidConstants, FluidWork, new_fluid_work
from swim_env.physics.fluid.model import Model
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.linking import Linked, link
from swim_env.physics.status import MASS_NOT_POSITIVE
from swim_env.scene import FLUID_MODEL_NAMES

Array = NDArray[np.float64]


def _load(name: str) -> Model:
    model = import_module(f"swim_env.physics.fluid.{name}").MODEL
    if not isinstance(model, Model):
        raise TypeError(f"swim_env.physics.fluid.{name}.MODEL must be a Model, got {model!r}")
    return model


#: The models by name, from the crudest to the full one and the one that is there for comparison.
MODELS: dict[str, Model] = {name: _load(name) for name in FLUID_MODEL_NAMES}
#: Names that a scene may use, and the code by which the kernels know each.
FLUID_MODELS: dict[str, int] = {name: code for code, name in enumerate(MODELS)}


def linked_kernels(name: str) -> list[Linked]:
    """Return the kernels of a model that are called at an address."""
    model = MODELS[name]
    work = new_fluid_work(SAMPLE)
    out = np.zeros((2, 2))
    found = []
    for one, last in ((model.added_mass, out), (model.shape_force, out[0])):
        if hasattr(one, "linked"):
            one.linked.declare(out[0], SAMPLE, work, last)
            found.append(one.linked)
    return found


def fluid_constants(
    name: str,
    geometry: FluidGeometry,
    density: float,
    *,
    axial: bool = False,
    terms: Array | None = None,
    drag: float = 0.0,
    stream: tuple[float, float] = (0.0, 0.0),
) -> FluidConstants:
    """Return the constants of a model for the kernels; see `FluidConstants`."""
    model = MODELS[name]
    motions = 2 * geometry.elements + (2 if axial else 0)
    return FluidConstants(
        FLUID_MODELS[name],
        geometry,
        density,
        name != "none",
        model.varies,
        int(model.panels(geometry)),
        int(model.squares(motions)),
        axial,
        np.zeros(0) if terms is None else np.array(terms, dtype=np.float64),  # one of its own
        drag,
        *stream,
    )


@kernel
def _no_added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    # Names are looked up in the table, so no scene comes here.
    return MASS_NOT_POSITIVE


@kernel
def _no_shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    out[:] = np.nan


def _by_model(name: str, unknown: Any, returned: str) -> Any:
    """Return a linked kernel that calls this kernel of the model whose code `fluid.model` is.

    Numba knows functions one by one and not in tables, so the comparisons are written out here: one
    level of them, as nested functions would be optimised once per level.
    """
    lines = [f"def {name}(given, fluid, work, out):"]
    for model, code in FLUID_MODELS.items():
        lines += [
            f"    if fluid.model == {code}:",
            f"        return {model}(given, fluid, work, out)",
        ]
    lines += ["    return unknown(given, fluid, work, out)"]
    names = {model: getattr(entry, name) for model, entry in MODELS.items()}
    names |= {"unknown": unknown, "__name__": __name__}
    # Under the name of this file, so that numba keeps the compiled code.
    exec(compile("\n".join(lines), __file__, "exec"), names)
    names[name].__annotations__["return"] = returned
    return link(entry_kernel(names[name]))


added_mass = _by_model("added_mass", _no_added_mass, "int")
"""Evaluate the added mass of a shape with the scene's fluid model.

Parameters
----------
joint_angles : (N - 1,) array
    theta_{k+1} - theta_k (rad).
fluid : FluidConstants
    Model and sizes.
work : FluidWork
    Overwritten; `shape_force` reads it.
out : (K, K) array, or padded
    Overwritten: the symmetric added mass A (kg/m, kg, kg m per metre of depth for v-v, v-w
    and w-w entries, all times a length).

Returns
-------
int
    0, or the code of the reason why there is none (see `swim_env.physics.status`).
"""

shape_force = _by_model("shape_force", _no_shape_force, "None")
"""Differentiate V^T A V/2 with respect to every element angle, V held.

Parameters
----------
motion : (K,) array, or padded
    Unit-motion velocities V (or increments).
fluid : FluidConstants
    Model and sizes.
work : FluidWork
    As `added_mass` left it for this shape.
out : (N,) array
    Overwritten: the derivative, in units of V^T A V.
"""
