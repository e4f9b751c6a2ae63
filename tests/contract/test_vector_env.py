"""The batched environments: bit for bit the single ones, in Gymnasium's batched form.

What they have in common with the single ones is in test_environments.py.
"""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, NormalizeObservation, RecordEpisodeStatistics

from swim_env import TERMINATION_REASONS, OptionError, SimulationEndedError, SwimError
from tests.support import (
    FORWARD,
    LIVELY,
    SMALL,
    TARGET,
    assert_same,
    each_mode,
    each_task,
    make_batch,
    make_singles,
    refuses,
    uniform,
)

#: Of the body `LIVELY`.
JOINTS = 3
#: Points close enough that a few random episodes get there.
NEAR: dict[str, Any] = {"target_distance": (0.042, 0.06), "target_radius": 0.04}
#: Actions to an episode: some end by the physics, and some by this limit.
LIMIT = 70


def lively_arguments(task: str) -> dict[str, Any]:
    return {
        "overrides": LIVELY,
        "max_episode_steps": LIMIT,
        "effort_weight": 0.1,
        "heading_weight": 0.2,
        **(NEAR if task == TARGET else {}),
    }


def first_members(value: Any, count: int) -> Any:
    """Return a batched result of the first few members alone."""
    if isinstance(value, dict):
        return {key: first_members(item, count) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(first_members(item, count) for item in value)
    return value[:count]


def both(
    task: str, num_envs: int, mode: AutoresetMode = AutoresetMode.NEXT_STEP, **arguments: Any
) -> tuple[Any, Any]:
    """Return a batch of ours and Gymnasium's loop over as many single environments."""
    ours = make_batch(task, num_envs, autoreset_mode=mode, num_threads=2, **arguments)
    return ours, make_singles(task, num_envs, mode, **arguments)


def reset_both(ours: Any, theirs: Any, where: str = "reset", **arguments: Any) -> Any:
    """Reset both alike; masks are copied, for Gymnasium takes them out of the options."""
    results = []
    for envs in (ours, theirs):
        options = arguments.get("options")
        given = options if options is None else dict(options)
        results.append(envs.reset(seed=arguments.get("seed"), options=given))
    assert_same(*results, where)
    return results[0]


# ---- the members are the single environments ---------------------------------------------------

STEPS, MOST = 200, 64


@pytest.fixture(scope="module")
def played_alone() -> list[Any]:
    """Results of 64 single environments, started by seeds 100 on, over 200 steps."""
    envs = make_singles(FORWARD, MOST, **lively_arguments(FORWARD))
    results: list[Any] = [envs.reset(seed=100)]
    results += [envs.step(actions) for actions in uniform(STEPS, MOST, JOINTS)]
    envs.close()
    terminated = np.array([result[2] for result in results[1:]])
    truncated = np.array([result[3] for result in results[1:]])
    assert terminated.any(axis=0).sum() > 10 and truncated.any(axis=0).sum() > 10
    assert len(set(np.flatnonzero(terminated.any(axis=1)))) > 10, "ends at different times"
    return results


@pytest.mark.parametrize(
    ("num_envs", "num_threads"),
    [(1, 1), (1, 2), (2, 1), (2, 2), (2, 5), (7, 1), (7, 2), (7, 500), (MOST, 1), (MOST, 5)],
)
def test_members_are_single_environments_whatever_the_batch(played_alone, num_envs, num_threads):
    envs = make_batch(FORWARD, num_envs, num_threads=num_threads, **lively_arguments(FORWARD))
    assert_same(envs.reset(seed=100), first_members(played_alone[0], num_envs))
    for step, actions in enumerate(uniform(STEPS, MOST, JOINTS)):
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
def test_members_of_every_scene_are_single_environments(task, arguments):
    envs, alone = both(task, 3, **arguments)
    reset_both(envs, alone, seed=7)
    for step, actions in enumerate(uniform(4, *envs.action_space.shape)):
        assert_same(envs.step(actions), alone.step(actions), f"step {step}")


@each_task
@each_mode
def test_every_way_of_starting_anew_is_gymnasiums(task, mode):
    """All results, infos, masks and types are those of Gymnasium's own loop."""
    envs, alone = both(task, 5, mode, **lively_arguments(task))
    assert envs.metadata["autoreset_mode"] is envs.autoreset_mode is mode
    reset_both(envs, alone, seed=3)
    ends = {"terminated": 0, "truncated": 0}
    reasons = set()
    for step, actions in enumerate(uniform(220, 5, JOINTS, seed=1)):
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
            mask = {"reset_mask": over.copy()}
            reset_both(envs, alone, f"reset after step {step}", seed=seed, options=mask)
    assert min(ends.values()) > 0, ends
    if task == TARGET:
        assert "target_reached" in reasons
    assert reasons <= set(TERMINATION_REASONS)


@each_mode
def test_masked_resets_and_resets_in_mid_episode_are_gymnasiums(mode):
    envs, alone = both(FORWARD, 4, mode, overrides=SMALL, max_episode_steps=7)
    reset_both(envs, alone, seed=0)
    rng = np.random.default_rng(5)
    over = np.zeros(4, dtype=np.bool_)
    for step, actions in enumerate(uniform(40, 4, 2)):
        mask = rng.random(4) < 0.3
        if mode is AutoresetMode.DISABLED:
            mask |= over
        if mask.any():
            options: dict[str, Any] = {"noise": 0.5, "heading": 0.3} if step % 2 else {}
            options["reset_mask"] = mask
            seed = step if step % 3 == 0 else None
            reset_both(envs, alone, f"reset before step {step}", seed=seed, options=options)
        result = envs.step(actions)
        assert_same(result, alone.step(actions), f"step {step}")
        over = result[2] | result[3]
        if step == 20:
            reset_both(envs, alone, "full reset")
            over[:] = False
    reset_both(envs, alone, seed=[4, 3, 2, 1])
    all_members = {"noise": 0.5, "reset_mask": np.ones(4, dtype=np.bool_)}
    reset_both(envs, alone, options=all_members)
    envs.reset(options=all_members)
    assert set(all_members) == {"noise", "reset_mask"}, "the caller's options were changed"


@each_mode
def test_starts_that_cannot_be_simulated_are_drawn_again(mode):
    """Noise that folds the body now and then stops nobody, and all forms draw alike."""
    overrides = {"fluid.panels_per_element": 2, "episode.bend_noise": 2.3}
    envs, alone = both(FORWARD, 6, mode, overrides=overrides, max_episode_steps=3)
    reset_both(envs, alone, seed=0)
    drawn = [
        envs.task.draw_start(np.random.default_rng(seed), envs.task.plan_start()).coordinates
        for seed in range(6)
    ]
    again = (np.array(drawn) != envs.episodes.bodies.coordinates).any(axis=1)
    assert again.any(), "no start had to be drawn again"
    for step, actions in enumerate(uniform(12, 6, 8)):
        result = envs.step(actions)
        assert_same(result, alone.step(actions), f"step {step}")
        over = result[2] | result[3]
        if mode is AutoresetMode.DISABLED and over.any():
            reset_both(envs, alone, options={"reset_mask": over})


@each_task
def test_seeds_are_taken_as_gymnasiums_own(task):
    envs, alone = both(task, 3, overrides=SMALL)
    reset_both(envs, alone, seed=0)
    for seed in (0, 5, [5, 6, 7], [9, 9, 9], [1, None, 3], None, [None] * 3, 2**70):
        reset_both(envs, alone, f"seed {seed}", seed=seed)
        reset_both(envs, alone, f"after seed {seed}")
    first = envs.reset(seed=4)
    for same in ([4, 5, 6], (4, 5, 6), np.array([4, 5, 6])):
        assert_same(envs.reset(seed=same), first)
    start = envs.reset(seed=[8, 8, 8])[0]
    np.testing.assert_array_equal(start, start[[0, 0, 0]])
    unseeded = make_batch(task, 2, overrides=SMALL).reset()[0]
    assert not np.array_equal(unseeded[0], unseeded[1])


@each_task
@pytest.mark.parametrize(("limit", "ends"), [(8, [7]), (3, [2, 6, 10]), (None, [4, 10])])
def test_limits_of_episodes_mean_the_same_in_both(task, limit, ends):
    """Where it is given, `max_episode_steps` replaces the scene's duration, of five actions."""
    arguments: dict[str, Any] = {"overrides": {**SMALL, "episode.duration": 0.1}}
    if limit is not None:
        arguments["max_episode_steps"] = limit
    envs, alone = both(task, 2, **arguments)
    reset_both(envs, alone, seed=0)
    truncated = []
    for _ in range(11):
        result = envs.step(np.zeros((2, 2)))
        assert_same(result, alone.step(np.zeros((2, 2))))
        truncated.append(result[3].tolist())
    assert truncated == [[step in ends] * 2 for step in range(11)]


# ---- snapshots ---------------------------------------------------------------------------------


def test_a_snapshot_at_an_end_remembers_who_starts_anew():
    envs = make_batch(FORWARD, 3, overrides=SMALL, max_episode_steps=4)
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


def test_snapshots_need_an_episode_and_a_batch_of_that_size():
    envs, other = make_batch(FORWARD, 3), make_batch(FORWARD, 2)
    with refuses(SwimError, "snapshot", "reset"):
        envs.snapshot()
    envs.reset(seed=0)
    other.reset(seed=0)
    with refuses(SwimError, "snapshot", leaving=envs):
        envs.restore(other.snapshot())


# ---- Gymnasium's surface -----------------------------------------------------------------------


@each_task
def test_spaces_are_batches_of_the_single_ones(task):
    envs, alone = both(task, 5)
    assert isinstance(envs.unwrapped, gymnasium.vector.VectorEnv)
    assert envs.num_envs == 5
    for name in ("single_action_space", "action_space"):
        assert getattr(envs, name) == getattr(alone, name)
    for name in ("single_observation_space", "observation_space"):
        assert getattr(envs, name) == getattr(alone, name)
    assert envs.spec is not None and envs.spec.id == task
    assert gymnasium.make_vec(envs.spec).num_envs == 5
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    envs.action_space.seed(0)
    observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert rewards.dtype == np.float64 and rewards.shape == (5,)
    assert terminated.dtype == truncated.dtype == np.bool_


def test_modes_are_known_by_member_value_and_name():
    for mode in AutoresetMode:
        for given in (mode, mode.value, mode.name):
            assert make_batch(FORWARD, 1, autoreset_mode=given).autoreset_mode is mode
    assert make_batch(FORWARD, 1).autoreset_mode is AutoresetMode.NEXT_STEP


@pytest.mark.parametrize(
    ("wrapper", "mode"),
    [
        (RecordEpisodeStatistics, AutoresetMode.NEXT_STEP),
        (RecordEpisodeStatistics, AutoresetMode.SAME_STEP),
        (NormalizeObservation, AutoresetMode.NEXT_STEP),
        *((DictInfoToList, mode) for mode in AutoresetMode),
    ],
)
def test_gymnasiums_wrappers_see_no_difference(wrapper, mode):
    envs, alone = (wrapper(each) for each in both(TARGET, 4, mode, **lively_arguments(TARGET)))
    reset_both(envs, alone, seed=0)
    episodes = 0
    for step, actions in enumerate(uniform(150, 4, JOINTS)):
        result, expected = envs.step(actions), alone.step(actions)
        if wrapper is RecordEpisodeStatistics:
            for _, _, _, _, infos in (result, expected):
                if "episode" in infos:
                    episodes += int(infos["_episode"].sum())
                    infos["episode"].pop("t")  # seconds of the wall clock
        assert_same(result, expected, f"step {step}")
        if mode is AutoresetMode.DISABLED and (result[2] | result[3]).any():
            break
    assert np.isfinite(result[0]).all()
    if wrapper is RecordEpisodeStatistics:
        assert episodes >= 16
        assert list(envs.return_queue) == list(alone.return_queue)
    if wrapper is DictInfoToList:
        assert isinstance(result[4], list) and {"time", "target", "distance"} <= set(result[4][0])


def test_whole_numbers_of_numpy_are_whole_numbers():
    envs = make_batch(
        num_envs=np.int64(2),
        num_threads=np.int32(2),
        max_episode_steps=np.uint8(3),
        overrides=SMALL,
    )
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 2)))[3].tolist() for _ in range(3)]
    assert truncated == [[False, False], [False, False], [True, True]]


