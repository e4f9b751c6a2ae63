"""One hard run: what is played, and the verdict on what came of it.

A run is right where every step met its residual, the momentum kept within its bound, and the mass
stayed positive, all in finite numbers; an energy budget beyond the scene's tolerance is flagged,
and anything else has to be an end with a reason from the closed list. A displacement is claimed
only where a run at half the step agrees.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from swim_env.physics.solve.integrator import LARGEST_TURN, RECORD_NAMES, energy_drift_of

from swim_env.errors import SimulationEndedError
from swim_env.physics.invariants import momentum_map
from swim_env.physics.status import TERMINATION_REASONS
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, minimal_start, scene_constants

__all__ = ["LONGEST_STEP", "HardRun", "Torques", "Verdict", "play"]

Array = NDArray[np.float64]
#: Torques (T, N - 1) in N m of steps that begin at these times (s).
Torques = Callable[[Scene, Array], Array]

#: Time that an outer step may take (s).
LONGEST_STEP = 1.0
#: Two runs agree where their displacements differ by less than this share, or of a body length.
_AGREEMENT = 0.05
#: Runs of more steps than this are watched in blocks of _BLOCK steps, the others step by step.
_MANY, _BLOCK = 20_000, 1000
#: Momentum that counts as none (kg m/s).
_NOTHING = 1e-300
_COLUMN = {name: i for i, name in enumerate(RECORD_NAMES)}
#: Largest residual that is taken where rounding keeps it from falling.
_LARGEST_ROUND_OFF = 1e-6
#: What rounding may add to the momentum in a step, as a share of its terms.
_ROUND_OFF = 1e-15


def wave(scene: Scene, times: Array) -> Array:
    """Return the scene's prescribed torques, none where it has none."""
    if scene.actuation is None:
        return np.zeros((len(times), scene.beam.elements - 1))
    return scene.actuation.torques(times, scene.beam)


@dataclass(frozen=True)
class HardRun:
    """A run of a hard case.

    Attributes
    ----------
    case : str
        The case that it belongs to.
    label : str
        What it varies.
    scene : Scene
        The scene.
    duration : float
        Simulated time (s), rounded to whole steps.
    torques : callable
        Of scene and times (T,) in s: joint torques (T, N - 1) in N m; the prescribed wave unless
        given.
    must_last : bool
        Whether a solution exists to the end, so that an early end is a failure.
    compared : bool
        Whether it is played at half the step as well, to see if its displacement may be claimed.
    velocity : (N + 2,) array, optional
        Velocity of the mean centre (m/s) and turning rates (rad/s) instead of the scene's.
    flagged : bool
        Whether it is known that its energy is not explained, of a run that must last: others that
        do fail.
    steady : bool
        Whether the mean energy of the last quarter has to be that of the first within 3 %
        (docs/physics.md), for passive bodies without losses.
    """

    case: str
    label: str
    scene: Scene
    duration: float
    torques: Torques = wave
    must_last: bool = False
    compared: bool = False
    velocity: Array | None = None
    flagged: bool = False
    steady: bool = False


