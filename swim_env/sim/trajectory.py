"""A recorded run: arrays over time, summary figures, and its file."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError, TrajectoryError
from swim_env.files.atomic import write_atomically
from swim_env.physics.invariants import (
    energy_drift,
    momentum_drift,
    unexplained_energy,
    unexplained_momentum,
)
from swim_env.physics.status import TERMINATION_REASONS
from swim_env.scene import Scene
from swim_env.scene.yaml import parse_yaml

Array = NDArray[np.float64]

#: Version of the file format; other versions cannot be read, except 2, which had no external
#: impulse.
FORMAT_VERSION = 3
_READABLE = (2, FORMAT_VERSION)


@dataclass(frozen=True, eq=False)
class TrajectoryBase:
    """A run of T steps of one scene: what runs in the plane and in space have in common.

    Vectors have D = 2 components in the plane and 3 in space, momenta J = 3 and 6.

    Attributes
    ----------
    scene : Scene
        What was run.
    termination_reason : str
        Why the run ended early, a key of `swim_env.TERMINATION_REASONS`; empty if it did not.
    time : (T + 1,) array
        Instants (s).
    centres : (T + 1, N, D) array
        Element centres (m).
    torques : (T, N - 1) array, in space (T, N - 1, 3)
        Joint torques held over each step (N m).
    momentum : (T + 1, J) array
        Linear momentum (kg m/s) and angular momentum about the origin (kg m^2/s).
    energy : (T + 1,) array
        H(q_n, p_n) (J).
    impulse : (T, J) array
        Linear and angular impulse of drag and stream in each step, in the units of `momentum`:
        the change of the momentum.
    work, positive_work, dissipated : (T,) arrays
        Work of the torques in each step, the sum of its positive parts over joints, and the loss
        to damping and drag (J).
    residual : (T,) array
        Scaled residual of the step equations after the last iteration.
    iterations : (T,) array
        Newton corrections tried.
    evaluations : (T,) array
        Evaluations of the whole residual, with the derivative of the added mass.
    parts : (T,) array
        Parts that a step had to be cut into; 1 where it was solved whole.
    at_round_off : (T,) array
        1 where rounding kept the residual above the tolerance.
    """

    scene: Scene
    termination_reason: str
    time: Array
    centres: Array
    torques: Array
    momentum: Array
    energy: Array
    work: Array
    positive_work: Array
    dissipated: Array
    residual: Array
    iterations: Array
    evaluations: Array
    parts: Array
    at_round_off: Array
    impulse: Array

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the arrays that depend on the number of elements."""
        raise NotImplementedError

    @property
    def heading_change(self) -> float:
        """By how much the body has turned from the start to the end (rad)."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Check that the arrays are those of the scene's body (else TrajectoryError)."""
        for key, wanted in self._shapes().items():
            shape = np.shape(getattr(self, key))
            if shape[1:] != wanted[1:]:
                raise TrajectoryError(
                    f"the trajectory's {key} must have shape {wanted} in scene {self.scene.name}, "
                    f"got {shape}"
                )

    # ---- figures -------------------------------------------------------------------------------

    @property
    def _torque_rows(self) -> int:
        return len(np.atleast_1d(self.torques))

    @property
    def steps(self) -> int:
        """Number T of steps."""
        return len(self.time) - 1

    @property
    def duration(self) -> float:
        """Simulated time that the run covers (s)."""
        return float(self.time[-1] - self.time[0])

    @property
    def path(self) -> Array:
        """Path of the mean element centre, (T + 1, D) (m)."""
        mean: Array = self.centres.mean(axis=1)
        return mean

    @property
    def displacement(self) -> Array:
        """Change of the mean element centre, (D,) (m)."""
        net: Array = self.path[-1] - self.path[0]
        return net

    @property
    def unexplained_energy(self) -> Array:
        """Unexplained energy since the start, H - H_0 - work + dissipated, (T + 1,) (J)."""
        return unexplained_energy(self.energy, self.work, self.dissipated)

    @property
    def unexplained_momentum(self) -> Array:
        """Unexplained momentum since the start, (T + 1, J) (kg m/s, kg m^2/s)."""
        return unexplained_momentum(self.momentum, self.impulse)

    @property
    def energy_drift(self) -> float:
        """Largest unexplained energy, as a share of what went through.

        See `swim_env.physics.invariants.energy_drift`.
        """
        return energy_drift(self.energy, self.work, self.dissipated)

    def warnings(self) -> list[str]:
        """Return the reasons not to trust this run; none if it can be trusted."""
        drift, tolerance = self.energy_drift, self.scene.integrator.energy_tolerance
        if drift <= tolerance:
            return []
        return [
            f"the energy budget is off by {drift:.2g} of what went through, more than the "
            f"scene's integrator.energy_tolerance of {tolerance:g}: do not trust this run; a "
            "smaller time step, integrator.scheme composed or damping may help"
        ]

    def summary(self) -> dict[str, Any]:
        """Return the run's figures as plain numbers and lists.

        Returns
        -------
        dict
            ``scene``; ``duration`` (s) and ``steps`` that were run; ``displacement`` (m) of
            the mean element centre, a list; ``heading_change`` (rad), ``mean_speed``
            |displacement|/duration (m/s); ``work``, ``positive_work``, ``dissipated`` (J);
            ``energy_drift``, the scene's ``energy_tolerance``, whether the run is ``trusted`` by
            it, and the ``warnings``; ``momentum_drift``; ``max_residual``;
            ``newton_iterations_mean``, ``evaluations_mean``; ``halved_steps`` and ``most_parts``
            of a step; ``round_off_steps``; ``termination_reason`` (empty if the run did not end
            early).
        """
        steps = self.steps
        speed = float(np.linalg.norm(self.displacement)) / self.duration if steps else 0.0
        warnings = self.warnings()
        return {
            "scene": self.scene.name,
            "duration": self.duration,
            "steps": steps,
            "displacement": [float(x) for x in self.displacement],
            "heading_change": self.heading_change,
            "mean_speed": speed,
            "work": float(self.work.sum()),
            "positive_work": float(self.positive_work.sum()),
            "dissipated": float(self.dissipated.sum()),
            "energy_drift": self.energy_drift,
            "energy_tolerance": self.scene.integrator.energy_tolerance,
            "trusted": not warnings,
            "warnings": warnings,
            "momentum_drift": momentum_drift(self.momentum, self.impulse),
            "max_residual": float(self.residual.max(initial=0.0)),
            "newton_iterations_mean": float(self.iterations.mean()) if steps else 0.0,
            "evaluations_mean": float(self.evaluations.mean()) if steps else 0.0,
            "halved_steps": int(np.count_nonzero(self.parts > 1)),
            "most_parts": int(self.parts.max(initial=0)),
            "round_off_steps": int(np.count_nonzero(self.at_round_off)),
            "termination_reason": self.termination_reason,
        }

    # ---- file ----------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the trajectory to a compressed NumPy file (.npz), whole or not at all.

        Arrays are stored under their names, the scene as YAML text under ``scene``; reading it
        needs no pickle.

        Raises
        ------
        TrajectoryError
            If the file cannot be written.
        """
        content = {
            "format_version": FORMAT_VERSION,
            "scene": self.scene.to_yaml(),
            "termination_reason": self.termination_reason,
            **{name: getattr(self, name) for name in self._arrays()},
        }
        try:
            write_atomically(path, lambda file: np.savez_compressed(file, **content))
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise TrajectoryError(
                f"cannot write the trajectory: {reason} ({os.fspath(path)})"
            ) from None

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Any:
        """Read a trajectory that `save` wrote: a `Trajectory`, or in space a `SpatialTrajectory`.

        Raises
        ------
        TrajectoryError
            If the file cannot be read, is damaged, or is not a trajectory of a known version.
        """
        name = os.fspath(path)
        try:
            with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
                # A damaged header may have less than the whole array read, and its checksum is
                # then not verified.
                damaged = file.zip.testzip()
                if damaged is not None:
                    raise zipfile.BadZipFile(f"the checksum of {damaged} is wrong")
                content = {key: file[key] for key in file.files}
        except OSError as error:
            reason = error.strerror or str(error)
            raise TrajectoryError(f"cannot read the trajectory: {reason} ({name})") from None
        except MemoryError:
            raise
        except Exception as error:  # a damaged archive makes its readers raise almost anything
            problem = " ".join(str(error).split()) or type(error).__name__
            raise TrajectoryError(
                f"not a trajectory file, or a damaged one: {problem} ({name})"
            ) from None
        if content.get("format_version", np.array(0)).tolist() == 2 and "torques" in content:
            content["impulse"] = np.zeros((len(content["torques"]), 3))
        _require(("format_version", "scene", "termination_reason"), content, name)
        version = content["format_version"].tolist()
        if version not in _READABLE:
            raise TrajectoryError(
                f"the trajectory has format version {version}, this version of swim_env reads "
                f"{' and '.join(str(number) for number in _READABLE)} ({name})"
            )
        reason = str(content["termination_reason"])
        if reason not in TERMINATION_REASONS.values():
            raise TrajectoryError(f"unknown termination_reason {reason!r} ({name})")
        try:
            data: Any = parse_yaml(str(content["scene"]), name)
            scene = Scene.from_dict(data, name)
        except SceneError as error:
            raise TrajectoryError(f"the trajectory's scene is not valid: {error}") from None
        kind = TRAJECTORIES[scene.dimension]
        wanted = kind._names(scene)
        _require(wanted, content, name)
        try:
            arrays = {key: np.asarray(content[key], dtype=np.float64) for key in wanted}
        except (TypeError, ValueError) as error:
            raise TrajectoryError(f"the trajectory holds no numbers: {error} ({name})") from None
        try:
            trajectory = kind(scene=scene, termination_reason=reason, **arrays)
            trajectory._check_shapes()
            return trajectory
        except TrajectoryError as error:
            raise TrajectoryError(f"{error} ({name})") from None

    @classmethod
    def _names(cls, scene: Scene) -> list[str]:
        """Return the names of the arrays that a scene's run has."""
        return [one.name for one in fields(cls) if one.name not in ("scene", "termination_reason")]

    def _arrays(self) -> list[str]:
        """Return the names of the arrays that there are."""
        return [name for name in self._names(self.scene) if getattr(self, name) is not None]

    def _check_shapes(self) -> None:
        steps = self._torque_rows
        momenta = 3 * self.scene.dimension - 3
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(self._arrays(), (steps,)) | {
            **self._shapes(),
            "time": (steps + 1,),
            "energy": (steps + 1,),
            "momentum": (steps + 1, momenta),
            "impulse": (steps, momenta),
        }
        for key, shape in shapes.items():
            found = getattr(self, key).shape
            if found != shape:
                raise TrajectoryError(
                    f"the trajectory's {key} must have shape {shape}, got {found}"
                )


