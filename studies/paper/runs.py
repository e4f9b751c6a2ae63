"""The twelve scenes of Table 1, their finer runs for error bars, and the figures of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.paper.constants import (
    energy_figures,
    has_forces,
    internal_figures,
    joint_moments,
    momentum_figures,
    resolved,
)
from studies.paper.units import Arrays, Figures, Unit
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

Array = NDArray[np.float64]

#: The paper's numbers of its simulations.
NUMERALS = ("i", "ii", "iii", "iv", "v", "vi", "vii", "viii", "ix", "x", "xi", "xii")
#: The paper's settings, half the step, and three times the panels with ends to match.
_LEVELS = ("", "half", "fine")
#: An end that is farther from its first y than this share of the length has left its line.
LEFT_LINE = 0.01
#: Seconds of simulated time that a step of 9 elements and 4 panels takes, for guesses of cost.
_STEP = 1e-4
#: Instants a second of the series that are kept.
_SERIES = 10


def scene_units(duration: float, finest: bool = True) -> list[Unit]:
    """Return the twelve runs, their finer ones, and the others that statements need.

    Each lasts ``duration`` (s), the paper's 100 or less; ``finest`` tells whether scene xii is
    computed with fine panels too, the longest run of all.
    """
    units = []
    for numeral in NUMERALS:
        scene = load_scene(f"paper_{numeral}").replace("episode.duration", duration)
        levels = _LEVELS if finest or numeral != "xii" else ("", "half")
        units += _units(f"run_{numeral}", scene.replace("internal_forces", {}), levels, True)
    first = load_scene("paper_i").replace("episode.duration", duration)
    units += _units("run_i_alone", first.replace("fluid", None), ("",))
    units += _units("run_i_mirrored", first.replace("actuation.phase", math.pi), ("",))
    # Stiff in its rear half instead: is it the head that must bend?
    pieces = [{"until": 0.5, "value": 5.0}, {"until": 1.0, "value": 50.0}]
    units += _units("run_vi_reversed", first.replace("beam.bending_stiffness", {"pieces": pieces}))
    return units


def _units(
    name: str, scene: Scene, levels: Sequence[str] = _LEVELS, pictured: bool = False
) -> list[Unit]:
    """Return a run and its finer ones, of which only the first is pictured."""
    panels = 3 * scene.fluid.panels_per_element if scene.fluid else 4
    changes: dict[str, dict[str, Any]] = {
        "": {},
        "half": {"integrator.time_step": 0.005},
        "fine": {"fluid.cap_panels": "proportional", "fluid.panels_per_element": panels},
    }
    units = []
    for level in levels:
        finer = scene.replace(changes[level])
        options = {"pictured": pictured and not level}
        units.append(Unit(f"{name}_{level}".rstrip("_"), play_run, finer, options, guess(finer)))
    return units


def guess(scene: Scene) -> float:
    """Return a guess of how long a run takes (s)."""
    steps = scene.episode.duration / scene.integrator.time_step
    fluid = scene.fluid
    if fluid is None or fluid.model != "panels":
        return 2e-5 * steps
    panels = scene.beam.elements * fluid.panels_per_element
    return float(_STEP * steps * max(panels / 36.0, (panels / 60.0) ** 2.5))


def play_run(unit: Unit) -> tuple[Figures, Arrays]:
    """Simulate a scene under its prescribed torque for its episode's duration.

    The figures are those of `run_figures`, and ``internal`` of `studies.paper.constants`; there are
    arrays if the option ``pictured`` asks for them.
    """
    trajectory = played(Simulator(unit.scene))
    figures = run_figures(trajectory)
    if has_forces(trajectory):
        figures["internal"] = internal_figures(trajectory)
    return figures, _arrays(trajectory) if unit.options.get("pictured") else {}


def played(simulator: Simulator) -> Trajectory:
    """Simulate a simulator's scene for its episode's duration."""
    scene = simulator.scene
    steps = round(scene.episode.duration / scene.integrator.time_step)
    return simulator.rollout(simulator.prescribed_torques(steps))


def run_figures(trajectory: Trajectory) -> dict[str, Any]:
    """Return the figures of a run.

    Paths and headings are means over each second, the period of the paper's drive, so that the
    body's swing to and fro does not count as swimming or turning. ``duration`` (s), ``steps``,
    ``end`` (why it ended early, or empty), ``length`` (m); ``path`` the mean centre in every second
    [[x, y]] (m), ``heading`` the mean element angle there (rad); ``displacement`` (m) between first
    and last second, ``speed`` (m/s), ``way`` the length of the path (m), ``turn`` (rad) of the
    heading, ``curvature`` turn over way (rad/m); ``left`` the first time that an end is 1 % of the
    length off its first y (s), or None; ``angle`` the mean element angle at whole seconds (rad);
    ``bends`` the largest angle of every joint (rad), ``halved`` the steps that had to be cut;
    ``momentum`` and ``energy`` of `studies.paper.constants`.
    """
    scene = trajectory.scene
    per_second = max(1, round(1.0 / scene.integrator.time_step))
    seconds = trajectory.steps // per_second
    heading = trajectory.angles.mean(axis=1)
    path = _means(trajectory.path, per_second, seconds)
    turned = _means(heading[:, None], per_second, seconds)[:, 0]
    displacement = path[-1] - path[0]
    way = float(np.hypot(*np.diff(path, axis=0).T).sum())
    turn = float(turned[-1] - turned[0])
    ends = trajectory.nodes[:, [0, -1], 1]
    off = np.abs(ends - ends[0]).max(axis=1)
    return {
        "duration": trajectory.duration,
        "steps": trajectory.steps,
        "end": trajectory.termination_reason,
        "length": scene.beam.length,
        "path": path.tolist(),
        "heading": turned.tolist(),
        "displacement": displacement.tolist(),
        "speed": float(np.hypot(*displacement)) / max(1, len(path) - 1),
        "way": way,
        "turn": turn,
        "curvature": turn / way if way > 0.0 else 0.0,
        "left": first_crossing(trajectory.time, off, LEFT_LINE * scene.beam.length),
        "angle": heading[::per_second].tolist(),
        "bends": np.abs(np.diff(trajectory.angles, axis=1)).max(axis=0).tolist(),
        "halved": int(np.count_nonzero(trajectory.parts > 1)),
        "momentum": momentum_figures(trajectory),
        "energy": energy_figures(trajectory),
    }


def first_crossing(time: Array, values: Array, limit: float) -> float | None:
    """Return when (s) values (T,) first exceed a limit, interpolated; None where they never do."""
    beyond = values > limit
    if not beyond.any():
        return None
    n = int(np.argmax(beyond))
    if n == 0:
        return float(time[0])
    share = (limit - values[n - 1]) / (values[n] - values[n - 1])
    return float(time[n - 1] + share * (time[n] - time[n - 1]))


def _means(values: Array, block: int, count: int) -> Array:
    """Return means over blocks of rows by the trapezoidal rule, or of all where there is none."""
    if count < 1:
        return np.asarray(values.mean(axis=0, keepdims=True))
    middles = 0.5 * (values[:-1] + values[1:])[: block * count]
    return np.asarray(middles.reshape(count, block, -1).mean(axis=1))


def _arrays(trajectory: Trajectory) -> Arrays:
    """Return what pictures of a run are made of: its shapes at whole seconds, and series.

    ``torque`` is of the last second, ``total`` the sum of moments below `RESOLVED` in the one
    before.
    """
    step = trajectory.scene.integrator.time_step
    whole = slice(None, None, max(1, round(1.0 / step)))
    often = slice(None, None, max(1, round(1.0 / (_SERIES * step))))
    momentum = np.linalg.norm(trajectory.momentum - trajectory.momentum[0], axis=1)
    found: Arrays = {
        "time": trajectory.time[whole],
        "nodes": trajectory.nodes[whole],
        "centres": trajectory.centres[whole],
        "angles": trajectory.angles[whole],
        "series_time": trajectory.time[often],
        "energy": trajectory.energy[often],
        "unexplained": trajectory.unexplained_energy[often],
        "drift": momentum[often],
    }
    if has_forces(trajectory):
        second = round(1.0 / step)
        moments = joint_moments(trajectory)
        found["torque"] = moments["torque"][-second:]
        # Not the last second, where the filter has nothing behind to go by.
        found["total"] = resolved(moments["total"], step)[-2 * second : -second]
    return found
