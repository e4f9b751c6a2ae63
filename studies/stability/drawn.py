"""Scenes at the edge of validity, drawn at random: short runs by the thousand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from studies.stability.runs import HardRun
from studies.stability.torques import SquareWave, WhiteNoise
from swim_env.errors import SceneError
from swim_env.scene import ENERGY_EXCESSES, SCHEME_NAMES, STRAIN_NAMES, Scene
from swim_env.scene.fluid import CENTRELINE_VARIANTS, FLUID_TABLE

_MOST_STEPS = 25
_MODELS = ("none", "strip", "frozen", "expansion", "panels", "panels", "panels", "centreline")


def draw_run(seed: int) -> HardRun:
    """Return a short run of a random scene with random torques, the same for the same seed."""
    rng = np.random.default_rng(seed)
    scene = _draw_scene(rng)
    steps = int(rng.integers(1, _MOST_STEPS + 1))
    step = scene.integrator.time_step
    stiffest = max(float(scene.beam.stiffness_at_joints().max()), 1e-3)
    # From torques that hardly bend the body to ones that fold it within a step.
    amplitude = _log_uniform(rng, 1e-3, 30.0) * stiffest / scene.beam.length
    drive = rng.choice(3)
    held = step * int(rng.integers(1, 6))
    torques = WhiteNoise(amplitude, seed, held) if drive else SquareWave(amplitude, 2.0 * held)
    velocity = None
    if rng.random() < 0.5:
        # Speeds and spins that a step carries by next to nothing to a whole length, or half a turn.
        n = scene.beam.elements
        speed = _log_uniform(rng, 1e-4, 1.0) * scene.beam.length / step
        spin = _log_uniform(rng, 1e-4, 0.5) / step
        velocity = np.concatenate(
            [speed * rng.uniform(-1.0, 1.0, 2), spin * rng.uniform(-1.0, 1.0, n)]
        )
    return HardRun(f"seed {seed}", scene, steps * step, torques, velocity=velocity, case="drawn")


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _draw_scene(rng: np.random.Generator) -> Scene:
    """Return a random scene that is valid, however odd."""
    while True:
        try:
            return Scene.from_dict(_draw(rng))
        except SceneError:
            # Blocks that do not go together, a bend that folds: another one.
            continue


def _draw(rng: np.random.Generator) -> dict[str, Any]:
    model = str(rng.choice(_MODELS))
    elements = int(rng.integers(2, 13))
    length = _log_uniform(rng, 1e-3, 1e2)
    dl = length / elements
    density = _log_uniform(rng, 1e-2, 1e4)
    half_thickness = dl * _log_uniform(rng, 1e-6, 0.25)
    # Masses from a millionth of the fluid's to a thousand times as much.
    line_density = density * length * _log_uniform(rng, 1e-6, 1e3)
    stiffness = _log_uniform(rng, 1e-6, 1e6) * density * length**4
    stiff: object = stiffness
    if rng.random() < 0.3:
        stiff = (stiffness * 10.0 ** rng.uniform(-3.0, 3.0, elements - 1)).tolist()
    elif rng.random() < 0.1:
        stiff = 0.0
    data: dict[str, Any] = {
        "name": "drawn",
        "beam": {
            "length": length,
            "elements": elements,
            "half_thickness": half_thickness,
            "line_density": line_density,
            "rotary_inertia": line_density * dl**2 * _log_uniform(rng, 1e-6, 1.0),
            "bending_stiffness": stiff,
        },
        "integrator": {
            "time_step": _log_uniform(rng, 1e-5, 0.3),
            "tolerance": _log_uniform(rng, 1e-13, 1e-4),
            "scheme": str(rng.choice(SCHEME_NAMES)),
            "strain": str(rng.choice(STRAIN_NAMES)),
            "energy_excess": str(rng.choice(ENERGY_EXCESSES)),
        },
        "initial": {
            "joint_angles": rng.uniform(-1.0, 1.0, elements - 1).tolist()
            if rng.random() < 0.3
            else float(rng.uniform(-1.0, 1.0) * _log_uniform(rng, 1e-6, 2.0)),
            "heading": float(rng.uniform(-math.pi, math.pi)),
            "position": rng.uniform(-10.0 * length, 10.0 * length, 2).tolist(),
        },
    }
    if model != "none":
        panels = 2 * int(rng.integers(1, 5))
        data["fluid"] = {"model": model, "density": density, "panels_per_element": panels}
        if rng.random() < 0.5 and FLUID_TABLE[model].outline:
            data["fluid"]["cap_panels"] = (
                "proportional" if rng.random() < 0.5 else int(rng.integers(1, 4))
            )
        if FLUID_TABLE[model].field == "variant":
            data["fluid"]["variant"] = str(rng.choice(CENTRELINE_VARIANTS))
        if FLUID_TABLE[model].axial and rng.random() < 0.3:
            data["axial_added_mass"] = {}
        if rng.random() < 0.3:
            data["cross_flow_drag"] = {"coefficient": _log_uniform(rng, 1e-2, 1e2)}
        if rng.random() < 0.2:
            data["stream"] = {"velocity": (length * rng.uniform(-10.0, 10.0, 2)).tolist()}
    if rng.random() < 0.5:
        data["damping"] = {"retardation_time": _log_uniform(rng, 1e-6, 1.0)}
    if rng.random() < 0.3:
        data["self_contact"] = {}
    if rng.random() < 0.2:
        data["internal_forces"] = {}
    return data
