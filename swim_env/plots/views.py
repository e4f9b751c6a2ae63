"""Three views of a body in space at one scale, and bodies with shaded faces in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.body_surface import BodySurface
from swim_env.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.ticker import MaxNLocator

__all__ = ["VIEWS", "Plan", "View", "draw_body"]

Array = NDArray[np.float64]

#: Room beside, between, under each other, above and below views for their axes (inches), most of
#: their height, and least distance of numbers at an axis.
_LEFT, _RIGHT, _BETWEEN, _UNDER, _ABOVE, _BELOW = 0.68, 0.12, 0.68, 0.75, 0.55, 0.5
_HIGHEST, _TICK = 5.0, 0.42
#: Views are in a row where their scale is then at least this share of the other arrangement's.
_ENOUGH = 0.8
#: Where light comes from, seen from the viewer: right, up, towards the viewer.
_LIGHT = np.array([-0.3, 0.5, 0.81])


@dataclass(frozen=True)
class View:
    """Which coordinates point to the right, upwards and towards the viewer, and their signs."""

    title: str
    right: int
    up: int
    towards: int
    sign_right: float
    sign_towards: float

    def place(self, points: Array) -> Array:
        """Return points (..., 2) of the picture."""
        return points[..., [self.right, self.up]]

    def lit(self, normals: Array) -> Array:
        """Return normals (..., 3) as the viewer sees them: right, up, towards the viewer."""
        signs = (self.sign_right, 1.0, self.sign_towards)
        return normals[..., [self.right, self.up, self.towards]] * signs


#: In the third one the head looks at the viewer, towards -x, so y points to the left.
VIEWS = (
    View("top", 0, 1, 2, 1.0, 1.0),
    View("side", 0, 2, 1, 1.0, -1.0),
    View("front", 1, 2, 0, -1.0, -1.0),
)


@dataclass(frozen=True)
class Plan:
    """How views are arranged, at one scale, on a picture's width.

    Constrained layout, which places the rest, would give each view a scale of its own.
    """

    box: Array
    front: Array
    #: Inches for a metre, and the height of all (inches).
    scale: float
    height: float
    #: Whether the views are beside each other, and not the side below the top.
    in_a_row: bool

    @classmethod
    def of(cls, box: Array, front: Array) -> Plan:
        """Arrange views of a box (2, 3), from the front of a range (2,) of y (m)."""
        x, y, z = box[1] - box[0]
        wide = float(front[1] - front[0])
        across = style.WIDTH - _LEFT - _BETWEEN - _RIGHT
        below = min(across / (x + wide), (_HIGHEST - _UNDER) / (y + z))
        beside = min((across - _BETWEEN) / (2.0 * x + wide), _HIGHEST / max(y, z))
        in_a_row = bool(beside > _ENOUGH * below)
        scale = float(beside if in_a_row else below)
        height = scale * max(y, z) if in_a_row else scale * (y + z) + _UNDER
        return cls(box, front, scale, float(height) + _ABOVE + _BELOW, in_a_row)

    def place(self, figure: Figure, above: SubFigure, views: list[Axes]) -> None:
        """Place the views from above, from the side and from the front."""
        figure.draw_without_rendering()
        width, height = (extent / figure.dpi for extent in above.bbox.size)
        box, (x, y, z) = self.box, self.scale * (self.box[1] - self.box[0])
        wide = self.scale * float(self.front[1] - self.front[0])
        top = height - _ABOVE
        second = _LEFT + x + _BETWEEN
        if self.in_a_row:
            corners = [(_LEFT, top - y), (second, top - z), (second + x + _BETWEEN, top - z)]
        else:
            low = top - y - _UNDER - z
            corners = [(_LEFT, top - y), (_LEFT, low), (second, low)]
        sizes = [(x, y), (x, z), (wide, z)]
        rights, ups = (box[:, 0], box[:, 0], self.front[::-1]), (box[:, 1], box[:, 2], box[:, 2])
        for axes, corner, size, right, up in zip(views, corners, sizes, rights, ups, strict=True):
            axes.set_position(
                (corner[0] / width, corner[1] / height, size[0] / width, size[1] / height)
            )
            for axis, extent in ((axes.xaxis, size[0]), (axes.yaxis, 2.5 * size[1])):
                if len(axis.get_ticklocs()):
                    axis.set_major_locator(_ticks(extent))
            axes.set_xlim(*right)
            axes.set_ylim(*up)


def _ticks(extent: float) -> MaxNLocator:
    """Return where numbers are along an axis of some length (inches)."""
    from matplotlib.ticker import MaxNLocator

    bins = max(1, int(extent / _TICK))
    return MaxNLocator(nbins=bins, steps=[1, 2, 5, 10], min_n_ticks=1)


def draw_body(
    axes: Axes,
    view: View,
    surface: BodySurface,
    vertices: Array,
    colour: Array,
    label: str,
) -> None:
    """Draw a body with shaded faces and an outline, from the far ones to the near ones."""
    from matplotlib.collections import PolyCollection

    corners = view.place(vertices)[surface.faces]
    dark = 0.45 * colour[:3]
    layer = 2.0 + len(axes.collections)
    outline = PolyCollection(list(corners), facecolors=[dark], edgecolors=[dark], linewidths=1.2)
    outline.set(zorder=layer, snap=False)
    axes.add_collection(outline, autolim=False)
    faces = view.lit(surface.areas(vertices))
    faces /= np.linalg.norm(faces, axis=-1, keepdims=True)
    near = faces[:, 2] > 0.0
    depth = view.sign_towards * vertices[surface.faces, view.towards].mean(axis=1)
    order = np.argsort(depth[near], kind="stable")
    light = np.clip(faces[near][order] @ _LIGHT, 0.0, 1.0)[:, None]
    shaded = colour[:3] * (0.62 + 0.38 * light) + (1.0 - colour[:3]) * 0.55 * light**4
    # Thin edges of the faces' own colour close the gaps between them.
    body = PolyCollection(
        list(corners[near][order]), facecolors=shaded, edgecolors=shaded, linewidths=0.3
    )
    body.set(zorder=layer + 1.0, snap=False)
    axes.add_collection(body, autolim=False)
    look: dict[str, Any] = {"markersize": 4.5, "markeredgecolor": "white", "markeredgewidth": 0.6}
    axes.plot(*view.place(vertices[0]), "o", color=colour, label=label, zorder=layer + 1.5, **look)
