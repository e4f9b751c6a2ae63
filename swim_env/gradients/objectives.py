"""What gradients are of: measures of a run that add up over its steps, and functions of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError
from swim_env.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stretch:
    """Some steps of a run in a row, S of the T that it has.

    Attributes
    ----------
    scene : Scene
        What moves.
    first, total : int
        The number of steps before, and T.
    coordinates : (S + 1, C) array
        Minimal coordinates before and after every step: in the plane the mean centre (m), the
        angle of element 1 and the joint angles (rad), C = N + 2; in space see
        `swim_env.physics.spatial.chain`, C = 4 N + 3.
    momenta : (S + 1, M) array
        Momenta that belong to them, M = N + 2 or 3 N + 3.
    torques : (S, ...) array
        Joint torques (N m).
    joints : (S + 1, ...) array
        Joint angles, in space the joints' rotation vectors (rad), as torques are laid out.
    """

    scene: Scene
    first: int
    total: int
    coordinates: Array
    momenta: Array
    torques: Array
    joints: Array


@dataclass
class Slopes:
    """Derivatives of a scalar by what a `Stretch` has, each an array like it, or None for zero."""

    coordinates: Array | None = None
    momenta: Array | None = None
    torques: Array | None = None
    joints: Array | None = None


#: Takes a stretch and returns its share of a sum over the run, and the derivatives.
Measure = Callable[[Stretch], tuple[float, Slopes]]


@dataclass(frozen=True)
class Objective:
    """A function of measures of a run.

    Attributes
    ----------
    measures : tuple of Measure
        What it is made of.
    combine : callable
        Takes the measures' sums and returns the objective's value and its derivatives by them.
    whole : bool
        Whether the measures need all steps at once.
    """

    measures: tuple[Measure, ...]
    combine: Callable[[Array], tuple[float, ArrayLike]] = field(
        default=lambda sums: (float(sums[0]), [1.0])
    )
    whole: bool = False


def displacement(stretch: Stretch) -> tuple[float, Slopes]:
    """Displacement of the mean centre along the scene's heading (BL)."""
    heading = np.array(stretch.scene.episode.heading) / stretch.scene.beam.length
    q = stretch.coordinates
    slopes = np.zeros_like(q)
    axes = slice(0, heading.size)
    slopes[-1, axes] = heading
    slopes[0, axes] = -heading
    return float((q[-1, axes] - q[0, axes]) @ heading), Slopes(coordinates=slopes)


def turn(stretch: Stretch) -> tuple[float, Slopes]:
    """Change of the mean element angle (rad), in the plane."""
    if stretch.scene.dimension != 2:
        raise OptionError(
            "the objective turn is one of the plane; in space give a function of the run"
        )
    q = stretch.coordinates
    elements = stretch.scene.beam.elements
    weights = np.zeros(q.shape[1])
    # A joint turns all that is behind it.
    weights[2:] = np.arange(elements, 0, -1) / elements
    slopes = np.zeros_like(q)
    slopes[-1], slopes[0] = weights, -weights
    return float((q[-1] - q[0]) @ weights), Slopes(coordinates=slopes)


def _work_with(weights: Callable[[Array], Array], stretch: Stretch) -> tuple[float, Slopes]:
    """Return a weighted sum of the work at each joint in each step (J)."""
    changes = np.diff(stretch.joints, axis=0)
    works = stretch.torques * changes
    share = weights(works)
    joints = np.zeros_like(stretch.joints)
    joints[1:] += share * stretch.torques
    joints[:-1] -= share * stretch.torques
    return float((share * works).sum()), Slopes(torques=share * changes, joints=joints)


def work(stretch: Stretch) -> tuple[float, Slopes]:
    """Work of the joint torques (J)."""
    return _work_with(np.ones_like, stretch)


def positive_work(stretch: Stretch) -> tuple[float, Slopes]:
    """Work where it is positive, summed over joints and steps (J)."""
    return _work_with(lambda works: (works > 0.0).astype(np.float64), stretch)


