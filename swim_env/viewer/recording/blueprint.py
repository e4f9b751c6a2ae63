"""How rerun lays a recording out: the water on the left, plots over time on the right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swim_env.viewer.recording.legend import LEGEND, LEGEND_HEIGHT, LEGEND_WIDTH
from swim_env.viewer.recording.palette import WATER_COLOUR
from swim_env.viewer.recording.scenery import Lane
from swim_env.viewer.recording.schema import REWARDS, TIMELINE, WORLD, group_path

__all__ = ["blueprint_of"]

#: What a view that follows a body shows around its mean centre (BL).
_HALF_WIDTH, _HALF_HEIGHT = 1.0, 0.5
#: Share of a plot's width, behind the end of the run, that is left to the legend.
_ROOM = 0.5
#: Joints up to which a plot of all of them has a legend.
_NAMED_JOINTS = 10
#: Marks that go with a swimmer in the view of the whole course.
_ON_COURSE = ("body", "outline", "path", "centre", "heading", "target", "grid")


def blueprint_of(lanes: Sequence[Lane]) -> Any:
    """Return the blueprint of a recording."""
    import rerun.blueprint as rrb

    wide = lanes[0].pressure is not None
    water = [_following(lane) for lane in lanes]
    legend = rrb.Spatial2DView(
        origin=LEGEND,
        name="Colours and arrows",
        background=[*WATER_COLOUR],
        visual_bounds=rrb.VisualBounds2D(x_range=[0.0, LEGEND_WIDTH], y_range=[0.0, LEGEND_HEIGHT]),
    )
    left = rrb.Vertical(
        *water,
        _course(lanes),
        legend,
        row_shares=[*([3.0] * len(water)), 2.0, 0.8],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, _plots(lanes), column_shares=[1.45 if wide else 1.2, 1.0]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _growing() -> Any:
    """Return the range of time of a path: from its beginning to the present."""
    import rerun.blueprint as rrb

    return rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _following(lane: Lane) -> Any:
    """Return the view that follows one body."""
    import rerun.blueprint as rrb

    length = lane.swimmer.scene.beam.length
    return rrb.Spatial2DView(
        origin=f"{lane.place}/camera",
        contents=[f"{lane.place}/**"],
        name=f"{lane.swimmer.name} on {lane.swimmer.scene.name} (grid {0.5 * length:g} m)",
        background=[*WATER_COLOUR],
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-_HALF_WIDTH * length, _HALF_WIDTH * length],
            y_range=[-_HALF_HEIGHT * length, _HALF_HEIGHT * length],
        ),
        overrides={f"{lane.place}/path": _growing()},
    )


def _course(lanes: Sequence[Lane]) -> Any:
    """Return the view in which nothing but the bodies moves."""
    import rerun.blueprint as rrb

    length = lanes[0].swimmer.scene.beam.length
    low = np.min([lane.low for lane in lanes], axis=0) - 0.15 * length
    high = np.max([lane.high for lane in lanes], axis=0) + 0.15 * length
    name = f"Whole course (grid {0.5 * length:g} m)"
    if len(lanes) > 1:
        name += ", each swimmer in its own lane"
    return rrb.Spatial2DView(
        origin="/",
        contents=[f"{lane.place}/{mark}" for lane in lanes for mark in _ON_COURSE],
        name=name,
        background=[*WATER_COLOUR],
        # The plane's y points upwards, the view's downwards.
        visual_bounds=rrb.VisualBounds2D(x_range=[low[0], high[0]], y_range=[-high[1], -low[1]]),
        overrides={f"{lane.place}/path": _growing() for lane in lanes},
    )


def _plots(lanes: Sequence[Lane]) -> Any:
    """Return the plots: progress, energy, torques at once, and the others behind tabs."""
    import rerun.blueprint as rrb

    def everyone(group: str) -> list[str]:
        return [group_path(lane.label, group) for lane in lanes]

    paid = [lane for lane in lanes if lane.swimmer.rewards is not None]
    first = [_plot(lanes, "Progress (BL)", everyone("progress"))]
    if paid:
        first += [
            _plot(lanes, name, [group_path(lane.label, group) for lane in paid])
            for group, name in zip(REWARDS, ("Rewards (BL)", "Sum of rewards (BL)"), strict=True)
        ]
    first.append(_plot(lanes, "Position (BL)", everyone("position")))
    rows = [_tabs(first)]
    for names in (
        (("energy", "Energy (J)"), ("work", "Work (J)")),
        (
            ("torques", "Joint torques (N m)"),
            ("joint_angles", "Joint angles (rad)"),
            ("momentum", "Momentum (kg m/s, kg m\u00b2/s)"),
            ("drift", "Momentum drift (kg m/s, kg m\u00b2/s)"),
            ("solver", "Newton solver"),
        ),
    ):
        views = []
        for group, name in names:
            for lane in lanes:
                title = name if len(lanes) == 1 else f"{lane.label}: {name}"
                views.append(_plot(lanes, title, [group_path(lane.label, group)]))
        rows.append(_tabs(views))
    return rrb.Vertical(*rows, row_shares=[1.0, 1.0, 1.35])


def _tabs(views: list[Any]) -> Any:
    import rerun.blueprint as rrb

    return rrb.Tabs(*views, active_tab=0)


def _plot(lanes: Sequence[Lane], name: str, paths: list[str]) -> Any:
    """Return one plot, with room for its legend behind the end of the run."""
    import rerun.blueprint as rrb

    begin = min(float(lane.swimmer.trajectory.time[0]) for lane in lanes)
    end = max(float(lane.swimmer.trajectory.time[-1]) for lane in lanes)
    joints = max(lane.swimmer.scene.beam.elements for lane in lanes) - 1
    of_joints = "Joint" in name
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"/{path}" for path in paths],
        name=name,
        axis_x=rrb.TimeAxis(
            view_range=rrb.TimeRange(
                start=rrb.TimeRangeBoundary.absolute(seconds=begin),
                end=rrb.TimeRangeBoundary.absolute(seconds=end + _ROOM * (end - begin)),
            )
        ),
        plot_legend=rrb.PlotLegend(
            rrb.Corner2D.RightTop, visible=not of_joints or joints <= _NAMED_JOINTS
        ),
    )
