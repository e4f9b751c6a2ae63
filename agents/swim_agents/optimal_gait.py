"""Optimal gaits: torques that `swim-env optimise` found, and how they are kept and played."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_agents.baselines import WavePolicy, _Baseline
from swim_agents.fit import TUNED_FIELDS, difference
from swim_env.errors import OptionError, SwimError
from swim_env.scene import Scene, scene_names

__all__ = ["GOALS", "GAIT_SUFFIX", "OptimalGait", "find_optimal_gait", "gait_file", "load_gait"]

Array = NDArray[np.float64]

#: What gaits are optimal for.
GOALS = ("displacement", "efficiency", "turn")
#: How names of records end, after the goal.
GAIT_SUFFIX = ".optimal_gait.json"
#: Where those of shipped scenes are.
_SHIPPED = Path(__file__).with_name("optimal_gaits")


class OptimalGait(_Baseline):
    """Torques that were optimised for one body, played from a table by the clock.

    Parameters
    ----------
    scene : Scene
        The scene to play.
    table : (P, n) array
        Actions in [-1, 1]; after the last the first follows.
    made_for : Scene
        The scene that they were optimised on; `check` refuses another body, fluid or damping.
    """

    _fields = WavePolicy._fields

    def __init__(self, scene: Scene, table: Array, made_for: Scene) -> None:
        super().__init__(scene)
        self.table = table
        self.made_for = made_for

    def check(self, scene: Scene, task: str | None = None) -> None:
        """Refuse a scene that the gait was not made for (OptionError)."""
        super().check(scene, task)
        found = difference(self.made_for, scene, TUNED_FIELDS, "its own scene")
        if found:
            raise OptionError(
                f"the gait was optimised on scene {self.made_for.name} and cannot play scene "
                f"{scene.name}: {found}; `swim-env optimise` finds the scene's own"
            )

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        return self.table[clock % len(self.table)]


def gait_file(scene: str | os.PathLike[str], goal: str) -> Path:
    """Return where the optimal gait of a scene's file is kept: beside it."""
    return Path(scene).with_suffix(f".{goal}{GAIT_SUFFIX}")


def find_optimal_gait(scene: Scene, goal: str) -> OptimalGait:
    """Return the gait that lies beside a scene's file, or else one that ships with it.

    An OptionError says that there is none.
    """
    places = [] if scene.source is None else [gait_file(scene.source, goal)]
    if scene.name in scene_names():
        places.append(gait_file(_SHIPPED / f"{scene.name}.yaml", goal))
    for place in places:
        if place.is_file():
            return load_gait(place, scene)
    raise OptionError(
        f"scene {scene.name} has no optimal gait for {goal}; `swim-env optimise --for {goal}` "
        "finds it"
    )


def load_gait(path: str | os.PathLike[str], scene: Scene) -> OptimalGait:
    """Return a stored gait; a file that is none is a SwimError."""
    try:
        data: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
        table = np.array(data["actions"], dtype=np.float64)
        made_for = Scene.from_dict(data["scene_fields"])
        if table.ndim != 2 or not len(table) or not (np.abs(table) <= 1.0).all():
            raise ValueError("actions must be rows of numbers from -1 to 1")
        if table.shape[1] != made_for.action_places.size:
            raise ValueError(f"actions must have {made_for.action_places.size} columns")
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SwimError(
            f"cannot read the optimal gait ({Path(path).name}): {error!r}; `swim-env optimise` "
            "makes it again"
        ) from None
    return OptimalGait(scene, table, made_for)