def squared_torque(stretch: Stretch) -> tuple[float, Slopes]:
    """Mean square of the torques, as shares of the scene's limits, over joints, axes and time."""
    limits = np.ones(stretch.torques.shape[1:])
    if stretch.scene.dimension == 3:
        axes = [("pitch", "yaw", "roll").index(name) for name in stretch.scene.axes]
        limits[:, axes] = stretch.scene.action_limits[: len(axes)]
    else:
        limits[:] = stretch.scene.torque_limit
    count = stretch.total * stretch.scene.action_limits.size
    weights = 1.0 / (count * limits**2)
    return (
        float((weights * stretch.torques**2).sum()),
        Slopes(torques=2.0 * weights * stretch.torques),
    )


def path_error(path: ArrayLike) -> Objective:
    """Return the objective of how far the mean centre is from where it should be.

    Parameters
    ----------
    path : (T + 1, D) array_like
        Places (m) at the start and after every step, D the scene's dimension.

    Returns
    -------
    Objective
        The mean over all times of the squared distance (BL^2).
    """
    places = np.array(path, dtype=np.float64)
    if places.ndim != 2 or not np.isfinite(places).all():
        raise OptionError(
            f"path must be finite places of shape (T + 1, D), got an array of {places.shape}"
        )

    def measure(stretch: Stretch) -> tuple[float, Slopes]:
        axes = stretch.scene.dimension
        if places.shape != (stretch.total + 1, axes):
            raise OptionError(
                f"path must have the shape {(stretch.total + 1, axes)}, got {places.shape}"
            )
        # The first of a stretch was the last of the one before.
        begin = 0 if stretch.first == 0 else 1
        here = places[stretch.first : stretch.first + len(stretch.coordinates)]
        away = stretch.coordinates[:, :axes] - here
        away[:begin] = 0.0
        weight = 1.0 / (len(places) * stretch.scene.beam.length**2)
        slopes = np.zeros_like(stretch.coordinates)
        slopes[:, :axes] = 2.0 * weight * away
        return float(weight * (away**2).sum()), Slopes(coordinates=slopes)

    return Objective((measure,))


def _ratio(sums: Array) -> tuple[float, list[float]]:
    """Return displacement per positive work (BL/J)."""
    moved, spent = sums
    if not spent > 0.0:
        raise OptionError(f"the efficiency needs positive work, the run's is {spent:g} J")
    return moved / spent, [1.0 / spent, -moved / spent**2]


#: Objectives by name.
OBJECTIVES: Mapping[str, Objective] = {
    "displacement": Objective((displacement,)),
    "turn": Objective((turn,)),
    "work": Objective((work,)),
    "positive_work": Objective((positive_work,)),
    "squared_torque": Objective((squared_torque,)),
    "efficiency": Objective((displacement, positive_work), _ratio),
}


def objective_of(given: Any) -> Objective:
    """Return an objective from what a caller gave: a name, an Objective or a function of the run.

    A function takes the run as a `Stretch` of all its steps and returns its value and the
    derivatives: `Slopes`, a mapping from names of a stretch's arrays to them, or an array by the
    coordinates.

    Raises
    ------
    OptionError
        If it is none of them.
    """
    if isinstance(given, Objective):
        return given
    if isinstance(given, str) and given in OBJECTIVES:
        return OBJECTIVES[given]
    if not callable(given):
        raise OptionError(
            f"objective must be one of {', '.join(OBJECTIVES)}, an Objective or a function of the "
            f"run, got {given!r}"
        )

    def measure(stretch: Stretch) -> tuple[float, Slopes]:
        returned = given(stretch)
        try:
            value, slopes = returned
            if not isinstance(slopes, (Slopes, Mapping)):
                slopes = {"coordinates": slopes}
            by = slopes if isinstance(slopes, Mapping) else vars(slopes)
            arrays = {
                name: np.asarray(one, dtype=np.float64)
                for name, one in by.items()
                if one is not None
            }
            value, found = float(value), Slopes(**arrays)
        except (TypeError, ValueError) as error:
            raise OptionError(
                f"the objective must return its value and its derivatives, see Slopes: {error}"
            ) from error
        for name, one in arrays.items():
            wanted = getattr(stretch, name).shape
            if one.shape != wanted or not np.isfinite(one).all():
                raise OptionError(
                    f"the objective's derivatives by {name} must have the shape {wanted} and be "
                    f"finite, got {one.shape}"
                )
        return value, found

    return Objective((measure,), whole=True)
