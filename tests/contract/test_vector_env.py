"""The batched environments: bit for bit the single ones, in Gymnasium's batched form."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import (
    DictInfoToList,
    NormalizeObservation,
    RecordEpisodeStatistics,
)
from numpy.typing import NDArray

from swim_env import (
    TERMINATION_REASONS,
    ActionError,
    OptionError,
    SceneError,
    SimulationEndedError,
    SwimError,
    SwimVectorEnv,
)

Array = NDArray[np.float64]

FORWARD = "swim_env/KirchhoffSwimmer-v0"
TARGET = "swim_env/KirchhoffSwimmerTarget-v0"
TASKS = (FORWARD, TARGET)
MODES = tuple(AutoresetMode)
each_task = pytest.mark.parametrize("task", TASKS, ids=("forward", "target"))
each_mode = pytest.mark.parametrize("mode", MODES, ids=[mode.name for mode in MODES])

#: Cheap and calm.
SMALL: dict[str, object] = {"beam.elements": 3, "fluid.panels_per_element": 2}
#: Cheap, and bent beyond what the panels can follow by random actions within a second or so.
LIVELY: dict[str, object] = {
    "beam.elements": 4,
    "beam.bending_stiffness": 1.0,
    "fluid.panels_per_element": 2,
    "damping.retardation_time": 0.005,
    "integrator.time_step": 0.01,
    "actuation.torque_limit": 2.0,
}
JOINTS = 3
#: Points close enough that a few random episodes get there.
NEAR: dict[str, Any] = {"target_distance": (0.042, 0.06), "target_radius": 0.04}
#: Ends by the physics and by the time limit, mixed.
LIMIT = 70


def make(task: str = FORWARD, num_envs: int = 3, **arguments: Any) -> SwimVectorEnv:
    envs = gymnasium.make_vec(task, num_envs=num_envs, **arguments)
    assert isinstance(envs, SwimVectorEnv)
    return envs


def singles(
    task: str,
    num_envs: int,
    mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    **arguments: Any,
) -> SyncVectorEnv:
    """Return as many single environments under Gymnasium's own loop."""

    def make_one() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(task, **arguments)

    return SyncVectorEnv([make_one] * num_envs, autoreset_mode=mode)


def lively_arguments(task: str) -> dict[str, Any]:
    return {
        "overrides": LIVELY,
        "max_episode_steps": LIMIT,
        "effort_weight": 0.1,
        "heading_weight": 0.2,
        **(NEAR if task == TARGET else {}),
    }


def random_actions(steps: int, members: int, joints: int = JOINTS, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, members, joints))


def assert_same(left: Any, right: Any, where: str = "") -> None:
    """Compare nested results of environments, types and every bit."""
    assert type(left) is type(right), f"{where}: {type(left)} and {type(right)}"
    if isinstance(left, dict):
        assert set(left) == set(right), where
        for key in left:
            assert_same(left[key], right[key], f"{where}[{key!r}]")
    elif isinstance(left, (tuple, list)):
        assert len(left) == len(right), where
        for i, (one, other) in enumerate(zip(left, right, strict=True)):
            assert_same(one, other, f"{where}[{i}]")
    elif isinstance(left, np.ndarray) and left.dtype == object:
        assert right.dtype == object and left.shape == right.shape, where
        assert_same(left.tolist(), right.tolist(), where)
    elif isinstance(left, np.ndarray):
        assert left.dtype == right.dtype, f"{where}: {left.dtype} and {right.dtype}"
        np.testing.assert_array_equal(left, right, err_msg=where)
    else:
        assert left == right, where


