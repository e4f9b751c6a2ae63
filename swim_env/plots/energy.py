"""The energy of a run over time: its parts, where it came from, what is unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.analysis.energy import elastic_energy, split_energy, summed
from swim_env.analysis.spatial_energy import spatial_elastic_energy
from swim_env.physics.invariants import energy_through
from swim_env.plots import style
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from swim_env.sim.trajectory import Trajectory, TrajectoryBase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_energy"]

#: Most instants of a panel's lines, and pieces of a band: more than its pixels cannot be seen.
_MOST, _PIECES = 800, 250


def draw_energy(
    trajectories: Mapping[str, Trajectory],
    velocities: Mapping[str, ArrayLike] | None = None,
    seconds: float | None = None,
) -> Figure:
    """Draw the energy budgets of runs, a column for each.

    Above, the energy in its parts at the end of the run; below, work and losses since the start,
    and what they do not explain, as a share of what went through (`Trajectory.energy_drift`).

    Parameters
    ----------
    trajectories, seconds
        About two runs fit; the time is that of the parts. See `swim_env.plots`.
    velocities : mapping of str to (N + 2,) array_like, optional
        With which the runs started, see `swim_env.analysis.energy.split_energy`. Without, and
        always in space, the kinetic energy is not split between body and fluid.
    """
    if style.are_in_space(trajectories):
        velocities = None
    style.require_steps(trajectories)
    figure = style.new_figure(style.WIDTH, 5.4)
    axes = figure.subplots(3, len(trajectories), height_ratios=(1.2, 1.2, 0.8), squeeze=False)
    for column, (name, run) in enumerate(trajectories.items()):
        parts, spent, drift = axes[:, column]
        shown = style.shown_seconds(run, seconds)
        _draw_parts(parts, run, (velocities or {}).get(name), shown)
        _draw_spent(spent, run)
        _draw_drift(drift, run)
        for place, label, title in (
            (parts, "energy (J)", f"energy in its parts, last {shown:g} s"),
            (spent, "energy (J)", "since the start"),
            (drift, "share of what\nwent through (%)", "energy that nothing explains"),
        ):
            style.style_axes(place, "time (s)", "" if column else label, f"{name}: {title}")
        style.add_legend(parts, loc="upper center", ncols=2)
        style.add_legend(spent, loc="upper left")
    return figure


def _draw_parts(axes: Axes, run: Trajectory, velocity: ArrayLike | None, seconds: float) -> None:
    """Draw the parts on top of each other, and the energy as a line above them."""
    first = max(0, run.steps - max(1, round(seconds / run.scene.integrator.time_step)))
    instants = _thinned(first, run.steps)
    time, total = run.time[instants], run.energy[instants]
    if velocity is None:
        elastic = _elastic_energy(run, instants)
        layers = {
            "elastic": elastic,
            "kinetic, body and fluid": total - elastic,
        }
    else:
        split = split_energy(run, velocity, instants)
        layers = {
            "elastic": split.elastic,
            "kinetic, fluid": split.fluid,
            "kinetic, body": split.body,
        }
    colours = [style.energy_colour(part) for part in layers]
    axes.stackplot(time, *layers.values(), labels=list(layers), colors=colours, linewidth=0)
    axes.plot(time, total, color=style.BLACK, linewidth=style.LINE, label="total")
    axes.set_xlim(time[0], time[-1])
    # Room for the legend.
    axes.set_ylim(0.0, 1.45 * float(total.max()) or None)


def _elastic_energy(run: TrajectoryBase, instants: NDArray[np.int64]) -> NDArray[np.float64]:
    if isinstance(run, SpatialTrajectory):
        rotations = run.joint_rotations[instants]
        return spatial_elastic_energy(run.scene, rotations)  # type: ignore[arg-type]
    return elastic_energy(run, instants)  # type: ignore[arg-type]


def _draw_spent(axes: Axes, run: Trajectory) -> None:
    """Draw the work of the torques, the losses to damping, and the energy that is there."""
    instants = _thinned(0, run.steps)
    style.mark_zero(axes)
    for label, values, colour, stroke in (
        ("work of the torques", summed(run.work), style.energy_colour("by torques"), "-"),
        ("dissipated", summed(run.dissipated), style.energy_colour("to damping"), "--"),
        ("energy gained", run.energy - run.energy[0], style.BLACK, "-"),
    ):
        time, width = run.time[instants], style.LINE
        axes.plot(time, values[instants], stroke, color=colour, linewidth=width, label=label)
    axes.set_xlim(run.time[0], run.time[-1])


def _draw_drift(axes: Axes, run: Trajectory) -> None:
    """Draw what nothing explains: between its least and its largest in short pieces of time."""
    through = energy_through(run.energy, run.dissipated) or 1.0
    left = run.unexplained_energy
    begins = _thinned(0, run.steps, _PIECES)[:-1]
    low, high = (100.0 / through * end.reduceat(left, begins) for end in (np.minimum, np.maximum))
    style.mark_zero(axes)
    axes.fill_between(
        run.time[begins], low, high, color=style.energy_colour("unexplained"), linewidth=style.LINE
    )
    axes.set_xlim(run.time[0], run.time[-1])


def _thinned(first: int, last: int, most: int = _MOST) -> NDArray[np.int64]:
    """Return instants from the first to the last, about so many at most."""
    step = max(1, -(-(last - first) // most))
    instants: NDArray[np.int64] = np.unique([*range(first, last, step), last])
    return instants
