"""One hard run: what is played, and the verdict on it.

A run is right where every step met its residual, the momentum kept within its bound, and the mass
stayed positive, all in finite numbers; an energy budget beyond the scene's tolerance is flagged,
and anything else has to be an end with a reason from the closed list. A displacement is claimed
only where a run at half the step agrees.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SimulationEndedError
from swim_env.physics.invariants import momentum_map
from swim_env.physics.solve.outer_step import LARGEST_TURN
from swim_env.physics.solve.state import RECORD_NAMES, energy_drift_of
from swim_env.physics.status import TERMINATION_REASONS
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, minimal_start
from swim_env.sim.constants import scene_constants

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
#: Largest residual that is accepted where rounding keeps it from falling.
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

    `label` is what it varies; `duration`, simulated time (s), is rounded to whole steps; `velocity`
    is that of the mean centre (m/s) and the turning rates (rad/s), (N + 2,), if not the scene's.
    """

    label: str
    scene: Scene
    duration: float
    torques: Torques = wave
    #: Whether a solution exists to the end, so that an early end is a failure, and so is energy
    #: that is not explained unless it is `flagged` as known to be so.
    must_last: bool = False
    flagged: bool = False
    #: Whether it is played at half the step as well, to see if its displacement may be claimed.
    compared: bool = False
    #: Whether the mean energy of the last quarter has to be that of the first within 3 %
    #: (docs/theory/plane.md), for passive bodies without losses.
    steady: bool = False
    velocity: Array | None = None
    case: str = ""


@dataclass
class Verdict:
    """What a run of a case came to.

    It took `steps` of those `wanted` in `seconds` of wall time. `reason` is why it ended early,
    `failures` what is not right; both are empty for a run that lasted and is right.
    """

    case: str
    label: str
    reason: str = ""
    wanted: int = 0
    steps: int = 0
    #: Largest scaled residual of steps that rounding did not stop; how many steps it did stop above
    #: the tolerance, and their largest residual.
    residual: float = 0.0
    at_round_off: int = 0
    rounded: float = 0.0
    #: Largest drift of the momentum as a share of its bound: 10 tolerances plus 1e-15 n times the
    #: size of its terms, n the parts solved.
    momentum: float = 0.0
    #: Largest unexplained energy as a share of what went through, and the scene's tolerance.
    energy_drift: float = 0.0
    energy_tolerance: float = 0.0
    #: Mean energy of the last quarter over that of the first.
    energy_ratio: float = 1.0
    #: Steps that had to be cut, and into how many parts at most.
    cut_steps: int = 0
    most_parts: int = 1
    #: Processor time of the slowest outer step (s), of long runs the mean of the slowest block.
    slowest: float = 0.0
    seconds: float = 0.0
    #: Of the mean centre (m), and how far a run at half the step is away, as a share of it or of a
    #: tenth of a body length; None where there was none.
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


def play(run: HardRun) -> Verdict:
    """Play a run and judge it.

    A step that took too long gets a second chance: another program may have had the processor.
    """
    verdict = _play(run)
    if verdict.slowest > LONGEST_STEP:
        verdict = min(verdict, _play(run), key=lambda one: one.slowest)
    failures = verdict.failures
    if run.compared and not verdict.reason:
        half = 0.5 * run.scene.integrator.time_step
        fine = _play(replace(run, scene=run.scene.replace("integrator.time_step", half)))
        failures += [f"at half the step: {text}" for text in fine.failures]
        if not fine.reason:
            scale = max(math.hypot(*fine.displacement), 0.1 * run.scene.beam.length)
            verdict.agreement = math.dist(verdict.displacement, fine.displacement) / scale
    if verdict.slowest > LONGEST_STEP:
        failures.append(f"a step took {verdict.slowest:.1f} s")
    if run.must_last and not run.flagged and not verdict.trusted:
        failures.append(f"energy off by {verdict.energy_drift:.2g} of what went through")
    if run.steady and not abs(verdict.energy_ratio - 1.0) <= 0.03:
        failures.append(f"mean energy changes by a factor {verdict.energy_ratio:.3f}")
    if verdict.reason and run.must_last:
        failures.append(f"ended with {verdict.reason}, and a solution exists")
    return verdict