TRAJECTORIES: dict[int, type[TrajectoryBase]] = {}
"""The class of runs by the dimension of their scenes."""


def _require(names: Iterable[str], content: Mapping[str, object], file: str) -> None:
    """Refuse a file that lacks some entries."""
    missing = [name for name in names if name not in content]
    if missing:
        raise TrajectoryError(f"not a trajectory file, it lacks {', '.join(missing)} ({file})")


@dataclass(frozen=True, eq=False)
class Trajectory(TrajectoryBase):
    """A run of T steps of a scene in the plane; see `TrajectoryBase` for what is not said here.

    Attributes
    ----------
    angles : (T + 1, N) array
        Element angles (rad).
    internal_forces : (T, N - 1, 2) array or None
        Force (N) of the part behind a joint on the part in front of it, at the beginning of each
        step, a mean over that step and the one before; NaN at the beginning of a run. None unless
        the scene has the effect. It follows from the momentum balance of the elements, including
        the fluid's impulse on an element's own panels.
    """

    angles: Array
    internal_forces: Array | None = None

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        elements, steps = self.scene.beam.elements, self._torque_rows
        shapes: dict[str, tuple[int, ...]] = {
            "centres": (steps + 1, elements, 2),
            "angles": (steps + 1, elements),
            "torques": (steps, elements - 1),
        }
        if self.internal_forces is not None:
            shapes["internal_forces"] = (steps, elements - 1, 2)
        return shapes

    @classmethod
    def _names(cls, scene: Scene) -> list[str]:
        names = super()._names(scene)
        return names if scene.internal_forces is not None else names[:-1]

    @property
    def heading_change(self) -> float:
        """Change of the mean element angle (rad)."""
        return float(self.angles[-1].mean() - self.angles[0].mean())

    @property
    def nodes(self) -> Array:
        """Nodes of the centre line from head to tail, (T + 1, N + 1, 2) (m)."""
        half = 0.5 * self.scene.beam.element_length
        arms = half * np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)
        return np.concatenate([self.centres - arms, (self.centres + arms)[:, -1:]], axis=1)


TRAJECTORIES[2] = Trajectory
