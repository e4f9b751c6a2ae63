"""The energy of a run over time: what it consists of, where it came from, what nothing explains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.analysis.energy import elastic_energy, split_energy, summed
from swim_env.errors import SwimError
from swim_env.plots.style import (
    AMBER,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LINE,
    ORANGE,
    PINK,
    SKY,
    SMALLER,
    THIN,
    WIDTH,
    name_panel,
    new_figure,
    style_axes,
)
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_energy"]

Array = NDArray[np.float64]

#: Most instants of a panel's lines: more than its pixels cannot be seen.
_MOST, _PIECES = 800, 250


def draw_energy(
    trajectories: Mapping[str, Trajectory],
    velocities: Mapping[str, ArrayLike] | None = None,
    seconds: float = 1.0,
) -> Figure:
    """Draw the energy budgets of runs, a column for each.

    Above, the energy in its parts at the end of the run; below, work and losses since the start,
    and what they do not explain, as a share of the largest energy.

    Parameters
    ----------
    trajectories : mapping of str to Trajectory
        One of each policy; about two fit.
    velocities : mapping of str to (N + 2,) array_like, optional
        With which the runs started, see `swim_env.analysis.energy.split_energy`. Without, the
        kinetic energy is not split between body and fluid.
    seconds : float
        Time that the parts are shown for, the last of each run (s).

    Raises
    ------
    SwimError
        If there is no trajectory, or one has no steps, or a velocity is not that of its start.
    """
    if not trajectories or any(run.steps < 1 for run in trajectories.values()):
        raise SwimError("there is nothing to draw: no trajectory, or one without steps")
    figure = new_figure(WIDTH, 5.4)
    axes = figure.subplots(3, len(trajectories), height_ratios=(1.2, 1.2, 0.8), squeeze=False)
    for column, (name, run) in enumerate(trajectories.items()):
        velocity = (velocities or {}).get(name)
        parts, spent, drift = axes[:, column]
        _draw_parts(parts, run, velocity, seconds)
        _draw_spent(spent, run)
        _draw_drift(drift, run)
        name_panel(parts, f"{name}: energy in its parts, last {seconds:g} s")
        name_panel(spent, f"{name}: since the start")
        name_panel(drift, f"{name}: H - H(0) - work + dissipated")
        first = column == 0
        style_axes(parts, "time (s)", "energy (J)" if first else "")
        style_axes(spent, "time (s)", "energy (J)" if first else "")
        style_axes(drift, "time (s)", "share of the\nlargest H (%)" if first else "")
        parts.legend(fontsize=SMALLER, frameon=False, loc="upper center", ncols=2)
        spent.legend(fontsize=SMALLER, frameon=False, loc="upper left")
    return figure


def _draw_parts(axes: Axes, run: Trajectory, velocity: ArrayLike | None, seconds: float) -> None:
    """Draw the parts on top of each other, and the energy as a line above them."""
    first = max(0, run.steps - round(seconds / run.scene.integrator.time_step))
    instants = _thinned(first, run.steps)
    if velocity is None:
        elastic = elastic_energy(run, instants)
        layers: dict[str, tuple[Array, str]] = {
            "elastic": (elastic, AMBER),
            "kinetic, body and fluid": (run.energy[instants] - elastic, SKY),
        }
    else:
        split = split_energy(run, velocity, instants)
        layers = {
            "elastic": (split.elastic, AMBER),
            "kinetic, fluid": (split.fluid, SKY),
            "kinetic, body": (split.body, BLUE),
        }
    axes.stackplot(
        run.time[instants],
        *[values for values, _ in layers.values()],
        labels=list(layers),
        colors=[colour for _, colour in layers.values()],
        linewidth=0,
    )
    axes.plot(
        run.time[instants], run.energy[instants], color=BLACK, linewidth=LINE, label="H, their sum"
    )
    axes.set_xlim(run.time[instants[0]], run.time[instants[-1]])
    # Room for the legend.
    axes.set_ylim(0.0, 1.45 * float(run.energy[instants].max()) or None)


def _draw_spent(axes: Axes, run: Trajectory) -> None:
    """Draw what the torques put in, what damping took, and what is there."""
    instants = _thinned(0, run.steps)
    axes.axhline(0.0, color=GREY, linewidth=THIN)
    for label, values, colour, stroke in (
        ("work of the torques", summed(run.work), ORANGE, "-"),
        ("dissipated", summed(run.dissipated), GREEN, "--"),
        ("H - H(0)", run.energy - run.energy[0], BLACK, "-"),
    ):
        axes.plot(
            run.time[instants],
            values[instants],
            color=colour,
            linestyle=stroke,
            linewidth=LINE,
            label=label,
        )
    axes.set_xlim(run.time[0], run.time[-1])


def _draw_drift(axes: Axes, run: Trajectory) -> None:
    """Draw what nothing explains: between its least and its largest in short pieces of time."""
    largest = float(run.energy.max()) or 1.0
    left = run.unexplained_energy
    begins = _thinned(0, run.steps, _PIECES)[:-1]
    low, high = (100.0 / largest * end.reduceat(left, begins) for end in (np.minimum, np.maximum))
    axes.axhline(0.0, color=GREY, linewidth=THIN)
    axes.fill_between(run.time[begins], low, high, color=PINK, linewidth=LINE)
    axes.set_xlim(run.time[0], run.time[-1])


def _thinned(first: int, last: int, most: int = _MOST) -> NDArray[np.int64]:
    """Return instants from the first to the last, about so many at most."""
    step = max(1, -(-(last - first) // most))
    instants: NDArray[np.int64] = np.unique([*range(first, last, step), last])
    return instants