def _play(run: HardRun) -> Verdict:
    scene = run.scene
    total = max(1, round(run.duration / scene.integrator.time_step))
    tolerance = scene.integrator.energy_tolerance
    verdict = Verdict(run.case, run.label, wanted=total, energy_tolerance=tolerance)
    bodies = Bodies(scene)
    coordinates, velocity = minimal_start(scene, scene.initial)
    begin = time.perf_counter()
    try:
        bodies.start(0, coordinates, velocity if run.velocity is None else run.velocity)
    except SimulationEndedError as error:
        verdict.reason = error.reason
    else:
        _follow(run, bodies, verdict)
    verdict.seconds = time.perf_counter() - begin
    if verdict.reason and verdict.reason not in TERMINATION_REASONS.values():
        verdict.failures.append(f"unknown reason {verdict.reason!r}")
    return verdict


def _follow(run: HardRun, bodies: Bodies, verdict: Verdict) -> None:
    """Take the steps of a run that has started, and judge them."""
    scene, total, step = run.scene, verdict.wanted, run.scene.integrator.time_step
    watch = _Watch(bodies, verdict)
    block = 1 if total <= _MANY else _BLOCK
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
        verdict.slowest = max(verdict.slowest, (time.thread_time() - start) / count)
        taken, status = (int(n) for n in bodies.outcome[0])
        watch.look(trace[0, :taken], record[0, :taken], torques[:taken])
        if status:
            verdict.reason = TERMINATION_REASONS.get(status, f"code {status}")
    watch.close()


