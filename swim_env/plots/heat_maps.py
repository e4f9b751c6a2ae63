"""Maps in colours: bending and torques over the body and time, the search for the best wave."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.plots import style
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from swim_env.sim.trajectory import TrajectoryBase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.image import AxesImage

__all__ = [
    "add_bar",
    "curvature",
    "draw_kymographs",
    "draw_map",
    "draw_torques",
    "draw_wave_search",
    "tail",
]

Array = NDArray[np.float64]

#: The axes of joints in space, in the order in which they are shown.
AXES_SHOWN = ("yaw", "pitch", "roll")

_COLUMNS = 2
#: Values about an axis that reach less than this share of the largest are not shown.
_LITTLE = 0.05


def curvature(trajectory: TrajectoryBase) -> Array:
    """Return the curvature of the chain at its joints, (T + 1, N - 1), in space (T + 1, N - 1, 3).

    The joint angle over the length of an element (1/m), positive to the left seen from the head; in
    space the joint's rotations (pitch, yaw, roll) over it, the last one being the twist.
    """
    dl = trajectory.scene.beam.element_length
    if isinstance(trajectory, SpatialTrajectory):
        rotations: Array = trajectory.joint_rotations / dl
        return rotations
    bends: Array = np.diff(trajectory.angles, axis=1) / dl  # type: ignore[attr-defined]
    return bends


def draw_kymographs(
    trajectories: Mapping[str, TrajectoryBase], seconds: float | None = None
) -> Figure:
    """Draw the curvature along the body over time, a panel for each policy, on one scale.

    Stripes that lean are waves that travel along the body, upright ones are standing waves. In
    space a policy has a panel for each axis that is actuated or turns.
    """
    maps = {name: curvature(run)[1:] for name, run in trajectories.items()}
    return _draw_maps(trajectories, maps, seconds, "curvature (1/m)", "1/m")


def draw_torques(
    trajectories: Mapping[str, TrajectoryBase], seconds: float | None = None
) -> Figure:
    """Draw the torques of the joints over time, as `draw_kymographs` draws the curvature."""
    maps = {name: run.torques for name, run in trajectories.items()}
    return _draw_maps(trajectories, maps, seconds, "joint torque (N m)", "N m")


def _draw_maps(
    trajectories: Mapping[str, TrajectoryBase],
    maps: Mapping[str, Array],
    seconds: float | None,
    label: str,
    unit: str,
) -> Figure:
    """Draw values (T, N - 1), in space (T, N - 1, 3); the colours of all reach as far."""
    style.require_steps(trajectories)
    shown = {name: tail(maps[name], run, seconds) for name, run in trajectories.items()}
    limit = max(float(np.abs(values).max()) for values in shown.values()) or 1.0
    panels = [(name, trajectories[name], values) for name, values in shown.items()]
    columns = min(_COLUMNS, len(maps))
    if style.are_in_space(trajectories):
        seen = _axes_seen(shown.values(), limit)
        panels = [
            (f"{name}, {axis}", run, values[..., AXIS_NAMES.index(axis)])
            for name, run, values in panels
            for axis in seen
        ]
        columns = len(seen)
    rows = math.ceil(len(panels) / columns)
    figure = style.new_figure(style.WIDTH, 0.7 + 1.75 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for place in axes.ravel()[len(panels) :]:
        place.set_axis_off()
    for number, (title, run, values) in enumerate(panels):
        place = axes[number // columns, number % columns]
        joints = values.shape[1]
        image = draw_map(place, run, values, limit)
        place.set_yticks(np.unique(np.linspace(1, joints, min(joints, 4)).round().astype(int)))
        style.style_axes(
            place,
            "time (s)" if number + columns >= len(panels) else "",
            "joint, 1 at the head" if number % columns == 0 else "",
            f"{title}, largest {float(np.abs(values).max()):.2g} {unit}",
            grid=False,
        )
    add_bar(figure, axes, image, label, aspect=30, pad=0.015)
    return figure


def _axes_seen(shown: Iterable[Array], limit: float) -> list[str]:
    """Return the axes about which values (T, N - 1, 3) are seen in some run, yaw at least."""
    most = np.max([np.abs(values).max(axis=(0, 1)) for values in shown], axis=0)
    seen = [axis for axis in AXES_SHOWN if most[AXIS_NAMES.index(axis)] > _LITTLE * limit]
    return seen or ["yaw"]


def draw_map(axes: Axes, run: TrajectoryBase, values: Array, limit: float) -> AxesImage:
    """Draw values (K, N - 1) of a run's last steps and its joints as colours, -limit to limit."""
    end = float(run.time[-1])
    begin = end - len(values) * run.scene.integrator.time_step
    return axes.imshow(
        values.T,
        aspect="auto",
        origin="upper",
        interpolation="nearest",
        cmap=style.diverging_map(),
        vmin=-limit,
        vmax=limit,
        extent=(begin, end, values.shape[1] + 0.5, 0.5),
    )


def tail(values: Array, run: TrajectoryBase, seconds: float | None) -> Array:
    """Return the rows of the last seconds of values (T, ...) of a run's steps, at least one."""
    shown = style.shown_seconds(run, seconds)
    return values[-max(1, round(shown / run.scene.integrator.time_step)) :]


def draw_wave_search(record: dict[str, Any]) -> Figure:
    """Draw how far travelling waves of torque swim, over frequency and wave number.

    The record is that of `swim_agents.tuning.record_of`. The picture shows the grid of the
    search at full amplitude, and the wave that was chosen.
    """
    grid = record["search"]["grid"]
    values = np.array(grid["net_displacement"])
    figure = style.new_figure(0.8 * style.WIDTH, 4.2)
    axes = figure.add_subplot()
    largest = float(np.abs(values).max()) or 1.0
    periods = record["search"].get("periods_in_episode")
    lasted = "one episode" if periods is None else f"{periods:g} periods of the first bending mode"
    image = axes.pcolormesh(
        np.array(grid["wave_number"]) / np.pi,
        grid["frequency_hz"],
        values,
        cmap=style.diverging_map(),
        vmin=-largest,
        vmax=largest,
        shading="nearest",
    )
    add_bar(figure, axes, image, "net displacement along the heading (body lengths)")
    wave = record["wave"]
    if wave is not None:
        axes.plot(
            wave["wave_number"] / np.pi,
            wave["frequency"] / (2.0 * np.pi),
            "*",
            color=style.BLACK,
            markersize=11,
            markerfacecolor="white",
            label=f"tuned wave, {record['net_displacement']:.2f} body lengths",
        )
        axes.legend(fontsize=style.SMALL, loc="lower left")
    style.style_axes(
        axes,
        "wave number \u03ba (\u03c0 rad per body length)",
        "frequency (Hz)",
        f"{record['scene']}: waves of full torque over {lasted}",
        grid=False,
    )
    return figure


def add_bar(
    figure: Figure | SubFigure, axes: Any, image: ScalarMappable, label: str, **options: Any
) -> None:
    """Add a labelled bar of an image's colours beside axes."""
    bar = figure.colorbar(image, ax=axes, **options)
    style.mark_ends(bar)
    bar.set_label(label, fontsize=style.SMALL)
    bar.ax.tick_params(labelsize=style.SMALL)
