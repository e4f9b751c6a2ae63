"""Gradients of whole runs, by the exact discrete adjoint of the integrator's steps."""

from typing import Any

from swim_env.gradients.adjoint import tangent, value_and_gradient
from swim_env.gradients.objectives import OBJECTIVES, Objective, Slopes, Stretch, path_error

__all__ = [
    "OBJECTIVES",
    "Objective",
    "Slopes",
    "Stretch",
    "SwimFunction",
    "path_error",
    "tangent",
    "value_and_gradient",
]


def __getattr__(name: str) -> Any:
    # PyTorch is for training alone, and slow to import.
    if name == "SwimFunction":
        from swim_env.gradients.torch_function import SwimFunction

        return SwimFunction
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