@dataclass
class Verdict:
    """What came of a run.

    Attributes
    ----------
    case, label : str
        Those of the run.
    reason : str
        Why it ended early, empty where it did not.
    wanted, steps : int
        Steps asked for and taken.
    residual : float
        Largest scaled residual that was met, of steps that rounding did not stop.
    at_round_off : int
        Steps at which rounding kept the residual above the tolerance.
    rounded : float
        Largest residual of these.
    momentum : float
        Largest drift of the momentum as a share of its bound, 10 tolerances plus 1e-15 n times the
        size of its terms, n the parts solved.
    energy_drift, energy_tolerance : float
        Largest unexplained energy as a share of the largest energy, and what the scene takes.
    energy_ratio : float
        Mean energy of the last quarter over that of the first.
    cut_steps, most_parts : int
        Steps that had to be cut, and into how many parts at most.
    slowest : float
        Time of the slowest outer step (s), that of other programs not counted; of long runs the
        mean of the slowest block.
    seconds : float
        Wall time of all (s).
    displacement : list of float
        Of the mean centre (m).
    agreement : float or None
        How far a run at half the step is away, as a share of its displacement or of a tenth of a
        body length; None where there was none.
    failures : list of str
        What is not right, empty for a run that is.
    """

    case: str
    label: str
    reason: str = ""
    wanted: int = 0
    steps: int = 0
    residual: float = 0.0
    at_round_off: int = 0
    rounded: float = 0.0
    momentum: float = 0.0
    energy_drift: float = 0.0
    energy_tolerance: float = 0.0
    energy_ratio: float = 1.0
    cut_steps: int = 0
    most_parts: int = 1
    slowest: float = 0.0
    seconds: float = 0.0
    displacement: list[float] = field(default_factory=lambda: [0.0, 0.0])
    agreement: float | None = None
    failures: list[str] = field(default_factory=list)

    @property
    def trusted(self) -> bool:
        """Whether the energy budget kept within the scene's tolerance."""
        return self.energy_drift <= self.energy_tolerance

    @property
    def claimed(self) -> bool:
        """Whether the displacement agrees with a run at half the step."""
        return self.agreement is not None and self.agreement <= _AGREEMENT


def play(run: HardRun, repeat: bool = True) -> Verdict:
    """Play a run and judge it.

    Parameters
    ----------
    run : HardRun
        The run.
    repeat : bool
        Whether a step that took too long is given a second chance: another program may have had
        the processor.
    """
    verdict = _play(run)
    if verdict.slowest > LONGEST_STEP and repeat:
        again = _play(run)
        verdict = min(verdict, again, key=lambda one: one.slowest)
    if run.compared and not verdict.reason:
        step = run.scene.integrator.time_step
        half = run.scene.replace("integrator.time_step", 0.5 * step)
        fine = _play(
            HardRun(run.case, run.label, half, run.duration, run.torques, velocity=run.velocity)
        )
        verdict.failures += [f"at half the step: {text}" for text in fine.failures]
        if not fine.reason:
            scale = max(math.hypot(*fine.displacement), 0.1 * run.scene.beam.length)
            verdict.agreement = math.dist(verdict.displacement, fine.displacement) / scale
    if verdict.slowest > LONGEST_STEP:
        verdict.failures.append(f"a step took {verdict.slowest:.1f} s")
    if run.must_last and not run.flagged and not verdict.trusted:
        verdict.failures.append(f"energy off by {verdict.energy_drift:.2g} of the largest")
    if run.steady and not abs(verdict.energy_ratio - 1.0) <= 0.03:
        verdict.failures.append(f"mean energy changes by a factor {verdict.energy_ratio:.3f}")
    if verdict.reason and run.must_last:
        verdict.failures.append(f"ended with {verdict.reason}, and a solution exists")
    return verdict


def _play(run: HardRun) -> Verdict:
    scene = run.scene
    total = max(1, round(run.duration / scene.integrator.time_step))
    verdict = Verdict(run.case, run.label, wanted=total)
    verdict.energy_tolerance = scene.integrator.energy_tolerance
    bodies = Bodies(scene)
    coordinates, velocity = minimal_start(scene, scene.initial)
    begin = time.perf_counter()
    try:
        bodies.start(0, coordinates, velocity if run.velocity is None else run.velocity)
    except SimulationEndedError as error:
        verdict.reason = error.reason
        verdict.seconds = time.perf_counter() - begin
        if error.reason not in TERMINATION_REASONS.values():
            verdict.failures.append(f"unknown reason {error.reason!r}")
        return verdict
    watch = _Watch(bodies, verdict)
    block = 1 if total <= _MANY else _BLOCK
    step = scene.integrator.time_step
    into = 0.5 if scene.integrator.scheme == "composed" else 0.0
    record = bodies.new_record(block)
    while verdict.steps < total and not verdict.reason:
        count = min(block, total - verdict.steps)
        times = step * np.arange(verdict.steps + into, verdict.steps + count, dtype=np.float64)
        torques = np.ascontiguousarray(run.torques(scene, times))
        trace = np.empty((1, count, bodies.trace_columns))
        # This thread's own time, which is the wall's where nobody else has the processor.
        start = time.thread_time()
        bodies.advance(torques[None], 1, record[:, :count], trace=trace)
        spent = time.thread_time() - start
        verdict.slowest = max(verdict.slowest, spent / count)
        taken, status = (int(n) for n in bodies.outcome[0])
        watch.look(trace[0, :taken], record[0, :taken], torques[:taken])
        verdict.steps += taken
        if status:
            verdict.reason = TERMINATION_REASONS.get(status, f"code {status}")
    verdict.seconds = time.perf_counter() - begin
    watch.close()
    return verdict


