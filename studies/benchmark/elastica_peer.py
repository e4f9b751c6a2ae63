"""The peer that runs in PyElastica: a Cosserat rod with the scene's beam for its parameters.

The rod is three-dimensional, shears and stretches, and has a circular section. Radius, density and
Young's modulus are chosen such that line density, rotary inertia and bending stiffness are the
scene's; for the paper's beam the radius comes out as 0.01 m, its half thickness. The section then
also fixes how fast the rod's shear and stretching waves are, and these, not bending, bound its
explicit time step. Stretching and shear stiffness may be divided by a factor (`softening`) for
larger steps: for the paper's beam with 10 the first bending mode is 0.4 % slower than with 1, with
100 it is 4 % slower.

The fluid is PyElastica's slender-body theory: drag proportional to the velocity, twice as large
across the rod as along it, and no added mass. Kelvin-Voigt damping has no counterpart and is left
out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.environments import Workload
from studies.benchmark.peer_tools import intervals_in, largest_stable_step, load_peer, wave_of
from studies.benchmark.timing import Progress, no_progress
from swim_env.errors import SceneError
from swim_env.scene import Scene

Array = NDArray[np.float64]

#: Factors that the benchmark runs.
SOFTENINGS = (1.0, 10.0, 100.0)

#: Dynamic viscosity of the drag (Pa s): that of Swimmer-v5, as an ideal fluid has none.
_VISCOSITY = 0.1


class ElasticaRod:
    """A Cosserat rod with the scene's beam for its parameters, driven by the scene's wave.

    It starts straight along +x with its head at the origin, at rest. PyElastica evaluates the wave
    in every step, where other peers hold the torques over a control interval. `softening` divides
    stretching and shear stiffness; `viscosity` is the drag's (Pa s), 0 leaves it out; `rod` is
    PyElastica's own. A scene without rotary inertia or a wave, or with one that PyElastica's
    `MuscleTorques` do not know (with `end_time` or `active_until`), is a SceneError.
    """

    def __init__(
        self, scene: Scene, *, softening: float = 1.0, viscosity: float = _VISCOSITY
    ) -> None:
        elastica: Any = load_peer("elastica", "PyElastica")
        beam, wave = scene.beam, wave_of(scene)
        if wave.end_time is not None or wave.active_until < 1.0:
            raise SceneError(
                "actuation.end_time and actuation.active_until must be left out: the torques of "
                "PyElastica's rod act always and everywhere"
            )
        if beam.rotary_inertia == 0.0:
            raise SceneError("beam.rotary_inertia must be above 0: it sets the rod's radius, got 0")
        # Rotary inertia per length of a circular section is the line density times radius^2/4.
        radius = 2.0 * math.sqrt(beam.rotary_inertia / beam.line_density)
        area = math.pi * radius**2
        stiffness = beam.stiffness_at_joints()
        self.rod: Any = elastica.CosseratRod.straight_rod(
            beam.elements,
            start=np.zeros(3),
            direction=np.array([1.0, 0.0, 0.0]),
            normal=np.array([0.0, 0.0, 1.0]),
            base_length=beam.length,
            base_radius=radius,
            density=beam.line_density / area,
            youngs_modulus=4.0 * float(stiffness.max()) / (math.pi * radius**4),
        )
        # Bending stiffness varies along the body; the rest of the section's stiffness does not.
        self.rod.bend_matrix *= stiffness / stiffness.max()
        self.rod.shear_matrix /= softening
        self._system: Any = type("Rods", (elastica.BaseSystemCollection, elastica.Forcing), {})()
        self._system.append(self.rod)
        self._system.add_forcing_to(self.rod).using(
            elastica.MuscleTorques,
            base_length=beam.length,
            b_coeff=np.empty(0),
            period=2.0 * math.pi / wave.frequency,
            # A sine that runs from the tail, s' = 1 - s: this makes it A cos(f t - kappa s).
            wave_number=-wave.wave_number,
            phase_shift=wave.phase + 0.5 * math.pi - wave.wave_number,
            direction=np.array([0.0, 0.0, wave.amplitude]),
            rest_lengths=self.rod.rest_lengths.copy(),
            ramp_up_time=1e-12,  # none: it must be above 0
        )
        if viscosity > 0.0:
            self._system.add_forcing_to(self.rod).using(
                elastica.SlenderBodyTheory, dynamic_viscosity=viscosity
            )
        self._system.finalize()
        self._step: Callable[[Any, float, float], float] = elastica.PositionVerlet().step
        names = ("position", "director", "velocity", "omega")
        self._moving = [getattr(self.rod, f"{name}_collection") for name in names]
        self._start = [array.copy() for array in self._moving]
        self.time = 0.0

    def reset(self) -> None:
        """Go back to the start."""
        for array, start in zip(self._moving, self._start, strict=True):
            array[:] = start
        self.time = 0.0

    def advance(self, time_step: float, steps: int) -> None:
        """Take a number of steps of PyElastica's `PositionVerlet` (s)."""
        step, system, now = self._step, self._system, self.time
        for _ in range(steps):
            now = step(system, now, time_step)
        self.time = float(now)

    def play(self, time_step: float, steps: int) -> None:
        """Take a number of steps from the start (s)."""
        self.reset()
        self.advance(time_step, steps)

    def joint_angles(self) -> Array:
        """Return the angles between the tangents of neighbouring elements, (N - 1,) (rad)."""
        tangents = self.rod.director_collection[2]
        turns = np.diff(np.arctan2(tangents[1], tangents[0]))
        return np.asarray(np.remainder(turns + np.pi, 2.0 * np.pi) - np.pi, dtype=np.float64)

    def swim(self, interval: float, count: int, substeps: int) -> Array | None:
        """Run from the start and return the joint angles (count, N - 1) at the ends of intervals.

        They are in rad; None once they are not finite. Every interval (s) has `substeps` steps.
        """
        self.reset()
        angles = np.empty((count, self.rod.n_elems - 1))
        with np.errstate(all="ignore"):  # what blows up overflows first
            for index in range(count):
                self.advance(interval / substeps, substeps)
                angles[index] = self.joint_angles()
                if not np.isfinite(angles[index]).all():
                    return None
        return angles


