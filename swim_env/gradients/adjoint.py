"""Gradients of a run by the discrete adjoint of its steps, and their tangent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError
from swim_env.gradients.objectives import objective_of
from swim_env.gradients.parameters import (
    START,
    WAVE,
    change_of_constants,
    change_of_wave,
    check_names,
    shape_of,
)
from swim_env.gradients.tape import TOLERANCE, Record, Tape
from swim_env.scene import load_scene
from swim_env.sim.replay import steps_of
from swim_env.sim.simulator import torque_times

Array = NDArray[np.float64]

#: Steps between checkpoints.
CHECKPOINT = 5000
#: Differences by which the momentum of a moving start is differentiated by its pose (rad).
_POSE_DIFFERENCE = 1e-3


def value_and_gradient(
    scene: Any,
    torques: ArrayLike | None = None,
    objective: Any = "displacement",
    with_respect_to: str | Iterable[str] = ("torques",),
    *,
    steps: int | None = None,
    start: tuple[ArrayLike, ArrayLike] | None = None,
    checkpoint: int = CHECKPOINT,
    tolerance: float = TOLERANCE,
) -> tuple[float, dict[str, Array]]:
    """Return an objective of a run, and its gradient by the discrete adjoint.

    The derivatives are those of the step equations, right to eight digits and more over thousands
    of steps. With the fluid models `panels` and `expansion`, derivatives of the added mass and of
    its exact first derivative along one direction are central differences.

    Parameters
    ----------
    scene : Scene, str or path
        What moves. Not with `cross_flow_drag` or the fluid model `centreline`; in space with the
        models `none`, `strip`, `frozen` and `given`.
    torques : (T, N - 1) array_like, optional
        Joint torques of every step (N m), in space (T, N - 1, 3); the scene's wave unless given.
    objective : str, Objective or callable
        ``displacement`` along the scene's heading (BL), ``turn`` of the mean element angle (rad),
        ``work`` and ``positive_work`` (J), ``squared_torque``, ``efficiency`` (BL/J),
        `path_error`, or a function that takes the run as a `Stretch` and returns its value and its
        derivatives, see `objectives.objective_of`.
    with_respect_to : names
        ``torques``; ``start.coordinates`` and ``start.velocity``, as in `Simulator.reset_to`;
        fields of the scene such as ``beam.bending_stiffness`` (one number, or one per joint),
        ``beam.line_density``, ``fluid.density``, ``damping.retardation_time``, and, without given
        torques, ``actuation.amplitude``, ``frequency``, ``wave_number`` and ``phase``.
    steps : int, optional
        The number of steps T where torques are not given; the episode's unless given.
    start : pair of arrays, optional
        Coordinates and velocity of the start as in `Simulator.reset_to`; the scene's unless given.
    checkpoint : int
        Steps between checkpoints. A run of more is played twice, and what its derivatives need is
        kept for so many steps only, in the plane 24 (N + 2) bytes each, 32 with the composed
        scheme. An objective that is a function of the run needs all steps at once.
    tolerance : float
        Largest scaled residual of the steps, or the scene's where that is smaller. Derivatives of
        steps that are solved less exactly are less exact, and cost less.

    Returns
    -------
    value : float
        The objective.
    gradient : dict of arrays
        The derivatives by name, shaped like what they belong to.

    Raises
    ------
    OptionError
        If something has no gradient here, or a step was cut, with its time.
    SimulationEndedError
        If the run ends early.
    """
    scene = load_scene(scene)
    names = check_names(scene, with_respect_to, torques is None)
    found = objective_of(objective)
    tape = Tape.of(scene, start, tolerance)
    held = held_torques(tape, torques, steps)
    length = len(held) if found.whole else max(1, int(checkpoint))
    cuts = list(range(0, len(held), length)) or [0]
    snapshots, sums = [], np.zeros(len(found.measures))
    record: Record | None = None
    for first in cuts:
        snapshots.append(tape.simulator.snapshot())
        record = tape.play(held[first : first + length], first, len(held))
        for i, measure in enumerate(found.measures):
            sums[i] += measure(record.stretch)[0]
    value, weights = found.combine(sums)
    weights = np.asarray(weights, dtype=np.float64)
    adjoint = np.zeros((2, tape._bodies.unknowns))
    by_parameters, by_torques = np.zeros(tape.parameters), np.zeros_like(held)
    for first, snapshot in zip(reversed(cuts), reversed(snapshots), strict=True):
        if first != cuts[-1] or record is None:
            tape.simulator.restore(snapshot)
            record = tape.play(held[first : first + length], first, len(held))
        by_q, by_p = np.zeros_like(record.stretch.momenta), np.zeros_like(record.stretch.momenta)
        own = np.zeros_like(record.stretch.torques)
        for weight, measure in zip(weights, found.measures, strict=True):
            slopes = measure(record.stretch)[1]
            q, p = tape.rates(record.stretch, slopes)
            by_q += weight * q
            by_p += weight * p
            if slopes.torques is not None:
                own += weight * slopes.torques
        adjoint[0] += by_q[-1]
        adjoint[1] += by_p[-1]
        own += tape.pull(record, by_q, by_p, adjoint, by_parameters)
        by_torques[first : first + length] = own
    return value, {
        name: _by_name(tape, name, held, adjoint, by_torques, by_parameters) for name in names
    }


def tangent(
    scene: Any,
    torques: ArrayLike | None = None,
    direction: Mapping[str, ArrayLike] | None = None,
    objective: Any = "displacement",
    *,
    steps: int | None = None,
    start: tuple[ArrayLike, ArrayLike] | None = None,
    checkpoint: int = CHECKPOINT,
) -> tuple[float, float]:
    """Return an objective of a run and its derivative along one direction (Jacobian-vector).

    It costs as much as a gradient, and is an independent computation of a product with it.

    Parameters
    ----------
    direction : mapping
        Changes by name, as `value_and_gradient` names what it differentiates by, shaped like the
        values.
    scene, torques, objective, steps, start, checkpoint
        As in `value_and_gradient`.

    Returns
    -------
    value, derivative : float, float
        The objective, and its derivative.
    """
    scene = load_scene(scene)
    given = dict(direction or {})
    check_names(scene, given, torques is None, "direction")
    found = objective_of(objective)
    tape = Tape.of(scene, start)
    held = held_torques(tape, torques, steps)
    moved, turned = np.zeros((2, tape._bodies.unknowns)), np.zeros_like(held)
    changed = np.zeros(tape.parameters)
    for name, value in given.items():
        change = _checked_change(tape, name, value, held)
        if name == "torques":
            turned += change
        elif name in WAVE:
            turned += float(change) * _change_of_wave(tape, name, len(held))
        elif name in START:
            moved += _start_change(tape, name, change)
        else:
            slopes, of_momenta = _field_slopes(tape, name)
            changed += change.ravel() @ slopes
            moved[1] += change.ravel() @ of_momenta
    length = len(held) if found.whole else max(1, int(checkpoint))
    sums, slopes_sums = np.zeros(len(found.measures)), np.zeros(len(found.measures))
    for first in range(0, max(1, len(held)), length):
        record = tape.play(held[first : first + length], first, len(held))
        torque_change = turned[first : first + length]
        states = tape.push(record, moved, changed, torque_change)
        moved = states[-1].copy()
        for i, measure in enumerate(found.measures):
            share, by = measure(record.stretch)
            q, p = tape.rates(record.stretch, by)
            sums[i] += share
            slopes_sums[i] += (q * states[:, 0]).sum() + (p * states[:, 1]).sum()
            if by.torques is not None:
                slopes_sums[i] += (by.torques * torque_change).sum()
    value, weights = found.combine(sums)
    return value, float(np.asarray(weights) @ slopes_sums)


def _checked_change(tape: Tape, name: str, value: ArrayLike, held: Array) -> Array:
    """Return a change of what a name means, or an OptionError that it has another shape."""
    start = dict(zip(START, tape.start, strict=True))
    if name == "torques":
        shape = held.shape
    elif name in start:
        shape = start[name].shape
    else:
        shape = () if name in WAVE else shape_of(tape.scene, name)
    change = np.asarray(value, dtype=np.float64)
    if change.shape != shape or not np.isfinite(change).all():
        raise OptionError(
            f"the change of {name} must be finite numbers of shape {shape}, got an array of "
            f"{change.shape}"
        )
    return change


def held_torques(tape: Tape, torques: ArrayLike | None, steps: int | None) -> Array:
    """Return the torques of every step, given or the scene's."""
    if torques is not None:
        if steps is not None:
            raise OptionError("steps are for the scene's own torques; leave them out")
        held: Array = tape.simulator._checked(torques, many=True)
        return held
    return tape.simulator.prescribed_torques(steps_of(tape.scene) if steps is None else steps)


