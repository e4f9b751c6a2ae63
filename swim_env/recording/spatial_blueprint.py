"""How rerun lays out recordings of bodies in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from swim_env.colours import WATER
from swim_env.recording.layout import Layout

__all__ = ["spatial_views"]

#: Where eyes are, seen from the mean centre (BL): of the view that follows the body, above it,
#: beside it, and of the view of the whole course, from the course's middle (in its sizes).
_EYE, _ABOVE, _BESIDE = (-0.42, -0.72, 0.42), (0.0, 0.0, 1.05), (0.0, -1.05, 0.0)
_FAR = (-0.13, -0.37, 0.27)
#: Half heights of the body from which on it is what places eyes, and not its length.
_TALL = 2.4
#: What is switched off at first where a view follows a body.
_HIDDEN = ("flow/horizontal/speed", "flow/vertical/speed")
_ON_COURSE = ("body", "path", "head_path", "head", "target", "grid")


def spatial_views(lanes: Sequence[Layout], paths: dict[str, Any]) -> tuple[list[Any], list[float]]:
    """Return views of bodies, and their shares of the height.

    A view that follows each of them; below that of one body, what is seen from above and from the
    side, with the flow in that plane; at last the whole course. `paths` are what views show of
    trails, by their entities.
    """
    views = [_following(lane, paths) for lane in lanes]
    shares = [3.0] * len(lanes)
    if len(lanes) == 1:
        views.append(rrb.Horizontal(*_sides(lanes[0], paths)))
        shares.append(1.7)
    return [*views, _course(lanes, paths)], [*shares, 1.5]


def _following(lane: Layout, paths: dict[str, Any]) -> Any:
    off = rrb.EntityBehavior(visible=False)
    looks = {**paths, **{f"{lane.place}/{mark}": off for mark in _HIDDEN}}
    name = f"{lane.name} on {lane.scene.name} (grid {0.5 * lane.scene.beam.length:g} m)"
    return _view(lane, name, _EYE, [f"{lane.place}/**"], looks)


def _sides(lane: Layout, paths: dict[str, Any]) -> list[Any]:
    """Return the views from above and from the side."""
    marks = ("camera", "body", "path", "head_path", "head")
    shown = [f"{lane.place}/{mark}" for mark in marks]
    views = []
    for name, eye, plane in (
        ("From above", _ABOVE, "horizontal"),
        ("From the side", _BESIDE, "vertical"),
    ):
        contents = [*shown, f"{lane.place}/flow/{plane}/**"]
        views.append(_view(lane, name, eye, contents, paths))
    return views


def _course(lanes: Sequence[Layout], paths: dict[str, Any]) -> Any:
    """Return the view in which nothing but the bodies moves."""
    low, high = np.array(lanes[0].low), np.array(lanes[0].high)
    middle = 0.5 * (low + high)
    apart = ", each swimmer in its own lane" if len(lanes) > 1 else ""
    return rrb.Spatial3DView(
        origin="/",
        name=f"Whole course (grid {0.5 * lanes[0].scene.beam.length:g} m){apart}",
        contents=[f"{lane.place}/{mark}" for lane in lanes for mark in _ON_COURSE],
        overrides=paths,
        background=[*WATER],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=middle + np.linalg.norm(high - low) * np.array(_FAR), look_target=middle
        ),
    )


def _view(
    lane: Layout,
    name: str,
    eye: tuple[float, float, float],
    contents: Sequence[str],
    paths: dict[str, Any],
) -> Any:
    """Return a view that goes along with a body."""
    beam: Any = lane.scene.beam
    s = np.linspace(0.0, beam.length, 51)
    size = max(beam.length, _TALL * float(beam.half_height_at(s).max()))
    return rrb.Spatial3DView(
        origin=f"{lane.place}/camera",
        name=name,
        contents=contents,
        overrides=paths,
        background=[*WATER],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=size * np.array(eye),
            look_target=[0.0, 0.0, 0.0],
            eye_up=[0.0, 1.0, 0.0] if eye == _ABOVE else [0.0, 0.0, 1.0],
        ),
    )