class _Watch:
    """Follows a run block by block and keeps what its verdict needs."""

    def __init__(self, bodies: Bodies, verdict: Verdict) -> None:
        self._verdict = verdict
        self._unknowns = bodies.unknowns
        self._tolerance = bodies.scene.integrator.tolerance
        self._start = bodies.states[0, : 2 * self._unknowns].copy()
        self._energy, _, _ = bodies.energy_and_velocity(0)
        self._bodies = bodies
        self._momentum = self._maps(self._start[None])[0]
        self._outside = np.zeros(3)
        self._balance = self._energy
        self._unexplained = 0.0
        self._largest = self._energy
        self._terms = 0.0
        self._steps = 0
        self._quarters: tuple[list[float], list[float]] = ([], [])
        self._not_finite = ""
        self._beam = scene_constants(bodies.scene)[0]
        self._last = self._start[: self._unknowns].copy()
        self._solved = 0.0
        self._halves = 2.0 if bodies.scene.integrator.scheme == "composed" else 1.0

    def _maps(self, states: Array) -> Array:
        n = self._unknowns
        return momentum_map(states[:, :n], states[:, n:])

    def _impulses(self, q: Array, before: Array, torques: Array) -> Array:
        """Return the sizes of the moments' impulses in some steps, added up (kg m^2/s)."""
        beam, step = self._beam, self._bodies.scene.integrator.time_step
        elastic = (beam.joint_stiffness * np.abs(q[:, 3:])).sum(axis=1)
        damping = (beam.joint_damping * np.abs(q[:, 3:] - before[:, 3:])).sum(axis=1)
        found: Array = step * (elastic + np.abs(torques).sum(axis=1)) + damping
        return found

    def _look_for_wrong_roots(self, q: Array, before: Array, record: Array) -> None:
        """Refuse turns that no part of a step may have: solutions of the equations, but wrong."""
        joints = np.abs(q[:, 3:] - before[:, 3:])
        elements = np.abs(np.cumsum(q[:, 2:] - before[:, 2:], axis=1))
        turns = np.maximum(joints.max(axis=1), elements.max(axis=1))
        # Every part may turn by that much, in composed steps every half of one.
        most = LARGEST_TURN * self._halves * np.maximum(record[:, _COLUMN["parts"]], 1.0)
        if (turns > most + 1e-9).any():
            row = int(np.argmax(turns - most))
            self._verdict.failures.append(
                f"step {self._steps + row + 1} turned by {turns[row]:.2f} rad in "
                f"{record[row, _COLUMN['parts']]:.0f} parts"
            )

    def _check_budget(self) -> None:
        """Compare the budget that the kernels keep, and what they make of it, with this one."""
        verdict = self._verdict
        kept = energy_drift_of(self._bodies.states[0], self._bodies.scene.beam.elements)
        if not abs(kept - verdict.energy_drift) <= 1e-6 * verdict.energy_drift + 1e-12:
            verdict.failures.append(
                f"the budget was kept at {kept:.3e}, and is {verdict.energy_drift:.3e}"
            )
        ends = self._bodies.scene.integrator.energy_excess == "end" and not verdict.trusted
        if ends != (verdict.reason == "energy_unexplained"):
            verdict.failures.append(f"energy off by {kept:.2g} and the end {verdict.reason!r}")

    def look(self, states: Array, record: Array, torques: Array) -> None:
        """Take in steps: states after them (K, 2 (N + 2)), record (K, 12), torques (K, N - 1)."""
        if not len(states):
            return
        n = self._unknowns
        verdict = self._verdict
        states = states[:, : 2 * n]
        for name, values in (("state", states), ("record", record)):
            if not self._not_finite and not np.isfinite(values).all():
                row = int(np.argwhere(~np.isfinite(values))[0, 0])
                self._not_finite = f"{name} of step {self._steps + row + 1} is not finite"
        energy = record[:, _COLUMN["energy"]]
        spent = record[:, _COLUMN["work"]] - record[:, _COLUMN["dissipated"]]
        expected = self._balance + np.cumsum(spent)
        self._balance = float(expected[-1])
        self._unexplained = max(self._unexplained, float(np.abs(energy - expected).max()))
        self._largest = max(self._largest, float(energy.max()))
        q, p = states[:, :n], states[:, n:]
        residual = record[:, _COLUMN["residual"]]
        before = np.concatenate([self._last[None], q[:-1]])
        self._look_for_wrong_roots(q, before, record)
        rounded = record[:, _COLUMN["at_round_off"]] > 0.0
        verdict.at_round_off += int(rounded.sum())
        verdict.residual = max(verdict.residual, float(residual[~rounded].max(initial=0.0)))
        verdict.rounded = max(verdict.rounded, float(residual[rounded].max(initial=0.0)))
        parts = record[:, _COLUMN["parts"]]
        verdict.cut_steps += int((parts > 1.0).sum())
        verdict.most_parts = max(verdict.most_parts, int(parts.max()))
        impulses = record[:, [_COLUMN[k] for k in ("impulse_x", "impulse_y", "angular_impulse")]]
        outside = self._outside + np.cumsum(impulses, axis=0)
        self._outside = outside[-1]
        drift = np.linalg.norm(self._maps(states) - self._momentum - outside, axis=1)
        terms = np.abs(p).sum(axis=1) + np.abs(q[:, 0] * p[:, 1]) + np.abs(q[:, 1] * p[:, 0])
        terms += np.abs(impulses).sum(axis=1) + self._impulses(q, before, torques)
        self._terms = max(self._terms, float(terms.max()))
        count = self._steps + np.arange(1, len(states) + 1)
        self._solved += np.maximum(parts, 1.0).sum() * self._halves
        # Momentum is as exact as its terms, the impulses of a step among them; what the tolerance
        # leaves of it counts by them too, and rounding adds up over all parts that are solved.
        bound = (10.0 * self._tolerance + _ROUND_OFF * self._solved) * self._terms
        bound = np.maximum(bound, _NOTHING)
        verdict.momentum = max(verdict.momentum, float((drift / bound).max()))
        first, last = self._quarters
        first.append(float(energy[count <= verdict.wanted // 4].sum()))
        last.append(float(energy[count > verdict.wanted - verdict.wanted // 4].sum()))
        self._steps += len(states)
        self._last = q[-1].copy()
        verdict.displacement = (q[-1, :2] - self._start[:2]).tolist()

    def close(self) -> None:
        """Sum up."""
        verdict = self._verdict
        if self._largest > 0.0:
            verdict.energy_drift = self._unexplained / self._largest
        first, last = (math.fsum(one) for one in self._quarters)
        verdict.energy_ratio = last / first if first > 0.0 else 1.0
        if self._not_finite:
            verdict.failures.append(self._not_finite)
        if not verdict.residual <= self._tolerance:
            verdict.failures.append(f"a residual of {verdict.residual:.1e} was taken")
        if not verdict.rounded <= max(self._tolerance, _LARGEST_ROUND_OFF):
            verdict.failures.append(f"a residual of {verdict.rounded:.1e} was taken for round-off")
        if not verdict.momentum <= 1.0:
            verdict.failures.append(f"momentum off by {verdict.momentum:.2g} times its bound")
        if verdict.reason and verdict.reason not in TERMINATION_REASONS.values():
            verdict.failures.append(f"unknown reason {verdict.reason!r}")
        self._check_budget()
        # The state that is left is one to go on from, or at least to look at.
        left, velocity, status = self._bodies.energy_and_velocity(0)
        if status or not (math.isfinite(left) and np.isfinite(velocity).all()):
            verdict.failures.append("the last state cannot be weighed")
