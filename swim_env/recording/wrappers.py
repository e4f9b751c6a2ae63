"""Wrappers that record episodes of the environments while a program plays them."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from swim_env.envs.single import SwimEnv
from swim_env.envs.vector import SwimVectorEnv
from swim_env.errors import OptionError
from swim_env.recording.tape import Tape
from swim_env.recording.writer import WrittenRecording
from swim_env.scene.checks import got, whole

__all__ = ["RecordEpisodes", "RecordVectorEpisodes"]

Trigger = Callable[[int], bool]
Own = TypeVar("Own", SwimEnv, SwimVectorEnv)


class _Recorded:
    """What both wrappers share: the environment inside, the files so far, and the end."""

    _tape: Tape
    _trigger: Trigger

    def _own(self, env: object, kind: type[Own], other: type, hint: str) -> Own:
        """Return the environment of this package inside of its wrappers."""
        inner = getattr(env, "unwrapped", env)
        if isinstance(inner, kind):
            return inner
        tip = f"; {hint}" if isinstance(inner, other) else ""
        raise OptionError(
            f"{type(self).__name__} needs a {kind.__name__}, got {type(inner).__name__}{tip}"
        )

    def _keep(self, tape: Tape, trigger: Trigger | None) -> None:
        self._tape, self._trigger = tape, trigger or _chosen_by_default
        weakref.finalize(self, tape.finish_or_print)

    @property
    def written(self) -> list[WrittenRecording]:
        """The files so far."""
        return self._tape.written

    def close(self, **kwargs: Any) -> None:
        """Write what there is and close the environment."""
        try:
            self._tape.finish()
        finally:
            super().close(**kwargs)  # type: ignore[misc]


class RecordEpisodes(
    _Recorded,
    gymnasium.Wrapper[Any, NDArray[Any], Any, NDArray[Any]],
    gymnasium.utils.RecordConstructorArgs,
):
    """Records episodes of a `SwimEnv` for rerun, one file each.

    While an episode runs, its steps are kept in memory as the physics makes them; the file is
    written when it ends, when the next one starts, when a step fails, when the environment is
    closed and, if nobody closes it, when Python ends: half an episode is a recording too. Nothing
    is left of an episode whose process is killed. A file that cannot be written costs no episode:
    `reset` and `step` warn of it, `close` raises it. Where a snapshot is restored, the recording
    begins there.

    Parameters
    ----------
    env : gymnasium.Env
        A `SwimEnv`, with or without wrappers.
    folder : str or os.PathLike
        Where the files go: ``PREFIX-episode-N.rrd``. Made where it is missing.
    episode_trigger : callable, optional
        Called with the episode's number from 0 on; tells whether to record it. Cubes and every
        thousandth unless given, as Gymnasium's RecordVideo does.
    name_prefix : str
        Beginning of the names.
    flow_rate : float, optional
        Frames of the flow in a simulated second, computed when the file is written; none unless
        given.
    frame_rate : float, optional
        Frames of everything else, one in each of the scene's `frame_interval` unless given.
    split_energy : bool
        Whether to split the kinetic energy between body and fluid. The torques are played again for
        it when the file is written, which takes as long as the episode's physics.

    Raises
    ------
    OptionError, SwimError
        If the environment is not one of this package or is being recorded already, if another
        argument cannot be used, or if rerun is not installed. Recordings of these names in the
        folder are overwritten, with a UserWarning.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        folder: str | os.PathLike[str],
        episode_trigger: Trigger | None = None,
        name_prefix: str = "swimmer",
        flow_rate: float | None = None,
        frame_rate: float | None = None,
        split_energy: bool = False,
    ) -> None:
        swimmer = self._own(env, SwimEnv, VectorEnv, "RecordVectorEpisodes records a batch")
        gymnasium.utils.RecordConstructorArgs.__init__(
            self,
            folder=folder,
            episode_trigger=episode_trigger,
            name_prefix=name_prefix,
            flow_rate=flow_rate,
            frame_rate=frame_rate,
            split_energy=split_energy,
        )
        gymnasium.Wrapper.__init__(self, env)
        self._prefix = _checked_prefix(name_prefix)
        tape = Tape(swimmer.episodes, folder, [self._prefix], flow_rate, frame_rate, split_energy)
        self._keep(tape, episode_trigger)
        self._episode = -1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode, and write what there is of the one before."""
        tape = self._tape
        tape.end(0)
        wanted = self._trigger(self._episode + 1)
        if wanted:
            tape.attach()
        else:
            tape.detach()
        result = self.env.reset(seed=seed, options=options)
        self._episode += 1
        if wanted:
            tape.begin(0, self._prefix, self._episode)
        return result

    def step(self, action: NDArray[Any]) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Hold an action, and write the file at the episode's end."""
        tape = self._tape
        if not tape.running:
            return self.env.step(action)
        result = tape.play(self.env.step, action)
        tape.pay_last(0)
        if result[2] or result[3]:
            tape.end(0)
            tape.detach()
        return result


