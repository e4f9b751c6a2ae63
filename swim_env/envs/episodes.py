"""Episodes of one task for one body or many: starts, steps, ends."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import (
    END_CODE,
    FIGURES,
    REACHED,
    TIME_IS_UP,
    collect,
    torques_of_actions,
)
from swim_env.envs.tasks import Start, StartPlan, Task
from swim_env.envs.tasks.hooks import Hooks
from swim_env.envs.tasks.layout import TERMS, TOLD, standard_size
from swim_env.envs.tasks.moment import COLUMNS, Arrays
from swim_env.errors import ActionError, OptionError, SimulationEndedError, SwimError
from swim_env.physics.status import TERMINATION_REASONS as PHYSICS_REASONS
from swim_env.physics.status import describe
from swim_env.scene.checks import got, whole
from swim_env.scene.scene import MOST_ACTIONS
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.sim.recorder import needs_recording
from swim_env.sim.trajectory import TrajectoryBase

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

assert REACHED not in PHYSICS_REASONS
_REASON_BY_CODE = {**PHYSICS_REASONS, REACHED: "target_reached"}

#: Why a run or an episode ends before its time: every reason, and what it means.
TERMINATION_REASONS: dict[str, str] = {
    reason: "the target was reached" if code == REACHED else describe(reason)
    for code, reason in _REASON_BY_CODE.items()
    if reason
}

#: What ``termination_code`` of an info means: the reason for each code, empty for none. The reasons
#: of a task's own have the codes after these, see `Episodes.reasons`.
TERMINATION_CODES: dict[int, str] = dict(sorted(_REASON_BY_CODE.items()))


class Reasons(np.ndarray[Any, Any]):
    """Reasons of a batch as text (M,), None for none; libraries without text get the codes.

    They take arrays by ``__dlpack__``, as in `gymnasium.wrappers.vector.NumpyToTorch`.
    """

    codes: dict[str, int]

    @classmethod
    def of(cls, texts: NDArray[Any], codes: dict[str, int]) -> Reasons:
        """Return reasons of an array of text, with the codes of a task."""
        reasons = texts.view(cls)
        reasons.codes = codes
        return reasons

    def __array_finalize__(self, other: Any) -> None:
        self.codes = getattr(other, "codes", _CODES)

    def __dlpack__(self, **options: Any) -> Any:
        codes = self.codes
        found = np.array([codes[reason or ""] for reason in self.tolist()], dtype=np.int64)
        return found.__dlpack__(**options)


class LastObservations(np.ndarray[Any, Any]):
    """Last observations of a batch (M,) as Gymnasium has them, None of members that play on.

    Libraries without objects get float32 (M, n) by ``__dlpack__``, zeros for None.
    """

    def __dlpack__(self, **options: Any) -> Any:
        there = [one is not None for one in self.tolist()]
        known = np.stack(self[there].tolist()) if any(there) else np.zeros((0, 0), np.float32)
        found = np.zeros((len(there), *known.shape[1:]), dtype=known.dtype)
        found[there] = known
        return found.__dlpack__(**options)


_CODES = {reason: code for code, reason in TERMINATION_CODES.items()}
assert list(TERMINATION_CODES) == list(range(len(TERMINATION_CODES)))

#: A start that cannot be simulated is drawn again with less noise, down to this share and then 0.
_SMALLEST_SHARE = 1e-3

_TIME, _REWARD = COLUMNS["time"], COLUMNS["reward"]


@dataclass(frozen=True)
class EnvSnapshot:
    """An environment's complete state; a restored one continues bit for bit.

    Attributes
    ----------
    task : tuple
        Identity of the task, see `Task.identity`.
    arrays : dict of str to numpy.ndarray
        Copies of the state, by member.
    randoms : list of dict
        States of the members' random number generators.
    is_reset : bool
        Whether an episode had begun.
    limit : int or None
        Actions until the time is up; None to keep those of the environment that restores it.
    """

    task: tuple[object, ...]
    arrays: dict[str, NDArray[Any]]
    randoms: list[dict[str, Any]]
    is_reset: bool = True
    limit: int | None = None

    def member(self, index: int) -> EnvSnapshot:
        """Return the snapshot of one member, which a single environment can restore.

        A number that is not one of its members' is an OptionError.
        """
        number, count = whole(index), len(self.randoms)
        if number is None or not 0 <= number < count:
            raise OptionError(f"member must be 0 to {count - 1}, got {got(index)}")
        index = number
        return EnvSnapshot(
            self.task,
            {name: array[index : index + 1].copy() for name, array in self.arrays.items()},
            [deepcopy(self.randoms[index])],
            limit=self.limit,
        )


class BatchResults(NamedTuple):
    """What a batched step returns, in Gymnasium's form.

    The masks of infos, and the reasons where no episode ended, are the same arrays in every step
    and cannot be written to.
    """

    observations: NDArray[np.float32]
    rewards: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    infos: dict[str, Any]


class Episodes:
    """M episodes that run side by side.

    Parameters
    ----------
    task : Task
        The task of all of them.
    count : int
        Their number M.
    max_episode_steps : int, optional
        See `set_limit`.

    Attributes
    ----------
    limit : int
        Actions until the time is up.
    limit_is_the_scenes : bool
        Whether they are those of the scene's duration.
    observations : (M, n) array of float32
        What each member observes now.
    actions : (M, n) array
        The actions that `play` takes.
    all_members : (M,) array of int
        The indices of all members.
    torques : (M, 1, N - 1) array, in space (M, 1, N - 1, 3)
        Torques of the last actions (N m).
    goals : (M, D) array
        Directions (unit vectors) or targets (m).
    counters : (M, 3) array of int
        Actions taken, code of the reason for an end, and whether the time is up.
    someone_ended : bool
        Whether any member was at its end at the last call of `results`.
    is_reset : bool
        Whether an episode has begun.
    reasons : dict of str to int
        Every reason for an end with its code: TERMINATION_CODES, and those of the task's own.
    meanings : dict of str to str
        What each of them means.

    Raises
    ------
    SceneError
        If the control interval is not a whole number of time steps.
    OptionError
        If max_episode_steps is not such a number.
    TaskError
        If what the task's methods return cannot be used.
    SimulationEndedError
        If the scene's own start cannot be simulated.
    """

    def __init__(self, task: Task, count: int = 1, max_episode_steps: int | None = None) -> None:
        scene = task.scene
        self.task = task
        self._hold = scene.steps_per_action
        self.set_limit(max_episode_steps)
        geometry = self._geometry = task.geometry
        geometry.load()
        self.bodies = geometry.bodies(count)
        self.all_members = self.bodies.all_members
        self._torque_of_one, self._places = scene.action_torques, scene.action_places
        self.actions = np.zeros((count, len(self._places)))
        self.torques: Array = np.zeros((count, 1, *geometry.joint_shape))
        self._record = self.bodies.new_record(self._hold)
        self.goals: Array = np.zeros((count, scene.dimension))
        self._position = slice(COLUMNS["x"], COLUMNS["x"] + scene.dimension)
        self.someone_ended = self.is_reset = False
        self._earlier = np.zeros((count, geometry.kept))
        size = standard_size(task)
        self._seen = self.observations = np.zeros((count, size), dtype=np.float32)
        self._figures = np.zeros((count, len(COLUMNS)))
        self.counters = np.zeros((count, 3), dtype=np.int64)
        start = task.draw_start(np.random.default_rng(0), task.plan_start({"noise": 0.0}))
        # Not `start`, with which a recording would begin.
        self.bodies.states[0] = self.bodies.prepared(0, start.coordinates, start.velocity)
        self.bodies.velocities[0] = start.velocity
        layout = task.layout
        own = {reason: len(_CODES) + i for i, reason in enumerate(layout.reasons)}
        self.reasons = {**_CODES, **own}
        self.meanings = {**TERMINATION_REASONS, **{one: task.reasons[one] for one in own}}
        self._texts = Reasons.of(np.array(list(self.reasons), dtype=object), self.reasons)
        reached = [REACHED] if task.ends_at_goal else []
        self._successes = [*reached, *(self.reasons[one] for one in task.successes)]
        self._hooks: Hooks | None = None
        if layout.is_own:
            arrays = Arrays(
                self._earlier,
                np.zeros_like(self._earlier),
                self.bodies.velocities,
                self.torques,
                self.bodies.outcome,
                self.goals,
                self._figures,
                self.counters,
                self._seen,
            )
            self._hooks = Hooks(task, arrays, own)
            self.observations = self._hooks.observations
        self._info_columns = [(name, COLUMNS[name]) for name in TOLD]
        if task.goal_is_point:
            self._info_columns.append(("distance", COLUMNS["distance"]))
        if not task.overrides("reward"):
            self._info_columns[1:1] = [
                (name, COLUMNS[name]) for name in (f"reward_{one}" for one in TERMS)
            ]
        self._all_there = np.ones(count, dtype=np.bool_)
        self._no_reasons = Reasons.of(np.full(count, "", dtype=object), self.reasons)
        for constant in (self._all_there, self._no_reasons):
            constant.flags.writeable = False
        self._masks = [f"_{name}" for name in self.info(0)]

    def set_limit(self, max_episode_steps: int | None) -> None:
        """Set the actions until the time is up.

        None means those of the scene's duration, -1 as many as can be counted, as for
        `gymnasium.make`. Another number below 1 is an OptionError.
        """
        self.limit_is_the_scenes = max_episode_steps is None
        if max_episode_steps is None:
            self.limit = self.task.scene.actions_per_episode
        elif whole(max_episode_steps) == -1:
            self.limit = MOST_ACTIONS
        else:
            self.limit = whole_number(max_episode_steps, "max_episode_steps", MOST_ACTIONS)
        self._settings = self.task.settings(self.limit)

    # ---- running -------------------------------------------------------------------------------

    def start(self, member: int, random: np.random.Generator, plan: StartPlan) -> None:
        """Put a member at a start, see `find_start`; where there is none, it is as before."""
        self.begin(member, *self.find_start(member, random, plan))

    def find_start(
        self, member: int, random: np.random.Generator, plan: StartPlan
    ) -> tuple[Start, Array]:
        """Draw a start that `Task.plan_start` has planned, and return it with its state vector.

        Raises
        ------
        SimulationEndedError
            If the start cannot be simulated, whatever its noise.
        """
        share = 1.0
        while True:
            start = self.task.draw_start(random, plan, share)
            try:
                return start, self.bodies.prepared(member, start.coordinates, start.velocity)
            except SimulationEndedError:
                # Large noise may bend the body beyond what its outline allows. The start without
                # noise was tried when the environment was made.
                if share == 0.0:
                    raise
                share = 0.8 * share if share > _SMALLEST_SHARE else 0.0

    def begin(self, member: int, start: Start, state: Array) -> None:
        """Put a member at a start that `find_start` has found."""
        self.bodies.put(member, state, start.velocity)
        self.is_reset = True
        self.goals[member] = start.goal
        self.torques[member] = 0.0
        if self._hooks is not None:
            self._hooks.begin(member, start.state)
        self._assess(self.all_members[member : member + 1], True)

    def take(self, actions: object, single: bool, members: Indices) -> None:
        """Check the members' actions and keep their torques for `play`.

        Actions are (M, n), those of a single environment (n,); other members' are ignored.
        An ActionError says that they have another shape, are not numbers or not finite; then no
        torques have changed.
        """
        shape = self.actions.shape[1:] if single else self.actions.shape
        what = "an action" if single else "actions"
        try:
            given = np.asarray(actions)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ActionError(f"{what} must be numbers of shape {shape}: {error}") from None
        if given.dtype.kind not in "iuf":
            raise ActionError(f"{what} must be numbers of shape {shape}, got {given.dtype}")
        if given.shape != shape:
            raise ActionError(f"{what} must have shape {shape}, got {given.shape}")
        if given.dtype == np.longdouble and given.dtype != np.float64:
            with np.errstate(over="ignore"):  # becomes infinite and is refused as such
                given = given.astype(np.float64)
        self.actions[:] = given
        torques = self.torques.reshape(len(self.torques), -1)
        bad = torques_of_actions(members, self.actions, self._torque_of_one, self._places, torques)
        if bad >= 0:
            member, action = divmod(bad, shape[-1])
            joint, axis = divmod(int(self._places[action]), self.torques[0, 0, 0].size)
            where = f"joint {joint}"
            if self.task.scene.dimension == 3:
                where = f"the {AXIS_NAMES[axis]} of {where}"
            where += "" if single else f" of member {member}"
            raise ActionError(
                f"{what} must be finite, got {self.actions[member, action]} at {where}"
            )

    def play(self, members: Indices, threads: int = 1) -> None:
        """Hold the torques that `take` has kept over one control interval."""
        self.bodies.advance(self.torques, self._hold, self._record, members, threads)
        self._assess(members, False)

    def _assess(self, members: Indices, start: bool) -> None:
        hooks = self._hooks
        if hooks is not None:
            hooks.before()
        self._geometry.assess(
            members,
            start,
            self.bodies.states,
            self.bodies.velocities,
            self.torques.reshape(len(self.torques), -1),
            self._torque_of_one,
            self._places,
            self._record,
            self.bodies.outcome,
            self.goals,
            self._settings,
            self._earlier,
            self._seen,
            self._figures.view(FIGURES)[:, 0],
            self.counters,
        )
        if hooks is not None:
            hooks.run(members, start)

    def drawn(self, member: int) -> dict[str, Any]:
        """Return what the task has drawn of a member's state at its start."""
        return {} if self._hooks is None else dict(self._hooks.drawn[member])

    # ---- results -------------------------------------------------------------------------------

    @property
    def rewards(self) -> Array:
        """Rewards of the last action, (M,), a view."""
        return self._figures[:, _REWARD]

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """Whether the members' episodes ended before their time, (M,)."""
        return self.counters[:, END_CODE] > 0

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Whether the members' time is up, (M,)."""
        return self.counters[:, TIME_IS_UP] > 0

    @property
    def times(self) -> Array:
        """Simulated time of the members since their start (s), (M,), a view."""
        return self._figures[:, _TIME]

    def info(self, member: int) -> dict[str, Any]:
        """Return the info of one member."""
        code = int(self.counters[member, END_CODE])
        position = self._figures[member, self._position].copy()
        info = self._info(self._figures[member].tolist(), position, self._texts[code], code)
        if self._hooks is not None:
            info.update(self._hooks.told(member))
        if self.task.goal_is_point:
            info["target"] = self.goals[member].copy()
        if self._successes:
            info["success"] = info["is_success"] = code in self._successes
        return info

    def _info(self, figures: Any, position: Array, reason: Any, code: Any) -> dict[str, Any]:
        """Return what all tasks tell, of one member or of all: figures are by column."""
        info = {"time": figures[_TIME], "position": position, "termination_reason": reason}
        info["termination_code"] = code
        for name, column in self._info_columns:
            info[name] = figures[column]
        return info

    def results(self) -> BatchResults:
        """Return new arrays of all members' observations, rewards, ends and infos."""
        count = len(self.all_members)
        observations = np.empty(self.observations.shape, dtype=np.float32)
        columns = np.empty((len(COLUMNS), count))
        flags = np.empty((2, count), dtype=np.bool_)
        ended = collect(
            self.observations, self._figures, self.counters, observations, columns, flags
        )
        self.someone_ended = ended > 0
        codes = self.counters[:, END_CODE].copy()
        reasons = self._texts[codes] if ended else self._no_reasons
        infos = self._info(columns, columns[self._position].T, reasons, codes)
        if self._hooks is not None:
            infos.update(self._hooks.told_of_all())
        if self.task.goal_is_point:
            infos["target"] = self.goals.copy()
        if self._successes:
            infos["success"] = self._succeeded(codes)
            infos["is_success"] = infos["success"].copy()
        for name in self._masks:
            infos[name] = self._all_there
        return BatchResults(observations, columns[_REWARD], flags[0], flags[1], infos)

    def _succeeded(self, codes: Indices) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = codes == self._successes[0]
        for code in self._successes[1:]:
            found |= codes == code
        return found

    def recorded(self, member: int) -> TrajectoryBase:
        """Return a member's trajectory since its start; OptionError if the scene records none."""
        recorder = needs_recording(self.bodies.recorder)
        status = int(self.bodies.outcome[member, 1])
        return recorder.trajectory(member, PHYSICS_REASONS[status])

    # ---- snapshots -----------------------------------------------------------------------------

    def _arrays(self) -> dict[str, NDArray[Any]]:
        bodies = self.bodies
        own = {} if self._hooks is None else self._hooks.arrays()
        if self.observations is not self._seen:
            own["seen"] = self._seen
        return {
            "states": bodies.states,
            "velocities": bodies.velocities,
            "outcome": bodies.outcome,
            "torques": self.torques,
            "record": self._record,
            "goals": self.goals,
            "earlier": self._earlier,
            "observations": self.observations,
            "figures": self._figures,
            "counters": self.counters,
            **own,
        }

    def snapshot(self, randoms: list[np.random.Generator]) -> EnvSnapshot:
        """Return a copy of everything that decides how the episodes continue."""
        return EnvSnapshot(
            self.task.identity,
            {name: array.copy() for name, array in self._arrays().items()},
            [deepcopy(dict(random.bit_generator.state)) for random in randoms],
            self.is_reset,
            self.limit,
        )

    def restore(self, snapshot: EnvSnapshot, randoms: list[np.random.Generator]) -> None:
        """Go back to a snapshot, generators included; what follows is what followed then.

        Raises
        ------
        SwimError
            If it is no snapshot, or one of another task, scene or number of members.
        """
        if not isinstance(snapshot, EnvSnapshot):
            raise SwimError(f"restore needs what snapshot returned, got {type(snapshot).__name__}")
        same = snapshot.task == self.task.identity
        if not same or len(snapshot.randoms) != len(randoms):
            raise SwimError(
                "the snapshot belongs to another environment: scene, task, weights and number of "
                "members must be the same"
            )
        arrays = self._arrays()
        for name, array in arrays.items():
            kept = snapshot.arrays.get(name)
            if kept is None or kept.shape != array.shape:
                raise SwimError(
                    f"the snapshot was made by another version: its {name} do not fit those of here"
                )
        for name, array in arrays.items():
            array[:] = snapshot.arrays[name]
        if snapshot.limit not in (None, self.limit):
            self.set_limit(snapshot.limit)
        for member in self.all_members:
            self.bodies.begin_recording(int(member))
        self.someone_ended = bool(self.counters[:, END_CODE:].any())
        self.is_reset = snapshot.is_reset
        for random, state in zip(randoms, snapshot.randoms, strict=True):
            random.bit_generator.state = deepcopy(state)


def whole_number(value: object, name: str, at_most: int | None = None) -> int:
    """Return a whole number of at least 1 and at most a bound, or raise OptionError."""
    number = whole(value)
    if number is None:
        shown = repr(value) if value is None or isinstance(value, bool) else got(value)
        raise OptionError(f"{name} must be a whole number of at least 1, got {shown}")
    if number < 1:
        raise OptionError(f"{name} must be at least 1, got {got(number)}")
    if at_most is not None and number > at_most:
        raise OptionError(f"{name} must be at most {at_most:,}, got {got(number)}")
    return number
