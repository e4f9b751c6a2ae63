"""The environments in space: what is seen and paid, batches, starts, snapshots, the checkers."""

import copy
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, check_returned_data_not_reused
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swim_env import ActionError, OptionError, SceneError, SwimEnv, SwimVectorEnv, load_scene
from swim_env.envs.spatial import SwimEnv3D, SwimTargetEnv3D, SwimVectorEnv3D
from swim_env.envs.tasks import ForwardTask, Start
from swim_env.physics.spatial.invariants import directors_of, heading_of
from tests.support import (
    FORWARD_3D,
    SPATIAL_TASKS,
    TARGET_3D,
    assert_same,
    each_mode,
    make_singles,
    refuses,
    state_of,
    uniform,
)

Array = NDArray[np.float64]

each_task = pytest.mark.parametrize("task", SPATIAL_TASKS, ids=("forward", "target"))
#: Bends beyond what its joints may within a second or so.
LIVELY: dict[str, Any] = {
    "beam.elements": 4,
    "beam.lateral_stiffness": 0.3,
    "beam.dorsoventral_stiffness": 0.3,
    "damping.retardation_time": 0.005,
    "episode.duration": 1.0,
}
#: Mirrors left and right: true vectors and pseudovectors (pitch, yaw, roll) of joints.
LEFT_RIGHT, JOINTS = np.array([1.0, -1.0, 1.0]), np.array([1.0, -1.0, -1.0])


def make(id_: str = FORWARD_3D, **arguments: Any) -> SwimEnv:
    env = gymnasium.make(id_, **arguments).unwrapped
    assert isinstance(env, SwimEnv)
    return env


def frame_of(coordinates: Array) -> Array:
    """Return forward, left and up of a body, in columns."""
    d1, d2, d3 = heading_of(directors_of(coordinates)[0]).T
    return np.stack([-d3, -d1, d2], axis=1)


def begin(env: SwimEnv, rotation: Rotation, shift: Array) -> Array:
    """Go to the present start turned and shifted; return what is observed."""
    episodes, coordinates, velocity = env.episodes, env.coordinates, env.velocity
    coordinates[:3] = rotation.apply(coordinates[:3]) + shift
    head = rotation * Rotation.from_quat(coordinates[3:7], scalar_first=True)
    coordinates[3:7] = head.as_quat(scalar_first=True)
    velocity = rotation.apply(velocity.reshape(-1, 3)).ravel()
    goal = rotation.apply(env.goal) + shift * env.task.goal_is_point
    state = episodes.bodies.prepared(0, coordinates, velocity)
    episodes.begin(0, Start(coordinates, velocity, goal), state)
    return episodes.observations[0].copy()


# ---- what is seen and paid ---------------------------------------------------------------------


@each_task
@pytest.mark.parametrize("scene", ["eel_3d", "fish_3d"])
def test_an_episode_is_what_the_documentation_says(task, scene):
    env = make(task, scene=scene)
    seen, info = env.reset(seed=3)
    body, axes = env.scene, len(env.scene.axes)
    joints, interval, length = body.joints, body.episode.control_interval, body.beam.length
    assert env.action_space.shape == (joints * axes,)
    assert seen.shape == (6 * joints + 9 + (task == TARGET_3D),)
    assert info["position"].shape == (3,)
    for action in uniform(30, joints * axes, seed=1, size=1.3):
        before = env.coordinates
        frame_before, seen_before = frame_of(before), seen
        seen, reward, *_, info = env.step(action)
        now = env.coordinates
        frame = frame_of(now)
        rotations, earlier = (directors_of(one)[1] for one in (now, before))
        goal = env.goal
        if task == TARGET_3D:
            goal = (goal - now[:3]) / np.linalg.norm(goal - now[:3])
        turned = Rotation.from_matrix(frame_before.T @ frame).as_rotvec()
        expected = [
            rotations.ravel() / 0.1,
            (rotations - earlier).ravel() / 0.1,
            frame.T @ goal,
            frame.T @ (now[:3] - before[:3]) / (0.002 * length),
            turned / 0.02,
        ]
        if task == TARGET_3D:
            expected.append([np.linalg.norm(env.goal - now[:3]) / length])
        assert np.allclose(seen, np.concatenate(expected), rtol=1e-5, atol=1e-5)
        assert info["heading_error"] == pytest.approx(math.acos(frame[:, 0] @ goal), abs=1e-9)
        if task == FORWARD_3D:
            gained = -(now[0] - before[0]) / length
        else:
            gained = np.subtract(
                *(np.linalg.norm(env.goal - one[:3]) / length for one in (before, now))
            )
        assert reward == pytest.approx(gained, abs=1e-12)
        held = np.zeros((joints, 3))
        columns = [("pitch", "yaw", "roll").index(axis) for axis in body.axes]
        limits = np.array(body.actuation.torque_limit)
        held[:, columns] = np.clip(action, -1.0, 1.0).reshape(joints, axes) * limits
        assert np.array_equal(env.torques, held)
        assert not np.array_equal(seen, seen_before)
    assert info["time"] == pytest.approx(30 * interval)