def first_members(value: Any, count: int) -> Any:
    """Return a batched result of the first few members alone."""
    if isinstance(value, dict):
        return {key: first_members(item, count) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(first_members(item, count) for item in value)
    return value[:count]


def assert_clear(error: BaseException, *parts: str) -> None:
    """Check that a message is one line that holds these parts."""
    message = str(error)
    assert message.strip() and "\n" not in message, message
    for part in parts:
        assert part in message, f"{part!r} is not in {message!r}"


# ---- the members are the single environments ---------------------------------------------------

STEPS, MOST = 200, 64


@pytest.fixture(scope="module")
def played_alone() -> list[Any]:
    """Results of 64 single environments, started by seeds 100 on, over 200 steps."""
    envs = singles(FORWARD, MOST, **lively_arguments(FORWARD))
    results: list[Any] = [envs.reset(seed=100)]
    results += [envs.step(actions) for actions in random_actions(STEPS, MOST)]
    envs.close()
    terminated = np.array([result[2] for result in results[1:]])
    truncated = np.array([result[3] for result in results[1:]])
    assert terminated.any(axis=0).sum() > 10 and truncated.any(axis=0).sum() > 10
    assert len(set(np.flatnonzero(terminated.any(axis=1)))) > 10, "ends at different times"
    return results


@pytest.mark.parametrize("num_threads", [1, 2, 5])
@pytest.mark.parametrize("num_envs", [1, 2, 7, MOST])
def test_members_are_single_environments_whatever_the_batch(
    played_alone: list[Any], num_envs: int, num_threads: int
) -> None:
    envs = make(FORWARD, num_envs, num_threads=num_threads, **lively_arguments(FORWARD))
    assert_same(envs.reset(seed=100), first_members(played_alone[0], num_envs))
    for step, actions in enumerate(random_actions(STEPS, MOST)):
        expected = first_members(played_alone[1 + step], num_envs)
        assert_same(envs.step(actions[:num_envs]), expected, f"step {step}")


@each_task
@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"scene": "paper_ix"},
        {"scene": "paper_x"},
        {"overrides": {"beam.elements": 2}},
        {"overrides": {"fluid": None}},
        {"overrides": {"axial_added_mass": True}},
        {"overrides": {"fluid.panels_per_element": 12}},
    ],
    ids=str,
)
def test_members_of_every_scene_are_single_environments(
    task: str, arguments: dict[str, Any]
) -> None:
    envs, alone = make(task, 3, num_threads=2, **arguments), singles(task, 3, **arguments)
    joints = envs.single_action_space.shape[0]
    assert_same(envs.reset(seed=7), alone.reset(seed=7))
    for step, actions in enumerate(random_actions(4, 3, joints)):
        assert_same(envs.step(actions), alone.step(actions), f"step {step}")


@each_task
@each_mode
def test_every_way_of_starting_anew_is_gymnasiums(task: str, mode: AutoresetMode) -> None:
    """All results, infos, masks and types are those of Gymnasium's own loop."""
    arguments = lively_arguments(task)
    envs = make(task, 5, autoreset_mode=mode, num_threads=2, **arguments)
    alone = singles(task, 5, mode, **arguments)
    assert envs.metadata["autoreset_mode"] is mode
    assert envs.autoreset_mode is mode
    assert_same(envs.reset(seed=3), alone.reset(seed=3), "reset")
    ends = {"terminated": 0, "truncated": 0}
    reasons = set()
    for step, actions in enumerate(random_actions(220, 5, seed=1)):
        result, expected = envs.step(actions), alone.step(actions)
        assert_same(result, expected, f"step {step}")
        _, _, terminated, truncated, infos = result
        ends["terminated"] += int(terminated.sum())
        ends["truncated"] += int(truncated.sum())
        told = infos["final_info"] if "final_info" in infos else infos
        reasons |= {reason for reason in told["termination_reason"] if reason}
        over = terminated | truncated
        if mode is AutoresetMode.DISABLED and over.any():
            seed = [None, step, None, None, 5] if step % 2 else None
            assert_same(
                envs.reset(seed=seed, options={"reset_mask": over.copy()}),
                alone.reset(seed=seed, options={"reset_mask": over.copy()}),
                f"reset after step {step}",
            )
    assert min(ends.values()) > 0, ends
    if task == TARGET:
        assert "target_reached" in reasons
    assert reasons <= set(TERMINATION_REASONS)


@each_mode
def test_masked_resets_and_resets_in_mid_episode_are_gymnasiums(mode: AutoresetMode) -> None:
    arguments = {"overrides": SMALL, "max_episode_steps": 7}
    envs = make(FORWARD, 4, autoreset_mode=mode, **arguments)
    alone = singles(FORWARD, 4, mode, **arguments)
    assert_same(envs.reset(seed=0), alone.reset(seed=0))
    rng = np.random.default_rng(5)
    over = np.zeros(4, dtype=np.bool_)
    for step, actions in enumerate(random_actions(40, 4, 2)):
        mask = rng.random(4) < 0.3
        if mode is AutoresetMode.DISABLED:
            mask |= over
        if mask.any():
            options: dict[str, Any] = {"noise": 0.5, "heading": 0.3} if step % 2 else {}
            given = {**options, "reset_mask": mask.copy()}
            assert_same(
                envs.reset(seed=step if step % 3 == 0 else None, options=given),
                alone.reset(
                    seed=step if step % 3 == 0 else None, options={**options, "reset_mask": mask}
                ),
                f"reset before step {step}",
            )
            assert set(given) == {*options, "reset_mask"}, "the caller's options were changed"
        result = envs.step(actions)
        assert_same(result, alone.step(actions), f"step {step}")
        over = result[2] | result[3]
        if step == 20:
            assert_same(envs.reset(), alone.reset(), "full reset")
            over[:] = False
    assert_same(envs.reset(seed=[4, 3, 2, 1]), alone.reset(seed=[4, 3, 2, 1]))
    given = {"reset_mask": np.ones(4, dtype=np.bool_)}
    assert_same(envs.reset(options=given), alone.reset(options={**given}))


