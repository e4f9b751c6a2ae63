"""The batched environments: many bodies in one process, stepped by threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from types import NoneType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swim_env.envs.episodes import LastObservations, Reasons, whole_number
from swim_env.envs.interface import (
    Observation,
    Overrides,
    SceneLike,
    SharedInterface,
    action_space_of,
    checked_render_mode,
    checked_seed,
    observation_space_of,
    task_of,
)
from swim_env.envs.tasks import (
    TARGET_BEARING,
    TARGET_DISTANCE,
    TARGET_RADIUS,
    StartPlan,
    TaskLike,
)
from swim_env.errors import OptionError, SwimError
from swim_env.physics.runtime.threads import usable_threads
from swim_env.scene.checks import got, listed, scalar, whole
from swim_env.sim.trajectory import TrajectoryBase

#: What all members share, what of it can be set, and methods of each that move nothing.
MEMBERS_SHARE = (
    "action_space",
    "metadata",
    "observation_space",
    "render_mode",
    "scene",
    "spec",
    "task",
)
SETTABLE = ("render_mode", "spec")
MEMBER_METHODS = ("recorded", "render", "snapshot")

Booleans = NDArray[np.bool_]

#: Largest number of members; memory ends sooner.
MOST_MEMBERS = 1_000_000


class SwimVectorEnv(
    SharedInterface,
    gymnasium.vector.VectorEnv[Observation, NDArray[Any], NDArray[Any]],
):
    """Many `SwimEnv` in one, each member bit for bit what it would be alone.

    ``gymnasium.make_vec("swim_env/KirchhoffSwimmer-v0", num_envs=64)``

    Actions, observations, rewards and infos are those of `SwimEnv` in Gymnasium's batched form:
    arrays whose first axis is the member, and infos with a mask ``_key`` for every key. Members
    that have ended start again in the next step, whose action they ignore (NEXT_STEP, the default);
    in the same step, with ``final_obs`` and ``final_info`` in the infos (SAME_STEP); or only by
    ``reset(options={"reset_mask": ...})`` (DISABLED).

    Parameters
    ----------
    num_envs : int
        Number M of members.
    scene, overrides, render_mode, effort_weight, heading_weight
        As for `SwimEnv`.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        ``NextStep``, ``SameStep`` or ``Disabled``.
    max_episode_steps : int, optional
        Number of actions in an episode, as for `SwimEnv`.
    num_threads : int, optional
        Largest number of threads; by default as many as numba uses at this moment.
    task, task_options
        As for `SwimEnv`.

    Raises
    ------
    SceneError
        If there is no such scene, or its control interval is not a whole number of time steps.
    TaskError
        If what the task's methods return cannot be used.
    OptionError
        If another argument cannot be used.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "swimmer",
        overrides: Overrides | None = None,
        render_mode: str | None = None,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
        task: TaskLike = "forward",
        task_options: Mapping[str, Any] | None = None,
    ) -> None:
        self.num_envs = whole_number(num_envs, "num_envs", MOST_MEMBERS)
        self.autoreset_mode = _checked_mode(autoreset_mode)
        made = task_of(task, scene, overrides, task_options, effort_weight, heading_weight)
        try:
            self._set_up_episodes(
                made, render_mode, num_threads, count=self.num_envs, limit=max_episode_steps
            )
        except MemoryError:
            raise OptionError(
                f"{self.num_envs} members of scene {made.scene.name} do not fit into memory; "
                "num_envs must be smaller"
            ) from None
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self.single_action_space = action_space_of(made.scene)
        self.single_observation_space = observation_space_of(made)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._randoms: list[np.random.Generator | None] = [None] * self.num_envs
        self._threads = self.num_threads or usable_threads()

    def recorded(self, member: int) -> TrajectoryBase:
        """Return a member's trajectory since its last reset, of a scene with the effect recording.

        Raises
        ------
        OptionError
            If the scene has no recording, or there is no such member.
        """
        index = whole(member)
        if index is None:
            raise OptionError(f"member must be a whole number, got {got(member)}")
        if not 0 <= index < self.num_envs:
            raise OptionError(f"member must be 0 to {self.num_envs - 1}, got {member}")
        return self.episodes.recorded(index)

    # ---- Gymnasium's methods -------------------------------------------------------------------

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start all members, or those of a mask.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Member i is seeded with seed + i, or with the i-th of a sequence. Without a seed the
            members' generators continue.
        options : mapping, optional
            As for `SwimEnv`, for all members; and ``reset_mask``, an (M,) array of bool that says
            which members to start.

        Raises
        ------
        gymnasium.error.Error
            If a seed is not a whole number of at least 0.
        OptionError
            If an option cannot be used.
        SimulationEndedError
            If a start cannot be simulated. Nothing has changed after any of these errors.
        """
        plan, mask = self._plan_and_mask(options)
        fresh = self._seeded(seed)
        found = {}
        for member in np.flatnonzero(mask).tolist():
            # A copy: if a later member has no start, none has drawn any numbers.
            random = deepcopy(fresh[member] or self._randoms[member]) or seeding.np_random()[0]
            found[member] = random, self.episodes.find_start(member, random, plan)
        for member, (random, start) in found.items():
            self._randoms[member] = random
            self.episodes.begin(member, *start)
            self._forget_frames(member)
        results = self.episodes.results()
        if np.ndim(seed) == 0:  # type: ignore[arg-type]
            super().reset(seed=checked_seed(seed))  # type: ignore[arg-type]
        self._show()
        infos = results.infos if mask.all() else self._masked_infos(mask)
        return results.observations, infos

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[np.float64], Booleans, Booleans, dict[str, Any]]:
        """Hold an action for each member over one control interval.

        Parameters
        ----------
        actions : (M, N - 1) array_like
            Actions.

        Raises
        ------
        ActionError
            If they are not finite numbers of that shape; no member has moved.
        gymnasium.error.ResetNeeded
            Before the first reset, or where a member has ended and the mode is DISABLED.
        """
        self._need_reset("step")
        episodes = self.episodes
        moving = episodes.all_members
        if episodes.someone_ended:
            ended = episodes.terminated | episodes.truncated
            if self.autoreset_mode is AutoresetMode.DISABLED:
                raise gymnasium.error.ResetNeeded(
                    f"members {np.flatnonzero(ended).tolist()} have ended; start them by "
                    "reset(options={'reset_mask': ...})"
                )
            moving = np.flatnonzero(~ended)
            episodes.take(actions, False, moving)
            for member in np.flatnonzero(ended).tolist():
                self._restart(member)
        else:
            episodes.take(actions, False, moving)
        episodes.play(moving, self._threads)
        observations, rewards, terminated, truncated, infos = episodes.results()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and episodes.someone_ended:
            last: dict[str, Any] = {}
            for member in np.flatnonzero(terminated | truncated).tolist():
                final = {"final_obs": observations[member], "final_info": episodes.info(member)}
                last = self._add_info(last, final, member)
                self._restart(member)
            observations, _, _, _, infos = episodes.results()
            reasons = last["final_info"]["termination_reason"]
            last["final_info"]["termination_reason"] = Reasons.of(reasons, episodes.reasons)
            last["final_obs"] = last["final_obs"].view(LastObservations)
            infos.update(last)
        self._show()
        return observations, rewards, terminated, truncated, infos

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what every member has or, of a method, returns by a name, as `SyncVectorEnv` does.

        Members share ``scene``, ``task``, ``spec``, ``render_mode``, ``metadata``,
        ``action_space`` and ``observation_space``. Their own are ``coordinates``, ``velocity``,
        ``torques``, ``goal``, ``steps`` and ``np_random``, and the methods ``render``,
        ``snapshot`` and ``recorded``. A member is no object that could be moved without the others.

        Raises
        ------
        AttributeError
            If members have nothing of that name.
        """
        members = range(self.num_envs)
        if (args or kwargs) and name in MEMBER_METHODS:
            raise TypeError(f"{name} takes no arguments")
        if name == "render":
            frames = self.render()
            return (None,) * self.num_envs if frames is None else tuple(frames)
        if name == "snapshot":
            snapshot = self.snapshot()
            return tuple(snapshot.member(member) for member in members)
        if name == "recorded":
            return tuple(self.recorded(member) for member in members)
        if name in MEMBERS_SHARE:
            value = getattr(self, f"single_{name}" if name.endswith("_space") else name)
            if name == "metadata":  # a single environment knows no autoreset mode
                value = {key: item for key, item in value.items() if key != "autoreset_mode"}
            return (value,) * self.num_envs
        if name == "np_random":
            return tuple(self._generators("random numbers need"))
        bodies, episodes = self.episodes.bodies, self.episodes
        own = {
            "coordinates": bodies.coordinates,
            "velocity": bodies.velocities,
            "torques": episodes.torques[:, 0],
            "goal": episodes.goals,
        }
        if name in own:
            return tuple(np.array(own[name][member]) for member in members)
        if name == "steps":
            return tuple(map(int, bodies.steps_taken))
        known = ", ".join(sorted((*MEMBERS_SHARE, *own, *MEMBER_METHODS, "np_random", "steps")))
        raise AttributeError(f"a member of the batch has no attribute {name!r}; it has {known}")

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every member, see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set ``render_mode`` or ``spec`` of all members, to one value or to M equal ones.

        Raises
        ------
        AttributeError
            If it is nothing that can be set.
        OptionError
            If the values are not M, or differ, as members share it.
        """
        if name not in SETTABLE:
            raise AttributeError(
                f"{name} of a batch cannot be set; what can is {' and '.join(SETTABLE)}"
            )
        items = listed(values)
        given = [values] * self.num_envs if items is None else items
        if name == "render_mode":
            given = [checked_render_mode(scalar(one)) for one in given]
        elif any(not isinstance(one, (EnvSpec, NoneType)) for one in given):
            raise OptionError("spec must be an EnvSpec of Gymnasium or None")
        if len(given) != self.num_envs or any(one != given[0] for one in given):
            raise OptionError(
                f"all members share {name}: it must be one value or {self.num_envs} equal ones"
            )
        setattr(self, name, given[0])

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window, if there is one."""
        self._close_viewer()

    def _restart(self, member: int) -> None:
        random = self._randoms[member]
        assert random is not None
        self.episodes.start(member, random, self.task.plan_start())
        self._forget_frames(member)

    def _masked_infos(self, mask: Booleans) -> dict[str, Any]:
        """Return infos of the members of a mask only, in the form of Gymnasium's own."""
        infos: dict[str, Any] = {}
        for member in np.flatnonzero(mask):
            infos = self._add_info(infos, self.episodes.info(int(member)), int(member))
        infos["termination_reason"] = Reasons.of(infos["termination_reason"], self.episodes.reasons)
        return infos

    def _plan_and_mask(self, options: Mapping[str, Any] | None) -> tuple[StartPlan, Booleans]:
        all_members = np.ones(self.num_envs, dtype=np.bool_)
        if not isinstance(options, Mapping) or "reset_mask" not in options:
            return self.task.plan_start(options), all_members
        mask = options["reset_mask"]
        if (
            not isinstance(mask, np.ndarray)
            or mask.dtype != np.bool_
            or mask.shape != all_members.shape
            or not mask.any()
        ):
            raise OptionError(
                f"option reset_mask must be an array of {self.num_envs} bools, at least one of "
                f"them true, got {_described(mask)}"
            )
        if not (self.episodes.is_reset or mask.all()):
            raise OptionError("the first reset has to start all members, reset_mask leaves some")
        rest = {name: value for name, value in options.items() if name != "reset_mask"}
        return self.task.plan_start(rest), mask

    def _seeded(
        self, seed: int | Sequence[int | None] | NDArray[np.int64] | None
    ) -> list[np.random.Generator | None]:
        """Return new generators where seeds are given, None where not."""
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, np.ndarray) and seed.ndim:
            seed = seed.tolist()
        if isinstance(seed, Sequence) and not isinstance(seed, (str, bytes)):
            seeds = list(seed)
            if len(seeds) != self.num_envs:
                raise OptionError(
                    f"seed must be one number or {self.num_envs} of them, got {len(seeds)}"
                )
        else:
            first = checked_seed(seed)  # type: ignore[arg-type]
            assert first is not None
            seeds = [first + i for i in range(self.num_envs)]
        seeds = [checked_seed(one, f"seed of member {i}: ") for i, one in enumerate(seeds)]
        return [None if one is None else seeding.np_random(one)[0] for one in seeds]

    def _generators(self, wish: str = "snapshots need") -> list[np.random.Generator]:
        randoms = [random for random in self._randoms if random is not None]
        if len(randoms) < self.num_envs:
            raise SwimError(f"{wish} an episode: call reset first")
        return randoms


