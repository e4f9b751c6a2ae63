"""A fish-like elastic beam that swims in an ideal fluid, as a learning environment.

After Leyendecker & Kanso, "Locomotion of a submerged Cosserat beam" (DETC2009-87198).
"""

import importlib
from types import ModuleType

from swim_env.accuracy.choice import with_chosen_settings
from swim_env.analysis.characteristics import (
    Characteristics,
    SpatialCharacteristics,
    characterise,
    resolve,
)
from swim_env.analysis.modes import natural_frequencies
from swim_env.envs.episodes import TERMINATION_CODES, TERMINATION_REASONS, EnvSnapshot
from swim_env.envs.registration import register_environments
from swim_env.envs.single import SwimEnv, SwimTargetEnv
from swim_env.envs.spatial import (
    SwimEnv3D,
    SwimTargetEnv3D,
    SwimTargetVectorEnv3D,
    SwimVectorEnv3D,
)
from swim_env.envs.tasks import (
    TASKS,
    EfficientTask,
    ForwardTask,
    Moment,
    PathTask,
    StationTask,
    TargetTask,
    Task,
    TurnTask,
)
from swim_env.envs.vector import SwimTargetVectorEnv, SwimVectorEnv
from swim_env.errors import (
    ActionError,
    OptionError,
    OutlineError,
    SceneError,
    SimulationEndedError,
    SurfaceError,
    SwimError,
    TaskError,
    TorqueError,
    TrajectoryError,
)
from swim_env.physics import FLUID_MODELS
from swim_env.scene import EFFECT_NAMES, Initial, Scene, SpatialScene, load_scene, scene_names
from swim_env.sim.simulator import Simulator, Snapshot
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from swim_env.sim.trajectory import Trajectory

__version__ = "0.1.0"

#: Names of the effects that a scene may have; each is the name of its block.
EFFECTS = EFFECT_NAMES


def __getattr__(name: str) -> ModuleType:
    """Import `swim_env.gradients` where it is asked for, which most programs do not."""
    if name == "gradients":
        return importlib.import_module("swim_env.gradients")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


register_environments()
Scene._choose = with_chosen_settings
Scene._resolve = resolve

__all__ = [
    "EFFECTS",
    "FLUID_MODELS",
    "TASKS",
    "TERMINATION_CODES",
    "TERMINATION_REASONS",
    "ActionError",
    "Characteristics",
    "EfficientTask",
    "EnvSnapshot",
    "ForwardTask",
    "Initial",
    "Moment",
    "OptionError",
    "OutlineError",
    "PathTask",
    "Scene",
    "SceneError",
    "SimulationEndedError",
    "Simulator",
    "Snapshot",
    "SpatialCharacteristics",
    "SpatialScene",
    "SpatialTrajectory",
    "StationTask",
    "SurfaceError",
    "SwimEnv",
    "SwimEnv3D",
    "SwimError",
    "SwimTargetEnv",
    "SwimTargetEnv3D",
    "SwimTargetVectorEnv",
    "SwimTargetVectorEnv3D",
    "SwimVectorEnv",
    "SwimVectorEnv3D",
    "TargetTask",
    "Task",
    "TaskError",
    "TorqueError",
    "Trajectory",
    "TrajectoryError",
    "TurnTask",
    "__version__",
    "characterise",
    "load_scene",
    "natural_frequencies",
    "scene_names",
]
