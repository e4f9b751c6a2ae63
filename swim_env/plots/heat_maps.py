"""Maps over the body and time, policies beside each other on one scale: bending and torques."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.plots.style import SMALL, WIDTH, diverging_map, name_panel, new_figure, style_axes
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["curvature", "draw_kymographs", "draw_map", "draw_torques"]

Array = NDArray[np.float64]

_COLUMNS = 2


def curvature(trajectory: Trajectory) -> Array:
    """Return the curvature of the chain at its joints, (T + 1, N - 1) (1/m).

    The joint angle over the length of an element, positive to the left seen from the head.
    """
    bends: Array = np.diff(trajectory.angles, axis=1) / trajectory.scene.beam.element_length
    return bends


def draw_kymographs(trajectories: Mapping[str, Trajectory], seconds: float = 1.0) -> Figure:
    """Draw the curvature along the body over time, a panel for each policy, on one scale.

    Stripes that lean are waves that travel along the body, upright ones stand.

    Parameters
    ----------
    trajectories : mapping of str to Trajectory
        One of each policy.
    seconds : float
        Time that is shown, the last of each run (s).

    Raises
    ------
    SwimError
        If there is no trajectory, or one has no steps.
    """
    maps = {name: curvature(run)[1:] for name, run in trajectories.items()}
    return _draw_maps(trajectories, maps, seconds, "curvature (1/m)", "1/m")


def draw_torques(trajectories: Mapping[str, Trajectory], seconds: float = 1.0) -> Figure:
    """Draw the torques of the joints over time, a panel for each policy, on one scale.

    Parameters
    ----------
    trajectories : mapping of str to Trajectory
        One of each policy.
    seconds : float
        Time that is shown, the last of each run (s).

    Raises
    ------
    SwimError
        If there is no trajectory, or one has no steps.
    """
    maps = {name: run.torques for name, run in trajectories.items()}
    return _draw_maps(trajectories, maps, seconds, "joint torque (N m)", "N m")


def draw_map(axes: Axes, run: Trajectory, values: Array, limit: float) -> AxesImage:
    """Draw values (K, N - 1) of a run's last steps and its joints as colours from -limit to limit.

    Returns
    -------
    AxesImage
        What a colour bar takes.
    """
    end = float(run.time[-1])
    return axes.imshow(
        values.T,
        aspect="auto",
        origin="upper",
        interpolation="nearest",
        cmap=diverging_map(),
        vmin=-limit,
        vmax=limit,
        extent=(
            end - len(values) * run.scene.integrator.time_step,
            end,
            values.shape[1] + 0.5,
            0.5,
        ),
    )


def _draw_maps(
    trajectories: Mapping[str, Trajectory],
    maps: Mapping[str, Array],
    seconds: float,
    label: str,
    unit: str,
) -> Figure:
    """Draw values (T, N - 1) of each step and joint; the colours of all reach as far."""
    if not maps or any(run.steps < 1 for run in trajectories.values()):
        raise SwimError("there is nothing to draw: no trajectory, or one without steps")
    shown = {}
    for name, run in trajectories.items():
        count = max(1, round(seconds / run.scene.integrator.time_step))
        shown[name] = maps[name][-count:]
    limit = max(float(np.abs(values).max()) for values in shown.values()) or 1.0
    columns = min(_COLUMNS, len(maps))
    rows = math.ceil(len(maps) / columns)
    figure = new_figure(WIDTH, 0.7 + 1.75 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for place in axes.ravel()[len(maps) :]:
        place.set_axis_off()
    for number, (name, values) in enumerate(shown.items()):
        place, run = axes[number // columns, number % columns], trajectories[name]
        joints = values.shape[1]
        image = draw_map(place, run, values, limit)
        place.set_yticks(np.unique(np.linspace(1, joints, min(joints, 4)).round().astype(int)))
        largest = float(np.abs(values).max())
        name_panel(place, f"{name}, largest {largest:.2g} {unit}")
        below = number + columns >= len(maps)
        style_axes(
            place,
            "time (s)" if below else "",
            "joint, 1 at the head" if number % columns == 0 else "",
            grid=False,
        )
    bar = figure.colorbar(image, ax=axes, aspect=30, pad=0.015)
    bar.set_label(label, fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)
    return figure
