"""The batched environments as a `VecEnv` of stable-baselines3.

`DummyVecEnv` steps single environments one after another. Here the whole batch is stepped at once,
in threads, and the results are bit for bit the same.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_env import OptionError, SwimError, SwimVectorEnv
from swim_env.envs.vector import MEMBER_METHODS, SETTABLE


class TrainingExtraError(SwimError, ImportError):
    """What it takes to train is not installed."""


try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as _error:
    raise TrainingExtraError(
        f"training needs stable-baselines3 ({_error}): install the extra 'train' "
        "(pip install 'swim-env[train]')"
    ) from _error

__all__ = ["SwimVecEnv", "TrainingExtraError", "make_swim_vec_env"]

Members = int | Iterable[int] | None


class SwimVecEnv(VecEnv):  # type: ignore[misc]
    """M swimmers for the algorithms of stable-baselines3, all stepped at once.

    Observations, rewards, dones, infos and `reset_infos` are bit for bit those of a `DummyVecEnv`
    of M `SwimEnv` with the same seeds. Episode statistics need a `VecMonitor` around it, as for
    every environment that is batched by itself.

    `get_attr` and `env_method` read what `SwimVectorEnv.call` lists, and `set_attr` sets
    ``render_mode`` and ``spec``, for all members together. A member is no object of its own and
    cannot be moved without the others: `reset`, `step`, and `restore` of the batch itself, `batch`,
    move them all.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A `SwimVectorEnv` in autoreset mode SAME_STEP, with or without wrappers of Gymnasium for
        batches; another environment or mode is an OptionError.

    Attributes
    ----------
    env : gymnasium.vector.VectorEnv
        What is stepped, with its wrappers.
    batch : SwimVectorEnv
        The batch inside.
    """

    env: gymnasium.vector.VectorEnv[Any, Any, Any]

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        batch = getattr(env, "unwrapped", env)
        if not isinstance(batch, SwimVectorEnv):
            raise OptionError(
                "env must be a SwimVectorEnv, with or without wrappers for batches, got "
                f"{type(batch).__name__}"
            )
        if batch.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise OptionError(
                "stable-baselines3 starts members in the step of their end: make the environment "
                f"with autoreset_mode='SameStep', not {batch.autoreset_mode.value!r}"
            )
        self.env, self.batch = env, batch
        self._actions: NDArray[Any] | None = None
        self._was_reset = False
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = batch.get_attr("metadata")[0]

    @property
    def spec(self) -> gymnasium.envs.registration.EnvSpec | None:
        """What `gymnasium.make_vec` made the batch of; None without it."""
        return self.batch.spec

    # ---- running -------------------------------------------------------------------------------

    def set_options(
        self, options: Sequence[Mapping[str, Any]] | Mapping[str, Any] | None = None
    ) -> None:
        """Keep options of `SwimEnv.reset` for the next reset only: one mapping, or M of them.

        Another number of them is an OptionError. What they say is checked by `reset`.
        """
        if isinstance(options, Mapping):
            options = dict(options)
        elif options is not None:
            options = list(options)
            if len(options) != self.num_envs:
                raise OptionError(
                    f"options must be one mapping or {self.num_envs} of them, got {len(options)}"
                )
        super().set_options(options)

    def reset(self) -> NDArray[np.float32]:
        """Start all members, with the seeds and options that wait for it; return observations.

        An action that waits for `step_wait` is forgotten. Where a seed or an option cannot be used,
        nothing changes, and the seeds and options wait until a reset succeeds.
        """
        # Options are the same object for all members where they were given once for all.
        groups: dict[int, list[int]] = {}
        for member, options in enumerate(self._options):
            groups.setdefault(id(options) if options else 0, []).append(member)
        for members in groups.values():
            self.batch.task.plan_start(self._options[members[0]] or {})
        self._actions = None
        for members in groups.values():
            options = dict(self._options[members[0]] or {})
            # The batch's first reset has to start all members. The other groups start once more
            # then, from their seeds, or from random numbers that nobody has seen.
            if self._was_reset:
                options["reset_mask"] = np.isin(np.arange(self.num_envs), members)
            observations, batch = self.env.reset(seed=self._seeds, options=options)
            self._was_reset = True
            for member, info in zip(members, _dicts(batch, members), strict=True):
                self.reset_infos[member] = info
        self._reset_seeds()
        self._reset_options()
        found: NDArray[np.float32] = observations
        return found

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep actions, (M, N - 1), for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Hold the actions over one control interval, and restart the members that ended.

        Returns observations, (M, n), those of the new episodes where the old ones ended; rewards,
        (M,); which members ended, (M,); and each member's info of this action, as from
        `SwimEnv.step`, with ``TimeLimit.truncated``, whether nothing but the time ended the
        episode, and ``terminal_observation``, (n,), where it ended. Before the first reset, without
        actions, or with unusable ones no member moves: gymnasium's ResetNeeded, SwimError or
        ActionError.
        """
        if self._actions is None:
            raise SwimError("no actions to wait for: call step, or step_async before step_wait")
        actions, self._actions = self._actions, None
        observations, rewards, terminated, truncated, batch = self.env.step(actions)
        last, last_observations = batch.pop("final_info", None), batch.pop("final_obs", None)
        infos = _dicts(batch)
        dones = terminated | truncated
        ended = np.flatnonzero(dones)
        if ended.size:
            # The batch's infos are those of the new starts there.
            for member, info in zip(ended.tolist(), _dicts(last, ended), strict=True):
                self.reset_infos[member] = infos[member]
                # What a wrapper tells of the end is not in the environment's last info.
                infos[member] = {**infos[member], **info}
        for info, out_of_time in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = out_of_time
        for member in ended.tolist():
            infos[member]["terminal_observation"] = last_observations[member]
        return observations, rewards.astype(np.float32), dones, infos

    def close(self) -> None:
        """Close the batch. Closing twice does no harm."""
        self.env.close()

    # ---- members -------------------------------------------------------------------------------

    def get_attr(self, attr_name: str, indices: Members = None) -> list[Any]:
        """Return an attribute of members, all unless given; `SwimVecEnv` lists what there is."""
        members = self._members(indices)
        if attr_name in MEMBER_METHODS:
            return [partial(self._call, attr_name, member) for member in members]
        values = self.batch.get_attr(attr_name)
        return [values[member] for member in members]

    def set_attr(self, attr_name: str, value: Any, indices: Members = None) -> None:
        """Set ``render_mode`` or ``spec``, which all members share, for all of them at once."""
        members = self._members(indices)
        if attr_name in SETTABLE and len(set(members)) < self.num_envs:
            raise OptionError(
                f"all members share {attr_name}: it cannot be set for {len(set(members))} of "
                f"{self.num_envs}"
            )
        self.batch.set_attr(attr_name, value)
        self.render_mode = self.batch.render_mode

    def env_method(
        self, method_name: str, *method_args: Any, indices: Members = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``snapshot``, ``render`` or ``recorded`` of members, all unless given.

        ``snapshot`` returns a member's state as `SwimEnv.snapshot` does: a `SwimEnv` of the same
        scene can `restore` it and then does bit for bit what the member would. ``render``
        returns a member's frame.
        """
        members = self._members(indices)
        if method_name not in MEMBER_METHODS:
            hint = ""
            if callable(getattr(self.batch, method_name, None)):
                hint = f"; call it for the whole batch, as SwimVecEnv.batch.{method_name}"
            raise AttributeError(
                f"a member of the batch has no method {method_name!r} of its own, only "
                f"{', '.join(MEMBER_METHODS)}{hint}"
            )
        values = self.batch.call(method_name, *method_args, **method_kwargs)
        return [values[member] for member in members]

    def _call(self, name: str, member: int, *args: Any, **kwargs: Any) -> Any:
        return self.env_method(name, *args, indices=member, **kwargs)[0]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Members = None
    ) -> list[bool]:
        """Return False for every member: wrappers of single environments cannot be in a batch."""
        return [False] * len(self._members(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a frame of every member, (height, width, 3) uint8, in render mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            warnings.warn(
                f"images need the render mode 'rgb_array', this is {self.render_mode!r}",
                stacklevel=2,
            )
            return [None] * self.num_envs
        return self.env_method("render")

    def _members(self, indices: Members) -> list[int]:
        """Return members by their numbers, which may count from the end."""
        all_members = range(self.num_envs)
        if indices is None:
            return list(all_members)
        if isinstance(indices, (int, np.integer)):
            indices = [int(indices)]
        return [all_members[index] for index in indices]


def make_swim_vec_env(
    env_id: str = "swim_env/KirchhoffSwimmer-v0",
    num_envs: int = 64,
    seed: int | None = None,
    **kwargs: Any,
) -> SwimVecEnv:
    """Make a `SwimVecEnv`.

    Parameters
    ----------
    env_id : str
        Name of one of this package's environments.
    num_envs : int
        Number M of members.
    seed : int, optional
        The first reset seeds member i with seed + i; random unless given.
    **kwargs
        Arguments of the environment: scene, overrides, max_episode_steps ...
    """
    kwargs.setdefault("autoreset_mode", AutoresetMode.SAME_STEP.value)
    venv = SwimVecEnv(gymnasium.make_vec(env_id, num_envs=num_envs, **kwargs))
    if seed is not None:
        venv.seed(seed)
        venv.action_space.seed(seed)
    return venv


def _dicts(
    batch: Mapping[str, Any], members: Sequence[int] | NDArray[np.int64] | None = None
) -> list[dict[str, Any]]:
    """Return the infos of members, all unless given, one dict each with plain Python values.

    Called in every step, so each key is converted once for all members.
    """
    names = []
    columns: list[list[Any]] = []
    for name, values in batch.items():
        if name[0] == "_":  # the mask of another key
            continue
        names.append(name)
        if isinstance(values, Mapping):  # of a wrapper, as the statistics of episodes
            columns.append(_dicts(values, members))
            continue
        if members is not None:
            values = values[members]
        columns.append(values.tolist() if values.ndim == 1 else list(values))
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