@each_task
def test_a_member_that_ends_early_leaves_the_others_alone(task: str) -> None:
    """Violent actions of one member are not felt by any other, resets included."""
    arguments = {
        "overrides": {**SMALL, "actuation.torque_limit": 2.0},
        "max_episode_steps": 25,
        "num_threads": 2,
    }
    calm, violent = make(task, 7, **arguments), make(task, 7, **arguments)
    others = np.arange(7) != 3
    assert_same(calm.reset(seed=0), violent.reset(seed=0))
    # Member 3 starts bent to the verge of its end: only its own mask and options name it.
    mask = ~others
    verge = {"reset_mask": mask, "joint_angles": 1.3, "velocity": (3.0, 2.0)}
    violent.reset(options=verge)
    ends = 0
    for step, actions in enumerate(0.2 * random_actions(80, 7, 2)):
        wild = actions.copy()
        wild[3] = (-1.0) ** (step // 4)
        result, expected = violent.step(wild), calm.step(actions)
        ends += int(result[2][3])
        if result[2][3] and ends < 4:
            violent.step(np.zeros((7, 2)))
            calm.step(np.zeros((7, 2)))
            violent.reset(options=verge)
        pairs = zip(result[:4], expected[:4], strict=True)
        for one, other in pairs:
            np.testing.assert_array_equal(one[others], other[others])
        assert not expected[2].any()
        for key, values in expected[4].items():
            assert_same(result[4][key][others], values[others], key)
    assert ends > 0


@each_task
def test_a_longer_limit_means_the_same_in_both(task: str) -> None:
    """What `max_episode_steps` asks for is what both forms do, beyond the scene's duration, too."""
    arguments = {"overrides": {**SMALL, "episode.duration": 0.1}, "max_episode_steps": 8}
    envs, alone = make(task, 2, **arguments), singles(task, 2, **arguments)
    assert_same(envs.reset(seed=0), alone.reset(seed=0))
    for _ in range(10):
        assert_same(envs.step(np.zeros((2, 2)))[3], alone.step(np.zeros((2, 2)))[3])


@each_task
def test_without_a_limit_the_scenes_duration_counts(task: str) -> None:
    envs = make(task, 2, overrides={**SMALL, "episode.duration": 0.1})
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 2)))[3].tolist() for _ in range(11)]
    assert truncated == [[step in (4, 10)] * 2 for step in range(11)]


# ---- seeds and snapshots -----------------------------------------------------------------------


@each_task
def test_seeds_are_taken_as_gymnasiums_own(task: str) -> None:
    envs, alone = make(task, 3, overrides=SMALL), singles(task, 3, overrides=SMALL)
    envs.reset(seed=0)
    alone.reset(seed=0)
    for seed in (0, 5, [5, 6, 7], [9, 9, 9], [1, None, 3], None, [None] * 3, 2**70):
        assert_same(envs.reset(seed=seed), alone.reset(seed=seed), f"seed {seed}")
        assert_same(envs.reset(), alone.reset(), f"after seed {seed}")
    first = envs.reset(seed=4)
    for same in ([4, 5, 6], (4, 5, 6), np.array([4, 5, 6])):
        assert_same(envs.reset(seed=same), first)
    start = envs.reset(seed=[8, 8, 8])[0]
    np.testing.assert_array_equal(start, start[[0, 0, 0]])
    fresh = {make(task, 2, overrides=SMALL).reset()[0].tobytes() for _ in range(3)}
    assert len(fresh) == 3
    unseeded = make(task, 2, overrides=SMALL).reset()[0]
    assert not np.array_equal(unseeded[0], unseeded[1])


@each_task
@each_mode
def test_a_snapshot_continues_bit_for_bit(task: str, mode: AutoresetMode) -> None:
    """In the same batch and in another, through ends, with the random numbers to come."""
    arguments = {**lively_arguments(task), "autoreset_mode": mode}

    def play(envs: SwimVectorEnv, steps: int) -> list[Any]:
        results: list[Any] = []
        for actions in random_actions(steps, 4, seed=steps):
            results.append(envs.step(actions))
            over = results[-1][2] | results[-1][3]
            if mode is AutoresetMode.DISABLED and over.any():
                results.append(envs.reset(options={"reset_mask": over}))
        return results

    envs = make(task, 4, **arguments)
    envs.reset(seed=3)
    play(envs, 10)
    snapshot = envs.snapshot()
    kept = pickle.dumps(snapshot)
    observations = envs.restore(snapshot)
    following = [play(envs, 130), envs.reset()]
    assert any(result[2].any() or result[3].any() for result in following[0] if len(result) == 5)
    other = make(task, 4, **arguments, num_threads=1)
    other.reset()
    play(other, 3)
    for each in (envs, other):
        assert_same(each.restore(pickle.loads(kept)), observations)
        assert_same([play(each, 130), each.reset()], following)
    assert_same(envs.restore(snapshot), observations)


