"""What all peers need: their package, the wave that drives them, their largest stable step."""

from __future__ import annotations

import functools
import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.environments import Workload
from swim_env.errors import SceneError, SwimError
from swim_env.scene import Actuation, Scene

Array = NDArray[np.float64]

#: Joint angles beyond this count as blown up (rad); the paper's wave bends joints by 0.05 rad.
_LARGEST_ANGLE = 1.0
#: By what factor the largest joint angle may exceed that of the run with a quarter of the step.
_OVERSHOOT = 1.5


class PeerMissingError(SwimError, ImportError):
    """A package that a peer needs is not installed."""


def load_peer(module: str, name: str) -> ModuleType:
    """Import a peer's package, called `name` in messages.

    One that is not installed is a PeerMissingError; one that fails to import raises what it raises.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise PeerMissingError(
            f"{name} is not measured: it is not installed (pip install 'swim-env[bench]')"
        ) from None


def wave_of(scene: Scene) -> Actuation:
    """Return the scene's travelling wave of torque, which drives every peer."""
    if scene.actuation is None:
        raise SceneError("actuation is missing: its wave must be there to drive the peers")
    return scene.actuation


def intervals_in(seconds: float, scene: Scene) -> int:
    """Return how many control intervals of a scene there are in a time (s), at least one."""
    return max(1, round(seconds / scene.episode.control_interval))


@dataclass(frozen=True)
class StableStep:
    """The largest stable time step of a peer (s), as `substeps` in one control interval.

    `peak` is the largest joint angle with it (rad).
    """

    substeps: int
    time_step: float
    #: The next larger step that was tried (s); None where one for a whole interval is stable.
    unstable_time_step: float | None
    #: Root mean square difference of the joint angles from the run with a quarter of the step, over
    #: that of the angles there. Stable is not accurate: an undamped chain that rings drifts out of
    #: phase at any step.
    deviation: float
    peak: float

    def workload(
        self, label: str, call: Callable[[], object], count: int, facts: Mapping[str, Any]
    ) -> Workload:
        """Return the workload of a call that plays `count` control intervals with this step."""
        steps, facts = count * self.substeps, {**facts, **asdict(self)}
        return Workload(
            label, call, count, steps * self.time_step, steps, {**facts, **asdict(self)}
        )


def largest_stable_step(
    run: Callable[[int], Array | None],
    interval: float,
    *,
    most: int = 4000,
    resolution: float = 0.03,
) -> StableStep | None:
    """Find the largest stable time step among the whole parts of a control interval.

    A step is stable when the run stays finite and without complaint of the peer, when no joint
    angle exceeds 1 rad, and when none exceeds 1.5 times the largest of the run with a quarter of
    the step, which must be stable too. The number of parts is doubled until it is stable and then
    bisected, on the assumption that smaller steps are no less stable.

    Parameters
    ----------
    run : callable
        Returns the joint angles (T, J) (rad) of a run with that many steps in an interval, at the
        same times for any number; None where the peer gave up.
    interval : float
        Control interval (s).
    most : int
        Largest number of steps in an interval to try; None is returned where they are unstable.
    resolution : float
        Relative accuracy of the result; the step is at most this much too small, or one part.
    """
    limit = _LARGEST_ANGLE

    @functools.cache
    def angles_of(count: int) -> Array:
        found = run(count)
        if found is None or not np.isfinite(found).all():
            return np.array([math.inf])
        return found

    def peak_of(count: int) -> float:
        return float(np.abs(angles_of(count)).max())

    unstable, stable = 0, 1
    while stable <= most:
        if peak_of(stable) > limit:
            unstable, stable = stable, 2 * stable
        elif stable - unstable > max(1.0, resolution * stable):
            middle = (unstable + stable) // 2
            if peak_of(middle) > limit:
                unstable = middle
            else:
                stable = middle
        else:
            fine = peak_of(4 * stable)
            if fine <= _LARGEST_ANGLE and peak_of(stable) <= _OVERSHOOT * fine:
                return StableStep(
                    substeps=stable,
                    time_step=interval / stable,
                    unstable_time_step=interval / unstable if unstable else None,
                    deviation=_deviation(angles_of(stable), angles_of(4 * stable)),
                    peak=peak_of(stable),
                )
            # Slow growth: bounded only for as long as the run lasts. The finer run knows better.
            if fine <= _LARGEST_ANGLE:
                limit = _OVERSHOOT * fine
            unstable, stable = stable, 2 * stable
    return None


def _deviation(coarse: Array, fine: Array) -> float:
    scale = float(np.sqrt(np.mean(fine**2)))
    return float(np.sqrt(np.mean((coarse - fine) ** 2))) / scale if scale else 0.0
