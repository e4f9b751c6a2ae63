"""The fluid in a recording: pressure as pictures of a few kilobytes, velocity as arrows."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from swim_env.analysis.flow import BodyFlow
from swim_env.physics.runtime.threads import usable_threads
from swim_env.recording.palette import INSIDE, MIDDLE, pressure_palette
from swim_env.recording.swimmer import Swimmer, frames_of

Array = NDArray[np.float64]
Item = TypeVar("Item")
Result = TypeVar("Result")

#: Grid cells in a body length, and cells from one arrow to the next.
CELLS_IN_LENGTH, ARROW_EVERY = 40, 4
#: Parts that the frames are divided into, to be computed in whatever threads there are.
_PARTS = 16
#: Pixels of a picture along a cell's side; odd, so that one is in the middle.
PIXELS = 3
#: How far the grid reaches from the mean centre (BL), and that for two swimmers, whose views
#: are lower.
REACH, REACH_OF_TWO = (1.2, 0.6), (1.6, 0.5)
#: Share of all pressures, and of all speeds, that the scales cover.
_SHARE_SHOWN = 0.995
#: Arrows begin at least so far from the centre line (BL): at the body's ends, where a thin body's
#: flow is fastest, they would be longer than the body.
_CLEAR = 0.05


@dataclass(frozen=True, eq=False)
class Water:
    """Pressure and velocity at F instants on a grid that follows the body in whole cells."""

    #: Instants, (F,) (s).
    time: Array
    #: Size of a cell, and left lower corners of the grid, (F, 2) (m).
    cell: float
    corners: Array
    #: At the middles of the cells, (F, R, C), rows upwards (Pa); not a number inside of the body.
    pressures: NDArray[np.float32]
    #: Where the arrows begin, from the corner, (A, 2) (m): at points that rest in the plane.
    origins: Array
    #: Velocities there, (F, A, 2) (m/s); zero inside of the body and close to it.
    velocities: NDArray[np.float32]
    #: Time that it took to compute.
    seconds: float

    @property
    def largest_pressure(self) -> float:
        """Pressure (Pa) that all but a few points stay below; 1 where there is none."""
        return scale_of(np.abs(self.pressures))

    @property
    def largest_speed(self) -> float:
        """Speed (m/s) that all but a few arrows stay below; 1 where there is none."""
        return scale_of(np.hypot(self.velocities[..., 0], self.velocities[..., 1]))


def scale_of(values: NDArray[np.float32]) -> float:
    """Return what all but a few values stay below, 1 where there is nothing."""
    known = values[np.isfinite(values)]
    found = float(np.quantile(known, _SHARE_SHOWN)) if known.size else 0.0
    return found if found > 0.0 else 1.0


def compute_water(
    swimmer: Swimmer,
    rate: float,
    reach: tuple[float, float] = REACH,
    progress: Callable[[float], object] | None = None,
) -> Water:
    """Compute the flow around a swimmer.

    The rate is that of the frames (1/s); the grid reaches so far from the mean centre along x and
    y (BL); `progress` is called with the simulated seconds that were computed since its last call.
    A scene without fluid and a run of fewer than two steps are OptionErrors.
    """
    begin = time.perf_counter()
    run = swimmer.trajectory
    BodyFlow(swimmer.scene)  # says so where there is no fluid, and loads the kernels
    instants = frames_of(run, rate)
    length = swimmer.scene.beam.length
    cell = length / CELLS_IN_LENGTH
    # Whole numbers of arrow distances, so that arrows stay where they are as the grid moves on.
    block = ARROW_EVERY * cell
    columns, rows = (2 * ARROW_EVERY * round(half * length / block) for half in reach)
    size = np.array([columns, rows])
    y, x = np.mgrid[:rows, :columns]
    middles = (np.stack([x, y], axis=-1).reshape(-1, 2) + 0.5) * cell
    first = ARROW_EVERY // 2
    with_arrow = ((x % ARROW_EVERY == first) & (y % ARROW_EVERY == first)).ravel()
    corners = (np.rint(run.path[instants] / block) * block) - 0.5 * size * cell
    pressures = np.empty((len(instants), rows, columns), dtype=np.float32)
    velocities = np.zeros((len(instants), int(with_arrow.sum()), 2), dtype=np.float32)
    nodes = run.nodes[instants]
    lock = threading.Lock()

    def compute(part: NDArray[np.int64]) -> None:
        flow = BodyFlow(swimmer.scene)
        for frame in part.tolist():
            found, pressure = flow.during(run, int(instants[frame]), corners[frame] + middles)
            pressures[frame] = np.where(found.inside, np.nan, pressure).reshape(rows, columns)
            apart = _distances(corners[frame] + middles[with_arrow], nodes[frame])
            outside = ~found.inside[with_arrow] & (apart > _CLEAR * length)
            velocities[frame, outside] = found.velocity[with_arrow][outside]
            if progress is not None:
                with lock:
                    progress(run.duration / len(instants))

    # The kernels release the interpreter's lock; every frame is computed by itself.
    side_by_side(compute, np.array_split(np.arange(len(instants)), min(_PARTS, len(instants))))
    return Water(
        run.time[instants],
        cell,
        corners,
        pressures,
        middles[with_arrow],
        velocities,
        time.perf_counter() - begin,
    )


def side_by_side(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the results of a function for some items, in their order.

    It runs in as many threads as numba may use, and in this one where Python is ending and
    starts no more of them: that is when recordings that nobody has closed are written.
    """
    listed = list(items)
    with ThreadPoolExecutor(usable_threads()) as pool:
        try:
            waiting = [pool.submit(function, item) for item in listed]
        except RuntimeError:
            return [function(item) for item in listed]
        return [one.result() for one in waiting]


