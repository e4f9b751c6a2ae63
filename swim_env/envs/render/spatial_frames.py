"""Frames of a body that swims in space: what `render` of the environments returns there.

A frame shows the body's true surface above a floor that rests in the fluid, with the shadow that
light from straight above would throw on it. Colours are those of bending torques, as shares of
their limits: orange on the side that they shorten, blue on the other. Torques of roll, which bend
nothing, are not shown.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swim_env.colours import GOAL, Colour, ramp
from swim_env.envs.render.drawing import Image, ImageDraw, ImageFilter, Patch
from swim_env.envs.render.mesh import BodyMesh, Polygons, normals_of
from swim_env.envs.render.painter import PAPER, QUIET_TEXT, TRAIL, Painter, short
from swim_env.envs.render.spatial_camera import AXES, FLOOR_STEP, FOCUS, NEAREST, SpatialCamera
from swim_env.scene.spatial.scene import SpatialScene

Array = NDArray[np.float64]

#: Colours of the water far away, of the lines on the floor, and of what throws a shadow on it.
_FAR_WATER: Colour = (207, 224, 238)
_NEAR_WATER: Colour = (246, 250, 253)
_LINES: Colour = (150, 173, 196)
_SHADOW: Colour = (88, 110, 138)
_SHADOW_OF_TRAIL: Colour = (186, 201, 217)
#: Width of the lines (units), and how much of the water a shadow covers.
_LINE = 1.1
_SHADOW_SHARE = 0.42
#: Unit vectors to the light and half way between it and the eye.
_LIGHT = np.array([-0.35, -0.55, 0.76])
_LIGHT /= np.linalg.norm(_LIGHT)
_HALF_WAY = _LIGHT - AXES[2]
_HALF_WAY /= np.linalg.norm(_HALF_WAY)
#: A level circle.
_turn = np.linspace(0.0, math.tau, 32, endpoint=False)
_CIRCLE = np.stack([np.cos(_turn), np.sin(_turn), 0.0 * _turn], axis=-1)
#: Radius of an arrow along itself, and where, as shares of its length.
_ARROW = ((0.0, 0.0), (0.08, 0.0), (0.08, 0.55), (0.25, 0.55), (1e-3, 1.0))


class SpatialFramePainter(Painter[SpatialCamera]):
    """Draws frames in space, see `Painter`."""

    camera_type = SpatialCamera
    _margins: ClassVar = (12.0, 34.0, 12.0, 38.0)

    def __init__(
        self,
        scene: SpatialScene,
        width: int = 640,
        height: int = 360,
        target_radius: float | None = None,
    ) -> None:
        super().__init__(scene, width, height, target_radius)
        self._mesh = BodyMesh(scene, self._unit)
        left, top, right, bottom = self._plot
        # Rays of the pixels, in the world's axes, down to a floor one BL below the eye.
        column = (np.arange(left, right) + 0.5 - self._middle_of_plot[0])[None, :, None]
        row = (np.arange(top, bottom) + 0.5 - self._middle_of_plot[1])[:, None, None]
        focal = FOCUS * self._half[1]
        rays = AXES[2] + column / focal * AXES[0] - row / focal * AXES[1]
        hits = rays[..., :2] / -rays[..., 2:]
        self._hits = [np.ascontiguousarray(hits[..., axis], dtype=np.float32) for axis in (0, 1)]
        # And one over how far they move there from a pixel to the next.
        steps = [np.hypot(*np.gradient(hits[..., axis])) for axis in (0, 1)]
        self._sharpness = [(1.0 / step).astype(np.float32) for step in steps]
        # Lines fade in the distance.
        far = np.linspace(1.0, 0.0, bottom - top)[:, None]
        self._near = (204.0 - 184.0 * far**2).astype(np.float32)

    def _legend_of_torques(self) -> tuple[str, str, str]:
        return "bending torque", "1", "of its limit"

    def _draw_backdrop(self) -> Image.Image:
        image = super()._draw_backdrop()
        left, top, right, bottom = self._plot
        far = np.linspace(1.0, 0.0, bottom - top) ** 1.3
        shades = ramp((_NEAR_WATER, _FAR_WATER), far)[:, None]
        image.paste(Image.fromarray(shades).resize((right - left, bottom - top)), (left, top))
        return image

    def _draw_view(
        self, image: Image.Image, camera: SpatialCamera, shape: Array, torques: Array, aim: Array
    ) -> None:
        body = self._mesh.polygons(shape, torques)
        away = camera.centre - camera.place
        for floor in camera.floors:
            self._draw_floor(image, camera, *floor)
            self._draw_shadows(image, camera, body.coarse + away, aim, *floor)
        height = max(camera.floors, key=lambda floor: floor[1])[0]
        self._draw_drop(image, camera, camera.centre, height, TRAIL)
        self._name_floor(image, height)
        self._draw_axes(image)
        # Whatever is nearer comes later.
        is_behind = self._radius is None or bool(AXES[2] @ (aim - camera.centre) > 0.0)
        if is_behind:
            self._draw_goal(image, camera, aim, height)
        self._draw_trail(image, camera)
        self._draw_body(image, camera, body, away)
        if not is_behind:
            self._draw_goal(image, camera, aim, height)

    def _draw_floor(
        self, image: Image.Image, camera: SpatialCamera, height: float, weight: float
    ) -> None:
        """Draw the lines of a floor, FLOOR_STEP apart."""
        eye = -camera.distance * AXES[2]
        drop = float(eye[2] - (height - camera.place[2]))
        # How far a pixel is from the next line, in pixels of a floor one BL below the eye.
        shown = np.full_like(self._hits[0], np.inf)
        for axis in (0, 1):
            # Relative to a line near the middle: exact wherever the camera is.
            first = math.fmod(float(camera.place[axis]), FLOOR_STEP) + float(eye[axis])
            away = self._hits[axis] * np.float32(drop / FLOOR_STEP)
            away += np.float32(first / FLOOR_STEP)
            away -= np.rint(away)
            np.abs(away, out=away)
            away *= self._sharpness[axis]
            np.minimum(shown, away, out=shown)
        shown *= np.float32(-FLOOR_STEP / drop)
        shown += np.float32(0.5 + 0.5 * _LINE * self._unit)
        np.clip(shown, np.float32(0.0), np.float32(weight), out=shown)
        shown *= self._near
        image.paste(_LINES, self._plot[:2], Image.fromarray(shown.astype(np.uint8)))

    def _draw_shadows(
        self,
        image: Image.Image,
        camera: SpatialCamera,
        corners: Array,
        aim: Array,
        height: float,
        weight: float,
    ) -> None:
        """Draw what body, trail and target throw on a floor."""
        lift = height - camera.place[2]

        def on_floor(away: Array) -> Array:
            return camera.project(away * (1.0, 1.0, 0.0) + (0.0, 0.0, lift))[0]

        path = np.concatenate([camera.trail, camera.centre[None]]) - camera.place
        faded = tuple(ramp((_NEAR_WATER, _SHADOW_OF_TRAIL), weight).tolist())
        self._draw_path(image, on_floor(path), 1.4, faded)
        if self._radius is not None:
            disc = on_floor(aim - camera.place + self._radius * _CIRCLE)
            if (np.abs(disc - self._middle_of_plot) < 4.0 * self._half).all():
                self._shade(image, disc[None], GOAL, 0.22 * weight)
        self._shade(image, on_floor(corners), _SHADOW, _SHADOW_SHARE * weight)

    def _shade(self, image: Image.Image, polygons: Array, colour: Colour, share: float) -> None:
        """Cover the area of polygons (n, k, 2) with a share of a colour, with soft edges."""
        left, top, right, bottom = self._plot
        margin = math.ceil(3.0 * self._unit)
        low = np.clip(polygons.min(axis=(0, 1)) - margin, (left, top), (right, bottom)).astype(int)
        high = np.clip(polygons.max(axis=(0, 1)) + margin, (left, top), (right, bottom)).astype(int)
        if (high <= low).any():
            return
        mask = Image.new("L", tuple((2 * (high - low)).tolist()))
        draw, ink = ImageDraw.Draw(mask), round(255.0 * share)
        for polygon in (2.0 * (polygons - low)).reshape(len(polygons), -1).tolist():
            draw.polygon(polygon, fill=ink)
        mask = mask.reduce(2).filter(ImageFilter.BoxBlur(1.2 * self._unit))
        image.paste(colour, tuple(low.tolist()), mask)

    def _draw_drop(
        self, image: Image.Image, camera: SpatialCamera, place: Array, height: float, colour: Colour
    ) -> None:
        """Draw the line from a place straight down, or up, to a floor."""
        unit = self._unit
        ends = camera.on_screen(np.array([place, [*place[:2], height]]))
        if (np.abs(ends - self._middle_of_plot) > 4.0 * self._half).any():
            return
        dashes = max(1, round(float(np.hypot(*(ends[1] - ends[0]))) / (7.0 * unit)))
        at = (np.arange(dashes)[:, None] + (0.2, 0.8)) / dashes
        with Patch(image, ends, 3.0 * unit, self._plot) as patch:
            for dash in ends[0] + at[..., None] * (ends[1] - ends[0]):
                patch.line(dash, 1.1 * unit, colour)
            patch.discs(ends[1:], 2.0 * unit, colour)

    def _name_floor(self, image: Image.Image, height: float) -> None:
        """Write the height of the floor into the lower right corner."""
        small, unit = self._small, self._unit
        after, number = f"BL, lines {FLOOR_STEP} BL apart", short(height, 1)
        x, y = self._plot[2] - 8.0 * unit, self._plot[3] - 8.0 * unit
        x -= small.words(image, (x, y), after, QUIET_TEXT, 1.0) + 3.0 * unit
        x -= small.figures(image, (x, y), number, QUIET_TEXT, 1.0) + 3.0 * unit
        small.words(image, (x, y), "floor at z =", QUIET_TEXT, 1.0)

    def _draw_goal(
        self, image: Image.Image, camera: SpatialCamera, aim: Array, height: float
    ) -> None:
        if self._radius is None:
            self._draw_direction(image, aim)
        else:
            self._draw_target(image, camera, aim, self._radius, height)

    def _draw_target(
        self, image: Image.Image, camera: SpatialCamera, aim: Array, radius: float, height: float
    ) -> None:
        """Draw the ball of a target, or where it lies outside of the view."""
        unit = self._unit
        place, depth = camera.project(aim - camera.place)
        away = place - self._middle_of_plot
        distance = float(np.linalg.norm(aim - camera.centre))
        nearest = NEAREST * camera.distance
        size = max(radius * camera.scale * camera.distance / max(float(depth), nearest), 4.0 * unit)
        if depth <= nearest or (np.abs(away) >= self._half + 0.5 * size).any():
            ahead = away if depth > nearest else AXES[:2] @ (aim - camera.place) * (1.0, -1.0)
            self._draw_beyond(image, ahead, distance)
            return
        self._draw_drop(image, camera, aim, height, GOAL)
        left, top, right, bottom = self._plot
        low = np.clip(place - size - 1.0, (left, top), (right, bottom)).astype(int)
        high = np.clip(place + size + 2.0, (left, top), (right, bottom)).astype(int)
        x, y = (np.arange(low[i], high[i]) + 0.5 - place[i] for i in (0, 1))
        from_middle = np.hypot(x, y[:, None])
        inside = np.clip(size - from_middle + 0.5, 0.0, 1.0)
        clear = 0.5 if distance <= radius else 0.24
        rim = np.minimum(from_middle / size, 1.0) ** 6
        shine = np.hypot(x + 0.38 * size, y[:, None] + 0.42 * size) / (0.3 * size)
        for colour, shown in (
            (GOAL, inside * (clear + (0.95 - clear) * rim)),
            (PAPER, inside * 0.75 * np.exp(-(shine**2))),
        ):
            mask = Image.fromarray(np.rint(255.0 * shown).astype(np.uint8))
            image.paste(colour, tuple(low.tolist()), mask)
        with Patch(image, place[None], 3.0 * unit, self._plot) as patch:
            patch.discs(place[None], 2.2 * unit, GOAL)

    def _draw_direction(self, image: Image.Image, aim: Array) -> None:
        """Draw the arrow of a goal that is a direction, at the side that it points to.

        It begins in the middle of a level circle; a line from its tip ends on the circle's plane.
        """
        unit = self._unit
        along = AXES[:2] @ aim * (1.0, -1.0)
        middle = self._place_of_direction(along)
        # Above what stands in the corners.
        middle[1] = min(middle[1], self._plot[3] - 86.0 * unit)

        def seen(points: Array) -> Array:
            return np.asarray(middle + 36.0 * unit * (points @ AXES[:2].T) * (1.0, -1.0))

        corners, normals = _arrow(aim)
        front = np.flatnonzero(normals @ AXES[2] < 0.0)
        front = front[np.argsort(-corners[front].mean(axis=1) @ AXES[2], kind="stable")]
        light = 0.62 + 0.5 * np.maximum(normals[front] @ _LIGHT, 0.0)
        green = np.clip(np.array(GOAL) * light[:, None], 0, 255).astype(np.uint8)
        circle, foot = 0.9 * _CIRCLE, aim * (1.0, 1.0, 0.0)
        pale = tuple(ramp((GOAL, _FAR_WATER), 0.35).tolist())
        with Patch(image, seen(1.1 * _CIRCLE), 40.0 * unit, self._plot) as patch:
            lines = [seen(circle[[*range(len(circle)), 0]]), seen(np.array([aim, foot, 0.0 * aim]))]
            # Seen from above, what is below the circle lies behind it.
            if aim[2] < 0.0:
                patch.polygons(seen(corners[front]), green)
            for line in lines:
                patch.line(line, 1.1 * unit, pale)
            if aim[2] >= 0.0:
                patch.polygons(seen(corners[front]), green)
        # On the side of the circle where the arrow is not.
        lift = -27.0 if aim[2] >= 0.0 else 18.0
        self._middle.words(image, (middle[0], middle[1] - lift * unit), "goal", GOAL, 0.5)

    def _draw_axes(self, image: Image.Image) -> None:
        """Draw the directions of x, y and z into the lower left corner."""
        unit = self._unit
        start = np.array([self._plot[0] + 22.0 * unit, self._plot[3] - 13.0 * unit])
        ends = start + 20.0 * unit * AXES[:2].T * (1.0, -1.0)
        with Patch(image, ends, 22.0 * unit, self._plot) as patch:
            for end in ends:
                patch.line(np.array([start, end]), 1.4 * unit, QUIET_TEXT)
        for name, end in zip("xyz", start + 1.35 * (ends - start), strict=True):
            self._small.words(image, (end[0], end[1] + 4.0 * unit), name, QUIET_TEXT, 0.5)

    def _draw_body(
        self, image: Image.Image, camera: SpatialCamera, body: Polygons, away: Array
    ) -> None:
        """Draw the faces that look at the eye, the furthest first."""
        sight = body.corners.mean(axis=1) + away + camera.distance * AXES[2]
        depth = np.linalg.norm(sight, axis=1)
        facing = -(body.normals * sight).sum(axis=1) / depth
        front = np.flatnonzero(facing > 0.0)
        front = front[np.argsort(-depth[front], kind="stable")]
        normals = body.normals[front]
        light = 0.71 + 0.34 * np.maximum(normals @ _LIGHT, -0.3)
        # Darker towards the outline, so that it stands out.
        light *= 0.72 + 0.28 * np.minimum(2.2 * facing[front], 1.0)
        shine = 32.0 * np.maximum(normals @ _HALF_WAY, 0.0) ** 16
        lit = np.clip(body.colours[front] * light[:, None] + shine[:, None], 0.0, 255.0)
        points, _ = camera.project(body.corners[front] + away)
        with Patch(image, points.reshape(-1, 2), 1.0, self._plot) as patch:
            patch.polygons(points, np.rint(lit).astype(np.uint8))


def _arrow(aim: Array) -> tuple[Array, Array]:
    """Return corners (F, 4, 3) and unit normals (F, 3) of an arrow from the origin to a tip."""
    aside = np.cross(aim, np.eye(3)[np.argmin(np.abs(aim))])
    aside /= np.linalg.norm(aside)
    ring = _CIRCLE[::2, :2] @ np.array([aside, np.cross(aim, aside)])
    rings = [size * ring + at * aim for size, at in _ARROW]
    corners = np.concatenate(
        [
            np.stack([a, np.roll(a, -1, axis=0), np.roll(b, -1, axis=0), b], axis=1)
            for a, b in pairwise(rings)
        ]
    )
    return corners, normals_of(corners)
