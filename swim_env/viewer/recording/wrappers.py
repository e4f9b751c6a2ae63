"""Wrappers that record episodes of the environments while somebody else plays them."""

from __future__ import annotations

import glob
import os
import sys
import warnings
import weakref
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_env.env import SwimEnv
from swim_env.episodes import Episodes
from swim_env.errors import OptionError, SwimError
from swim_env.physics.status import TERMINATION_REASONS as PHYSICS_REASONS
from swim_env.recorder import Recorder
from swim_env.scene import Scene
from swim_env.scene_checks import got
from swim_env.trajectory import Trajectory
from swim_env.vector_env import SwimVectorEnv
from swim_env.viewer.recording.swimmer import Swimmer
from swim_env.viewer.recording.writer import (
    FRAME_RATE,
    WrittenRecording,
    recording_file,
    write_recording,
)

__all__ = ["RecordEpisodes", "RecordVectorEpisodes"]

Trigger = Callable[[int], bool]

#: Bodies keep the steps for one recorder alone: environments that somebody records already.
_RECORDED: weakref.WeakSet[Episodes] = weakref.WeakSet()


class _ChosenRecorder(Recorder):
    """A recorder that keeps the steps of chosen members, and those of an episode that is over.

    Attributes
    ----------
    chosen : set of int
        Whose steps are kept.
    over : dict
        What was kept of a chosen member when it was started anew.
    begun : list of int
        How often each member's trajectory has begun: with every start, and with every snapshot
        that the environment went back to.
    """

    def __init__(self, scene: Scene, count: int) -> None:
        super().__init__(scene, count)
        self.chosen = set(range(count)) if scene.recording is not None else set()
        self.over: dict[int, Any] = {}
        self.begun = [0] * count

    def begin(self, member: int, steps: int, energy: float, state: NDArray[np.float64]) -> None:
        """Begin a member's trajectory, and put the one before aside."""
        self.begun[member] += 1
        if member in self.chosen and self._steps[member]:
            self.over[member] = self._kept_of(member)
        super().begin(member, steps, energy, state)

    def wants(self, member: int) -> bool:
        """Tell whether a member was chosen."""
        return member in self.chosen

    def trajectory_before(self, member: int, reason: str) -> Trajectory:
        """Return the trajectory of a chosen member that was started anew since."""
        return self._trajectory(self.over[member], reason)

    def is_paid(self, member: int, rewards: int) -> bool:
        """Tell whether there are as many rewards as actions whose steps were kept."""
        return rewards * self._scene.steps_per_action >= self._steps[member]


