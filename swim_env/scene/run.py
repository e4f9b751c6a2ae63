"""How a scene is run: the integrator, and the episode that is played."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.checks import Check, Pair, one_of, real, vector

SCHEME_NAMES: tuple[str, ...] = ("paper", "composed")
"""Names that `Integrator.scheme` may have: of first order, and of second."""

STRAIN_NAMES: tuple[str, ...] = ("averaged_directors", "mean_angles", "joint_angle")
"""Names that `Integrator.strain` may have."""

ENERGY_EXCESSES: tuple[str, ...] = ("warn", "end")
"""Names that `Integrator.energy_excess` may have."""

TOLERANCE_RANGE: tuple[float, float] = (1e-13, 1e-4)
"""Smallest and largest `Integrator.tolerance`."""


@dataclass(frozen=True)
class Integrator(Block, path="integrator"):
    """How the motion is computed in time.

    Attributes
    ----------
    time_step : float
        Time step dt [s], above 0.
    tolerance : float
        Largest scaled residual of the step equations, dimensionless, 1e-13 to 1e-4.
    scheme : str
        One of `SCHEME_NAMES`: ``paper`` has the fluid's inertia at the beginning of a step and is
        of first order in it; ``composed`` is half a step of that followed by its adjoint, of
        second order, and takes prescribed torques at the middle of a step.
    strain : str
        One of `STRAIN_NAMES`: that of the directors averaged over a step, as in the paper, which
        softens where elements turn far in a step; sin(a)/dl at the mean joint angle a; or a/dl,
        whose moment does not fall again beyond 45 degrees.
    energy_tolerance : float
        Largest energy that a run may leave unexplained, |H - H_0 - work + dissipated| as a share
        of what went through, the largest energy and all that was dissipated, before it is said not
        to be trusted; above 0.
    energy_excess : str
        One of `ENERGY_EXCESSES`, what happens then: ``warn`` says so in every summary, ``end`` ends
        the run with the reason ``energy_unexplained``.
    """

    time_step: Annotated[float, real("s", above=0.0)] = 0.01
    tolerance: Annotated[float, real(at_least=TOLERANCE_RANGE[0], at_most=TOLERANCE_RANGE[1])] = (
        1e-10
    )
    scheme: Annotated[str, one_of(SCHEME_NAMES)] = "paper"
    strain: Annotated[str, one_of(STRAIN_NAMES)] = "averaged_directors"
    energy_tolerance: Annotated[float, real(above=0.0)] = 0.05
    energy_excess: Annotated[str, one_of(ENERGY_EXCESSES)] = "warn"


def direction(*components: str) -> Check[Any]:
    """Return a check for a unit vector with components of these names."""

    def check(value: object, field: str) -> tuple[float, ...]:
        heading = vector("", *components)(value, field)
        norm = math.hypot(*heading)
        if not abs(norm - 1.0) <= 1e-6:
            raise SceneError(
                f"{field} must be a unit vector ({', '.join(components)}), got {list(heading)} of "
                f"length {norm:.6g}"
            )
        return tuple(one / norm for one in heading)

    return check


@dataclass(frozen=True)
class EpisodeBase(Block, path="episode"):
    """How a scene is played: how long, and for learners, how often they act and for what.

    Attributes
    ----------
    duration : float
        Simulated time of an episode, and of a replay for which no other is given [s], above 0.
    control_interval : float
        Time over which an environment holds an action [s], above 0; environments need a whole
        number of time steps in it.
    heading : tuple of float
        Direction (x, y) or (x, y, z) in which an environment counts displacement, a unit vector.
        By default -x, which is head first for a body that starts along +x.
    bend_noise : float
        Environments start with joint angles that are off by up to this [rad], 0 to pi.
    heading_noise : float
        They start with the body turned by up to this [rad], 0 to pi.
    velocity_noise : float or None
        They start with a rigid motion whose components are off by up to this [m/s], at least 0:
        the velocity along every axis, and the turning rates times the body length. In an ideal
        fluid this impulse P stays, and about a body that swims away at speed U its moment grows as
        U P t: 1e-4 m/s turn a body of 1 m that swims 0.2 m/s by a radian in 80 s, however it
        swims. None for 2e-7 body lengths per control interval (1e-5 m/s for 1 m and 0.02 s).
    """

    duration: Annotated[float, real("s", above=0.0)] = 20.0
    control_interval: Annotated[float, real("s", above=0.0)] = 0.02
    heading: tuple[float, ...] = (-1.0, 0.0)
    bend_noise: Annotated[float, real("rad", at_least=0.0, at_most=math.pi)] = 0.01
    heading_noise: Annotated[float, real("rad", at_least=0.0, at_most=math.pi)] = 0.05
    velocity_noise: Annotated[float | None, real("m/s", at_least=0.0)] = None


@dataclass(frozen=True)
class Episode(EpisodeBase, path="episode"):
    """How a scene in the plane is played, see `EpisodeBase` for the fields."""

    heading: Annotated[Pair, direction("x", "y")] = (-1.0, 0.0)
