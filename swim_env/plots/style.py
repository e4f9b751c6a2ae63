"""How all still pictures look: colours, maps, widths, sizes, and axes with units.

Pictures are drawn with matplotlib's object interface, so nothing global is touched and no window
opens. The colours are those of Okabe & Ito, made to be told apart by everybody; maps differ in
lightness as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.colours import ENERGY, TORQUE_STOPS
from swim_env.envs.render.silhouette import head_outline, mitres
from swim_env.errors import SwimError, require_packages
from swim_env.files.atomic import write_atomically
from swim_env.sim.trajectory import TrajectoryBase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.legend import Legend

BLACK, GREY, SILVER = "#000000", "#666666", "#999999"
BLUE, ORANGE, GREEN, PINK = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
AMBER, SKY, YELLOW = "#E69F00", "#56B4E9", "#F0E442"
#: Of lines that lead the eye, of areas that mean "not known here", and of fronts.
GRID, SHADE, FRONT = "#E6E9ED", "#DDDDDD", BLACK

#: Runs through colours that differ in lightness as well, from the beginning to the end of a run.
TIME_COLOURS = "viridis"

#: Width of a picture (inches), and sizes of text (points). Shown 800 pixels wide, as on a page
#: of a repository, text of the smaller size is 9.7 pixels high.
WIDTH, SMALL, SMALLER = 8.0, 8, 7
#: Widths of lines (points).
THIN, LINE, THICK = 0.6, 1.3, 2.2
_DOTS_PER_INCH = 150
#: Least half width of a head (body lengths), as in frames.
_HEAD = 0.014
#: Displacements below this are rounding (body lengths).
_NOTHING = 1e-12
#: Frames of a moving picture that a still one shows of a run's end.
_FRAMES_SHOWN = 50

#: A colour for each policy, the same in every picture.
_POLICY_COLOURS = {
    "paper_wave": GREY,
    "tuned_wave": ORANGE,
    "ppo_forward": BLUE,
    "sac_forward": GREEN,
    "ppo_target": PINK,
    "lateral_wave": SKY,
    "dorsoventral_wave": SILVER,
    "helical_wave_right": PINK,
    "helical_wave_left": YELLOW,
    "zero": BLACK,
    "random": AMBER,
}
_OTHERS = (SKY, AMBER, PINK, YELLOW, BLACK)
_STROKES = ("-", "--", ":", "-.")


def policy_looks(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return a colour for each policy, and a stroke for each of its training seeds.

    Agents that differ in nothing but their training seed are called ``NAME/seed_0``,
    ``NAME/seed_1`` ... and have the colour of NAME.
    """
    looks: dict[str, dict[str, Any]] = {}
    colours = dict(_POLICY_COLOURS)
    members: dict[str, int] = {}
    for name in names:
        group = name.partition("/")[0]
        if group not in colours:
            others = len(colours) - len(_POLICY_COLOURS)
            colours[group] = _OTHERS[others % len(_OTHERS)]
        number = members[group] = members.get(group, -1) + 1
        looks[name] = {"color": colours[group], "linestyle": _STROKES[number % len(_STROKES)]}
    return looks


def energy_colour(part: str) -> str:
    """Return the colour of a part of the energy, see `swim_env.colours.ENERGY`."""
    return "#" + bytes(ENERGY[part]).hex()


def diverging_map() -> LinearSegmentedColormap:
    """Return the colours of what has a sign, white at zero: those of the frames' torques."""
    from matplotlib.colors import LinearSegmentedColormap

    stops = [tuple(part / 255.0 for part in stop) for stop in TORQUE_STOPS]
    return LinearSegmentedColormap.from_list("blue_orange", stops)


def require_matplotlib() -> None:
    """Check that matplotlib is installed; else the SwimError says how to get it."""
    require_packages("pictures need", {"matplotlib": "matplotlib"}, "view")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size (inches), 150 pixels an inch; needs matplotlib."""
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def require_steps(trajectories: Mapping[str, TrajectoryBase]) -> None:
    """Check that there is a trajectory and that all have steps; else it is a SwimError."""
    if not trajectories or any(run.steps < 1 for run in trajectories.values()):
        raise SwimError("there is nothing to draw: no trajectory, or one without steps")


def are_in_space(trajectories: Mapping[str, TrajectoryBase]) -> bool:
    """Return whether runs are in space; it is a SwimError if some are and others are not."""
    dimensions = {run.scene.dimension for run in trajectories.values()}
    if len(dimensions) > 1:
        raise SwimError("a picture shows runs in the plane or in space, got some of both")
    return dimensions == {3}


def title_of(trajectory: TrajectoryBase, name: str) -> str:
    """Return the title of a picture of one run of somebody, with how far it went."""
    net = trajectory.displacement / trajectory.scene.beam.length
    shown = ", ".join(f"{part:+.3g}" for part in np.where(np.abs(net) < _NOTHING, 0.0, net))
    text = f"{name} on {trajectory.scene.name}" if name else trajectory.scene.name
    text += f": {trajectory.duration:g} s, net displacement ({shown}) body lengths"
    if trajectory.termination_reason:
        text += f", ended early: {trajectory.termination_reason}"
    return text


def shown_seconds(run: TrajectoryBase, seconds: float | None) -> float:
    """Return how much of a run's end is shown (s), a second on the shipped scenes unless given."""
    return _FRAMES_SHOWN * run.scene.frame_interval if seconds is None else seconds