class _Tape:
    """What is kept of episodes that are being played, and the files that become of it."""

    def __init__(
        self,
        episodes: Episodes,
        folder: Path,
        flow_rate: float | None,
        frame_rate: float,
        split_energy: bool,
    ) -> None:
        self.written: list[WrittenRecording] = []
        self._episodes = episodes
        #: A view, taken once: between two actions of an agent every lookup counts.
        self._last_rewards = episodes.rewards
        self._folder = folder
        self._flow_rate, self._frame_rate = flow_rate, frame_rate
        self._split_energy = split_energy
        self._always = episodes.task.scene.recording is not None
        self._recorder = _ChosenRecorder(episodes.task.scene, len(episodes.everyone))
        self._rewards: dict[int, list[float]] = {}
        self._goals: dict[int, NDArray[np.float64]] = {}
        self._velocities: dict[int, NDArray[np.float64]] = {}
        self._begun: dict[int, int] = {}
        #: Members whose episode is being recorded: what they are called in all their files, and the
        #: file of this episode.
        self.running: dict[int, tuple[str, str]] = {}

    def attach(self) -> None:
        """Have the bodies' steps kept."""
        self._episodes.bodies.recorder = self._recorder

    def detach(self) -> None:
        """Keep no more steps, unless the scene does so by itself."""
        if self._episodes.bodies.recorder is self._recorder and not self._always:
            self._episodes.bodies.recorder = None

    def begin(self, member: int, name: str, episode: int) -> None:
        """Record a member's episode, which has just started."""
        self._recorder.chosen.add(member)
        self._recorder.over.pop(member, None)
        self._rewards[member] = []
        self._begun[member] = self._recorder.begun[member]
        self._goals[member] = self._episodes.goals[member].copy()
        if self._split_energy:
            self._velocities[member] = self._episodes.bodies.weigh(member)[1]
        self.running[member] = name, f"{name}-episode-{episode}"

    def drop(self, member: int) -> None:
        """Keep nothing more of a member."""
        if not self._always:
            self._recorder.chosen.discard(member)
        self._recorder.over.pop(member, None)
        self.running.pop(member, None)

    def pay_last(self, member: int) -> None:
        """Keep the reward of the member's last action."""
        self.pay(member, self._last_rewards.item(member))

    def pay(self, member: int, reward: float, started_anew: bool = False) -> None:
        """Keep the reward of an action, after which the member may have been started anew.

        Where a snapshot was restored since the last one, the trajectory begins there: what was
        known of the start and the rewards before it are of no run any more.
        """
        begun = self._recorder.begun[member] - int(started_anew)
        if begun != self._begun[member]:
            self._begun[member] = begun
            self._rewards[member] = []
            self._velocities.pop(member, None)
            if not started_anew:
                self._goals[member] = self._episodes.goals[member].copy()
        self._rewards[member].append(reward)

    def pay_played(self) -> None:
        """Keep the rewards of actions that were played in a step that has failed afterwards."""
        for member in self.running:
            same = self._recorder.begun[member] == self._begun[member]
            if not self._recorder.is_paid(member, len(self._rewards[member]) if same else 0):
                self.pay_last(member)

    def end(self, member: int, reason: str | None = None) -> None:
        """Write what there is of a member's episode; nothing where it has taken no step.

        A reason is given where the member was started anew already.
        """
        if member not in self.running:
            return
        task = self._episodes.task
        if reason is not None and member in self._recorder.over:
            physical = reason if reason in PHYSICS_REASONS.values() else ""
            trajectory = self._recorder.trajectory_before(member, physical)
        else:
            trajectory = self._episodes.recorded(member)
        name, file = self.running[member]
        swimmer = Swimmer(
            name,
            trajectory,
            self._rewards[member],
            self._goals[member],
            task.radius if task.goal_is_point else None,
            self._velocities.pop(member, None),
        )
        self.drop(member)
        if trajectory.steps:
            self.written.append(
                write_recording(
                    self._folder / f"{file}.rrd",
                    [swimmer],
                    flow_rate=self._flow_rate,
                    frame_rate=self._frame_rate,
                    title=f"{file} on {trajectory.scene.name}",
                )
            )

    def end_or_warn(self, member: int, reason: str | None = None) -> None:
        """Write as `end` does; what cannot be written is not worth the caller's episode."""
        try:
            self.end(member, reason)
        except SwimError as error:
            warnings.warn(f"an episode was not recorded: {error}", stacklevel=3)

    def end_all(self) -> None:
        """Write what there is of every episode; of several errors the first is raised."""
        errors = []
        for member in list(self.running):
            try:
                self.end(member)
            except SwimError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def finish(self) -> None:
        """Write what there is of every episode, and let others record."""
        try:
            self.end_all()
        finally:
            self.detach()
            _RECORDED.discard(self._episodes)


def _finish(tape: _Tape) -> None:
    """Write what is left where nobody closed the environment."""
    try:
        tape.finish()
    except SwimError as error:
        print(f"swim_env: {error}", file=sys.stderr)


def _new_tape(
    episodes: Episodes,
    folder: str | os.PathLike[str],
    prefixes: Collection[str],
    flow_rate: float | None,
    frame_rate: float,
    split_energy: bool,
) -> _Tape:
    """Check what both wrappers are given, and begin to record.

    Prefixes are what stands in the files' names before the episode.
    """
    if episodes in _RECORDED:
        raise OptionError(
            "the environment is being recorded already: use one recording wrapper, or close the "
            "other one first"
        )
    _check_rate("frame_rate", frame_rate)
    if flow_rate is not None:
        _check_rate("flow_rate", flow_rate)
    place = recording_file(Path(folder) / "any.rrd", "any").parent
    for prefix in prefixes:
        if any(place.glob(f"{glob.escape(prefix)}-episode-*.rrd")):
            warnings.warn(
                f"recordings in {place} will be overwritten ({prefix}-episode-*.rrd); name another "
                "folder or name_prefix to keep them",
                stacklevel=3,
            )
    _RECORDED.add(episodes)
    return _Tape(episodes, place, flow_rate, frame_rate, split_energy)