def test_a_snapshot_at_an_end_remembers_who_starts_anew() -> None:
    envs = make(FORWARD, 3, overrides=SMALL, max_episode_steps=4)
    envs.reset(seed=0)
    envs.step(np.ones((3, 2)))
    envs.reset(options={"reset_mask": np.array([True, False, False])})
    while not envs.step(np.ones((3, 2)))[3].any():
        pass
    snapshot = envs.snapshot()
    expected = [envs.step(np.ones((3, 2))) for _ in range(6)]
    envs.reset(seed=9)
    envs.restore(snapshot)
    assert_same([envs.step(np.ones((3, 2))) for _ in range(6)], expected)
    assert expected[0][4]["time"].tolist() == [pytest.approx(0.08), 0.0, 0.0]


def test_a_snapshot_of_another_batch_is_refused() -> None:
    envs, twin = make(FORWARD, 3), make(FORWARD, 3)
    for each in (envs, twin):
        each.reset(seed=0)
    for other in (
        make(FORWARD, 2),
        make(TARGET, 3),
        make(FORWARD, 3, effort_weight=0.5),
        make(FORWARD, 3, overrides=SMALL),
    ):
        other.reset(seed=0)
        with pytest.raises(SwimError) as caught:
            envs.restore(other.snapshot())
        assert_clear(caught.value, "snapshot")
    with pytest.raises(SwimError) as caught:
        make(FORWARD, 3).snapshot()
    assert_clear(caught.value, "reset")
    actions = random_actions(1, 3, 8)[0]
    assert_same(envs.step(actions), twin.step(actions))


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))]
)
def test_a_copy_continues_bit_for_bit_on_its_own(
    duplicate: Callable[[SwimVectorEnv], SwimVectorEnv],
) -> None:
    envs = make(FORWARD, 4, **lively_arguments(FORWARD))
    envs.reset(seed=0)
    for actions in random_actions(5, 4):
        envs.step(actions)
    other = duplicate(envs)
    played = [envs.step(actions) for actions in random_actions(120, 4, seed=1)]
    assert any(result[2].any() for result in played)
    assert_same([other.step(actions) for actions in random_actions(120, 4, seed=1)], played)


# ---- Gymnasium's surface -----------------------------------------------------------------------


@each_task
def test_spaces_are_batches_of_the_single_ones(task: str) -> None:
    envs, alone = make(task, 5), singles(task, 5)
    assert isinstance(envs.unwrapped, gymnasium.vector.VectorEnv)
    assert envs.num_envs == 5
    assert envs.single_action_space == alone.single_action_space
    assert envs.action_space == alone.action_space
    assert envs.single_observation_space == alone.single_observation_space
    assert envs.observation_space == alone.observation_space
    assert envs.spec is not None and envs.spec.id == task
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    envs.action_space.seed(0)
    observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert rewards.dtype == np.float64 and rewards.shape == (5,)
    assert terminated.dtype == truncated.dtype == np.bool_
    again = gymnasium.make_vec(envs.spec)
    assert again.num_envs == 5


def test_modes_are_known_by_member_value_and_name() -> None:
    for mode in MODES:
        for given in (mode, mode.value, mode.name):
            assert make(FORWARD, 1, autoreset_mode=given).autoreset_mode is mode
    assert make(FORWARD, 1).autoreset_mode is AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_statistics_of_episodes_are_those_of_gymnasiums_loop(mode: AutoresetMode) -> None:
    arguments = lively_arguments(FORWARD)
    envs = RecordEpisodeStatistics(make(FORWARD, 4, autoreset_mode=mode, **arguments))
    alone = RecordEpisodeStatistics(singles(FORWARD, 4, mode, **arguments))
    envs.reset(seed=0)
    alone.reset(seed=0)
    episodes = 0
    for actions in random_actions(150, 4):
        infos, expected = envs.step(actions)[4], alone.step(actions)[4]
        assert ("episode" in infos) == ("episode" in expected)
        if "episode" in infos:
            for key in ("r", "l"):
                assert_same(infos["episode"][key], expected["episode"][key])
            assert_same(infos["_episode"], expected["_episode"])
            episodes += int(infos["_episode"].sum())
    assert episodes >= 8
    assert list(envs.return_queue) == list(alone.return_queue)


