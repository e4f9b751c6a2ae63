"""The fluid in a recording in space: its velocity in a horizontal and a vertical plane."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.spatial_flow import SpatialBodyFlow
from swim_env.recording.spatial_swimmer import SpatialSwimmer
from swim_env.recording.swimmer import frames_of
from swim_env.recording.water import scale_of, side_by_side, under_rim

__all__ = ["PLANES", "WaterPlanes", "compute_planes"]

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

#: The planes: x-y and x-z, through the mean centre.
PLANES: dict[str, tuple[int, int]] = {"horizontal": (0, 1), "vertical": (0, 2)}
#: Grid cells in a body length, and cells from one arrow to the next.
_CELLS_IN_LENGTH, _ARROW_EVERY = 20, 2
#: How far planes reach from the mean centre along x, and across from the body's sides (BL).
_ALONG, _ACROSS = 1.2, 0.5
#: Arrows begin at least so far from the surface (BL), where it is faster than the plane shows.
_CLEAR = 0.02
_PARTS = 16


@dataclass(frozen=True, eq=False)
class WaterPlanes:
    """Velocities at F instants on grids that follow the body in whole cells, by the plane's name.

    Attributes
    ----------
    time : (F,) array
        Instants (s).
    grids : dict of (R, C, 3) arrays
        The grid's points (m), seen from the plane's place.
    places : dict of (F, 3) arrays
        Where the plane is (m).
    speeds : dict of (F, R, C) arrays
        Speed at the grid's points (m/s), 0 inside of the body but for what continues under its rim.
    origins : dict of (A, 3) arrays
        Where arrows begin (m), seen from the plane's place: at points that rest along its axes.
    velocities : dict of (F, A, 3) arrays
        Velocities there (m/s); zero inside of the body and close to it.
    seconds : float
        Time that it took to compute.
    """

    time: Array
    grids: dict[str, Array]
    places: dict[str, Array]
    speeds: dict[str, Floats]
    origins: dict[str, Array]
    velocities: dict[str, Floats]
    seconds: float

    @property
    def largest_speed(self) -> float:
        """Speed (m/s) that all but a few arrows stay below; 1 where there is none."""
        sizes = [np.linalg.norm(one, axis=-1).ravel() for one in self.velocities.values()]
        return scale_of(np.concatenate(sizes))


def compute_planes(
    swimmer: SpatialSwimmer, rate: float, progress: Callable[[float], object] | None = None
) -> WaterPlanes:
    """Compute the flow around a swimmer in both planes.

    The rate is that of the frames (1/s); `progress` is called with the simulated seconds that were
    computed since its last call. A scene without panels and a run without a step are OptionErrors.
    """
    begin = time.perf_counter()
    run, scene = swimmer.trajectory, swimmer.scene
    SpatialBodyFlow(scene)  # says so where there are no panels, and loads the kernels
    instants = frames_of(run, rate)
    length = scene.beam.length
    cell = length / _CELLS_IN_LENGTH
    block = _ARROW_EVERY * cell
    s = np.linspace(0.0, length, 101)
    sides = (scene.beam.half_width_at(s).max(), scene.beam.half_height_at(s).max())
    grids, with_arrow, places = {}, {}, {}
    for (name, axes), side in zip(PLANES.items(), sides, strict=True):
        half = [round(reach / block) for reach in (_ALONG * length, _ACROSS * length + side)]
        u, v = (np.arange(-_ARROW_EVERY * n, _ARROW_EVERY * n + 1) for n in half)
        grid = np.zeros((len(v), len(u), 3))
        grid[..., axes[0]], grid[..., axes[1]] = cell * u, cell * v[:, None]
        grids[name] = grid
        with_arrow[name] = ((u % _ARROW_EVERY == 0) & (v % _ARROW_EVERY == 0)[:, None]).ravel()
        # Within a plane in whole arrow distances, so that arrows stay where they are.
        places[name] = run.path[instants]
        places[name][:, axes] = np.rint(places[name][:, axes] / block) * block
    points = {name: grid.reshape(-1, 3) for name, grid in grids.items()}
    ends = np.cumsum([len(one) for one in points.values()])[:-1]
    found = {
        name: np.zeros((len(instants), len(one), 3), np.float32) for name, one in points.items()
    }
    clear = {name: np.zeros(one.shape[:2], dtype=np.bool_) for name, one in found.items()}
    lock = threading.Lock()

    def compute(part: NDArray[np.int64]) -> None:
        flow = SpatialBodyFlow(scene)
        for frame in part.tolist():
            n = int(instants[frame])
            at = np.concatenate([points[name] + places[name][frame] for name in points])
            velocity = flow.during(run, n, at)
            if velocity is not None:
                shape = run.centres[n], run.directors[n]
                velocity[flow.inside(at, *shape)] = np.nan
                away = ~flow.inside(at, *shape, _CLEAR * length)
                for name, one, apart in zip(
                    points, np.split(velocity, ends), np.split(away, ends), strict=True
                ):
                    found[name][frame], clear[name][frame] = one, apart
            if progress is not None:
                with lock:
                    progress(run.duration / len(instants))

    side_by_side(compute, np.array_split(np.arange(len(instants)), min(_PARTS, len(instants))))
    speeds, velocities = {}, {}
    for name, grid in grids.items():
        sizes = np.linalg.norm(found[name], axis=-1).reshape(len(instants), *grid.shape[:2])
        speeds[name] = np.nan_to_num(np.stack([under_rim(one) for one in sizes]))
        shown = np.where(clear[name][..., None], found[name], np.float32(0.0))
        velocities[name] = shown[:, with_arrow[name]]
    origins = {name: points[name][with_arrow[name]] for name in points}
    seconds = time.perf_counter() - begin
    return WaterPlanes(run.time[instants], grids, places, speeds, origins, velocities, seconds)
