"""Net speed over frequency and wave number, and over stiffness and length, each point checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from studies.paper.units import Arrays, Figures, Unit
from swim_env.analysis.modes import natural_frequencies
from swim_env.errors import SimulationEndedError
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

#: Frequencies (Hz) and wave numbers (rad per body length) of the first map.
FREQUENCIES = tuple(float(f) for f in np.arange(0.5, 20.01, 0.5))
WAVE_NUMBERS = tuple(float(k) * math.pi / 4.0 for k in range(-4, 17))
#: Stiffness (N m^2) and length (m) of the second one; the paper's scenes iii and v lie on it.
STIFFNESS = tuple(float(s) for s in 5.0 * 2.0 ** np.arange(-2.0, 4.01, 0.5))
LENGTHS = tuple(float(x) for x in np.arange(0.5, 3.01, 0.125))
#: The drive of the second map: the paper's wave with the torque of scenes iii and v (N m).
_AMPLITUDE = 0.5
#: Panels of an element of the constant added mass, and of the runs that check it.
_PANELS, _CHECK_PANELS = 24, 8
#: A point in every so many rows and columns is also computed with panels at every step.
_EVERY = 4
#: A point is verified where two ways to compute it agree to this share, or to this speed (body
#: lengths a second), 0.002 body lengths in 20 s.
AGREEMENT, SMALLEST = 0.1, 1e-4
#: Beyond this joint angle (rad) the constant added mass is off by more than a per cent
#: (docs/reports/accuracy.md): such a point counts only where it was checked with panels.
LARGEST_BEND = 0.4


def map_units(quick: bool = False) -> list[Unit]:
    """Return the rows of both maps as units; the quick ones have few points and two seconds each.

    Both are of scene ``swimmer`` with the straight body's added mass and the second-order scheme.
    """
    units = []
    columns = list(WAVE_NUMBERS[4::8] if quick else WAVE_NUMBERS)
    for i, frequency in enumerate(FREQUENCIES[1::16] if quick else FREQUENCIES):
        changes = {"actuation.frequency": 2.0 * math.pi * frequency}
        changes |= {"integrator.time_step": 0.005, "episode.duration": 2.0 if quick else 20.0}
        row = {"map": "drive", "row": i, "frequency": frequency}
        units.append(_row(changes, row, columns, "actuation.wave_number"))
    columns = list(LENGTHS[4::8] if quick else LENGTHS)
    for i, stiffness in enumerate(STIFFNESS[2::8] if quick else STIFFNESS):
        changes = {"actuation.amplitude": _AMPLITUDE, "beam.bending_stiffness": stiffness}
        changes |= {"integrator.time_step": 0.01, "episode.duration": 2.0 if quick else 40.0}
        row = {"map": "body", "row": i, "stiffness": stiffness}
        units.append(_row(changes, row, columns, "beam.length"))
    return units


def _row(changes: dict[str, float], row: dict[str, Any], columns: list[float], varied: str) -> Unit:
    constant = {
        "fluid.model": "frozen",
        "fluid.panels_per_element": _PANELS,
        "fluid.cap_panels": "proportional",
        "integrator.scheme": "composed",
    }
    checked = [] if row["row"] % _EVERY else list(range(0, len(columns), _EVERY))
    options = {**row, "columns": columns, "field": varied, "checked": checked}
    scene = load_scene("swimmer", {**changes, **constant})
    name = f"map_{row['map']}_{row['row']:02d}"
    return Unit(name, measure_row, scene, options, 40.0 if checked else 10.0)


def measure_row(unit: Unit) -> tuple[Figures, Arrays]:
    """Simulate a row of a map.

    The figures are the unit's options and ``points``, one for each column: ``speed`` (body lengths
    a second, positive head first) with steps half as long, ``coarse`` with the steps of the map,
    and ``panels`` with panels at every step, None where that was not done; None where a run ended
    early. ``bend`` is the largest joint angle (rad), ``trusted`` says whether the energy of the
    finer run adds up, ``turn`` is the heading's (rad). ``resonances`` are the first natural
    frequencies (Hz) at each column, or one set for all.
    """
    name, columns = str(unit.options["field"]), unit.options["columns"]
    points = []
    for j, value in enumerate(columns):
        scene = unit.scene.replace(name, value)
        fine = _played(scene, 0.5)
        checked = j in unit.options["checked"]
        changes = {"fluid.model": "panels", "fluid.panels_per_element": _CHECK_PANELS}
        points.append(
            {
                "speed": _speed(fine),
                "coarse": _speed(_played(scene, 1.0)),
                "panels": _speed(_played(scene.replace(changes), 1.0)) if checked else None,
                "checked": checked,
                "bend": None if fine is None else float(np.abs(np.diff(fine.angles, axis=1)).max()),
                "turn": None if fine is None else fine.heading_change,
                "trusted": fine is not None and not fine.warnings(),
            }
        )
    modes = columns if name.startswith("beam.") else columns[:1]
    resonances = [natural_frequencies(unit.scene.replace(name, value), 3) for value in modes]
    return {**unit.options, "points": points, "resonances": resonances}, {}


def _played(scene: Scene, share: float) -> Trajectory | None:
    """Simulate a scene with steps of a share of its own; None where it ends early."""
    step = share * scene.integrator.time_step
    try:
        simulator = Simulator(scene.replace("integrator.time_step", step))
    except SimulationEndedError:
        return None
    steps = round(scene.episode.duration / step)
    trajectory = simulator.rollout(simulator.prescribed_torques(steps))
    return None if trajectory.termination_reason else trajectory


def _speed(trajectory: Trajectory | None) -> float | None:
    """Return the net speed head first, -x (body lengths a second), to the last period's mean."""
    if trajectory is None:
        return None
    actuation, beam = trajectory.scene.actuation, trajectory.scene.beam
    assert actuation is not None
    period = 2.0 * math.pi / actuation.frequency
    last = max(1, round(period / trajectory.scene.integrator.time_step))
    net = float(trajectory.path[-last:, 0].mean()) - float(trajectory.path[0, 0])
    return -net / beam.length / (trajectory.duration - 0.5 * period)


def is_verified(point: Mapping[str, Any]) -> bool:
    """Tell whether a point's speed holds.

    The run with half the step came to its end, its energy adds up, and the speed is that of the
    coarser steps, and of panels where those were used, within `AGREEMENT` or `SMALLEST`. A point
    whose joints bend further than `LARGEST_BEND` counts only with panels.
    """
    speed = point["speed"]
    if speed is None or not point["trusted"]:
        return False
    others = [point["coarse"]]
    if point["checked"]:
        others.append(point["panels"])
    elif point["bend"] > LARGEST_BEND:
        return False
    return all(
        other is not None and abs(other - speed) <= max(AGREEMENT * abs(speed), SMALLEST)
        for other in others
    )