class _Watch:
    """Follows a run block by block and keeps what its verdict needs."""

    def __init__(self, bodies: Bodies, verdict: Verdict) -> None:
        self._bodies, self._verdict = bodies, verdict
        self._unknowns = n = bodies.unknowns
        self._integrator = bodies.scene.integrator
        self._halves = 2.0 if self._integrator.scheme == "composed" else 1.0
        self._beam = scene_constants(bodies.scene)[0]
        start = bodies.states[0, : 2 * n].copy()
        self._start = self._last = start[:n]
        self._momentum = momentum_map(start[None, :n], start[None, n:])[0]
        # Of the steps so far: the impulses from outside, the energy that is to be expected, the
        # largest energy and momentum terms, the parts that were solved.
        self._outside = np.zeros(3)
        self._balance = self._largest = bodies.energy_and_velocity(0)[0]
        self._unexplained = self._terms = self._solved = self._lost = 0.0
        self._quarters: tuple[list[float], list[float]] = ([], [])
        self._not_finite = ""

    def look(self, states: Array, record: Array, torques: Array) -> None:
        """Take in steps: states after them (K, 2 (N + 2)), record (K, 12), torques (K, N - 1)."""
        if not len(states):
            return
        n, verdict = self._unknowns, self._verdict
        states = states[:, : 2 * n]
        column = dict(zip(RECORD_NAMES, record.T, strict=True))
        for name, values in (("state", states), ("record", record)):
            if not self._not_finite and not np.isfinite(values).all():
                row = int(np.argwhere(~np.isfinite(values))[0, 0])
                self._not_finite = f"{name} of step {verdict.steps + row + 1} is not finite"
        q, p = states[:, :n], states[:, n:]
        before = np.concatenate([self._last[None], q[:-1]])
        self._look_for_wrong_roots(q, before, column["parts"])
        residual, rounded = column["residual"], column["at_round_off"] > 0.0
        verdict.at_round_off += int(rounded.sum())
        verdict.residual = float(residual[~rounded].max(initial=verdict.residual))
        verdict.rounded = float(residual[rounded].max(initial=verdict.rounded))
        verdict.cut_steps += int((column["parts"] > 1.0).sum())
        verdict.most_parts = max(verdict.most_parts, int(column["parts"].max()))
        self._look_at_energy(column)
        self._look_at_momentum(q, p, self._impulses(q, before, torques), column)
        verdict.steps += len(states)
        self._last = q[-1].copy()
        verdict.displacement = (q[-1, :2] - self._start[:2]).tolist()

    def _look_for_wrong_roots(self, q: Array, before: Array, parts: Array) -> None:
        """Refuse turns that no part of a step may have: solutions of the equations, but wrong."""
        joints = np.abs(q[:, 3:] - before[:, 3:])
        elements = np.abs(np.cumsum(q[:, 2:] - before[:, 2:], axis=1))
        turns = np.maximum(joints.max(axis=1), elements.max(axis=1))
        # Every part may turn by that much, in composed steps every half of one.
        most = LARGEST_TURN * self._halves * np.maximum(parts, 1.0)
        if (turns > most + 1e-9).any():
            row = int(np.argmax(turns - most))
            self._verdict.failures.append(
                f"step {self._verdict.steps + row + 1} turned by {turns[row]:.2f} rad in "
                f"{parts[row]:.0f} parts"
            )

    def _look_at_energy(self, column: dict[str, Array]) -> None:
        """Compare the energy with the work that was done, and add up two quarters of the run."""
        energy, verdict = column["energy"], self._verdict
        expected = self._balance + np.cumsum(column["work"] - column["dissipated"])
        self._balance = float(expected[-1])
        self._unexplained = max(self._unexplained, float(np.abs(energy - expected).max()))
        self._largest = max(self._largest, float(energy.max()))
        self._lost += float(np.maximum(column["dissipated"], 0.0).sum())
        count = verdict.steps + np.arange(1, len(energy) + 1)
        first, last = self._quarters
        first.append(float(energy[count <= verdict.wanted // 4].sum()))
        last.append(float(energy[count > verdict.wanted - verdict.wanted // 4].sum()))

    def _look_at_momentum(
        self, q: Array, p: Array, moments: Array, column: dict[str, Array]
    ) -> None:
        """Compare the momentum with the impulses from outside, by the size of its terms."""
        impulses = np.stack([column[k] for k in ("impulse_x", "impulse_y", "angular_impulse")], 1)
        outside = self._outside + np.cumsum(impulses, axis=0)
        self._outside = outside[-1]
        drift = np.linalg.norm(momentum_map(q, p) - self._momentum - outside, axis=1)
        terms = np.abs(p).sum(axis=1) + np.abs(q[:, 0] * p[:, 1]) + np.abs(q[:, 1] * p[:, 0])
        terms += np.abs(impulses).sum(axis=1) + moments
        self._terms = max(self._terms, float(terms.max()))
        self._solved += np.maximum(column["parts"], 1.0).sum() * self._halves
        # Momentum is as exact as its terms, the impulses of a step among them; what the tolerance
        # leaves of it counts by them too, and rounding adds up over all parts that are solved.
        bound = (10.0 * self._integrator.tolerance + _ROUND_OFF * self._solved) * self._terms
        momentum = float((drift / max(bound, _NOTHING)).max())
        self._verdict.momentum = max(self._verdict.momentum, momentum)

    def _impulses(self, q: Array, before: Array, torques: Array) -> Array:
        """Return the sizes of the moments' impulses in some steps, added up (kg m^2/s)."""
        elastic = (self._beam.joint_stiffness * np.abs(q[:, 3:])).sum(axis=1)
        damping = (self._beam.joint_damping * np.abs(q[:, 3:] - before[:, 3:])).sum(axis=1)
        driving = np.abs(torques).sum(axis=1)
        found: Array = self._integrator.time_step * (elastic + driving) + damping
        return found

    def close(self) -> None:
        """Sum up."""
        verdict, tolerance = self._verdict, self._integrator.tolerance
        if self._largest > 0.0:
            verdict.energy_drift = self._unexplained / (self._largest + self._lost)
        first, last = (math.fsum(one) for one in self._quarters)
        verdict.energy_ratio = last / first if first > 0.0 else 1.0
        # The kernels' own budget, and the end that they make of it.
        kept = energy_drift_of(self._bodies.states[0])
        own, allowed = verdict.energy_drift, max(tolerance, _LARGEST_ROUND_OFF)
        ends = self._integrator.energy_excess == "end" and not verdict.trusted
        # The state that is left is one to continue from, or at least to look at.
        try:
            left, velocity = self._bodies.energy_and_velocity(0)
            finite = math.isfinite(left) and bool(np.isfinite(velocity).all())
        except SimulationEndedError:
            finite = False
        checks = {
            self._not_finite: not self._not_finite,
            f"a residual of {verdict.residual:.1e} was accepted": verdict.residual <= tolerance,
            f"a residual of {verdict.rounded:.1e} was taken for round-off": (
                verdict.rounded <= allowed
            ),
            f"momentum off by {verdict.momentum:.2g} times its bound": verdict.momentum <= 1.0,
            f"the budget was kept at {kept:.3e}, and is {own:.3e}": (
                abs(kept - own) <= 1e-6 * own + 1e-12
            ),
            f"energy off by {kept:.2g} and the end {verdict.reason!r}": (
                ends == (verdict.reason == "energy_unexplained")
            ),
            "the last state has no finite energy and velocity": finite,
        }
        verdict.failures += [text for text, right in checks.items() if not right]