@each_task
def test_nothing_depends_on_place_or_on_how_space_is_turned(task):
    """Through 60 random actions; shifting alone leaves what does not measure shifts as it is."""
    actions = uniform(60, 24, seed=2)
    runs = []
    for rotation, shift in (
        (Rotation.identity(), np.zeros(3)),
        (Rotation.identity(), np.array([2.0, -4.0, 8.0])),
        (Rotation.from_rotvec([1.0, -2.0, 0.7]), np.array([0.3, 0.1, -0.2])),
    ):
        # Newton's method stops by the residual, which rounds with the axes of space.
        env = make(task, scene="fish_3d", overrides={"integrator.tolerance": 1e-10})
        env.reset(seed=5)
        seen, rewards = [begin(env, rotation, shift)], []
        for action in actions:
            observation, reward, *_ = env.step(action)
            seen.append(observation)
            rewards.append(reward)
        runs.append((np.array(seen), np.array(rewards)))
    (seen, rewards), (shifted, shifted_rewards), (turned, turned_rewards) = runs
    if task == FORWARD_3D:
        assert np.array_equal(shifted[:, :51], seen[:, :51]), "joints and direction, to the bit"
    for other, paid in ((shifted, shifted_rewards), (turned, turned_rewards)):
        # Observations are of single precision.
        assert np.abs(other - seen).max() < 3e-6 * np.abs(seen).max()
        assert np.abs(paid - rewards).max() < 1e-12


def test_mirrored_actions_give_mirrored_observations():
    seen = []
    for sign in (np.ones(3), JOINTS):
        env = make(FORWARD_3D, scene="fish_3d")
        env.reset(seed=0, options={"noise": 0.0})
        for action in uniform(40, 8, 3, seed=4):
            observation, *_ = env.step((sign * action).ravel())
        seen.append(observation)
    one, other = seen
    signs = np.concatenate([np.tile(JOINTS, 16), LEFT_RIGHT, LEFT_RIGHT, -LEFT_RIGHT])
    assert np.abs(one[[51, 52, 53, 54, 55, 56]]).min() > 1e-4
    assert np.abs(other - signs * one).max() < 1e-5 * np.abs(one).max()


@each_task
def test_rewards_sum_to_the_net_displacement(task):
    env = make(task, scene="eel_3d", overrides={"episode.duration": 4.0})
    env.reset(seed=9)
    start, rewards, ended = env.coordinates[:3], [], False
    while not ended:
        _, reward, terminated, truncated, info = env.step(uniform(18, seed=len(rewards)))
        rewards.append(reward)
        ended = terminated or truncated
    now, length = env.coordinates[:3], env.scene.beam.length
    net = -(now - start)[0] / length
    if task == TARGET_3D:
        net = np.subtract(*(np.linalg.norm(env.goal - at) / length for at in (start, now)))
    assert abs(math.fsum(rewards) - net) < 1e-12 and abs(info["progress"] - net) < 1e-12


def test_effort_and_heading_cost_what_their_weights_say():
    env = make(FORWARD_3D, effort_weight=0.3, heading_weight=0.2)
    env.reset(seed=1)
    action = uniform(18, seed=1, size=1.5)
    _, reward, *_, info = env.step(action)
    effort = -0.3 * np.mean(np.clip(action, -1.0, 1.0) ** 2) * 0.02
    assert info["reward_effort"] == pytest.approx(effort, rel=1e-12)
    heading = -0.2 * (1.0 - math.cos(info["heading_error"])) * 0.02
    assert info["reward_heading"] == pytest.approx(heading, rel=1e-9)
    parts = ("reward_progress", "reward_effort", "reward_heading")
    assert reward == sum(info[part] for part in parts)


# ---- starts ------------------------------------------------------------------------------------


def test_without_noise_the_start_is_the_scenes():
    env = make(FORWARD_3D, overrides={"initial.joint_rotations": [0.1, -0.2, 0.3]})
    env.reset(seed=0, options={"noise": 0.0})
    assert np.array_equal(env.coordinates, env.task.plan_start({}).coordinates)
    assert not env.velocity.any()


