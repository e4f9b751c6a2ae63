"""What of a recording does not change from frame to frame, and often not from file to file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from swim_env.recording.palette import SERIES_COLOURS, TRAIL_COLOURS
from swim_env.recording.schema import place_of
from swim_env.scene import Scene

__all__ = ["Layout", "column", "still"]

Point = tuple[float, float]


@dataclass(frozen=True)
class Layout:
    """How a swimmer is shown; files whose swimmers have the same ones share what follows from it.

    Attributes
    ----------
    name, label : str
        What it is called, and that in entity paths.
    scene : Scene
        Its scene.
    number, count : int
        Which lane of how many.
    offset : pair of float
        Where its lane's origin is drawn in the plane that all share (m).
    low, high : pairs of float
        Corners of what all bodies pass through, in the plane that they share, and a bit more (m).
    begin, end : float
        First and last instant of all swimmers (s).
    rewarded : bool
        Whether it was paid.
    split : bool
        Whether its kinetic energy is split between body and fluid.
    colour : str
        What its colours show.
    limit : float
        Torque or moment that all swimmers' colours reach to (N m).
    pressure : float or None
        Pressure that all swimmers' colours reach to (Pa), None without flow.
    arrow_seconds : float or None
        Seconds of the velocity that all swimmers' arrows are long, None without flow.
    """

    name: str
    label: str
    scene: Scene
    number: int
    count: int
    offset: Point
    low: Point
    high: Point
    begin: float
    end: float
    rewarded: bool
    split: bool
    colour: str
    limit: float
    pressure: float | None
    arrow_seconds: float | None

    @property
    def place(self) -> str:
        """The entity of the swimmer in the plane."""
        return place_of(self.label)

    @property
    def shade(self) -> tuple[int, int, int]:
        """The swimmer's own colour on water."""
        return TRAIL_COLOURS[self.number % len(TRAIL_COLOURS)]

    @property
    def bright(self) -> tuple[int, int, int]:
        """The swimmer's own colour in plots."""
        return SERIES_COLOURS[self.number % len(SERIES_COLOURS)]


def still(path: str, archetype: Any) -> Any:
    """Return a chunk, rerun's unit of data, with what stands at an entity all the time.

    It can be sent to any number of recordings, which takes a hundredth of logging it.
    """
    from rerun.chunk import Chunk

    columns = []
    for batch in archetype.as_component_batches():
        columns.append(batch.partition([len(batch.as_arrow_array())]))
    return Chunk.from_columns(path, [], columns)


def column(descriptor: Any, batch: Any, rows: int) -> Any:
    """Return a component's column in which every row has equally many of the batch's values.

    Rerun's own `columns` finds out how many by itself, which takes half of its time.
    """
    import rerun as rr

    each, rest = divmod(len(batch), rows)
    if rest:
        raise ValueError(f"{len(batch)} values do not make {rows} equal rows")
    return rr.ComponentColumn(
        descriptor, batch, offsets=np.arange(0, rows * each + 1, each, dtype=np.int32)
    )