@each_mode
def test_infos_become_one_mapping_for_each_member(mode: AutoresetMode) -> None:
    arguments = lively_arguments(TARGET)
    envs = DictInfoToList(make(TARGET, 3, autoreset_mode=mode, **arguments))
    alone = DictInfoToList(singles(TARGET, 3, mode, **arguments))
    assert_same(envs.reset(seed=0), alone.reset(seed=0))
    for step, actions in enumerate(random_actions(LIMIT, 3)):
        result, expected = envs.step(actions), alone.step(actions)
        assert_same(result, expected, f"step {step}")
        if mode is AutoresetMode.DISABLED and (result[2] | result[3]).any():
            break
    assert isinstance(result[4], list) and set(result[4][0]) >= {"time", "target", "distance"}


def test_observations_can_be_normalised() -> None:
    envs = NormalizeObservation(make(FORWARD, 4, overrides=SMALL, max_episode_steps=20))
    alone = NormalizeObservation(singles(FORWARD, 4, overrides=SMALL, max_episode_steps=20))
    assert_same(envs.reset(seed=0)[0], alone.reset(seed=0)[0])
    for actions in random_actions(30, 4, 2):
        observations = envs.step(actions)[0]
        assert_same(observations, alone.step(actions)[0])
    assert np.isfinite(observations).all() and np.abs(observations).max() < 10.0


@each_mode
def test_returned_arrays_are_the_callers(mode: AutoresetMode) -> None:
    """Results that are kept stay as they were; results that are spoilt spoil nothing."""
    arguments = {**lively_arguments(TARGET), "max_episode_steps": 9, "autoreset_mode": mode}
    envs, twin = make(TARGET, 3, **arguments), make(TARGET, 3, **arguments)
    envs.reset(seed=0)
    twin.reset(seed=0)
    kept: list[tuple[Any, Any]] = []

    def keep(result: Any) -> None:
        kept.append((result, copy.deepcopy(result)))

    steps = 8 if mode is AutoresetMode.DISABLED else 25
    for actions in random_actions(steps, 3):
        keep(envs.step(actions))
        twin.step(actions)
    for result, then in kept:
        assert_same(result, then)

    def spoil(value: Any) -> None:
        if isinstance(value, dict):
            for item in value.values():
                spoil(item)
        elif isinstance(value, tuple):
            for item in value:
                spoil(item)
        elif not value.flags.writeable:
            assert value.dtype == object or value.all()  # masks, and no reasons
        elif value.dtype == np.bool_:
            value[:] = ~value
        elif value.dtype != object:
            value[:] = 12345

    for result, _ in kept:
        spoil(result)
    spoil(envs.restore(envs.snapshot()))
    assert_same(envs.step(np.ones((3, 3))), twin.step(np.ones((3, 3))))
    spoil(envs.reset(seed=1))
    twin.reset(seed=1)
    assert_same(envs.step(np.ones((3, 3))), twin.step(np.ones((3, 3))))


@pytest.mark.parametrize(
    "form",
    [
        lambda actions: actions.tolist(),
        lambda actions: np.asfortranarray(actions),
        lambda actions: np.repeat(actions, 2, axis=1)[:, ::2],
        lambda actions: actions.astype(np.float16),
        lambda actions: tuple(list(row) for row in actions),
        lambda actions: np.broadcast_to(actions, actions.shape),
    ],
    ids=["list", "fortran", "strided", "half", "rows", "read-only"],
)
def test_all_forms_of_the_same_actions_do_the_same(form: Callable[[Array], Any]) -> None:
    actions = np.linspace(-1.0, 0.75, 24).reshape(3, 8).astype(np.float16).astype(np.float64)
    envs, twin = make(overrides={"fluid": None}), make(overrides={"fluid": None})
    envs.reset(seed=0)
    twin.reset(seed=0)
    assert_same(envs.step(form(actions)), twin.step(actions))
    assert_same(envs.step(np.ones((3, 8), dtype=np.int8)), twin.step(np.full((3, 8), 7.5)))


def test_closing_twice_does_no_harm() -> None:
    envs = make(overrides=SMALL)
    envs.reset(seed=0)
    envs.close()
    envs.close()
    assert envs.closed


# ---- bad input ---------------------------------------------------------------------------------


def _bad(member: int, joint: int, value: float) -> Array:
    actions = np.zeros((3, 8))
    actions[member, joint] = value
    return actions


