"""How swimmers are laid out in a recording: lanes, frames, and scales that all of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim_env.colours import Colour
from swim_env.files.names import shown_name
from swim_env.recording.palette import SERIES, TRAILS
from swim_env.recording.planes import WaterPlanes
from swim_env.recording.schema import label_of, place_of
from swim_env.recording.swimmer import Swimmer, frames_of
from swim_env.recording.water import ARROW_EVERY, CELLS_IN_LENGTH, Water
from swim_env.scene import Scene
from swim_env.sim.trajectory import Trajectory

__all__ = ["Lane", "Layout", "lanes_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Point = tuple[float, ...]

#: Instants of the energy for each frame: it has peaks that last two frames.
_ENERGIES_IN_FRAME = 2.0
#: Distance of the lanes of two swimmers in one plane (BL).
_LANE = 0.5
#: An arrow of the largest speed reaches over so many arrow distances.
_ARROW_REACH = 1.2


@dataclass(frozen=True)
class Layout:
    """How a swimmer is shown; files whose swimmers have equal ones share what follows from them."""

    #: Its name, and that in entity paths.
    name: str
    label: str
    scene: Scene
    #: Which lane of how many, and where the lane's origin is drawn among all (m).
    number: int
    count: int
    offset: Point
    #: Corners of what all bodies pass through there, rounded outwards (m).
    low: Point
    high: Point
    #: First and last instant of all swimmers (s).
    begin: float
    end: float
    #: Whether it has rewards, and whether its kinetic energy is split between body and fluid.
    rewarded: bool
    split: bool
    #: What the bodies' colours show, and the torque or moment that they reach to (N m).
    colour: str
    limit: float
    #: Pressure that colours reach to (Pa; None in space), speed that they reach to there (m/s), and
    #: seconds of the velocity that an arrow is long, for all swimmers; None without flow.
    pressure: float | None
    speed: float | None
    arrow_seconds: float | None

    @property
    def place(self) -> str:
        """The entity of the swimmer in the plane."""
        return place_of(self.label)

    @property
    def shade(self) -> Colour:
        """The swimmer's own colour on water."""
        return TRAILS[self.number % len(TRAILS)]

    @property
    def bright(self) -> Colour:
        """The swimmer's own colour in plots."""
        return SERIES[self.number % len(SERIES)]


@dataclass(frozen=True)
class Lane:
    """A swimmer's place in a recording."""

    swimmer: Swimmer
    #: Frames, (F,), and those of the energy, (E,).
    instants: Indices
    energy_instants: Indices
    #: The run's positions at the frames alone, and its nodes there, (F, N + 1, 2 or 3) (m).
    shapes: Trajectory
    nodes: Array
    layout: Layout


def lanes_of(
    swimmers: Sequence[Swimmer],
    waters: Sequence[Water | WaterPlanes],
    rate: float | None,
    colour: str,
) -> list[Lane]:
    """Give every swimmer its lane, one below the other where they start.

    `waters` are the flows that are shown; the rate is that of the frames (1/s), the scene's unless
    given.
    """
    # One legend serves all lanes, so they share their scales.
    limit = max([swimmer.largest(colour) for swimmer in swimmers])
    longest = max([swimmer.scene.beam.length for swimmer in swimmers])
    planar = [water for water in waters if isinstance(water, Water)]
    pressure = max((water.largest_pressure for water in planar), default=None)
    speed = max((water.largest_speed for water in waters), default=None)
    reach = _ARROW_REACH * ARROW_EVERY * longest / CELLS_IN_LENGTH
    runs = [swimmer.trajectory for swimmer in swimmers]
    frames = [frames_of(run, rate) for run in runs]
    shapes = [_at(run, frame) for run, frame in zip(runs, frames, strict=True)]
    nodes = [shape.nodes for shape in shapes]
    offsets, corners = [], []
    for number, swimmer in enumerate(swimmers):
        length = swimmer.scene.beam.length
        offset = np.zeros(swimmer.scene.dimension)
        offset[1] = -number * _LANE * length
        points = [
            nodes[number].min(axis=(0, 1)) - swimmer.girth,
            nodes[number].max(axis=(0, 1)) + swimmer.girth,
        ]
        if swimmer.target_radius is not None:
            radius = swimmer.target_radius * length
            points += [swimmer.aim - radius, swimmer.aim + radius]
        offsets.append(offset)
        corners += [point + offset for point in points]
    low, high = _rounded(
        np.min(corners, axis=0), np.max(corners, axis=0), runs[0].scene.beam.length
    )
    lanes: list[Lane] = []
    for number, swimmer in enumerate(swimmers):
        layout = Layout(
            name=shown_name(swimmer.name),
            label=label_of(swimmer.name, [lane.layout.label for lane in lanes]),
            scene=swimmer.scene,
            number=number,
            count=len(swimmers),
            offset=_point(offsets[number]),
            low=_point(low),
            high=_point(high),
            begin=min([float(run.time[0]) for run in runs]),
            end=max([float(run.time[-1]) for run in runs]),
            rewarded=swimmer.rewards is not None,
            split=swimmer.start_velocity is not None,
            colour=colour,
            limit=limit,
            pressure=pressure,
            speed=speed,
            arrow_seconds=None if speed is None else reach / speed,
        )
        energies = frames_of(runs[number], rate, _ENERGIES_IN_FRAME)
        lanes.append(Lane(swimmer, frames[number], energies, shapes[number], nodes[number], layout))
    return lanes


def _at(run: Trajectory, frames: Indices) -> Trajectory:
    """Return a run of which positions have some instants alone."""
    shape = ("angles",) if run.scene.dimension == 2 else ("directors", "joint_rotations")
    return replace(
        run, **{name: getattr(run, name)[frames] for name in ("time", "centres", *shape)}
    )


def _point(values: Array) -> Point:
    return tuple(values.tolist())


def _rounded(low: Array, high: Array, length: float) -> tuple[Array, Array]:
    """Move corners outwards to steps of about an eighth of the size, which many episodes share."""
    step = 2.0 ** np.floor(np.log2(np.maximum(high - low, length) / 6.0))
    return step * np.floor(low / step), step * np.ceil(high / step)