def _change_of_wave(tape: Tape, name: str, steps: int) -> Array:
    """Return how the prescribed torques of a run change with a field of the wave."""
    return change_of_wave(tape.scene, name, torque_times(tape.scene, 0, steps))


def _by_name(
    tape: Tape,
    name: str,
    held: Array,
    adjoint: Array,
    by_torques: Array,
    by_parameters: Array,
) -> Array:
    """Return the derivative by one of the names of `value_and_gradient`."""
    if name == "torques":
        return by_torques.copy()
    if name in WAVE:
        return np.array((by_torques * _change_of_wave(tape, name, len(held))).sum())
    if name == "start.coordinates":
        return tape.by_coordinates(adjoint[0] + _by_pose(tape, adjoint[1]), tape.start[0])
    if name == "start.velocity":
        return tape.mass_times(adjoint[1])
    slopes, of_momenta = _field_slopes(tape, name)
    found = slopes @ by_parameters + of_momenta @ adjoint[1]
    return np.asarray(found).reshape(shape_of(tape.scene, name))


def _field_slopes(tape: Tape, name: str) -> tuple[Array, Array]:
    """Return how parameters and the start's momenta change with a field, (F, P) and (F, M)."""
    coordinates, velocity = tape.start
    scenes, steps, slopes = change_of_constants(tape.scene, name)
    of_momenta = np.zeros((len(slopes), velocity.size))
    if tape.moving:
        before = tape.momenta_of(coordinates, velocity)
        for i, (one, step) in enumerate(zip(scenes, steps, strict=True)):
            of_momenta[i] = (tape.momenta_of(coordinates, velocity, one) - before) / step
    return slopes, of_momenta


