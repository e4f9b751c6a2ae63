"""How the physics depends on fields of a scene: derivatives of constants and of torques."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.scene import Scene

Array = NDArray[np.float64]

#: Fields that change constants of the beam or the fluid, all of them linearly.
CONSTANTS: dict[int, tuple[str, ...]] = {
    2: (
        "beam.bending_stiffness",
        "beam.line_density",
        "beam.rotary_inertia",
        "damping.retardation_time",
        "fluid.density",
    ),
    3: (
        "beam.density",
        "beam.line_density",
        "beam.rotary_inertia_1",
        "beam.rotary_inertia_2",
        "beam.lateral_stiffness",
        "beam.dorsoventral_stiffness",
        "beam.torsional_stiffness",
        "beam.natural_curvature",
        "damping.retardation_time",
        "fluid.density",
    ),
}
#: Fields of the prescribed wave.
WAVE = tuple(f"actuation.{name}" for name in ("amplitude", "frequency", "wave_number", "phase"))
#: Parts of the start, see `Simulator.reset_to`.
START = ("start.coordinates", "start.velocity")


def check_names(
    scene: Scene, names: Iterable[str], prescribed: bool, option: str = "with_respect_to"
) -> tuple[str, ...]:
    """Return what gradients are wanted with respect to; an OptionError names one that is not known.

    `prescribed` is whether the torques are those of the scene's wave; `option` gave the names.
    """
    wanted = (names,) if isinstance(names, str) else tuple(names)
    known = ("torques", *START, *CONSTANTS[scene.dimension], *WAVE)
    for name in wanted:
        if name not in known:
            raise OptionError(
                f"{option} must be of {', '.join(known)}, got {name!r}; what changes the "
                "body's shape or the panels has no gradient"
            )
        if name in WAVE and not prescribed:
            raise OptionError(f"{name} changes nothing where torques are given; leave them out")
        if name in WAVE and scene.actuation is None:
            raise OptionError(f"{name} needs a scene with actuation; {scene.name} has none")
        if name in CONSTANTS[scene.dimension] and field_of(scene, name) is None:
            raise OptionError(f"{name} is not given in the scene {scene.name}; set it first")
    return wanted


def field_of(scene: Scene, name: str) -> Any:
    """Return a field of a scene by its dotted name, None where its block is absent."""
    block, field = name.split(".")
    return getattr(getattr(scene, block), field, None)


def _density_of(scene: Scene) -> float:
    """Return the fluid's density (kg/m^3), 0 without one."""
    return float((scene.fluid.density if scene.fluid is not None else None) or 0.0)


def constants_of(scene: Scene, density: float) -> Array:
    """Return the parameters of a scene as the gradients' kernels count them.

    The fluid's is its share of the `density` of another scene (kg/m^3).
    """
    beam: Any = scene.beam
    dl = beam.element_length
    stiffness = beam.stiffness_at_joints() / dl
    fluid = [_density_of(scene) / density] if density else [1.0]
    if scene.dimension == 2:
        retardation = scene.damping.retardation_time if scene.damping else 0.0
        bodies = [[dl * beam.line_density, dl * beam.rotary_inertia]]
        joints = [stiffness, stiffness * retardation]
    else:
        spatial: Any = scene
        times = spatial.damping.times if spatial.damping else np.zeros(3)
        inertia = dl * spatial.inertia_per_length()
        bodies = [inertia[:, 0], inertia[:, 1:]]
        joints = [stiffness, stiffness * times, dl * beam.natural_curvature_at_joints()]
    return np.concatenate([np.ravel(one) for one in (*bodies, fluid, *joints)])


def _numbers_of(scene: Scene, name: str) -> Array:
    """Return a field's value; an OptionError says that it is a law and not numbers."""
    try:
        return np.array(field_of(scene, name), dtype=np.float64)
    except TypeError:
        raise OptionError(
            f"{name} of {scene.name} is a law; give numbers, one or one per joint"
        ) from None


def change_of_constants(scene: Scene, name: str) -> tuple[list[Scene], Array, Array]:
    """Return how the parameters change with a field.

    Returns
    -------
    scenes : list of Scene
        One for every number of the field, in which that is larger.
    steps : (F,) array
        By how much.
    slopes : (F, P) array
        Derivatives of the parameters; they are linear in the field.
    """
    value = _numbers_of(scene, name)
    density = _density_of(scene)
    before = constants_of(scene, density)
    scenes, steps, slopes = [], [], []
    for i, number in enumerate(value.ravel()):
        step = abs(float(number)) or 1.0
        larger = value.copy()
        larger.reshape(-1)[i] += step
        changed = scene.replace(name, larger.tolist())
        scenes.append(changed)
        steps.append(step)
        slopes.append((constants_of(changed, density) - before) / step)
    return scenes, np.array(steps), np.array(slopes).reshape(value.size, -1)


def shape_of(scene: Scene, name: str) -> tuple[int, ...]:
    """Return the shape of a field's value."""
    return np.shape(field_of(scene, name))


def change_of_wave(scene: Scene, name: str, times: Array) -> Array:
    """Return the derivative of the prescribed torques (T, ...) at some times (s) by a field."""
    drive: Any = scene.actuation
    if name == "actuation.amplitude":
        # In space the amplitude of pitch may be one of its own.
        own = {} if getattr(drive, "pitch_amplitude", None) is None else {"pitch_amplitude": 0.0}
        return np.asarray(replace(drive, amplitude=1.0, **own).torques(times, scene.beam))
    # d cos(x)/dx = cos(x + pi/2), and the same of the sine.
    turned = replace(drive, phase=drive.phase + 0.5 * math.pi).torques(times, scene.beam)
    if name == "actuation.frequency":
        turned *= times.reshape(-1, *[1] * (turned.ndim - 1))
    elif name == "actuation.wave_number":
        turned *= -scene.beam.joint_fractions.reshape(-1, *[1] * (turned.ndim - 2))
    return np.asarray(turned)