class SwimTargetVectorEnv(SwimVectorEnv):
    """Many `SwimTargetEnv` in one.

    ``gymnasium.make_vec("swim_env/KirchhoffSwimmerTarget-v0", num_envs=64)``

    Parameters
    ----------
    num_envs, scene, overrides, render_mode, effort_weight, heading_weight
        As for `SwimVectorEnv`.
    autoreset_mode, max_episode_steps, num_threads
        As for `SwimVectorEnv`.
    target_distance, target_bearing, target_radius
        As for `SwimTargetEnv`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "swimmer",
        overrides: Overrides | None = None,
        render_mode: str | None = None,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
        target_distance: Sequence[float] = TARGET_DISTANCE,
        target_bearing: float = TARGET_BEARING,
        target_radius: float = TARGET_RADIUS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
    ) -> None:
        options = {
            "target_distance": target_distance,
            "target_bearing": target_bearing,
            "target_radius": target_radius,
        }
        super().__init__(
            num_envs,
            scene,
            overrides,
            render_mode,
            effort_weight,
            heading_weight,
            autoreset_mode,
            max_episode_steps,
            num_threads,
            task="target",
            task_options=options,
        )


def _described(mask: object) -> str:
    """Say in a few words what a refused mask is."""
    if isinstance(mask, np.ndarray):
        return f"an array of {mask.dtype} and shape {mask.shape}, {np.count_nonzero(mask)} true"
    return "None" if mask is None else got(mask)


def _checked_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return a mode by its value or its name."""
    for known in AutoresetMode:
        if mode is known or (isinstance(mode, str) and mode in (known.value, known.name)):
            return known
    names = ", ".join(known.value for known in AutoresetMode)
    raise OptionError(f"unknown autoreset_mode {mode!r}; modes: {names}")