def rod_workloads(
    scene: Scene,
    softenings: tuple[float, ...] = SOFTENINGS,
    *,
    seconds: float = 0.1,
    duration: float = 0.6,
    progress: Progress = no_progress,
) -> dict[str, Workload]:
    """Prepare the rod at its largest stable steps; every call starts it anew.

    Softenings that are unstable with steps of 1/4000 of a control interval are left out. PyElastica
    compiles its functions in the search for the step, before anything is timed. A call is `seconds`
    of simulated time, the search runs for `duration` seconds of it, which are some thousand periods
    of the rod's fastest waves; `progress` is called after every softening.

    Returns
    -------
    dict of str to Workload
        Keyed ``elastica_rod/softening``; environment steps are control intervals. Facts:
        `softening`, `viscosity` (Pa s), `version` (of PyElastica), `search_duration` (s) and the
        fields of `StableStep`.
    """
    load_peer("elastica", "PyElastica")
    interval = scene.episode.control_interval
    count, watched = intervals_in(seconds, scene), intervals_in(duration, scene)
    workloads = {}
    for softening in softenings:
        rod = ElasticaRod(scene, softening=softening)
        found = largest_stable_step(partial(rod.swim, interval, watched), interval)
        if found is not None:
            how = "" if softening == 1.0 else f", shear and stretching {softening:g} times softer"
            facts = {
                "softening": softening,
                "viscosity": _VISCOSITY,
                "version": metadata.version("pyelastica"),
                "search_duration": duration,
            }
            call = partial(rod.play, found.time_step, count * found.substeps)
            name = f"elastica_rod/{softening:g}"
            workloads[name] = found.workload(f"PyElastica rod{how}", call, count, facts)
        progress(1)
    return workloads
