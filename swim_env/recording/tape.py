"""Episodes that are being played: what is kept of them, and the recordings made from it."""

from __future__ import annotations

import glob
import os
import sys
import warnings
import weakref
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swim_env.envs.episodes import Episodes
from swim_env.errors import OptionError, SwimError
from swim_env.physics.status import TERMINATION_REASONS as PHYSICS_REASONS
from swim_env.recording.swimmer import Swimmer, checked_rate
from swim_env.recording.writer import WrittenRecording, recording_file, write_recording
from swim_env.sim.batch import Bodies
from swim_env.sim.recorder import Kept, Recorder

__all__ = ["Tape"]

Result = TypeVar("Result")

#: Bodies have one recorder at a time: which tape records which environment.
_OWNERS: weakref.WeakKeyDictionary[Episodes, weakref.ref[Tape]] = weakref.WeakKeyDictionary()


class _ChosenRecorder(Recorder):
    """A recorder that keeps the steps of chosen members, and those of an episode that is over."""

    def __init__(self, bodies: Bodies) -> None:
        super().__init__(bodies)
        count, recording = len(bodies.states), bodies.scene.recording
        #: Members whose steps are kept.
        self.chosen = set(range(count)) if recording is not None else set()
        #: What was kept of a chosen member when it started again.
        self.over: dict[int, Kept | None] = {}
        #: How often each member's trajectory has begun: with every start, and with every snapshot
        #: that the environment went back to.
        self.begun = [0] * count

    def begin(self, member: int, steps: int, energy: float, state: NDArray[np.float64]) -> None:
        """Begin a member's trajectory, and put the one before aside."""
        self.begun[member] += 1
        if member in self.chosen and self._steps[member]:
            self.over[member] = self.kept(member)
        super().begin(member, steps, energy, state)

    def wants(self, member: int) -> bool:
        """Return whether a member was chosen."""
        return member in self.chosen

    def is_paid(self, member: int, rewards: int) -> bool:
        """Return whether there is a reward for every action whose steps were kept."""
        return rewards * self._bodies.scene.steps_per_action >= self._steps[member]