def _start_change(tape: Tape, name: str, change: Array) -> Array:
    """Return the change (2, M) of coordinates and momenta of the start."""
    moved = np.zeros((2, tape._bodies.unknowns))
    if name == "start.velocity":
        moved[1] = tape.mass_times(change)
        return moved
    moved[0] = tape.turns_of(change, tape.start[0])
    if tape.moving:
        for i, one in enumerate(np.eye(moved.shape[1])):
            moved[1] += _slope_of_momenta(tape, one) * moved[0, i]
    return moved


def _by_pose(tape: Tape, by_momenta: Array) -> Array:
    """Return what the start's momenta add to a derivative by its pose, velocity held."""
    found = np.zeros_like(by_momenta)
    if tape.moving:
        for i, one in enumerate(np.eye(found.size)):
            found[i] = _slope_of_momenta(tape, one) @ by_momenta
    return found


def _slope_of_momenta(tape: Tape, direction: Array) -> Array:
    """Differentiate the momenta of the start by its pose, velocity held, along a direction."""
    velocity = tape.start[1]
    found = np.zeros_like(velocity)
    for factor, weight in ((1.0, 8.0), (2.0, -1.0)):
        size = factor * _POSE_DIFFERENCE
        ahead, behind = (
            tape.momenta_of(tape.moved(sign * size * direction), velocity) for sign in (1.0, -1.0)
        )
        found += weight * (ahead - behind) / (12.0 * _POSE_DIFFERENCE)
    return found