def test_noise_of_the_start_fills_its_bounds():
    """Bends do not turn the body's frame, whose turn is that of the heading's noise."""
    changes = {"episode.bend_noise": 0.2, "episode.heading_noise": 0.3}
    env = make(FORWARD_3D, overrides={**changes, "episode.velocity_noise": 0.01})
    rest = frame_of(make_rest(env))
    bends, turns, velocities = [], [], []
    for seed in range(60):
        env.reset(seed=seed)
        bends.append(directors_of(env.coordinates)[1])
        turn = frame_of(env.coordinates) @ rest.T
        turns.append(Rotation.from_matrix(turn).as_rotvec())
        velocities.append(env.velocity.reshape(-1, 3))
    for found, bound in ((bends, 0.2), (turns, 0.3), (velocities, 0.01)):
        largest = np.abs(found).max(axis=0)
        assert (largest <= bound * (1.0 + 1e-9)).all() and (largest > 0.85 * bound).all()
    assert np.ptp([one[1:] for one in velocities], axis=1).max() < 1e-15, "one rigid motion"


def make_rest(env: SwimEnv) -> Array:
    env.reset(seed=0, options={"noise": 0.0})
    return env.coordinates


def test_options_change_only_what_they_name():
    env = make(FORWARD_3D)
    env.reset(seed=4)
    noisy = env.coordinates, env.velocity
    env.reset(seed=4, options={"velocity": (0.1, 0.0, -0.2)})
    assert np.array_equal(env.coordinates, noisy[0])
    assert np.array_equal(env.velocity[:3], (0.1, 0.0, -0.2))
    assert np.array_equal(env.velocity[3:], noisy[1][3:])
    env.reset(seed=4, options={"joint_rotations": [0.0, 0.3, 0.0], "spin": [0.0, 1.0, 0.0]})
    assert np.allclose(directors_of(env.coordinates)[1], [0.0, 0.3, 0.0], rtol=0.0, atol=1e-15)
    assert np.array_equal(env.velocity[3:], np.tile([0.0, 1.0, 0.0], 10))
    refuses(lambda: env.reset(options={"heading": 0.1}), OptionError, "heading", "spin")


def test_targets_fill_their_cone_evenly():
    env = make(TARGET_3D, target_bearing=1.0, overrides={"episode.heading": [0.6, 0.0, 0.8]})
    angles, around = [], []
    for seed in range(400):
        env.reset(seed=seed)
        way = env.goal - env.coordinates[:3]
        assert 0.5 <= np.linalg.norm(way) / env.scene.beam.length <= 1.5
        angles.append(way @ [0.6, 0.0, 0.8] / np.linalg.norm(way))
        around.append(math.atan2(way[1], way @ [0.8, 0.0, -0.6]))
    # Uniform on the sphere: the cosine is, and so is the angle around.
    assert math.cos(1.0) <= min(angles) < math.cos(1.0) + 0.02 and max(angles) > 0.99
    assert np.mean(angles) == pytest.approx(0.5 * (1.0 + math.cos(1.0)), abs=0.03)
    quarters = np.histogram(around, bins=4, range=(-math.pi, math.pi))[0]
    assert quarters.min() > 70


# ---- batches, snapshots ------------------------------------------------------------------------


@each_task
@each_mode
def test_batches_are_gymnasiums_own_of_single_environments(task, mode):
    given = {"scene": "eel_3d", "overrides": LIVELY}
    ours = gymnasium.make_vec(task, num_envs=5, autoreset_mode=mode, num_threads=2, **given)
    theirs = make_singles(task, 5, mode, **given)
    assert isinstance(ours, SwimVectorEnv)
    assert_same(ours.reset(seed=3), theirs.reset(seed=3))
    ends = 0
    for step, actions in enumerate(uniform(80, 5, 6, seed=1)):
        result = ours.step(actions)
        assert_same(result, theirs.step(actions), f"step {step}")
        ends += np.count_nonzero(result[2])
        if mode is AutoresetMode.DISABLED and (result[2] | result[3]).any():
            mask = result[2] | result[3]
            results = (one.reset(options={"reset_mask": mask.copy()}) for one in (ours, theirs))
            assert_same(*results, f"reset at {step}")
    assert ends > 3, "members end before their time is up"


def test_results_do_not_depend_on_the_batch_or_on_threads():
    results = []
    for count, threads in ((1, 1), (3, 2), (7, 5)):
        envs = SwimVectorEnv3D(count, num_threads=threads, overrides={"beam.elements": 5})
        envs.reset(seed=0)
        for actions in uniform(20, 7, 8, seed=1):
            result = envs.step(actions[:count])
        results.append((result[0][0], result[1][0], envs.episodes.bodies.states[0]))
    for other in results[1:]:
        assert_same(other, results[0])