class RecordVectorEpisodes(_Recorded, gymnasium.vector.VectorWrapper):
    """Records episodes of chosen members of a `SwimVectorEnv` for rerun, one file each.

    As `RecordEpisodes`, errors and warning included; the files are called
    ``PREFIX-member-M-episode-N.rrd``.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A `SwimVectorEnv`, with or without wrappers.
    folder : str or os.PathLike
        Where the files go.
    members : collection of int
        Which members; the first unless given.
    episode_trigger, name_prefix, flow_rate, frame_rate, split_energy
        As for `RecordEpisodes`; each member counts its own episodes.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        folder: str | os.PathLike[str],
        members: Collection[int] = (0,),
        episode_trigger: Trigger | None = None,
        name_prefix: str = "swimmer",
        flow_rate: float | None = None,
        frame_rate: float | None = None,
        split_energy: bool = False,
    ) -> None:
        batch = self._own(
            env, SwimVectorEnv, SwimEnv, "RecordEpisodes records a single environment"
        )
        super().__init__(env)
        self._members = _checked_members(members, batch.num_envs)
        self._mode = batch.autoreset_mode
        prefix = _checked_prefix(name_prefix)
        self._names = {member: f"{prefix}-member-{member}" for member in self._members}
        names = self._names.values()
        tape = Tape(batch.episodes, folder, names, flow_rate, frame_rate, split_energy)
        self._keep(tape, episode_trigger)
        self._counts = dict.fromkeys(self._members, 0)
        self._ended: set[int] = set()
        self._tape.attach()

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start members, and write what there is of their episodes before."""
        mask = options.get("reset_mask") if isinstance(options, Mapping) else None
        starting = [one for one in self._members if mask is None or bool(mask[one])]
        self._tape.attach()
        for member in starting:
            self._tape.end(member)
        # Gymnasium's own batched environments take a list of seeds too; its types do not say so.
        result = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        self._ended -= set(starting)
        self._begin(starting)
        return result

    def step(self, actions: NDArray[Any]) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold actions, and write the files of episodes that end."""
        tape = self._tape
        result = tape.play(self.env.step, actions)
        _, rewards, terminated, truncated, infos = result
        starting = self._ended if self._mode is AutoresetMode.NEXT_STEP else set()
        self._ended = set()
        self._begin(sorted(starting))
        for member in self._members:
            ended = bool(terminated[member] or truncated[member])
            same_step = ended and self._mode is AutoresetMode.SAME_STEP
            if member in tape.running and member not in starting:
                tape.pay(member, float(rewards[member]), same_step)
            if same_step:
                tape.end(member, str(infos["final_info"]["termination_reason"][member]))
                self._begin([member])
            elif ended:
                tape.end(member)
                self._ended.add(member)
        return result

    def _begin(self, members: Collection[int]) -> None:
        """Count members that have started, and record those that are wanted, unless closed."""
        for member in members:
            number = self._counts[member]
            self._counts[member] += 1
            if self._tape.is_owner and self._trigger(number):
                self._tape.begin(member, self._names[member], number)


def _checked_prefix(prefix: object) -> str:
    """Return the beginning of the files' names."""
    if (
        not isinstance(prefix, str)
        or prefix.strip(".") == ""
        or not prefix.isprintable()
        or any(sign in prefix for sign in "/\\")
    ):
        raise OptionError(
            f"name_prefix must be the beginning of a file's name, without a folder, got "
            f"{got(prefix)}"
        )
    return prefix


def _checked_members(members: Collection[int], count: int) -> list[int]:
    """Return which members are to be recorded, in order."""
    shape = f"members must be different whole numbers of 0 to {count - 1}, at least one of them"
    try:
        listed = list(members)
    except TypeError:
        raise OptionError(f"{shape}, got {got(members)}") from None
    chosen = sorted({number for number in map(whole, listed) if number is not None})
    in_range = chosen and 0 <= chosen[0] and chosen[-1] < count
    if not in_range or len(chosen) < len(listed):
        shown = ", ".join(map(str, listed)) or "none"
        raise OptionError(f"{shape}, got {shown}")
    return chosen


def _chosen_by_default(episode: int) -> bool:
    """Record episodes 0, 1, 8, 27 ... and every thousandth, as Gymnasium's RecordVideo does."""
    if episode < 1000:
        root: int = round(episode ** (1.0 / 3.0))
        return root**3 == episode
    return episode % 1000 == 0
