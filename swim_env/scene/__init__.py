"""Scenes: everything that decides a run, as frozen dataclasses, checked, to and from YAML."""

from swim_env.scene.body import Beam, LinearStiffness, PiecewiseStiffness, StiffnessPiece
from swim_env.scene.drive import Actuation
from swim_env.scene.effects import (
    EFFECT_NAMES,
    AxialAddedMass,
    CrossFlowDrag,
    Damping,
    InternalForces,
    Recording,
    SelfContact,
    Stream,
)
from swim_env.scene.fluid import FLUID_MODEL_NAMES, Fluid
from swim_env.scene.initial import Initial
from swim_env.scene.library import scene_names
from swim_env.scene.run import (
    ENERGY_EXCESSES,
    SCHEME_NAMES,
    STRAIN_NAMES,
    TOLERANCE_RANGE,
    Episode,
    Integrator,
)
from swim_env.scene.scene import Scene, load_scene, scene_label

__all__ = [
    "EFFECT_NAMES",
    "ENERGY_EXCESSES",
    "FLUID_MODEL_NAMES",
    "SCHEME_NAMES",
    "STRAIN_NAMES",
    "TOLERANCE_RANGE",
    "Actuation",
    "AxialAddedMass",
    "Beam",
    "CrossFlowDrag",
    "Damping",
    "Episode",
    "Fluid",
    "Initial",
    "Integrator",
    "InternalForces",
    "LinearStiffness",
    "PiecewiseStiffness",
    "Recording",
    "Scene",
    "SelfContact",
    "StiffnessPiece",
    "Stream",
    "load_scene",
    "scene_label",
    "scene_names",
]
