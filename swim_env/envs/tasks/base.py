"""What a task is: where an episode starts, what its goal is, what is seen and rewarded, its end."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import TASK_SETTINGS
from swim_env.envs.geometry.base import Geometry, StartPlan, geometry_of
from swim_env.envs.tasks.moment import Moment
from swim_env.errors import OptionError, SceneError, TaskError
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, got, integer, nearest, real

if TYPE_CHECKING:
    from swim_env.envs.tasks.layout import Layout

Array = NDArray[np.float64]

#: Checks of an episode's seed, and of the factor on the noise of its start.
SEED, NOISE = integer(0, 10**40), real(at_least=0.0, at_most=1e6)

#: Set in a module that `swim_env.envs.tasks.find_task` has read from a file: the file.
FILE_OF_MODULE = "__task_file__"

#: What Python calls the script that it runs, and that script in a process that it has spawned.
SCRIPT = ("__main__", "__mp_main__")


class Start(NamedTuple):
    """Where an episode begins.

    Attributes
    ----------
    coordinates : (N + 2,) array, in space (4 N + 3,)
        Mean centre (m), angle of element 1 and joint angles (rad), or quaternions.
    velocity : (N + 2,) array, in space (3 N + 3,)
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
    goal : (D,) array
        A direction, or a point (m).
    state : mapping
        What `Task.draw_state` has drawn.
    """

    coordinates: Array
    velocity: Array
    goal: Array
    state: Mapping[str, Any] = {}


class Task:
    """Base of the tasks: swim along the scene's heading, until a subclass says otherwise.

    A subclass overrides what it changes of `draw_goal`, `reward`, `ends`, `observe`, `info`,
    `state`, `draw_state`, `update` and `update_goal`. Those from `reward` on take a `Moment`, work
    on all members at once, and return new arrays whose first axis is the member. What is not
    overridden costs nothing. docs/environments/tasks.md has examples.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    effort_weight : float
        What an action of 1 at all joints costs in a second (BL/s), at least 0.
    heading_weight : float
        What pointing at a right angle to the goal costs in a second (BL/s), at least 0.

    Attributes
    ----------
    name : str
        What finds the class again: a shipped name, ``module:Class`` or ``FILE.py:Class``.
    goal_is_point : bool
        Whether the goal is a point (m) or a direction (unit vector).
    parts : tuple of str
        What is observed, in order, of the STANDARD_PARTS and what `observe` returns; what is not
        named of the latter follows. Unless given, all of the STANDARD_PARTS that the goal has.
    reasons : mapping
        Why an episode may end, beside those of the physics, and what each reason means.
    successes : tuple of str
        The `reasons` that count as success.
    unit : str
        Of the reward.
    own_options : tuple of str
        Options of `reset`, beside the start's noise and the fields of a scene's initial state.
    ends_at_goal : bool
        Whether the episode ends, with success, at `radius` from a point.
    radius : float
        Of a point (BL), also where it is drawn.

    Raises
    ------
    OptionError
        If a weight is not a number of at least 0.
    """

    name: ClassVar[str]
    goal_is_point: ClassVar[bool] = False
    parts: ClassVar[tuple[str, ...]] = ()
    reasons: ClassVar[Mapping[str, str]] = {}
    successes: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = "BL"
    own_options: ClassVar[tuple[str, ...]] = ()
    ends_at_goal: ClassVar[bool] = False
    radius: float = 0.1

    _made_of: tuple[tuple[Any, ...], dict[str, Any]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Name the class after where it can be found again."""
        super().__init_subclass__(**kwargs)
        module = sys.modules.get(cls.__module__)
        place = getattr(module, FILE_OF_MODULE, None)
        if cls.__module__ in SCRIPT:  # another process finds it in the file alone
            place = getattr(module, "__file__", None)
        cls.name = f"{place or cls.__module__}:{cls.__qualname__}"

    def __new__(cls, *arguments: Any, **options: Any) -> Self:
        """Remember what the task is made of."""
        task = super().__new__(cls)
        vars(task)["_made_of"] = arguments, options
        return task

    def __init__(
        self, scene: Scene, effort_weight: float = 0.0, heading_weight: float = 0.0
    ) -> None:
        self.scene = scene
        weight = real("BL/s", at_least=0.0)
        self.effort_weight = checked_option(weight, effort_weight, "effort_weight")
        self.heading_weight = checked_option(weight, heading_weight, "heading_weight")

    # ---- what a task may override --------------------------------------------------------------

    def draw_goal(self, random: np.random.Generator) -> Array:
        """Return an episode's goal, (D,): a direction, or the way from the mean centre to it (m).

        The scene's heading unless overridden, and the mean centre itself where it is a point.
        """
        if self.goal_is_point:
            return np.zeros(self.scene.dimension)
        return np.array(self.scene.episode.heading)

    def reward(self, now: Moment) -> Mapping[str, Array]:
        """Return the terms of an action's reward by name, (m,) each; the reward is their sum."""
        return now.terms

    def ends(self, now: Moment) -> Mapping[str, NDArray[np.bool_]]:
        """Return by `reasons` which members end after an action, (m,) each; the first counts."""
        return {}

    def observe(self, now: Moment) -> Mapping[str, Array]:
        """Return observations of the task's own by name, (m,) or (m, k) each, of order one."""
        return {}

    def info(self, now: Moment) -> Mapping[str, Array]:
        """Return more figures for `info` by name, (m,) each, which may replace ``progress``."""
        return {}

    def state(self, count: int) -> dict[str, NDArray[Any]]:
        """Return arrays (count, ...) that the task keeps of members, as they are at a start."""
        return {}

    def draw_state(self, random: np.random.Generator) -> Mapping[str, Any]:
        """Return what is drawn of a member's `state` at its start, by name."""
        return {}

    def update(self, now: Moment) -> None:
        """Write into `Moment.state`, first of all after a start or an action."""

    def update_goal(self, now: Moment) -> Array:
        """Return goals (m, D), unit vectors or points (m), after `update`.

        At a start one that it has returned before must stay as it is: comparisons begin again
        with the goal that an episode began with.
        """
        goals: Array = now.goal
        return goals

    # ---- what follows from it ------------------------------------------------------------------

    def overrides(self, method: str) -> bool:
        """Return whether a method is not that of this base."""
        return getattr(type(self), method) is not getattr(Task, method)

    @cached_property
    def geometry(self) -> Geometry:
        """What environments of the scene's dimension have of their own."""
        return geometry_of(self.scene)

    @cached_property
    def layout(self) -> Layout:
        """What the task's methods return; a TaskError if that cannot be used."""
        from swim_env.envs.tasks.layout import layout_of

        return layout_of(self)

    @property
    def has_success(self) -> bool:
        """Whether an episode can succeed."""
        return self.ends_at_goal or bool(self.successes)

    @property
    def has_target(self) -> bool:
        """Whether the goal is a point to be reached: one that is drawn, and stays."""
        drawn = self.overrides("draw_goal") and not self.overrides("update_goal")
        return self.goal_is_point and drawn

    @property
    def _goal_counts(self) -> bool:
        """Whether displacement counts along the goal or towards it."""
        return self.has_target if self.goal_is_point else not self.overrides("update_goal")

    def displacement_aim(self, goal: Array) -> Array:
        """Return what net displacement counts along, (D,), or towards where there is a target.

        That is the goal of the start, or the scene's heading where the goal moves or is a point
        that is there from the start.
        """
        return goal if self._goal_counts else np.array(self.scene.episode.heading)

    @property
    def scored_by_displacement(self) -> bool:
        """Whether an episode's score is its net displacement (BL), or else its return."""
        return self._goal_counts and not self.overrides("reward")

    @property
    def score_name(self) -> str:
        """What the score is called, with its unit; larger is better."""
        return "net displacement (BL)" if self.scored_by_displacement else f"return ({self.unit})"

    @property
    def identity(self) -> tuple[object, ...]:
        """What distinguishes this task from others, for comparing snapshots: its options.

        It is a TaskError if one is neither a number nor text, nor a list, a mapping or an array of
        them.
        """
        arguments, options = self._made_of
        bound = inspect.signature(type(self).__init__).bind(self, *arguments, **options)
        bound.apply_defaults()
        _, *own = bound.arguments.items()
        return (self.name, *((name, self._fixed(name, value)) for name, value in own))

    def _fixed(self, name: str, value: Any) -> object:
        """Return an option in a form that cannot change."""
        if isinstance(value, (np.ndarray, np.generic)):
            value = value.tolist()
        if value is None or isinstance(value, (bool, int, float, complex, str, Scene)):
            return value
        if isinstance(value, Mapping):
            return frozenset((key, self._fixed(name, one)) for key, one in value.items())
        if isinstance(value, Sequence):
            return tuple(self._fixed(name, one) for one in value)
        raise TaskError(
            f"task {self.name}: option {name} must be numbers or text, or a list, a mapping or an "
            f"array of them, so that snapshots tell tasks apart, got {got(value)}"
        )

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Task) and self.identity == other.identity)

    def __hash__(self) -> int:
        return hash((self.name, self.scene.name))

    @property
    def observation_size(self) -> int:
        """Number of observed quantities."""
        return sum(self.layout.parts.values())

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
                    self.radius * beam.length if self.ends_at_goal else -1.0,
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
        known = ("noise", *self.geometry.start_fields, *self.own_options)
        for name in options:
            if name not in known:
                hint = nearest(str(name), known)
                raise OptionError(f"unknown option {name!r}{hint}; options: {', '.join(known)}")
        initial = self.scene.initial
        fields = self.geometry.start_fields
        changes = {name: options[name] for name in fields if name in options}
        try:
            if changes:
                initial = replace(initial, **changes)
            goal = self.given_goal(options)
            return StartPlan(
                *self.geometry.start(initial),
                noise=NOISE(options.get("noise", 1.0), "noise"),
                exact=frozenset(changes),
                initial=initial,
                goal=None if goal is None else self._checked_goal("given_goal", goal),
            )
        except SceneError as error:
            raise OptionError(f"option {error.problem.replace('initial.', '', 1)}") from None

    def draw_start(self, random: np.random.Generator, plan: StartPlan, share: float = 1.0) -> Start:
        """Draw the start of an episode, with a share of the plan's noise.

        The same numbers are drawn whatever the options, so options change what they name and
        nothing else.
        """
        noise = self.geometry.draw_noise(random, share * plan.noise)
        aim = self._checked_goal("draw_goal", self.draw_goal(random))
        state = self.draw_state(random)
        coordinates, velocity = self.geometry.disturbed(plan, noise)
        goal = plan.goal
        if goal is None:
            goal = coordinates[: aim.size] + aim if self.goal_is_point else aim
        return Start(coordinates, velocity, goal, state)

    def _checked_goal(self, method: str, value: object) -> Array:
        """Return a goal that one of the task's methods has returned."""
        goal, size = np.asarray(value), self.scene.dimension
        if goal.shape == (size,) and goal.dtype.kind in "fiu" and np.isfinite(goal).all():
            return goal.astype(np.float64)
        count = {2: "two", 3: "three"}[size]
        raise TaskError(
            f"task {self.name}: {method} must return {count} finite numbers, shape ({size},), got "
            f"{goal.tolist() if goal.size == size else f'an array of shape {goal.shape}'}"
        )

    @cached_property
    def _default_plan(self) -> StartPlan:
        return self.plan_start({})

    def given_goal(self, options: Mapping[str, Any]) -> Array | None:
        """Return the goal that the `own_options` give, a direction or a point (m), or None."""
        return None
