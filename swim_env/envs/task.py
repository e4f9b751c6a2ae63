"""Tasks: where an episode starts, what its goal is, and what is rewarded.

Both tasks reward progress in body lengths: along a direction, or towards a point.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import TASK_SETTINGS, VELOCITY_SCALE, observation_size
from swim_env.errors import OptionError, SceneError
from swim_env.scene import Initial, Scene
from swim_env.scene.checks import checked_option, got, integer, nearest, pair, real, reals
from swim_env.sim.batch import minimal_start

Array = NDArray[np.float64]

#: Where a target is drawn by default: distance (BL), bearing (rad), radius (BL).
TARGET_DISTANCE, TARGET_BEARING, TARGET_RADIUS = (0.5, 1.5), 0.5 * math.pi, 0.1

#: Checks of an episode's seed, and of the factor on the noise of its start.
SEED, NOISE = integer(0, 10**40), real(at_least=0.0, at_most=1e6)

_START_FIELDS = tuple(spec.name for spec in fields(Initial))


class Start(NamedTuple):
    """Where an episode begins.

    Attributes
    ----------
    coordinates : (N + 2,) array
        Mean centre (m), angle of element 1 and joint angles (rad).
    velocity : (N + 2,) array
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
    goal : (2,) array
        A direction, or a point (m).
    """

    coordinates: Array
    velocity: Array
    goal: Array


class StartPlan(NamedTuple):
    """A start without its noise, made of the checked options of a reset.

    Coordinates and velocity are as in `Start`, before noise, which has a factor; `exact` are the
    fields of the initial state that the options gave, `position` is the head's end node (m), and
    the goal is None unless the options gave one.
    """

    coordinates: Array
    velocity: Array
    noise: float
    exact: frozenset[str]
    position: tuple[float, float]
    goal: Array | None


class Task(ABC):
    """Base of the tasks.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    effort_weight : float
        What an action of 1 at all joints costs in a second (BL/s), at least 0.
    heading_weight : float
        What pointing at a right angle to the goal costs in a second (BL/s), at least 0.

    Raises
    ------
    OptionError
        If a weight is not a number of at least 0.
    """

    goal_is_point: ClassVar[bool]
    #: Options of `reset`, beside the start's noise and the fields of a scene's initial state.
    own_options: ClassVar[tuple[str, ...]] = ()
    radius = 0.0

    def __init__(
        self, scene: Scene, effort_weight: float = 0.0, heading_weight: float = 0.0
    ) -> None:
        self.scene = scene
        weight = real("BL/s", at_least=0.0)
        self.effort_weight = checked_option(weight, effort_weight, "effort_weight")
        self.heading_weight = checked_option(weight, heading_weight, "heading_weight")
        self._default_plan = self.plan_start({})

    @property
    def identity(self) -> tuple[object, ...]:
        """What distinguishes this task from others, for comparing snapshots."""
        return (type(self).__name__, self.scene, self.effort_weight, self.heading_weight)

    @property
    def observation_size(self) -> int:
        """Number of observed quantities."""
        return observation_size(self.scene.beam.elements, self.goal_is_point)

    def settings(self, actions_per_episode: int) -> NDArray[np.void]:
        """Return what `swim_env.envs.assessment.assess` needs to know of the task."""
        beam = self.scene.beam
        return np.array(
            [
                (
                    beam.length,
                    self.scene.integrator.time_step,
                    self.scene.episode.control_interval,
                    self.goal_is_point,
                    self.radius * beam.length,
                    self.effort_weight,
                    self.heading_weight,
                    actions_per_episode,
                )
            ],
            dtype=TASK_SETTINGS,
        )

    def plan_start(self, options: Mapping[str, Any] | None = None) -> StartPlan:
        """Check the options of a reset.

        Parameters
        ----------
        options : mapping, optional
            ``noise``: factor on all of the start's noise, 0 for none. Any field of a scene's
            `initial` block: that field is then exactly as given, and the noise that would touch
            it is left out.

        Raises
        ------
        OptionError
            If an option is unknown or has a value that cannot be used.
        """
        if options is None:
            return self._default_plan
        if not isinstance(options, Mapping):
            raise OptionError(f"options must be a mapping, got {got(options)}")
        known = ("noise", *_START_FIELDS, *self.own_options)
        for name in options:
            if name not in known:
                hint = nearest(str(name), known)
                raise OptionError(f"unknown option {name!r}{hint}; options: {', '.join(known)}")
        initial = self.scene.initial
        changes = {name: options[name] for name in _START_FIELDS if name in options}
        try:
            if changes:
                initial = replace(initial, **changes)
            return StartPlan(
                *minimal_start(self.scene, initial),
                noise=NOISE(options.get("noise", 1.0), "noise"),
                exact=frozenset(changes),
                position=initial.position,
                goal=self._given_goal(options),
            )
        except SceneError as error:
            raise OptionError(f"option {error.problem.replace('initial.', '', 1)}") from None

    def draw_start(self, random: np.random.Generator, plan: StartPlan, share: float = 1.0) -> Start:
        """Draw the start of an episode, with a share of the plan's noise.

        The same numbers are drawn whatever the options, so options change what they name and
        nothing else.
        """
        episode = self.scene.episode
        coordinates, velocity = plan.coordinates.copy(), plan.velocity.copy()
        exact = plan.exact
        joints = coordinates.size - 3
        noise = share * plan.noise
        bend = random.uniform(-1.0, 1.0, joints) * (noise * episode.bend_noise)
        turn = float(random.uniform(-1.0, 1.0)) * (noise * episode.heading_noise)
        speed = episode.velocity_noise
        if speed is None:
            speed = 1e-4 * (VELOCITY_SCALE / episode.control_interval * self.scene.beam.length)
        push = random.uniform(-1.0, 1.0, 3) * (noise * speed)
        aim = self._draw_aim(random)
        if "joint_angles" not in exact:
            coordinates[3:] += bend
            # The mean angle of the elements is the body's heading: bending leaves it alone.
            if "heading" not in exact:
                coordinates[2] -= float(np.cumsum(bend).sum()) / (joints + 1)
        if "heading" not in exact:
            coordinates[2] += turn
            if not exact & {"velocity", "velocity_slope"}:
                # The body is turned with the motion that it has through the fluid.
                drift = np.array(self.scene.stream.velocity if self.scene.stream else (0.0, 0.0))
                x, y = velocity[:2] - drift
                cosine, sine = math.cos(turn), math.sin(turn)
                velocity[:2] = (cosine * x - sine * y, sine * x + cosine * y) + drift
        if "position" in exact:
            # The head's end is where the option says, however the body is bent and turned.
            there = Initial(
                position=plan.position,
                heading=float(coordinates[2]),
                joint_angles=tuple(coordinates[3:].tolist()),
            )
            coordinates[:2] = there.pose(self.scene.beam)[0].mean(axis=0)
        if not exact & {"velocity", "velocity_slope"}:
            velocity[:2] += push[:2]
        if not exact & {"turning_rate", "velocity_slope"}:
            velocity[2:] += push[2] / self.scene.beam.length
        goal = plan.goal
        if goal is None:
            goal = coordinates[:2] + aim if self.goal_is_point else aim
        return Start(coordinates, velocity, goal)

    def _given_goal(self, options: Mapping[str, Any]) -> Array | None:
        return None

    @abstractmethod
    def _draw_aim(self, random: np.random.Generator) -> Array:
        """Return the goal's direction, or the way from the mean centre to its point (m)."""