def _check_rate(name: str, rate: object) -> None:
    """Refuse what is no number of frames in a second."""
    is_number = isinstance(rate, (int, float, np.number)) and not isinstance(rate, bool)
    if not (is_number and 0.0 < float(rate) < np.inf):  # type: ignore[arg-type]
        raise OptionError(f"{name} must be a finite number above 0, got {got(rate)}")


def _checked_prefix(prefix: object) -> str:
    """Return the beginning of the files' names."""
    if (
        not isinstance(prefix, str)
        or not prefix
        or prefix.strip(".") == ""
        or any(sign in prefix for sign in "/\\\0\n")
    ):
        raise OptionError(
            f"name_prefix must be the beginning of a file's name, without a folder, got "
            f"{got(prefix)}"
        )
    return prefix


def _checked_members(members: object, count: int) -> list[int]:
    """Return which members are to be recorded, in order."""
    shape = f"members must be different whole numbers of 0 to {count - 1}, at least one of them"
    if isinstance(members, (str, bytes, Mapping)) or not isinstance(members, Iterable):
        raise OptionError(f"{shape}, got {got(members)}")
    chosen: list[int] = []
    for one in members:
        if isinstance(one, (bool, np.bool_)) or not isinstance(one, (int, np.integer)):
            raise OptionError(f"{shape}, got {got(one)} among them")
        if not 0 <= one < count:
            raise OptionError(f"{shape}, got {one}")
        if int(one) in chosen:
            raise OptionError(f"{shape}, got {one} twice")
        chosen.append(int(one))
    if not chosen:
        raise OptionError(f"{shape}, got none")
    return sorted(chosen)


def _chosen_by_default(episode: int) -> bool:
    """Record episodes 0, 1, 8, 27 ... and every thousandth, as Gymnasium's RecordVideo does."""
    if episode < 1000:
        root: int = round(episode ** (1.0 / 3.0))
        return root**3 == episode
    return episode % 1000 == 0


