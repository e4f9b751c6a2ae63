"""Tasks: what episodes are about. Each shipped one is a module, and may be a pattern for yours."""

from swim_env.envs.geometry import StartPlan
from swim_env.envs.tasks.base import NOISE, SEED, Start, Task
from swim_env.envs.tasks.efficient import EfficientTask
from swim_env.envs.tasks.find import TASKS, TaskLike, check_task, find_task, make_task
from swim_env.envs.tasks.forward import ForwardTask
from swim_env.envs.tasks.moment import Moment
from swim_env.envs.tasks.path import PathTask
from swim_env.envs.tasks.station import StationTask
from swim_env.envs.tasks.target import TARGET_BEARING, TARGET_DISTANCE, TARGET_RADIUS, TargetTask
from swim_env.envs.tasks.turn import TurnTask

__all__ = [
    "NOISE",
    "SEED",
    "TARGET_BEARING",
    "TARGET_DISTANCE",
    "TARGET_RADIUS",
    "TASKS",
    "EfficientTask",
    "ForwardTask",
    "Moment",
    "PathTask",
    "Start",
    "StartPlan",
    "StationTask",
    "TargetTask",
    "Task",
    "TaskLike",
    "TurnTask",
    "check_task",
    "find_task",
    "make_task",
]