class Tape:
    """Keeps episodes that are being played, and writes their files.

    The prefixes are the beginnings of the files' names, before the episode; the other arguments,
    errors and the warning are those of `swim_env.recording.RecordEpisodes`.
    """

    def __init__(
        self,
        episodes: Episodes,
        folder: str | os.PathLike[str],
        prefixes: Collection[str],
        flow_rate: float | None,
        frame_rate: float | None,
        split_energy: bool,
    ) -> None:
        self._episodes = episodes
        self._refuse_other_owner()
        self._frame_rate = None if frame_rate is None else checked_rate(frame_rate, "frame_rate")
        self._flow_rate = None if flow_rate is None else checked_rate(flow_rate, "flow_rate")
        self._split_energy = split_energy
        self._folder = recording_file(Path(folder) / "any.rrd", "any").parent
        for prefix in prefixes:
            if any(self._folder.glob(f"{glob.escape(prefix)}-episode-*.rrd")):
                warnings.warn(
                    f"recordings in {self._folder} will be overwritten ({prefix}-episode-*.rrd); "
                    "name another folder or name_prefix to keep them",
                    stacklevel=3,
                )
        self.written: list[WrittenRecording] = []
        #: Members whose episode is being recorded: the swimmer's name, the same in all its files,
        #: and the file of this episode.
        self.running: dict[int, tuple[str, str]] = {}
        self._always = episodes.task.scene.recording is not None
        self._recorder = _ChosenRecorder(episodes.bodies)
        self._rewards: dict[int, list[float]] = {}
        self._goals: dict[int, NDArray[np.float64]] = {}
        self._velocities: dict[int, NDArray[np.float64]] = {}
        self._begun: dict[int, int] = {}
        _OWNERS[episodes] = weakref.ref(self)

    @property
    def is_owner(self) -> bool:
        """Whether this is what records the environment: not after `finish`."""
        owner = _OWNERS.get(self._episodes)
        return owner is not None and owner() is self

    def attach(self) -> None:
        """Keep the steps of the environment's bodies, unless another tape does (OptionError)."""
        if not self.is_owner:
            self._refuse_other_owner()
            _OWNERS[self._episodes] = weakref.ref(self)
        self._episodes.bodies.recorder = self._recorder

    def _refuse_other_owner(self) -> None:
        owner = _OWNERS.get(self._episodes)
        if owner is not None and owner() is not None:
            raise OptionError(
                "the environment is being recorded already: use one recording wrapper, or close "
                "the other one first"
            )

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
            self._velocities[member] = self._episodes.bodies.energy_and_velocity(member)[1]
        self.running[member] = name, f"{name}-episode-{episode}"

    def play(self, step: Callable[[Any], Result], actions: Any) -> Result:
        """Step the environment; where that fails, write what there is of the episodes."""
        try:
            return step(actions)
        except (SwimError, gymnasium.error.Error):
            # A refused action changes nothing, and the episode can continue.
            raise
        except BaseException:
            for member in list(self.running):
                # The action may have been played before something else failed.
                same = self._recorder.begun[member] == self._begun[member]
                rewards = len(self._rewards[member]) if same else 0
                if not self._recorder.is_paid(member, rewards):
                    self.pay_last(member)
                self.end(member)
            raise

    def pay_last(self, member: int) -> None:
        """Keep the reward of the member's last action."""
        self.pay(member, self._episodes.rewards.item(member))

    def pay(self, member: int, reward: float, restarted: bool = False) -> None:
        """Keep the reward of an action, after which the member may have started again.

        Where a snapshot was restored since the last one, the trajectory begins there: the start
        and the rewards before it do not belong to it.
        """
        begun = self._recorder.begun[member] - int(restarted)
        if begun != self._begun[member]:
            self._begun[member] = begun
            self._rewards[member] = []
            self._velocities.pop(member, None)
            if not restarted:
                self._goals[member] = self._episodes.goals[member].copy()
        self._rewards[member].append(reward)

    def end(self, member: int, reason: str | None = None) -> None:
        """Write a member's episode if it is being recorded, and warn where that fails.

        A reason is given where the member has already started again.
        """
        try:
            self._write(member, reason)
        except SwimError as error:
            warnings.warn(f"an episode was not recorded: {error}", stacklevel=3)

    def _write(self, member: int, reason: str | None = None) -> None:
        """Write a member's episode; nothing where it has taken no step."""
        if member not in self.running:
            return
        task = self._episodes.task
        if reason is not None and member in self._recorder.over:
            physical = reason if reason in PHYSICS_REASONS.values() else ""
            trajectory: Any = self._recorder.trajectory_of(self._recorder.over[member], physical)
        else:
            trajectory = self._episodes.recorded(member)
        name, file = self.running.pop(member)
        swimmer = Swimmer(
            name,
            trajectory,
            self._rewards[member],
            task.displacement_aim(self._goals[member]),
            task.radius if task.has_target else None,
            self._velocities.pop(member, None),
        )
        self._recorder.over.pop(member, None)
        if not self._always:
            self._recorder.chosen.discard(member)
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

    def finish(self) -> None:
        """Write what there is of every episode, and let others record.

        Of several errors the first is raised.
        """
        errors = []
        try:
            for member in list(self.running):
                try:
                    self._write(member)
                except SwimError as error:
                    errors.append(error)
        finally:
            self.detach()
            if self.is_owner:
                del _OWNERS[self._episodes]
        if errors:
            raise errors[0]

    def finish_or_print(self) -> None:
        """Write what is left where nobody has closed the environment; errors go to stderr."""
        try:
            self.finish()
        except SwimError as error:
            print(f"swim_env: {error}", file=sys.stderr)