class RecordEpisodes(
    gymnasium.Wrapper[Any, NDArray[Any], Any, NDArray[Any]], gymnasium.utils.RecordConstructorArgs
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
    frame_rate : float
        Frames of everything else.
    split_energy : bool
        Whether to split the kinetic energy between body and fluid. The torques are played again for
        it when the file is written, which takes as long as the episode's physics.

    Attributes
    ----------
    written : list of WrittenRecording
        The files so far.

    Raises
    ------
    OptionError
        If the environment is not one of this package, if it is being recorded already, or if
        another argument cannot be used.
    SwimError
        If rerun is not installed, or the folder cannot be made or written to.

    Warns
    -----
    UserWarning
        If the folder holds recordings of these names: they will be overwritten.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        folder: str | os.PathLike[str],
        episode_trigger: Trigger | None = None,
        name_prefix: str = "swimmer",
        flow_rate: float | None = None,
        frame_rate: float = FRAME_RATE,
        split_energy: bool = False,
    ) -> None:
        given: Any = env
        swimmer = given.unwrapped if isinstance(given, gymnasium.Env) else given
        if not isinstance(swimmer, SwimEnv):
            hint = "; RecordVectorEpisodes records a batch"
            raise OptionError(
                f"RecordEpisodes needs a SwimEnv, got {type(swimmer).__name__}"
                f"{hint if isinstance(swimmer, gymnasium.vector.VectorEnv) else ''}"
            )
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
        self._trigger = _chosen_by_default if episode_trigger is None else episode_trigger
        self._prefix = _checked_prefix(name_prefix)
        self._tape = _new_tape(
            swimmer.episodes, folder, [self._prefix], flow_rate, frame_rate, split_energy
        )
        self._episode = -1
        weakref.finalize(self, _finish, self._tape)

    @property
    def written(self) -> list[WrittenRecording]:
        """The files so far."""
        return self._tape.written

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode, and write what there is of the one before."""
        tape = self._tape
        tape.end_or_warn(0)
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
        try:
            result = self.env.step(action)
        except (SwimError, gymnasium.error.Error):
            # A refused action changes nothing, and the episode can go on.
            raise
        except BaseException:
            tape.pay_played()
            tape.end_or_warn(0)
            raise
        tape.pay_last(0)
        if result[2] or result[3]:
            tape.end_or_warn(0)
            tape.detach()
        return result

    def close(self) -> None:
        """Write what there is and close the environment."""
        try:
            self._tape.finish()
        finally:
            super().close()


class RecordVectorEpisodes(gymnasium.vector.VectorWrapper):
    """Records episodes of chosen members of a `SwimVectorEnv` for rerun, one file each.

    As `RecordEpisodes`; the files are called ``PREFIX-member-M-episode-N.rrd``.

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

    Attributes
    ----------
    written : list of WrittenRecording
        The files so far.

    Raises
    ------
    OptionError
        As for `RecordEpisodes`, or if there is no such member.
    SwimError
        If rerun is not installed, or the folder cannot be made or written to.

    Warns
    -----
    UserWarning
        If the folder holds recordings of these names: they will be overwritten.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        folder: str | os.PathLike[str],
        members: Collection[int] = (0,),
        episode_trigger: Trigger | None = None,
        name_prefix: str = "swimmer",
        flow_rate: float | None = None,
        frame_rate: float = FRAME_RATE,
        split_energy: bool = False,
    ) -> None:
        given: Any = env
        batch = given.unwrapped if isinstance(given, gymnasium.vector.VectorEnv) else given
        if not isinstance(batch, SwimVectorEnv):
            single = isinstance(given, gymnasium.Env) and isinstance(given.unwrapped, SwimEnv)
            raise OptionError(
                f"RecordVectorEpisodes needs a SwimVectorEnv, got {type(batch).__name__}"
                f"{'; RecordEpisodes records a single environment' if single else ''}"
            )
        super().__init__(env)
        self._batch = batch
        self._members = _checked_members(members, batch.num_envs)
        self._trigger = _chosen_by_default if episode_trigger is None else episode_trigger
        self._prefix = _checked_prefix(name_prefix)
        prefixes = [self._name(member) for member in self._members]
        self._tape = _new_tape(
            batch.episodes, folder, prefixes, flow_rate, frame_rate, split_energy
        )
        self._counts = dict.fromkeys(self._members, 0)
        self._ended: set[int] = set()
        self._tape.attach()
        weakref.finalize(self, _finish, self._tape)

    @property
    def written(self) -> list[WrittenRecording]:
        """The files so far."""
        return self._tape.written

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start members, and write what there is of their episodes before."""
        mask = options.get("reset_mask") if isinstance(options, Mapping) else None
        starting = [one for one in self._members if mask is None or bool(mask[one])]
        for member in starting:
            self._tape.end_or_warn(member)
        # Gymnasium's own batched environments take a list of seeds too; its types do not say so.
        result = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        self._begin(starting)
        return result

    def step(self, actions: NDArray[Any]) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold actions, and write the files of episodes that end."""
        tape, mode = self._tape, self._batch.autoreset_mode
        try:
            result = self.env.step(actions)
        except (SwimError, gymnasium.error.Error):
            raise
        except BaseException:
            tape.pay_played()
            for member in list(tape.running):
                tape.end_or_warn(member)
            raise
        _, rewards, terminated, truncated, infos = result
        anew = self._ended if mode is AutoresetMode.NEXT_STEP else set()
        self._ended = set()
        self._begin(sorted(anew))
        for member in self._members:
            ended = bool(terminated[member] or truncated[member])
            same_step = ended and mode is AutoresetMode.SAME_STEP
            if member in tape.running and member not in anew:
                tape.pay(member, float(rewards[member]), same_step)
            if same_step:
                reason = str(infos["final_info"]["termination_reason"][member])
                tape.end_or_warn(member, reason)
                self._begin([member])
            elif ended:
                tape.end_or_warn(member)
                self._ended.add(member)
        return result

    def _begin(self, members: Collection[int]) -> None:
        """Count members that have started, and record those that are wanted."""
        for member in members:
            number = self._counts[member]
            self._counts[member] += 1
            if self._trigger(number):
                self._tape.begin(member, self._name(member), number)

    def _name(self, member: int) -> str:
        """Return what a member is called in its files."""
        return f"{self._prefix}-member-{member}"

    def close(self, **kwargs: Any) -> None:
        """Write what there is and close the environment."""
        try:
            self._tape.finish()
        finally:
            super().close(**kwargs)