def _distances(points: Array, nodes: Array) -> Array:
    """Return how far points (P, 2) are from the line through nodes (N + 1, 2), (P,) (m)."""
    along = np.diff(nodes, axis=0)
    away = points[:, None] - nodes[:-1]
    share = np.clip((away * along).sum(axis=-1) / (along**2).sum(axis=-1), 0.0, 1.0)
    apart: Array = np.linalg.norm(away - share[..., None] * along, axis=-1).min(axis=1)
    return apart


def under_rim(pressures: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return pressures continued under the body's rim, where the drawn body covers them."""
    padded = np.pad(pressures, 1, constant_values=np.nan)
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    known = np.isfinite(around)
    count = known.sum(axis=0)
    mean = np.where(known, around, 0.0).sum(axis=0) / np.maximum(count, 1)
    return np.where(np.isnan(pressures) & (count > 0), mean, pressures).astype(np.float32)


_PALETTE = pressure_palette().tobytes()


def pictures_of(water: Water, largest: float) -> list[bytes]:
    """Return a picture of every frame, see `picture_of`."""
    return side_by_side(lambda pressures: picture_of(pressures, largest), water.pressures)


def picture_of(pressures: NDArray[np.float32], largest: float) -> bytes:
    """Return a PNG file whose palette's indices are the pressures, PIXELS a side for each cell.

    The pixel in a cell's middle has the cell's pressure, those between are interpolated: rerun
    shows every pixel with sharp edges.

    Cells inside of the body with a neighbour outside take their neighbours' mean, so that the
    picture has no steps beside the body that is drawn over it; the others are INSIDE. Indices 1 to
    255 stand for pressures (R, C) (Pa), rows upwards, from minus the largest to the largest.
    """
    drawn = under_rim(pressures)
    shares = np.nan_to_num(np.clip(drawn / largest, -1.0, 1.0))
    size = (PIXELS * shares.shape[1], PIXELS * shares.shape[0])
    fine = np.asarray(Image.fromarray(shares).resize(size, Image.Resampling.BICUBIC))
    levels = np.rint(MIDDLE + (255 - MIDDLE) * np.clip(fine, -1.0, 1.0)).astype(np.uint8)
    levels[np.isnan(drawn).repeat(PIXELS, axis=0).repeat(PIXELS, axis=1)] = INSIDE
    image = Image.fromarray(levels)
    image.putpalette(_PALETTE)
    out = io.BytesIO()
    image.save(out, "PNG", compress_level=3)
    return out.getvalue()


def pressure_of(picture: bytes, largest: float) -> NDArray[np.float32]:
    """Return the pressures (R, C) of a picture that `picture_of` made, in steps of largest/127."""
    pixels = np.asarray(Image.open(io.BytesIO(picture))).astype(np.float32)
    levels = pixels[PIXELS // 2 :: PIXELS, PIXELS // 2 :: PIXELS]
    values: NDArray[np.float32] = (levels - MIDDLE) * np.float32(largest / (255 - MIDDLE))
    values[levels == INSIDE] = np.nan
    return values
