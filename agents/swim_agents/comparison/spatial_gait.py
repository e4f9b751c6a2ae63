"""A gait in space in figures: its axes one by one, the planes it bends in, its hand and its roll.

The bending vector of a joint is z = yaw + i pitch, of its rotations about d2 and d1; the centre
line is curved towards conj(z) in (d1, d2). Over time z draws an ellipse, a straight line where the
joint bends in a plane. The wave ``helical_right`` of `swim_env.scene.SpatialActuation` is
z = A exp(i (f t - kappa s/l)): at a joint z turns from yaw to pitch, and the curved side
right-handedly about the head's direction, -d3. Along the body, where kappa > 0, the curved side
turns about d3: the centre line is a right-handed helix. Ellipses and hands are those of the swing,
without means over time: a bend that stays steers and does not swim.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_agents.comparison.gait import Gait, analyse_gait, dominant_frequency
from swim_env.errors import OptionError
from swim_env.scene import AXIS_NAMES

__all__ = [
    "Ellipse",
    "SpatialGait",
    "analyse_spatial_gait",
    "bending_ellipse",
    "helicity",
    "plane_angle",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: An axis that turns by less than this share of the most, in the root mean square, has no gait.
_STILL = 0.01


@dataclass(frozen=True)
class Ellipse:
    """The ellipse of yaw and pitch with the covariance of a joint's bending, or of the body's."""

    #: Its semi-axes (rad), the larger one first.
    major: float
    minor: float
    #: The smaller over the larger one: 0 for bending in a plane, 1 for all planes alike; 0 where
    #: nothing bends.
    ratio: float
    #: Angle of the major axis from yaw towards pitch (rad), above -pi/2, at most pi/2: 0 for
    #: lateral bending, pi/2 for dorsoventral bending.
    angle: float
    #: The `helicity` in time, -1 to 1: 1 where the bending vector turns in a circle from yaw to
    #: pitch, which is right-handed about the head's direction; 0 in a plane.
    whirl: float


@dataclass(frozen=True)
class SpatialGait:
    """A gait in space in figures."""

    #: Dominant frequency of the bending, yaw and pitch together (Hz).
    frequency: float
    #: Root mean squares of the joint rotations over joints and time (rad), about each axis.
    pitch_rms: float
    yaw_rms: float
    roll_rms: float
    #: The gait about each axis; None where the joints hardly turn about it.
    pitch: Gait | None
    yaw: Gait | None
    roll: Gait | None
    #: Of all joints together, and of each from head to tail. Where joints bend in planes of their
    #: own, it is the body's ellipse alone that is wide.
    body: Ellipse
    joints: tuple[Ellipse, ...]
    #: The `helicity` along the body, -1 to 1: of right-handed helices it is 1, of left-handed ones
    #: -1; 0 in a plane.
    handedness: float
    #: Root mean square of the twist per length (rad per body length).
    torsion: float
    #: Mean rate of the body's turning about its d3, which points to the tail (rad/s), and the
    #: standard deviation of that rate over time.
    roll_rate: float
    roll_swing: float
    #: Mean velocity relative to the fluid far away along the head's direction (body lengths/s).
    forward_speed: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and mappings, for JSON."""
        gaits = {axis: getattr(self, axis) for axis in AXIS_NAMES}
        return {
            **asdict(self),
            **{axis: None if gait is None else gait.to_dict() for axis, gait in gaits.items()},
            "joints": [asdict(one) for one in self.joints],
        }


