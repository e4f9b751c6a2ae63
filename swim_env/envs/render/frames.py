"""Frames of a swimming body, one after the other: what `render` of the environments returns.

A frame shows the body at its true thickness in a grid that rests in the fluid, seen by a camera
that follows; lengths are in body lengths (BL). Pillow draws some hundred frames a second; without
it, importing this module is a `SwimError`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.colours import BODY, GOAL, WATER, Colour, ramp, torque_colours
from swim_env.envs.render.camera import Camera
from swim_env.envs.render.drawing import Box, Image, ImageDraw, Lettering, Patch, Point
from swim_env.envs.render.silhouette import chain, head_outline, mitres
from swim_env.errors import OptionError, SwimError
from swim_env.scene import Scene

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

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
#: Grid lines further out have no numbers (BL): they would not fit.
_NUMBERED = 1e7
_LEAST_WIDTH, _LEAST_HEIGHT = 480, 270


class FramePainter:
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
        sides = np.array([42.0, 34.0, 12.0, 56.0]) * unit
        left, top, right, bottom = (round(side) for side in sides.tolist())
        self._plot: Box = (left, top, width - right, height - bottom)
        self._half = 0.5 * np.array([width - left - right, height - top - bottom])
        self._middle_of_plot = np.array([left, top]) + self._half
        self._grid_shades = ramp((WATER, GRID), np.arange(256) / 255)
        self._backdrop = self._draw_backdrop()
        self.camera: Camera | None = None

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
        coordinates : (N + 2,) array_like
            Mean centre (m), angle of element 1 and joint angles (rad).
        torques : (N - 1,) array_like
            Torques at the joints as a share of the scene's limit.
        time : float
            Time (s). Where it goes back, a new episode starts.
        progress : float
            Progress (BL).
        goal : (2,) array_like
            A unit vector, or a point (m) if there is a target's radius.

        Returns
        -------
        (height, width, 3) array of uint8
            The frame, the caller's own.
        """
        values = np.asarray(coordinates, dtype=np.float64)
        length = self.scene.beam.length
        centre = np.clip(values[:2] / length, -_FAR, _FAR)
        aim = np.asarray(goal, dtype=np.float64)
        if self._radius is not None:
            aim = np.clip(aim / length, -_FAR, _FAR)
        camera = self.camera
        if camera is None or time < camera.time:
            step = _TRAIL_STEP * self._unit
            camera = self.camera = Camera(
                self._middle_of_plot, self._half, self._radius, step, self._lag, centre, aim, time
            )
        else:
            camera.follow(centre, aim, time)
        image = self._backdrop.copy()
        self._draw_grid(image, camera)
        if self._radius is None:
            self._draw_direction(image, aim)
        else:
            self._draw_target(image, camera, aim, self._radius)
        self._draw_trail(image, camera)
        self._draw_body(image, camera, values[2:], np.asarray(torques, dtype=np.float64))
        self._draw_figures(image, time, progress)
        return np.array(image)

    def pixels(self, points: ArrayLike) -> Array:
        """Return column and row (pixels), (..., 2), where the last frame shows points (m).

        The pixel in row i and column j has its middle at (j + 0.5, i + 0.5).
        """
        if self.camera is None:
            raise SwimError("no frame was drawn yet")
        return self.camera.on_screen(np.asarray(points, dtype=np.float64) / self.scene.beam.length)

    # ---- layers, from back to front ------------------------------------------------------------

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
        # Below: the colours of the torques in N m.
        small.words(image, (left - 6 * unit, bottom + 15 * unit), "BL", QUIET_TEXT, 1.0)
        base = self.height - 12 * unit
        limit = self.scene.torque_limit
        x = left + small.words(image, (left, base), "joint torque", QUIET_TEXT) + 9 * unit
        x += small.figures(image, (x, base), f"-{limit:.3g}", TEXT) + 5 * unit
        width = round(80 * unit)
        box = (round(x), round(base - 9 * unit), round(x) + width, round(base))
        shades = torque_colours(np.linspace(-1.0, 1.0, width))
        image.paste(Image.fromarray(shades[None]).resize((width, box[3] - box[1] + 1)), box[:2])
        draw.rectangle((box[0] - 1, box[1] - 1, box[2], box[3] + 1), outline=BORDER)
        x = box[2] + 5 * unit
        x += small.figures(image, (x, base), f"+{limit:.3g}", TEXT) + 4 * unit
        small.words(image, (x, base), "N m", QUIET_TEXT)
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

    def _draw_grid(self, image: Image.Image, camera: Camera) -> None:
        unit = self._unit
        left, top, right, bottom = self._plot
        step, parts = _grid_step(70.0 * unit / camera.scale)
        shares, numbers = [], []
        for axis, size in ((0, right - left), (1, bottom - top)):
            middle = float(camera.place[axis])
            reach = self._half[axis] / camera.scale
            # Line numbers relative to one near the middle: exact wherever the camera is.
            first = math.fmod(middle, step)
            k = np.arange(math.ceil(-reach / step) - 2, math.ceil(reach / step) + 3)
            sign = -1.0 if axis else 1.0
            large = self._half[axis] + sign * (k * step - first) * camera.scale
            fine = np.arange(k[0] * parts, k[-1] * parts + 1) * (step / parts)
            little = self._half[axis] + sign * (fine - first) * camera.scale
            shares.append(
                np.maximum(_coverage(large, 1.2 * unit, size), 0.38 * _coverage(little, unit, size))
            )
            numbers.append((large, (k + round((middle - first) / step)) * step))
        # Most rows are alike, those of no line along them; only the others are made one by one.
        columns, rows = (np.rint(255.0 * share).astype(np.uint8) for share in shares)
        view = np.empty((bottom - top, right - left, 3), dtype=np.uint8)
        view[:] = self._grid_shades[columns]
        on_line = np.flatnonzero(rows)
        view[on_line] = self._grid_shades[np.maximum(columns, rows[on_line, None])]
        image.paste(Image.fromarray(view), (left, top))
        self._draw_numbers(image, step, *numbers)

    def _draw_numbers(
        self,
        image: Image.Image,
        step: float,
        across: tuple[Array, Array],
        upwards: tuple[Array, Array],
    ) -> None:
        """Write the numbers of the grid's lines to the left of the view and below it."""
        unit, small = self._unit, self._small
        left, top, right, bottom = self._plot
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        for place, value in zip(*across, strict=True):
            text = _plain(value, digits)
            room = 0.5 * small.figures_width(text)
            if abs(value) < _NUMBERED and room <= place <= right - left - room:
                at = (left + place, bottom + 15 * unit)
                small.figures(image, at, text, QUIET_TEXT, 0.5)
        for place, value in zip(*upwards, strict=True):
            text = _plain(value, digits)
            if small.figures_width(text) <= left - 8 * unit:
                if 5 * unit <= place <= bottom - top - 5 * unit:
                    at = (left - 6 * unit, top + place + 4 * unit)
                    small.figures(image, at, text, QUIET_TEXT, 1.0)
            elif abs(value) < _NUMBERED:
                room = 0.5 * small.figures_width(text)
                if room <= place <= bottom - top - room:
                    small.figures_upwards(image, (left - 6 * unit, top + place), text, QUIET_TEXT)

    def _draw_direction(self, image: Image.Image, aim: Array) -> None:
        """Draw the arrow of a goal that is a direction, at the side that it points to."""
        unit = self._unit
        along = aim * (1.0, -1.0)
        side = 1.0 if along[0] >= 0.0 else -1.0
        room = self._half - 42.0 * unit
        centre = self._middle_of_plot + room * (side, along[1])
        across = np.array([-along[1], along[0]])
        tip, tail = centre + 28 * unit * along, centre - 28 * unit * along
        neck = tip - 17 * unit * along
        width, head = 3.0 * unit * across, 9.0 * unit * across
        with Patch(image, np.array([tip, tail]), 10 * unit, self._plot) as patch:
            shaft = np.array([[tail + width, neck + width, neck - width, tail - width]])
            patch.polygons(shaft, GOAL)
            patch.polygons(np.array([[tip, neck + head, neck - head]]), GOAL)
        # Level with the arrow's middle where it stands upright, above it where it lies.
        lift = 14 + 24 * abs(float(along[1]))
        at: Point = (centre[0], centre[1] - lift * unit)
        if at[1] < self._plot[1] + 14 * unit:
            at = (centre[0], centre[1] + (lift + 9) * unit)
        self._middle.words(image, at, "goal", GOAL, 0.5)

    def _draw_target(
        self, image: Image.Image, camera: Camera, aim: Array, target_radius: float
    ) -> None:
        """Draw the circle of a target, or where it lies outside of the view."""
        unit = self._unit
        place = camera.on_screen(aim[None])
        radius = max(target_radius * camera.scale, 4.0 * unit)
        away = place[0] - self._middle_of_plot
        distance = float(np.hypot(*(aim - camera.centre)))
        if (np.abs(away) < self._half + 0.5 * radius).all():
            inside = ramp((WATER, GOAL), 0.45 if distance <= target_radius else 0.16)
            with Patch(image, place, radius, self._plot) as patch:
                patch.discs(place, radius, inside)
                patch.ring(place[0], radius, 1.8 * unit, GOAL)
                patch.discs(place, 2.2 * unit, GOAL)
            return
        inner = self._half - 12.0 * unit
        edge = self._middle_of_plot + away * float((inner / np.maximum(np.abs(away), 1e-9)).min())
        along = away / max(float(np.hypot(*away)), 1e-9)
        across = np.array([-along[1], along[0]])
        corners = np.array(
            [8 * along, -6 * along + 8 * across, -2 * along, -6 * along - 8 * across]
        )
        with Patch(image, edge[None], 10 * unit, self._plot) as patch:
            patch.polygons((edge + unit * corners)[None], GOAL)
        text = f"{_short(distance, 2)} BL"
        room = 0.5 * self._small.words_width(text) + 4 * unit
        at = edge - (14 * unit + room * abs(along[0])) * along
        x = min(max(float(at[0]), self._plot[0] + room), self._plot[2] - room)
        self._small.words(image, (x, float(at[1]) + 4 * unit), text, GOAL, 0.5)

    def _draw_trail(self, image: Image.Image, camera: Camera) -> None:
        trail = camera.trail
        points = camera.on_screen(np.concatenate([trail, camera.centre[None]]))
        # Cut where it is well outside of the view, and left out there.
        outside = (np.abs(points - self._middle_of_plot) > 2.0 * self._half).any(axis=1)
        runs = np.split(points, np.flatnonzero(outside))
        for run in (runs[0], *(later[1:] for later in runs[1:])):
            if len(run) > 1:
                with Patch(image, run, 1.0 * self._unit, self._plot) as patch:
                    patch.line(run, 1.7 * self._unit, TRAIL)
        start = camera.on_screen(camera.start)[None]
        with Patch(image, start, _START_SIZE * self._unit, self._plot) as patch:
            self._draw_start(patch, start)

    def _draw_start(self, patch: Patch, start: Array) -> None:
        patch.discs(start, _START_SIZE * self._unit, TRAIL)
        patch.discs(start, (_START_SIZE - 1.7) * self._unit, PAPER)

    def _draw_body(self, image: Image.Image, camera: Camera, angles: Array, torques: Array) -> None:
        unit, beam = self._unit, self.scene.beam
        element = camera.scale / beam.elements
        half = max(beam.half_thickness / beam.length * camera.scale, 1.6 * unit)
        along, nodes = chain(angles, element)
        nodes += camera.on_screen(camera.centre)
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        sides = half * mitres(across)
        left, right = nodes + sides, nodes - sides
        head = max(half, min(max(0.028 * camera.scale, 4.8 * unit), 6.5 * unit))
        eyes = min(head, 9.0 * unit) * np.array([[0.8, 0.46], [0.8, -0.46]])
        with Patch(image, nodes, 2.5 * head, self._plot) as patch:
            corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
            patch.polygons(corners, BODY)
            patch.polygons(head_outline(nodes[0], along[0], across[0], head)[None], BODY)
            # On a body of many elements the joints make a band inside of its outline.
            size = min(0.45 * element, max(0.75 * half, min(0.22 * element, 4.2 * unit)))
            if size > 2.5 * unit:
                patch.discs(nodes[1:-1], size + 1.2 * unit, BODY)
            patch.discs(nodes[1:-1], size, torque_colours(torques))
            eyes = nodes[0] + eyes @ np.array([along[0], across[0]])
            patch.discs(eyes, 0.3 * min(head, 9.0 * unit), PAPER)

    def _draw_figures(self, image: Image.Image, time: float, progress: float) -> None:
        self._middle.figures(image, self._time_at, _short(time / self._seconds, 2), TEXT, 1.0)
        text = _short(progress, 3)
        text = text if text.startswith("-") else f"+{text}"
        self._middle.figures(image, self._progress_at, text, TEXT, 1.0)


