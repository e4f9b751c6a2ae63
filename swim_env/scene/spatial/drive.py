"""The prescribed torque that drives a body in space, and its damping."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SceneError
from swim_env.scene.body import Chain
from swim_env.scene.checks import Triple, got, listed, one_of, real, vector
from swim_env.scene.drive import Wave
from swim_env.scene.effects import Effect
from swim_env.scene.spatial.body import AXIS_NAMES

Floats = NDArray[np.float64]

WAVE_AXES: dict[str, tuple[str, ...]] = {
    "planar": ("yaw",),
    "dorsoventral": ("pitch",),
    "helical_right": ("yaw", "pitch"),
    "helical_left": ("yaw", "pitch"),
}
"""The axes that a wave drives, by its name; `SpatialActuation.amplitude` is that of the first."""

WAVE_NAMES: tuple[str, ...] = tuple(WAVE_AXES)
"""Names that `SpatialActuation.wave` may have."""


def _check_axes(value: object, field: str) -> tuple[str, ...]:
    items, known = listed(value), ", ".join(AXIS_NAMES)
    if not items:
        raise SceneError(f"{field} must be a list of some of {known}, got {got(value)}")
    axes = tuple(one_of(AXIS_NAMES)(item, f"{field}[{i}]") for i, item in enumerate(items))
    for i, axis in enumerate(axes):
        if axis in axes[:i]:
            raise SceneError(f"{field} must name every axis at most once, got {axis} twice")
    return axes


def _check_limit(value: object, field: str) -> float | tuple[float, ...]:
    check, items = real("N m", above=0.0), listed(value)
    if items is None:
        return check(value, field)
    return tuple(check(item, f"{field}[{i}]") for i, item in enumerate(items))


def _check_retardation(value: object, field: str) -> float | Triple:
    if listed(value) is None:
        return real("s", above=0.0)(value, field)
    times: Triple = vector("s", *AXIS_NAMES)(value, field)
    for i, time in enumerate(times):
        real("s", at_least=0.0)(time, f"{field}[{i}]")
    if not any(times):
        raise SceneError(f"{field} must be above 0 s for one axis at least; leave damping out")
    return times


@dataclass(frozen=True)
class SpatialActuation(Wave, path="actuation"):
    """The prescribed torque, and which axes of the joints are actuated; see `Wave` for the rest.

    Attributes
    ----------
    torque_limit : float or tuple of float
        Torque of an environment's action of 1 [N m], above 0: one for all axes or one for each in
        the order of `axes`. It does not limit the amplitude.
    axes : tuple of str
        The actuated axes, some of `AXIS_NAMES`, in the order of an environment's actions.
    wave : str
        One of `WAVE_NAMES`: ``planar`` is tau_2 = A cos(f t - kappa s/l + phase), of yaw, and
        ``dorsoventral`` the same of pitch, tau_1. The helical ones have the planar one and
        tau_1 = +-A sin(f t - kappa s/l + phase) beside it. The shape of ``helical_right`` (+) is a
        right-handed helix, and it turns the body about +d3.
    pitch_amplitude : float or None
        Amplitude of a helical wave's tau_1 [N m] where it is not that of its tau_2.
    """

    torque_limit: Annotated[float | tuple[float, ...], _check_limit] = 1.0  # type: ignore[assignment]
    axes: Annotated[tuple[str, ...], _check_axes] = ("yaw",)
    wave: Annotated[str, one_of(WAVE_NAMES)] = "planar"
    pitch_amplitude: Annotated[float | None, real("N m")] = None

    def __post_init__(self) -> None:
        """Check every field, and that the wave's axes are actuated and have their limits."""
        super().__post_init__()
        limit: Any = self.torque_limit
        if isinstance(limit, tuple) and len(limit) != len(self.axes):
            raise SceneError(
                f"actuation.torque_limit must be one number in N m or one for each of "
                f"actuation.axes, {len(self.axes)}, got {len(limit)}"
            )
        helical = len(WAVE_AXES[self.wave]) > 1
        if self.pitch_amplitude is not None and not helical:
            raise SceneError(
                f"actuation.pitch_amplitude has no meaning with actuation.wave {self.wave}, only "
                f"with a helical one; leave it out, got {self.pitch_amplitude!r}"
            )
        needed = sorted(WAVE_AXES[self.wave])
        if (self.amplitude or self.pitch_amplitude) and not set(needed) <= set(self.axes):
            raise SceneError(
                f"actuation.wave {self.wave} needs {' and '.join(needed)} among actuation.axes, or "
                f"an amplitude of 0, got {', '.join(self.axes)}"
            )

    @property
    def limits(self) -> tuple[float, ...]:
        """The torque limit of each axis in the order of `axes` [N m]."""
        limit: Any = self.torque_limit
        return limit if isinstance(limit, tuple) else (limit,) * len(self.axes)

    def torques(self, times: ArrayLike, beam: Chain) -> Floats:
        """Joint torques at given times.

        Parameters
        ----------
        times : array_like
            Times [s], shape (T,). For an exact end, compute them as step number times time step
            and not by summing.
        beam : Chain
            The body whose joints are driven.

        Returns
        -------
        numpy.ndarray
            Torques [N m] about (pitch, yaw, roll), shape (T, N-1, 3), conjugate to the joint's
            rotation vector. Zero from `end_time` on and at joints with s/l above `active_until`.
        """
        axis, *beside = (AXIS_NAMES.index(name) for name in WAVE_AXES[self.wave])
        along = self.travelling(np.cos, times, beam)
        torques = np.zeros((*along.shape, 3))
        torques[..., axis] = along
        if beside:
            own = self.amplitude if self.pitch_amplitude is None else self.pitch_amplitude
            hand = 1.0 if self.wave == "helical_right" else -1.0
            torques[..., beside[0]] = hand * replace(self, amplitude=own).travelling(
                np.sin, times, beam
            )
        return torques


@dataclass(frozen=True)
class SpatialDamping(Effect, path="damping"):
    """Effect: Kelvin-Voigt damping, a joint moment -(EI_i/dl) t_kv d(th_i)/dt about every axis.

    Attributes
    ----------
    retardation_time : float or tuple of float
        Retardation time t_kv [s], above 0; or one for each of (pitch, yaw, roll), at least 0.
    """

    retardation_time: Annotated[float | Triple, _check_retardation]

    @property
    def times(self) -> Floats:
        """Retardation times of (pitch, yaw, roll) [s], shape (3,)."""
        return np.array(np.broadcast_to(self.retardation_time, 3), dtype=np.float64)

    def check_scene(self, beam: Any, fluid: Any) -> None:
        """Refuse a body without stiffness about the axes that are damped."""
        if not (beam.stiffness_at_joints() * self.times).any():
            raise SceneError(
                "damping has no meaning where the beam's stiffnesses about its axes are zero "
                "everywhere, as its moment is proportional to them; leave damping out or give some "
                "stiffness"
            )