BAD_ACTIONS: dict[str, tuple[Any, str]] = {
    "single": (np.zeros(8), "shape (3, 8), got (8,)"),
    "few members": (np.zeros((2, 8)), "shape (3, 8), got (2, 8)"),
    "turned": (np.zeros((8, 3)), "shape (3, 8), got (8, 3)"),
    "one for all": (0.0, "shape (3, 8), got ()"),
    "deep": (np.zeros((3, 8, 1)), "shape (3, 8), got (3, 8, 1)"),
    "text": ([["a"] * 8] * 3, "numbers of shape (3, 8)"),
    "none": (None, "numbers of shape (3, 8)"),
    "a member without": ([np.zeros(8), None, np.zeros(8)], "numbers of shape (3, 8)"),
    "ragged": ([[0.0] * 8, [0.0] * 8, [0.0] * 7], "numbers of shape (3, 8)"),
    "bools": (np.ones((3, 8), dtype=bool), "numbers of shape (3, 8), got bool"),
    "complex": (np.ones((3, 8), dtype=complex), "numbers of shape (3, 8), got complex"),
    "nan": (_bad(1, 4, math.nan), "finite, got nan at joint 4 of member 1"),
    "inf": (_bad(2, 7, math.inf), "finite, got inf at joint 7 of member 2"),
    "minus inf": (_bad(0, 0, -math.inf), "finite, got -inf at joint 0 of member 0"),
}


@each_task
@pytest.mark.parametrize("kind", BAD_ACTIONS)
def test_bad_actions_are_refused_and_change_nothing(task: str, kind: str) -> None:
    actions, part = BAD_ACTIONS[kind]
    envs, twin = make(task, max_episode_steps=3), make(task, max_episode_steps=3)
    good = random_actions(6, 3, 8)
    for each in (envs, twin):
        each.reset(seed=0)
    for step, before in enumerate(good):
        if step == 3 and part.startswith("finite"):
            # All members are about to start anew and nobody's action counts.
            assert_same(envs.step(actions), twin.step(before))
            continue
        with pytest.raises(ActionError) as caught:
            envs.step(actions)
        assert_clear(caught.value, part, "actions")
        assert_same(envs.step(before), twin.step(before))
    assert_same(envs.reset(), twin.reset())


MASK = np.array([True, False, True])
BAD_OPTIONS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "a list": ([], ("options must be a mapping",)),
    "a typing error": ({"nois": 1.0}, ("unknown option 'nois'", "nearest: noise")),
    "negative noise": ({"noise": -0.1}, ("noise must be at least 0", "-0.1")),
    "few angles": ({"joint_angles": [0.1]}, ("joint_angles", "8", "got 1")),
    "a mask and an error": ({"reset_mask": MASK, "nois": 1}, ("unknown option 'nois'",)),
    "a mask as list": ({"reset_mask": [True] * 3}, ("reset_mask", "3 bools")),
    "a mask of numbers": ({"reset_mask": np.ones(3)}, ("reset_mask", "3 bools")),
    "a long mask": ({"reset_mask": np.ones(4, dtype=bool)}, ("reset_mask", "3 bools")),
    "a deep mask": ({"reset_mask": np.ones((3, 1), dtype=bool)}, ("reset_mask", "3 bools")),
    "an empty mask": ({"reset_mask": np.zeros(3, dtype=bool)}, ("reset_mask", "one of them")),
    "no mask": ({"reset_mask": None}, ("reset_mask", "None")),
}
BAD_SEEDS: list[Any] = [
    "1",
    1.0,
    -1,
    True,
    np.True_,
    np.array(1),
    {},
    [],
    [1, 2],
    [1, 2, 3, 4],
    [1, 2.0, 3],
    [1, "2", 3],
    [1, -2, 3],
    [True, 2, 3],
    np.array([1.0, 2.0, 3.0]),
    np.array([-1, 2, 3]),
]


def _refused_reset(
    task: str, error: type[Exception] | tuple[type[Exception], ...], *parts: str, **arguments: Any
) -> None:
    """Check that a reset is refused and that the episodes and random numbers go on."""
    envs, twin = make(task), make(task)
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((3, 8)))
    with pytest.raises(error) as caught:
        envs.reset(**arguments)
    assert_clear(caught.value, *parts)
    assert_same(envs.step(np.ones((3, 8))), twin.step(np.ones((3, 8))))
    assert_same(envs.reset(), twin.reset())
    fresh = make(task)
    with pytest.raises(error):
        fresh.reset(**arguments)
    with pytest.raises(gymnasium.error.ResetNeeded):
        fresh.step(np.ones((3, 8)))


