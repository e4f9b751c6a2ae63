"""A fish-like elastic beam that swims in an ideal fluid, as a learning environment.

After Leyendecker & Kanso, "Locomotion of a submerged Cosserat beam" (DETC2009-87198).
"""

from swim_env.env import SwimEnv, SwimTargetEnv
from swim_env.env_interface import EnvSnapshot
from swim_env.episodes import TERMINATION_REASONS
from swim_env.errors import (
    ActionError,
    OptionError,
    OutlineError,
    SceneError,
    SimulationEndedError,
    SwimError,
    TorqueError,
    TrajectoryError,
)
from swim_env.physics import FLUID_MODELS
from swim_env.registration import register_environments
from swim_env.scene import EFFECT_NAMES, Initial, Scene, load_scene, scene_names
from swim_env.simulator import Simulator, Snapshot
from swim_env.trajectory import Trajectory
from swim_env.vector_env import SwimTargetVectorEnv, SwimVectorEnv

__version__ = "0.1.0"

#: Names of the effects that a scene may have; each is the name of its block.
EFFECTS = EFFECT_NAMES

register_environments()

__all__ = [
    "EFFECTS",
    "FLUID_MODELS",
    "TERMINATION_REASONS",
    "ActionError",
    "EnvSnapshot",
    "Initial",
    "OptionError",
    "OutlineError",
    "Scene",
    "SceneError",
    "SimulationEndedError",
    "Simulator",
    "Snapshot",
    "SwimEnv",
    "SwimError",
    "SwimTargetEnv",
    "SwimTargetVectorEnv",
    "SwimVectorEnv",
    "TorqueError",
    "Trajectory",
    "TrajectoryError",
    "__version__",
    "load_scene",
    "scene_names",
]