def last_instants(run: TrajectoryBase, count: int) -> NDArray[np.int64]:
    """Return instants at equal intervals over a run's last 0.2 s, at most as many as it has."""
    back = np.linspace(0.2 / run.scene.integrator.time_step, 0.0, count)
    instants: NDArray[np.int64] = np.unique((run.steps - back).round().astype(int).clip(0))
    return instants


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture as PNG, whole or not at all (then it is a SwimError)."""

    def write(file: IO[bytes]) -> None:
        # Without the version of matplotlib, so that the same picture is the same file.
        figure.savefig(
            file, format="png", metadata={"Software": None}, pil_kwargs={"optimize": True}
        )

    try:
        write_atomically(path, write)
    except OSError as error:
        raise SwimError(
            f"cannot write the picture: {error.strerror or error} ({os.fspath(path)})"
        ) from None


def style_axes(axes: Axes, x: str, y: str, title: str = "", grid: bool = True) -> None:
    """Label axes, in the size and with the frame that all pictures have.

    `x` and `y` say what is shown, with its unit; the title is above the axes' left end. Lines at
    the ticks (`grid`) would disturb over an image.
    """
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    axes.spines[["top", "right"]].set_visible(False)
    if title:
        name_panel(axes, title)
    if grid:
        axes.grid(color=GRID, linewidth=THIN)
        axes.set_axisbelow(True)


def name_panel(axes: Axes, text: str) -> None:
    """Write what axes show above their left end."""
    axes.set_title(literal(text), fontsize=SMALL, loc="left")


def literal(text: str) -> str:
    """Return a text with a name in it as matplotlib shows it as it is, without formulas."""
    return text.replace("$", r"\$")


def add_legend(axes: Axes | Figure | SubFigure, *entries: Any, **options: Any) -> Legend:
    """Add a legend in small letters, without a frame; the rest is matplotlib's."""
    return axes.legend(*entries, **{"fontsize": SMALLER, "frameon": False, **options})


def draw_body(
    axes: Axes,
    nodes: ArrayLike,
    half_thickness: float,
    colour: Any,
    label: str = "",
    layer: int = 2,
) -> None:
    """Draw a planar body with its thickness and a head, as frames show it.

    Nodes (N + 1, 2) from head to tail and half the thickness are in the axes' units; the body is
    at least as wide as a line. The label is that of its centre line.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Polygon

    line = np.array(nodes, dtype=np.float64)
    along = np.diff(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    sides = half_thickness * mitres(across)
    elements = np.linalg.norm(np.diff(line, axis=0), axis=1)
    radius = max(1.4 * half_thickness, _HEAD * float(elements.sum()))
    head = head_outline(line[0], along[0], across[0], radius)
    # The outline begins where the head is widest, which covers its corners.
    line[0] += min(radius, 0.5 * float(elements[0])) * along[0]
    pale = 0.5 + 0.5 * np.array(to_rgb(colour))
    look: dict[str, Any] = {"edgecolor": colour, "linewidth": 0.9, "joinstyle": "round"}
    outline = np.concatenate([line + sides, (line - sides)[::-1]])
    for corners, fill in ((outline, pale), (head, colour)):
        axes.add_patch(Polygon(corners, facecolor=fill, zorder=layer, **look))
    # Where the body is small, it is its centre line, and its head is a dot.
    shown: dict[str, Any] = {"label": label} if label else {}
    axes.plot(*np.asarray(nodes).T, color=colour, linewidth=LINE, zorder=layer, **shown)
    axes.plot(*line[0], "o", color=colour, markersize=3, zorder=layer)


def mark_ends(bar: Colorbar) -> None:
    """Put numbers at both ends of a bar of colours from -x to x, in the middle and half way."""
    places = np.linspace(*bar.mappable.get_clim(), 5).tolist()
    bar.set_ticks(places, labels=[f"{place:.3g}" for place in places])


def mark_zero(axes: Axes) -> None:
    """Draw a line across axes at zero."""
    axes.axhline(0.0, color=GREY, linewidth=THIN)


def show_plane(axes: Axes, box: ArrayLike) -> None:
    """Show a box, lower left and upper right corner (2, 2), and what is around it at one scale."""
    axes.update_datalim(np.asarray(box))
    axes.margins(0.0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")


def time_colours(count: int) -> NDArray[np.float64]:
    """Return colours (count, 4) from the beginning to the end of a run, dark to light."""
    from matplotlib import colormaps

    colours: NDArray[np.float64] = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, count))
    return colours
