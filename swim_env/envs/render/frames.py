"""Frames of a body that swims in the plane: what `render` of the environments returns there.

A frame shows the body at its true thickness in a grid that rests in the fluid, seen by a camera
that follows.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swim_env.colours import BODY, GOAL, WATER, ramp, torque_colours
from swim_env.envs.render.camera import Camera
from swim_env.envs.render.drawing import Image, Patch, Point
from swim_env.envs.render.painter import GRID, PAPER, QUIET_TEXT, Painter
from swim_env.envs.render.silhouette import chain, head_outline, mitres

Array = NDArray[np.float64]

#: Grid lines further out have no numbers (BL): they would not fit.
_NUMBERED = 1e7


class FramePainter(Painter[Camera]):
    """Draws frames in the plane, see `Painter`."""

    camera_type = Camera
    _margins: ClassVar = (42.0, 34.0, 12.0, 56.0)
    _grid_shades = ramp((WATER, GRID), np.arange(256) / 255)

    def _draw_view(
        self, image: Image.Image, camera: Camera, shape: Array, torques: Array, aim: Array
    ) -> None:
        self._draw_grid(image, camera)
        if self._radius is None:
            self._draw_direction(image, aim)
        else:
            self._draw_target(image, camera, aim, self._radius)
        self._draw_trail(image, camera)
        self._draw_body(image, camera, shape, torques)

    def _legend_of_torques(self) -> tuple[str, str, str]:
        return "joint torque", f"{self.scene.torque_limit:.3g}", "N m"

    def _draw_backdrop(self) -> Image.Image:
        image = super()._draw_backdrop()
        left, _, _, bottom = self._plot
        at = (left - 6 * self._unit, bottom + 15 * self._unit)
        self._small.words(image, at, "BL", QUIET_TEXT, 1.0)
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
        centre = self._place_of_direction(along)
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
        self._draw_beyond(image, away, distance)

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