def _coverage(lines: Array, width: float, size: int) -> Array:
    """Return the share (n,) of each pixel of a row that lines (k,) of some width (pixels) cover."""
    left = np.arange(size, dtype=np.float64)
    begin = np.maximum(left, lines[:, None] - 0.5 * width)
    end = np.minimum(left + 1.0, lines[:, None] + 0.5 * width)
    covered: Array = np.minimum(np.maximum(end - begin, 0.0).sum(axis=0), 1.0)
    return covered


def _grid_step(least: float) -> tuple[float, int]:
    """Return the round distance of numbered lines from some least one on, and its parts."""
    power = 10.0 ** math.floor(math.log10(least))
    for factor, parts in ((1.0, 5), (2.0, 4), (5.0, 5)):
        if factor * power >= least:
            return factor * power, parts
    return 10.0 * power, 5


def _plain(value: float, digits: int) -> str:
    """Return a number of the grid; zero has no sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _time_unit(interval: float) -> tuple[str, float]:
    """Return the unit of time, and its seconds, in which two digits tell control intervals (s)."""
    for name, seconds in (("s", 1.0), ("ms", 1e-3), ("\u00b5s", 1e-6)):
        if interval >= 0.005 * seconds:
            return name, seconds
    return "ns", 1e-9


def _short(value: float, digits: int) -> str:
    """Return a number with some digits after the point, or so few that it stays short."""
    size = abs(value)
    if size >= 1e6:
        return f"{value:.0e}"
    return f"{value:.{digits if size < 1e2 else 2 if size < 1e4 else 0}f}"
