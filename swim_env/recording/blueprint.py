"""How rerun lays a recording out: the water on the left, plots over time on the right."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from swim_env.colours import WATER
from swim_env.recording.layout import Layout
from swim_env.recording.legend import LEGEND_HEIGHT, LEGEND_WIDTH
from swim_env.recording.schema import (
    APPLICATION,
    LEGEND,
    REWARDS,
    SPATIAL_DETAILS,
    TIMELINE,
    group_path,
    groups_of,
    map_path,
)
from swim_env.recording.spatial_blueprint import spatial_views
from swim_env.recording.torque_map import HEIGHT, groups_of_maps

__all__ = ["blueprint_of"]

#: What a view that follows a body shows around its mean centre (BL), and of two swimmers.
_VIEW, _VIEW_OF_TWO = (1.0, 0.5), (1.2, 0.4)
#: Room around the whole course (BL).
_MARGIN = 0.35
#: Room behind the end of the run that is left to the legend, as a share of the run.
_ROOM = 0.45
#: What plots of oscillations show before the present, and the room behind it (s).
_BEFORE, _BEHIND = 3.0, 1.6
_OSCILLATING = (
    *("energy", "torques", "joint_angles", "momentum", "solver", "orientation"),
    *("angular_momentum", *SPATIAL_DETAILS),
)
#: Joints up to which a plot of all of them has a legend.
_NAMED_JOINTS = 10
#: Marks that go with a swimmer in the view of the whole course.
_ON_COURSE = ("body", "outline", "path", "centre", "heading", "target", "grid")


class _KeptBlueprint(rrb.Blueprint):  # type: ignore[misc]  # rerun's types are not read
    """A blueprint whose chunks are made once, for all the recordings that hold it.

    Rerun makes new ones for each, which takes 3 to 7 ms of a file's 17 to 30. It asks for them by
    the method that is replaced here; a rerun that asked by another would only be slower. Every file
    gets a blueprint store of its own, with the same views.
    """

    def __init__(self, *parts: Any, **options: Any) -> None:
        super().__init__(*parts, **options)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "layout.rbl"
            rrb.Blueprint(*parts, **options).save(APPLICATION, file)
            reader = RrdReader(file)
            self._chunks = list(reader.stream(store=reader.blueprints()[0]))

    def _log_to_stream(self, stream: Any) -> None:
        stream.send_chunks(self._chunks)


def blueprint_of(lanes: Sequence[Layout]) -> Any:
    """Return the blueprint of recordings whose swimmers are shown like these."""
    if lanes[0].scene.dimension == 3:
        wide = True
        views, shares = spatial_views(lanes, _paths(lanes))
    else:
        wide = lanes[0].pressure is not None
        views, shares = _planar_views(lanes)
    legend = _plane(LEGEND, "Colours and arrows", [0.0, LEGEND_WIDTH], [0.0, LEGEND_HEIGHT])
    left = rrb.Vertical(*views, legend, row_shares=[*shares, 0.75])
    return _KeptBlueprint(
        rrb.Horizontal(left, _plots(lanes), column_shares=[1.45 if wide else 1.2, 1.0]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _planar_views(lanes: Sequence[Layout]) -> tuple[list[Any], list[float]]:
    """Return the views of the plane, and their shares of the height."""
    views, shares = [_following(lane) for lane in lanes], [3.0] * len(lanes)
    course, course_share = _course(lanes), 1.8
    if len(lanes) < 3:
        views, shares = [*views, course], [*shares, course_share]
    else:
        # More than two are in two columns, where the course fills a place that is left.
        rows = 3.0 * ((len(lanes) + 1) // 2)
        if len(lanes) % 2:
            views, shares = [rrb.Grid(*views, course, grid_columns=2)], [rows]
        else:
            views, shares = [rrb.Grid(*views, grid_columns=2), course], [rows, course_share]
    return views, shares


def _following(lane: Layout) -> Any:
    """Return the view that follows one body."""
    length = lane.scene.beam.length
    width, height = (length * share for share in (_VIEW_OF_TWO if lane.count == 2 else _VIEW))
    return _plane(
        f"{lane.place}/camera/screen",
        f"{lane.name} on {lane.scene.name} (grid {0.5 * length:g} m)",
        [-width, width],
        [-height, height],
        contents=[f"{lane.place}/**"],
        overrides=_paths([lane]),
    )


def _course(lanes: Sequence[Layout]) -> Any:
    """Return the view in which nothing but the bodies moves."""
    length = lanes[0].scene.beam.length
    (left, low), (right, high) = lanes[0].low, lanes[0].high
    room = _MARGIN * length
    apart = ", each swimmer in its own lane" if len(lanes) > 1 else ""
    return _plane(
        "/",
        f"Whole course (grid {0.5 * length:g} m){apart}",
        [left - room, right + room],
        # The plane's y points upwards, the view's downwards.
        [-high - room, -low + room],
        contents=[f"{lane.place}/{mark}" for lane in lanes for mark in _ON_COURSE],
        overrides=_paths(lanes),
    )


def _plane(origin: str, name: str, x: list[float], y: list[float], **options: Any) -> Any:
    """Return a view of a plane that shows at least some ranges of x and y."""
    bounds = rrb.VisualBounds2D(x_range=x, y_range=y)
    return rrb.Spatial2DView(
        origin=origin, name=name, background=[*WATER], visual_bounds=bounds, **options
    )


def _paths(lanes: Sequence[Layout]) -> dict[str, Any]:
    """Return what views show of paths: from the beginning to the present."""
    grown = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    marks = ("path",) if lanes[0].scene.dimension == 2 else ("path", "head_path")
    return {f"{lane.place}/{mark}": grown for lane in lanes for mark in marks}


def _plots(lanes: Sequence[Layout]) -> Any:
    """Return the plots: progress, energy, torques at once, and the others behind tabs."""
    paid = [lane for lane in lanes if lane.rewarded]
    first = [_plot(lanes, "Progress (BL)", "progress", lanes)]
    for group, name in zip(REWARDS, ("Rewards (BL)", "Sum of rewards (BL)"), strict=True):
        first += [_plot(lanes, name, group, paid)] if paid else []
    first.append(_plot(lanes, "Position (BL)", "position", lanes))
    rows = [first]
    for names in (
        {"energy": "Energy (J)", "work": "Work (J)"},
        _detailed(lanes[0].scene.dimension),
    ):
        views = []
        for group, name in names.items():
            for lane in lanes:
                title = name if len(lanes) == 1 else f"{lane.label}: {name}"
                if group in groups_of_maps(lane):
                    views.append(_map(lane, f"{title}, head above, last {_BEFORE:g} s", group))
                else:
                    views.append(_plot(lanes, title, group, [lane]))
        rows.append(views)
    tabs = [rrb.Tabs(*views, active_tab=0) for views in rows]
    return rrb.Vertical(*tabs, row_shares=[1.0, 1.0, 1.35])


def _detailed(dimension: int) -> dict[str, str]:
    """Return the titles of the plots behind the last tabs, by group."""
    drift = {"drift": "Momentum drift (kg m/s, kg m\u00b2/s)", "solver": "Newton solver"}
    if dimension == 2:
        return {
            "torques": "Joint torques (N m)",
            "joint_angles": "Joint angles (rad)",
            "momentum": "Momentum (kg m/s, kg m\u00b2/s)",
            **drift,
        }
    return {
        **{
            group: f"{group.replace('_', ' ').capitalize()} ({unit})"
            for group, unit in SPATIAL_DETAILS.items()
        },
        "orientation": "Orientation (\u00b0)",
        "momentum": "Momentum (kg m/s)",
        "angular_momentum": "Angular momentum (kg m\u00b2/s)",
        **drift,
    }


def _map(lane: Layout, name: str, group: str) -> Any:
    """Return the map of torques before the present, which is its right edge."""
    place = map_path(lane.label, group)
    return _plane(
        f"{place}/now", name, [-_BEFORE, 0.02 * _BEFORE], [0.0, HEIGHT], contents=[f"{place}/**"]
    )


def _plot(lanes: Sequence[Layout], name: str, group: str, shown: Sequence[Layout]) -> Any:
    """Return one plot, with room for its legend behind the end of the run or the present."""
    begin, end = lanes[0].begin, lanes[0].end
    joints = max(lane.scene.beam.elements for lane in lanes) - 1
    details = groups_of(lanes[0].scene.dimension)[1]
    at = rrb.TimeRangeBoundary
    ranges = None
    view = rrb.TimeRange(
        start=at.absolute(seconds=begin), end=at.absolute(seconds=end + _ROOM * (end - begin))
    )
    if group in _OSCILLATING:
        before, now = at.cursor_relative(seconds=-_BEFORE), at.cursor_relative()
        view = rrb.TimeRange(start=before, end=at.cursor_relative(seconds=_BEHIND))
        ranges = [rrb.VisibleTimeRange(TIMELINE, start=before, end=now)]
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"/{group_path(lane.label, group)}" for lane in shown],
        name=name,
        axis_x=rrb.TimeAxis(view_range=view),
        plot_legend=rrb.PlotLegend(
            rrb.Corner2D.RightTop, visible=group not in details or joints <= _NAMED_JOINTS
        ),
        time_ranges=ranges,
    )