def analyse_spatial_gait(
    times: ArrayLike,
    rotations: ArrayLike,
    torques: ArrayLike,
    places: ArrayLike,
    frames: ArrayLike,
    forward_speed: float,
) -> SpatialGait:
    """Describe a gait in space.

    Parameters
    ----------
    times : (T,) array_like
        At least 8 equidistant instants (s).
    rotations : (T, J, 3) array_like
        Rotation vectors of the joints (pitch, yaw, roll) (rad), from head to tail.
    torques : (T, J, 3) array_like
        Torques about the same axes (N m), held from these instants on.
    places : (J,) array_like
        The joints' s/l, in equal steps.
    frames : (T, 3, 3) array_like
        The body's rotation, with columns d1, d2, d3; see `swim_env.analysis.pose`. It must turn by
        less than half a turn from one instant to the next.
    forward_speed : float
        See `SpatialGait`.

    Raises
    ------
    OptionError
        If shapes do not fit, a value is not finite, or times are not equidistant.
    """
    turns, pushes = (np.asarray(values, dtype=np.float64) for values in (rotations, torques))
    at, bases = (np.asarray(values, dtype=np.float64) for values in (places, frames))
    joints = (*np.shape(times), *at.shape, 3)
    for name, values, shape in (
        ("rotations", turns, joints),
        ("torques", pushes, joints),
        ("frames", bases, (*np.shape(times), 3, 3)),
    ):
        if values.shape != shape:
            raise OptionError(f"{name} must have shape {shape}, got {values.shape}")
    if not all(np.isfinite(values).all() for values in (turns, pushes, bases)):
        raise OptionError("rotations, torques and frames must be finite")
    rms = np.sqrt((turns**2).mean(axis=(0, 1)))
    axes: dict[str, Any] = {
        f"{name}_rms": float(value) for name, value in zip(AXIS_NAMES, rms, strict=True)
    }
    for axis, name in enumerate(AXIS_NAMES):
        moves = rms[axis] > _STILL * rms.max() and np.ptp(turns[..., axis], axis=0).any()
        axes[name] = None
        if moves:
            axes[name] = analyse_gait(times, turns[..., axis], pushes[..., axis], at)
    bending = _bending(turns)
    flat = turns[..., :2].reshape(len(turns), -1)
    rates = _roll_rates(bases) / float(np.diff(np.asarray(times, dtype=np.float64)[:2])[0])
    twist_per_length = 1.0 / at[0] if len(at) == 1 else (len(at) - 1) / (at[-1] - at[0])
    return SpatialGait(
        frequency=dominant_frequency(times, flat),
        **axes,
        body=bending_ellipse(bending),
        joints=tuple(bending_ellipse(one[:, None]) for one in bending.T),
        handedness=-helicity(bending.T) if bending.shape[1] > 1 else 0.0,
        torsion=float(rms[2] * twist_per_length),
        roll_rate=float(rates.mean()),
        roll_swing=float(rates.std()),
        forward_speed=forward_speed,
    )


def _bending(rotations: Array) -> Complex:
    """Return yaw + i pitch of rotations (T, J, 3) without its mean over time, (T, J)."""
    bending = rotations[..., 1] + 1j * rotations[..., 0]
    swing: Complex = bending - bending.mean(axis=0)
    return swing


def bending_ellipse(bending: Complex) -> Ellipse:
    """Return the ellipse of bending vectors yaw + i pitch (rad) without their means, (T, J)."""
    # The covariance's mean diagonal, and half of its difference with its off-diagonal entry.
    size = 0.5 * float((np.abs(bending) ** 2).mean())
    shape = 0.5 * complex((bending**2).mean())
    # A cosine's variance is half its squared amplitude.
    major, minor = (math.sqrt(2.0 * max(0.0, size + sign * abs(shape))) for sign in (1, -1))
    return Ellipse(
        major=major,
        minor=minor,
        ratio=minor / major if major else 0.0,
        angle=plane_angle(shape),
        whirl=helicity(bending),
    )


def plane_angle(doubled: complex) -> float:
    """Return half the argument of a number (rad), above -pi/2 and at most pi/2.

    Planes are the same after half a turn, so exp(2 i angle) stands for one.
    """
    angle = 0.5 * math.atan2(doubled.imag, doubled.real)
    return angle if angle > -0.5 * math.pi else 0.5 * math.pi


def helicity(bending: Complex) -> float:
    """Return how bending vectors turn from row to row of (K, ...), -1 to 1.

    It is Im(conj(z) z') over the root mean squares of z, in the middle between rows, and of z',
    their difference: 1 or -1 where they turn by equal angles at equal size, 2 a b/(a^2 + b^2) with
    the sign of the turn on an ellipse with semi-axes a and b, and 0 in a plane.
    """
    middle, change = 0.5 * (bending[1:] + bending[:-1]), np.diff(bending, axis=0)
    scale = math.sqrt(float((np.abs(middle) ** 2).sum() * (np.abs(change) ** 2).sum()))
    return float((middle.conj() * change).imag.sum()) / scale if scale else 0.0


def _roll_rates(frames: Array) -> Array:
    """Return by how much frames turn about their own d3 from one to the next, (T - 1,) (rad)."""
    from scipy.spatial.transform import Rotation

    turns = np.swapaxes(frames[:-1], -1, -2) @ frames[1:]
    rates: Array = Rotation.from_matrix(turns).as_rotvec()[:, 2]
    return rates
