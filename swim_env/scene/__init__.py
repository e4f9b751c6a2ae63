"""Scenes: everything that decides a run, as frozen dataclasses, checked, to and from YAML."""

from swim_env.scene.body import Beam
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
from swim_env.scene.scene import Scene, load_scene, require_planar, scene_label
from swim_env.scene.spatial.body import AXIS_NAMES, SpatialBeam
from swim_env.scene.spatial.drive import (
    WAVE_AXES,
    WAVE_NAMES,
    SpatialActuation,
    SpatialDamping,
)
from swim_env.scene.spatial.fluid import SPATIAL_FLUID_MODEL_NAMES, SpatialFluid, SpatialStream
from swim_env.scene.spatial.initial import SpatialInitial
from swim_env.scene.spatial.scene import SpatialEpisode, SpatialScene
from swim_env.scene.spatial.section import PROFILE_NAMES, Section
from swim_env.scene.stiffness import LinearStiffness, PiecewiseStiffness, StiffnessPiece

__all__ = [
    "AXIS_NAMES",
    "EFFECT_NAMES",
    "ENERGY_EXCESSES",
    "FLUID_MODEL_NAMES",
    "PROFILE_NAMES",
    "SCHEME_NAMES",
    "SPATIAL_FLUID_MODEL_NAMES",
    "STRAIN_NAMES",
    "TOLERANCE_RANGE",
    "WAVE_AXES",
    "WAVE_NAMES",
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
    "Section",
    "SelfContact",
    "SpatialActuation",
    "SpatialBeam",
    "SpatialDamping",
    "SpatialEpisode",
    "SpatialFluid",
    "SpatialInitial",
    "SpatialScene",
    "SpatialStream",
    "StiffnessPiece",
    "Stream",
    "load_scene",
    "require_planar",
    "scene_label",
    "scene_names",
]