# ---- resets of some members --------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"reset_mask": np.array([True, False, True, True])}])
@pytest.mark.parametrize("seed", [None, 5, [7, 8, None, 9]], ids=str)
def test_a_start_that_only_some_members_can_take_changes_nothing(options, seed, monkeypatch):
    """All members start, or none."""
    envs, twin = (make_batch(FORWARD, 4, overrides=SMALL) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((4, 2)))
    prepared = envs.episodes.bodies.prepared

    def refuse_member_2(member: int, *state: Any) -> Any:
        if member == 2:
            raise SimulationEndedError("outline_degenerate", 0.0, "as if it were folded")
        return prepared(member, *state)

    with monkeypatch.context() as patch:
        patch.setattr(envs.episodes.bodies, "prepared", refuse_member_2)
        with refuses(SimulationEndedError, leaving=envs):
            envs.reset(seed=seed, options=options)
    assert_same(envs.step(np.ones((4, 2))), twin.step(np.ones((4, 2))))
    for _ in range(2):
        assert_same(envs.reset(), twin.reset())


def test_the_first_reset_has_to_start_all():
    envs = make_batch()
    with refuses(OptionError, "reset_mask", "first"):
        envs.reset(options={"reset_mask": np.array([True, False, True])})
    with refuses(gymnasium.error.ResetNeeded, "reset"):
        envs.step(np.zeros((3, 8)))


def test_members_that_ended_are_named_where_nobody_starts_them():
    arguments: dict[str, Any] = {"overrides": SMALL, "max_episode_steps": 3}
    envs, twin = (make_batch(FORWARD, 4, autoreset_mode="Disabled", **arguments) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((4, 2)))
        each.reset(options={"reset_mask": np.array([True, False, True, False])})
        each.step(np.ones((4, 2)))
        assert each.step(np.ones((4, 2)))[3].tolist() == [False, True, False, True]
    for _ in range(2):
        with refuses(gymnasium.error.ResetNeeded, "[1, 3]", "reset_mask", leaving=envs):
            envs.step(np.ones((4, 2)))
    reset_both(envs, twin, options={"reset_mask": np.array([False, True, False, True])})
    assert_same(envs.step(np.ones((4, 2))), twin.step(np.ones((4, 2))))
