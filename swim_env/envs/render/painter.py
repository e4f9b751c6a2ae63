"""What frames in the plane and in space have in common: layout, legend, figures, marks.

Lengths are in body lengths (BL). Pillow draws some hundred frames a second; without it, importing
this module is a `SwimError`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.colours import GOAL, WATER, Colour, torque_colours
from swim_env.envs.render.camera import Camera
from swim_env.envs.render.drawing import Box, Image, ImageDraw, Lettering, Patch
from swim_env.errors import OptionError, SwimError
from swim_env.scene import Scene

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]
AnyCamera = TypeVar("AnyCamera", bound=Camera)

PAPER: Colour = (255, 255, 255)
GRID: Colour = (198, 211, 223)
BORDER: Colour = (170, 184, 198)
TEXT: Colour = (28, 37, 48)
QUIET_TEXT: Colour = (96, 110, 126)
TRAIL: Colour = (108, 134, 168)

#: Least distance of the trail's points, and size of the ring at the start (pixels).
_TRAIL_STEP, _START_SIZE = 1.5, 4.0
#: Positions beyond this count as this (BL), so that every finite state can be drawn.
_FAR = 1e12
#: Control intervals after which the camera has made up for 63 % of a move.
_LAG = 30.0
_LEAST_WIDTH, _LEAST_HEIGHT = 480, 270


class Painter(ABC, Generic[AnyCamera]):
    """Draws the frames of one episode after the other.

    The same episode gives the same frames: a frame depends on nothing but the size, what it shows
    and what the frames since the last `forget` have shown.

    Parameters
    ----------
    scene : Scene
        What swims.
    width, height : int
        Size of the frames (pixels), at least 480 x 270.
    target_radius : float, optional
        The goal is a point, reached this close to it (BL); without, it is a direction.

    Attributes
    ----------
    camera : Camera or None
        What decides the next frame beside what it shows; None before an episode's first one.

    Raises
    ------
    OptionError
        If the size is too small.
    """

    camera_type: type[AnyCamera]
    #: Widths of the margins to the left, above, to the right and below, in units.
    _margins: ClassVar[tuple[float, float, float, float]]

    def __init__(
        self,
        scene: Scene,
        width: int = 640,
        height: int = 360,
        target_radius: float | None = None,
    ) -> None:
        if width < _LEAST_WIDTH or height < _LEAST_HEIGHT:
            raise OptionError(
                f"frames must have at least {_LEAST_WIDTH} x {_LEAST_HEIGHT} pixels, "
                f"got {width} x {height}"
            )
        self.scene = scene
        self.width, self.height = width, height
        self._radius = target_radius
        self._lag = _LAG * scene.episode.control_interval
        self._time_unit, self._seconds = _time_unit(scene.episode.control_interval)
        #: Lengths and sizes of text below are pixels of the smallest common size, times this.
        unit = self._unit = min(width / 640, height / 360)
        self._small, self._middle, self._big = (Lettering(size * unit) for size in (11.5, 13, 17))
        sides = np.array(self._margins) * unit
        left, top, right, bottom = (round(side) for side in sides.tolist())
        self._plot: Box = (left, top, width - right, height - bottom)
        self._half = 0.5 * np.array([width - left - right, height - top - bottom])
        self._middle_of_plot = np.array([left, top]) + self._half
        self._backdrop = self._draw_backdrop()
        self.camera: AnyCamera | None = None

    # ---- the frames ----------------------------------------------------------------------------

    def forget(self) -> None:
        """Start a new episode, with a new trail and a new place of the camera."""
        self.camera = None

    def draw(
        self,
        coordinates: ArrayLike,
        torques: ArrayLike,
        time: float,
        progress: float,
        goal: ArrayLike,
    ) -> Frame:
        """Draw the next frame.

        Parameters
        ----------
        coordinates : (N + 2,) array_like, in space (4 N + 3,)
            Minimal coordinates, which begin with the mean centre (m); angles in rad.
        torques : (n,) array_like
            Torques as shares of the limits, as `Scene.actions_of` returns them.
        time : float
            Time (s). Where it goes back, a new episode starts.
        progress : float
            Progress (BL).
        goal : (2,) array_like, in space (3,)
            A unit vector, or a point (m) if there is a target's radius.

        Returns
        -------
        (height, width, 3) array of uint8
            The frame, the caller's own.
        """
        values = np.asarray(coordinates, dtype=np.float64)
        length, dimension = self.scene.beam.length, self.scene.dimension
        centre = np.clip(values[:dimension] / length, -_FAR, _FAR)
        aim = np.asarray(goal, dtype=np.float64)
        if self._radius is not None:
            aim = np.clip(aim / length, -_FAR, _FAR)
        camera = self.camera
        if camera is None or time < camera.time:
            step = _TRAIL_STEP * self._unit
            camera = self.camera = self.camera_type(
                self._middle_of_plot, self._half, self._radius, step, self._lag, centre, aim, time
            )
        else:
            camera.follow(centre, aim, time)
        image = self._backdrop.copy()
        shape = values[dimension:]
        self._draw_view(image, camera, shape, np.asarray(torques, dtype=np.float64), aim)
        self._draw_figures(image, time, progress)
        return np.array(image)

    def pixels(self, points: ArrayLike) -> Array:
        """Return column and row (pixels), (..., 2), where the last frame shows points (m).

        The pixel in row i and column j has its middle at (j + 0.5, i + 0.5).
        """
        if self.camera is None:
            raise SwimError("no frame was drawn yet")
        return self.camera.on_screen(np.asarray(points, dtype=np.float64) / self.scene.beam.length)

    @abstractmethod
    def _draw_view(
        self, image: Image.Image, camera: AnyCamera, shape: Array, torques: Array, aim: Array
    ) -> None:
        """Draw all but the figures, from back to front; `shape` is the coordinates' rest."""

    @abstractmethod
    def _legend_of_torques(self) -> tuple[str, str, str]:
        """Return what the colours mean, their largest value and its unit."""

    # ---- what stays ----------------------------------------------------------------------------

    def _draw_backdrop(self) -> Image.Image:
        """Draw what stays: the name, the labels, the legend and the border of the view."""
        unit, small = self._unit, self._small
        image = Image.new("RGB", (self.width, self.height), PAPER)
        draw = ImageDraw.Draw(image)
        left, top, right, bottom = self._plot
        draw.rectangle((left - 1, top - 1, right, bottom), fill=WATER, outline=BORDER)
        # Above: whose episode it is, and the places of the figures.
        base = top - 11 * unit
        self._time_at = (right - 190 * unit, base)
        self._progress_at = (right - 21 * unit, base)
        for at, name, far, of in (
            (self._time_at, "time", 81, self._time_unit),
            (self._progress_at, "progress", 116, "BL"),
        ):
            self._middle.words(image, (at[0] - far * unit, base), name, QUIET_TEXT)
            self._middle.words(image, (at[0] + 4 * unit, base), of, QUIET_TEXT)
        title, room = self.scene.name, right - left - 290 * unit
        while self._big.words_width(title) > room:
            title = title[:-2] + "\u2026"
        self._big.words(image, (left, base), title, TEXT)
        # Below: the colours of the torques.
        base = self.height - 12 * unit
        name, most, of = self._legend_of_torques()
        x = left + small.words(image, (left, base), name, QUIET_TEXT) + 9 * unit
        x += small.figures(image, (x, base), f"-{most}", TEXT) + 5 * unit
        width = round(80 * unit)
        box = (round(x), round(base - 9 * unit), round(x) + width, round(base))
        shades = torque_colours(np.linspace(-1.0, 1.0, width))
        image.paste(Image.fromarray(shades[None]).resize((width, box[3] - box[1] + 1)), box[:2])
        draw.rectangle((box[0] - 1, box[1] - 1, box[2], box[3] + 1), outline=BORDER)
        x = box[2] + 5 * unit
        x += small.figures(image, (x, base), f"+{most}", TEXT) + 4 * unit
        small.words(image, (x, base), of, QUIET_TEXT)
        # And from right to left: what the unit, the line and the circle mean.
        x = float(right)
        entries = ["BL: body length", "path of the mean centre"]
        if self._radius is not None:
            entries.append("target")
        for number, text in enumerate(entries):
            x -= small.words_width(text)
            small.words(image, (x, base), text, QUIET_TEXT)
            mark = np.array([[x - 26 * unit, base - 4 * unit], [x - 6 * unit, base - 4 * unit]])
            everywhere = (0, 0, self.width, self.height)
            if number == 1:
                with Patch(image, mark, 6 * unit, everywhere) as patch:
                    patch.line(mark, 1.7 * unit, TRAIL)
                    self._draw_start(patch, mark[:1])
                x -= 30 * unit
            elif number == 2:
                with Patch(image, mark, 8 * unit, everywhere) as patch:
                    patch.ring(mark[1] - (5.5 * unit, 0.0), 5.5 * unit, 1.5 * unit, GOAL)
            x -= 16 * unit
        return image

    # ---- marks ---------------------------------------------------------------------------------

    def _place_of_direction(self, along: Array) -> Array:
        """Return the place (2,) of a goal's arrow: the side that it (2,) points to (pixels)."""
        room = self._half - 42.0 * self._unit
        return self._middle_of_plot + room * (1.0 if along[0] >= 0.0 else -1.0, along[1])

    def _draw_beyond(self, image: Image.Image, away: Array, distance: float) -> None:
        """Mark at the view's edge where a target lies, so far (BL) along a way (2,) (pixels)."""
        unit = self._unit
        inner = self._half - 12.0 * unit
        edge = self._middle_of_plot + away * float((inner / np.maximum(np.abs(away), 1e-9)).min())
        along = away / max(float(np.hypot(*away)), 1e-9)
        across = np.array([-along[1], along[0]])
        corners = np.array(
            [8 * along, -6 * along + 8 * across, -2 * along, -6 * along - 8 * across]
        )
        with Patch(image, edge[None], 10 * unit, self._plot) as patch:
            patch.polygons((edge + unit * corners)[None], GOAL)
        text = f"{short(distance, 2)} BL"
        room = 0.5 * self._small.words_width(text) + 4 * unit
        at = edge - (14 * unit + room * abs(along[0])) * along
        x = min(max(float(at[0]), self._plot[0] + room), self._plot[2] - room)
        self._small.words(image, (x, float(at[1]) + 4 * unit), text, GOAL, 0.5)

    def _draw_path(self, image: Image.Image, points: Array, width: float, colour: Colour) -> None:
        """Draw a line through points (n, 2) (pixels), so many units wide."""
        # Cut where it is well outside of the view, and left out there.
        outside = (np.abs(points - self._middle_of_plot) > 2.0 * self._half).any(axis=1)
        runs = np.split(points, np.flatnonzero(outside))
        for run in (runs[0], *(later[1:] for later in runs[1:])):
            if len(run) > 1:
                with Patch(image, run, 1.0 * self._unit, self._plot) as patch:
                    patch.line(run, width * self._unit, colour)

    def _draw_trail(self, image: Image.Image, camera: AnyCamera) -> None:
        points = camera.on_screen(np.concatenate([camera.trail, camera.centre[None]]))
        self._draw_path(image, points, 1.7, TRAIL)
        start = camera.on_screen(camera.start)[None]
        with Patch(image, start, _START_SIZE * self._unit, self._plot) as patch:
            self._draw_start(patch, start)

    def _draw_start(self, patch: Patch, start: Array) -> None:
        patch.discs(start, _START_SIZE * self._unit, TRAIL)
        patch.discs(start, (_START_SIZE - 1.7) * self._unit, PAPER)

    def _draw_figures(self, image: Image.Image, time: float, progress: float) -> None:
        self._middle.figures(image, self._time_at, short(time / self._seconds, 2), TEXT, 1.0)
        text = short(progress, 3)
        text = text if text.startswith("-") else f"+{text}"
        self._middle.figures(image, self._progress_at, text, TEXT, 1.0)


def _time_unit(interval: float) -> tuple[str, float]:
    """Return the unit of time, and its seconds, in which two digits tell control intervals (s)."""
    for name, seconds in (("s", 1.0), ("ms", 1e-3), ("\u00b5s", 1e-6)):
        if interval >= 0.005 * seconds:
            return name, seconds
    return "ns", 1e-9


def short(value: float, digits: int) -> str:
    """Return a number with some digits after the point, or so few that it stays short."""
    size = abs(value)
    if size >= 1e6:
        return f"{value:.0e}"
    return f"{value:.{digits if size < 1e2 else 2 if size < 1e4 else 0}f}"