class ForwardTask(Task):
    """Swim along the scene's heading; the reward is the net displacement in body lengths."""

    goal_is_point = False

    def _draw_aim(self, random: np.random.Generator) -> Array:
        return np.array(self.scene.episode.heading)


class TargetTask(Task):
    """Reach a point; the reward is the decrease of the mean centre's distance, in body lengths.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    distance : pair of float
        Least and largest distance of the point from the mean centre at the start (BL).
    bearing : float
        Largest angle between the scene's heading and the direction to the point (rad), up to pi.
    radius : float
        The point is reached when the mean centre is this close (BL).
    effort_weight, heading_weight : float
        As for `Task`.

    Raises
    ------
    OptionError
        If one of them cannot be used.
    """

    goal_is_point = True
    own_options = ("target",)

    def __init__(
        self,
        scene: Scene,
        distance: Sequence[float] = TARGET_DISTANCE,
        bearing: float = TARGET_BEARING,
        radius: float = TARGET_RADIUS,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
    ) -> None:
        super().__init__(scene, effort_weight, heading_weight)
        self.radius = checked_option(real("BL", above=0.0), radius, "target_radius")
        bounds = checked_option(reals("BL"), distance, "target_distance")
        if len(bounds) != 2 or not self.radius < bounds[0] <= bounds[1]:
            raise OptionError(
                "target_distance must be two numbers in BL, the least above target_radius "
                f"({self.radius:g}) and the largest not below it, got {list(bounds)}"
            )
        self.distance = bounds
        half_turn = real("rad", at_least=0.0, at_most=math.pi)
        self.bearing = checked_option(half_turn, bearing, "target_bearing")

    @property
    def identity(self) -> tuple[object, ...]:
        """What distinguishes this task from others, for comparing snapshots."""
        return (*super().identity, self.distance, self.bearing, self.radius)

    def _given_goal(self, options: Mapping[str, Any]) -> Array | None:
        if "target" not in options:
            return None
        return np.array(pair("m")(options["target"], "target"))

    def _draw_aim(self, random: np.random.Generator) -> Array:
        low, high = self.distance
        away = random.uniform(low, high) * self.scene.beam.length
        angle = random.uniform(-self.bearing, self.bearing)
        x, y = self.scene.episode.heading
        cosine, sine = math.cos(angle), math.sin(angle)
        return np.array([cosine * x - sine * y, sine * x + cosine * y]) * away


#: The tasks, where one is chosen by name.
TASKS: dict[str, type[Task]] = {"forward": ForwardTask, "target": TargetTask}


def check_task(name: str) -> str:
    """Return the name of a task, or raise OptionError if there is no such task."""
    if name not in TASKS:
        hint = nearest(str(name), TASKS)
        raise OptionError(f"unknown task {name!r}{hint}; tasks: {', '.join(TASKS)}")
    return name