@pytest.mark.parametrize("kind", BAD_OPTIONS)
def test_a_bad_option_is_refused_and_changes_nothing(kind: str) -> None:
    options, parts = BAD_OPTIONS[kind]
    _refused_reset(FORWARD, OptionError, *parts, seed=5, options=options)


@pytest.mark.parametrize("seed", BAD_SEEDS, ids=repr)
def test_a_bad_seed_is_refused_and_changes_nothing(seed: Any) -> None:
    _refused_reset(FORWARD, (gymnasium.error.Error, OptionError), "eed must be", seed=seed)


def test_a_bad_target_is_refused_and_changes_nothing() -> None:
    _refused_reset(TARGET, OptionError, "target must be two", options={"target": (1.0,)})
    _refused_reset(FORWARD, OptionError, "unknown option 'target'", options={"target": (1, 1)})


def test_a_start_that_cannot_be_simulated_is_refused_and_changes_nothing() -> None:
    _refused_reset(FORWARD, SimulationEndedError, "t = 0 s", options={"joint_angles": 2.9})


@pytest.mark.parametrize("options", [{}, {"reset_mask": np.array([True, False, True, True])}])
@pytest.mark.parametrize("seed", [None, 5, [7, 8, None, 9]], ids=str)
def test_a_start_that_only_some_members_can_take_changes_nothing(
    options: dict[str, Any], seed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All members start, or none."""
    envs, twin = make(FORWARD, 4, overrides=SMALL), make(FORWARD, 4, overrides=SMALL)
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((4, 2)))
    start = envs.episodes.bodies.start

    def refuse_member_2(member: int, *state: Any) -> None:
        if member == 2:
            raise SimulationEndedError("outline_degenerate", 0.0, "as if it were folded")
        start(member, *state)

    with monkeypatch.context() as patch:
        patch.setattr(envs.episodes.bodies, "start", refuse_member_2)
        with pytest.raises(SimulationEndedError):
            envs.reset(seed=seed, options=options)
    assert_same(envs.snapshot().episodes.arrays, twin.snapshot().episodes.arrays)
    assert_same(envs.step(np.ones((4, 2))), twin.step(np.ones((4, 2))))
    for _ in range(2):
        assert_same(envs.reset(), twin.reset())


@each_mode
def test_starts_that_cannot_be_simulated_are_drawn_again(mode: AutoresetMode) -> None:
    """Noise that folds the body now and then stops nobody, and all forms draw alike."""
    arguments: dict[str, Any] = {
        "overrides": {"fluid.panels_per_element": 2, "episode.bend_noise": 2.3},
        "max_episode_steps": 3,
    }
    envs, alone = (
        make(FORWARD, 6, autoreset_mode=mode, **arguments),
        singles(FORWARD, 6, mode, **arguments),
    )
    assert_same(envs.reset(seed=0), alone.reset(seed=0), "reset")
    drawn = [
        envs.task.draw_start(np.random.default_rng(seed), envs.task.plan_start()).coordinates
        for seed in range(6)
    ]
    again = (np.array(drawn) != envs.episodes.bodies.coordinates).any(axis=1)
    assert again.any(), "no start had to be drawn again"
    for step, actions in enumerate(random_actions(12, 6, 8)):
        result = envs.step(actions)
        assert_same(result, alone.step(actions), f"step {step}")
        over = result[2] | result[3]
        if mode is AutoresetMode.DISABLED and over.any():
            assert_same(
                envs.reset(options={"reset_mask": over}),
                alone.reset(options={"reset_mask": over}),
            )


@pytest.mark.parametrize("value", [np.ones(64, dtype=int), [True] * 64, np.ones(64)], ids=type)
def test_a_refused_mask_of_many_is_told_on_one_line(value: Any) -> None:
    envs = make(FORWARD, 64, overrides={"fluid": None})
    envs.reset(seed=0)
    with pytest.raises(OptionError) as caught:
        envs.reset(options={"reset_mask": value})
    assert_clear(caught.value, "reset_mask")


def test_the_first_reset_has_to_start_all() -> None:
    envs = make()
    with pytest.raises(OptionError) as caught:
        envs.reset(options={"reset_mask": MASK})
    assert_clear(caught.value, "reset_mask", "first")
    with pytest.raises(gymnasium.error.ResetNeeded) as needed:
        envs.step(np.zeros((3, 8)))
    assert_clear(needed.value, "reset")


def test_members_that_ended_are_named_where_nobody_starts_them() -> None:
    arguments: dict[str, Any] = {"overrides": SMALL, "max_episode_steps": 3}
    envs = make(FORWARD, 4, autoreset_mode="Disabled", **arguments)
    twin = make(FORWARD, 4, autoreset_mode="Disabled", **arguments)
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((4, 2)))
        each.reset(options={"reset_mask": np.array([True, False, True, False])})
        each.step(np.ones((4, 2)))
        assert each.step(np.ones((4, 2)))[3].tolist() == [False, True, False, True]
    for _ in range(2):
        with pytest.raises(gymnasium.error.ResetNeeded) as caught:
            envs.step(np.ones((4, 2)))
        assert_clear(caught.value, "[1, 3]", "reset_mask")
    over = {"reset_mask": np.array([False, True, False, True])}
    assert_same(envs.reset(options=over), twin.reset(options=over))
    assert_same(envs.step(np.ones((4, 2))), twin.step(np.ones((4, 2))))


BAD_ARGUMENTS: list[tuple[str, Any, type[Exception], tuple[str, ...]]] = [
    ("num_envs", 0, OptionError, ("num_envs must be at least 1", "0")),
    ("num_envs", -3, OptionError, ("num_envs must be at least 1", "-3")),
    ("num_envs", 2.0, OptionError, ("num_envs must be a whole number", "2.0")),
    ("num_envs", "2", OptionError, ("num_envs must be a whole number", "'2'")),
    ("num_envs", None, OptionError, ("num_envs must be a whole number", "None")),
    ("num_envs", True, OptionError, ("num_envs must be a whole number", "True")),
    ("num_envs", 10**15, OptionError, ("num_envs",)),
    ("num_envs", 10**30, OptionError, ("num_envs",)),
    ("num_threads", 0, OptionError, ("num_threads must be at least 1", "0")),
    ("num_threads", -1, OptionError, ("num_threads must be at least 1", "-1")),
    ("num_threads", 1.5, OptionError, ("num_threads must be a whole number", "1.5")),
    ("num_threads", "two", OptionError, ("num_threads must be a whole number", "'two'")),
    ("num_threads", False, OptionError, ("num_threads must be a whole number", "False")),
    ("max_episode_steps", 0, OptionError, ("max_episode_steps must be at least 1",)),
    ("max_episode_steps", 2.5, OptionError, ("max_episode_steps must be a whole", "2.5")),
    ("max_episode_steps", "5", OptionError, ("max_episode_steps must be a whole", "'5'")),
    ("autoreset_mode", "nextstep", OptionError, ("autoreset_mode 'nextstep'", "NextStep")),
    ("autoreset_mode", None, OptionError, ("autoreset_mode None", "SameStep")),
    ("autoreset_mode", 1, OptionError, ("autoreset_mode 1", "Disabled")),
    ("render_mode", "rgb", OptionError, ("render_mode 'rgb'", "rgb_array")),
    ("effort_weight", -1.0, OptionError, ("effort_weight must be at least 0",)),
    ("heading_weight", math.nan, OptionError, ("heading_weight must be a finite",)),
    ("scene", "swimer", SceneError, ("unknown scene 'swimer'", "swimmer")),
    (
        "overrides",
        "episode.control_interval=0.012",
        SceneError,
        ("episode.control_interval", "0.005", "0.012"),
    ),
]


@each_task
@pytest.mark.parametrize(("name", "value", "error", "parts"), BAD_ARGUMENTS)
def test_a_bad_argument_is_refused(
    task: str, name: str, value: Any, error: type[Exception], parts: tuple[str, ...]
) -> None:
    with pytest.raises(error) as caught:
        gymnasium.make_vec(task, **{"num_envs": 2, name: value})
    assert_clear(caught.value, *parts)


@pytest.mark.parametrize(
    ("name", "value"),
    [("target_distance", (2.0, 1.0)), ("target_bearing", 4.0), ("target_radius", 0.0)],
)
def test_a_bad_argument_of_the_target_is_refused(name: str, value: Any) -> None:
    with pytest.raises(OptionError) as caught:
        make(TARGET, **{name: value})
    assert_clear(caught.value, name)


def test_whole_numbers_of_numpy_are_whole_numbers() -> None:
    envs = gymnasium.make_vec(
        FORWARD,
        num_envs=np.int64(2),
        num_threads=np.int32(2),
        max_episode_steps=np.uint8(3),
        overrides=SMALL,
    )
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 2)))[3].tolist() for _ in range(3)]
    assert truncated == [[False, False], [False, False], [True, True]]


def test_more_threads_than_members_do_no_harm() -> None:
    envs, twin = make(overrides=SMALL, num_threads=500), make(overrides=SMALL, num_threads=1)
    assert_same(envs.reset(seed=0), twin.reset(seed=0))
    for actions in random_actions(5, 3, 2):
        assert_same(envs.step(actions), twin.step(actions))