@pytest.mark.parametrize("kind", [SwimEnv3D, SwimTargetEnv3D])
def test_snapshots_and_copies_continue_bit_for_bit(kind):
    env = kind(overrides={"recording": True})
    env.reset(seed=2)
    actions = uniform(30, 18, seed=3)
    for action in actions[:10]:
        env.step(action)
    snapshot, twin = env.snapshot(), copy.deepcopy(env)
    first = [env.step(action) for action in actions[10:]]
    end = state_of(env)["snapshot"]
    assert_same([twin.step(action) for action in actions[10:]], first)
    env.restore(snapshot)
    assert_same([env.step(action) for action in actions[10:]], first)
    assert_same(env.snapshot(), end)
    assert env.recorded().steps == 20 * 4 and twin.recorded().steps == 30 * 4


# ---- tasks, checkers, refusals -----------------------------------------------------------------


def test_a_turn_is_to_any_side_and_ends_with_success():
    env = make(FORWARD_3D, task="turn", task_options={"turn": [0.4, 0.6], "tolerance": 0.3})
    sides = []
    for seed in range(40):
        env.reset(seed=seed)
        assert 0.4 <= math.acos(-env.goal[0]) <= 0.6
        sides.append(np.sign(env.goal[1:]))
    assert len(np.unique(sides, axis=0)) == 4
    env.reset(seed=0, options={"turn": (0.5, 0.5 * math.pi), "noise": 0.0})
    assert np.allclose(env.goal, [-math.cos(0.5), 0.0, math.sin(0.5)]), "upwards"
    _, info = env.reset(seed=0, options={"turn": (0.31, 0.0), "spin": (0.0, 0.0, 1.0)})
    assert np.allclose(env.goal, [-math.cos(0.31), -math.sin(0.31), 0.0]), "to the left"
    reason = ""
    while not reason:
        *_, truncated, info = env.step(np.zeros(18))
        reason = info["termination_reason"]
        assert not truncated
    assert reason == "heading_reached" and info["success"]


def test_a_station_is_held_in_a_stream_from_any_side():
    stream = {"stream.velocity": [0.1, -0.2, 0.2]}
    env = make(FORWARD_3D, task="station", overrides=stream)
    seen, _ = env.reset(seed=0, options={"noise": 0.0})
    assert np.allclose(seen[-6:], [0, 0, 0, 1 / 3, -2 / 3, -2 / 3], atol=1e-6)
    *_, info = env.step(np.zeros(18))
    drifted = np.array([0.1, -0.2, 0.2]) * 0.02
    assert np.allclose(info["position"] - [0.5, 0.0, 0.0], drifted, rtol=0.0, atol=1e-12)
    assert info["reward_return"] == pytest.approx(-0.3 * 0.02, rel=1e-9)
    assert info["reward_held"] == pytest.approx(0.3 * 0.02, rel=1e-2)


class _Watching(ForwardTask):
    """Observes what a task sees of the body's turning."""

    def observe(self, now):
        return {"rate": now.turning_rate, "gone": now.in_body(now.velocity)}


def test_a_task_of_ones_own_sees_what_the_kernel_observes():
    env = make(FORWARD_3D, task=_Watching, scene="fish_3d")
    env.reset(seed=1, options={"spin": [0.3, -0.2, 0.5]})
    for action in uniform(10, 24, seed=6):
        seen, *_ = env.step(action)
        assert np.allclose(seen[57:60], seen[54:57] * 0.02 / 0.02, rtol=1e-4, atol=1e-5)
        assert np.allclose(seen[60:63], seen[51:54] * 0.002 / 0.02, rtol=1e-4, atol=1e-6)


@each_task
def test_the_checkers_find_nothing(task):
    for arguments in ({}, {"scene": "fish_3d", "overrides": {"beam.elements": 2}}):
        env = make(task, **arguments)
        check_env(env, skip_render_check=True)
        check_returned_data_not_reused(env)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(task), warn=True, skip_render_check=True)
    with_frames = make(task, render_mode="rgb_array")
    check_env(with_frames)


def test_what_does_not_fit_is_refused_in_one_line():
    refuses(lambda: SwimEnv3D("swimmer"), OptionError, "dimension 3", "swimmer", "SwimEnv")
    refuses(lambda: SwimVectorEnv3D(2, "swimmer"), OptionError, "dimension 3", "SwimVectorEnv")
    refuses(lambda: SwimEnv("eel_3d", task="path"), SceneError, "task path", "eel_3d")
    refuses(lambda: make(task="station"), OptionError, "stream", "[0.1, 0.0, 0.0]")
    env = make(TARGET_3D)
    refuses(lambda: env.reset(options={"target": (1.0, 2.0)}), OptionError, "target", "three")
    env.reset(seed=0)
    before = state_of(env)
    bad = np.zeros(18)
    bad[5] = np.nan
    refuses(lambda: env.step(bad), ActionError, "finite", "nan", "the yaw of joint 2")
    refuses(lambda: env.step(np.zeros(9)), ActionError, "(18,)", "(9,)")
    assert_same(state_of(env), before)
    assert load_scene("eel_3d") == env.scene
