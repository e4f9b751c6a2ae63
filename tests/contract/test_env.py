"""The single environments: observations, rewards, infos, starts, ends and targets.

What they have in common with the batched ones is in test_environments.py.
"""

import copy
import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, check_returned_data_not_reused
from numpy.typing import NDArray

from swim_env import (
    TERMINATION_REASONS,
    OptionError,
    SceneError,
    SimulationEndedError,
    Simulator,
    SwimEnv,
    SwimTargetEnv,
    load_scene,
)
from tests.support import (
    FORWARD,
    LIVELY,
    SMALL,
    TARGET,
    assert_one_line,
    assert_same,
    each_task,
    make,
    refuses,
    uniform,
)

Array = NDArray[np.float64]

#: A start that moves, bends and lies anywhere, with a goal in a direction of its own.
ASKEW: dict[str, object] = {
    "initial.position": (3.0, -2.0),
    "initial.heading": 0.4,
    "initial.joint_angles": 0.1,
    "initial.velocity": (0.2, -0.1),
    "episode.heading": (math.cos(2.0), math.sin(2.0)),
    "beam.length": 1.5,
}
VARIANTS: dict[str, tuple[str, dict[str, object]]] = {
    "swimmer": ("swimmer", {}),
    "paper_ix, torques in front only": ("paper_ix", {}),
    "torques up to a joint": ("paper_ix", {"beam.elements": 10}),
    "paper_x, no actuation": ("paper_x", {}),
    "askew": ("swimmer", ASKEW),
    "two elements": ("swimmer", {"beam.elements": 2}),
    "no fluid": ("swimmer", {"fluid": None}),
    "axial added mass": ("swimmer", {"axial_added_mass": True}),
    "twelve panels": ("swimmer", {"fluid.panels_per_element": 12}),
    "another torque limit": ("swimmer", {"actuation.torque_limit": 0.3}),
    "an action every step": ("swimmer", {"episode.control_interval": 0.005}),
    "another interval": ("paper_i", {"episode.control_interval": 0.07}),
}


def twin_of(env: SwimEnv) -> Simulator:
    """Return a simulator at the place where the environment has just started."""
    simulator = Simulator(env.scene)
    simulator.reset_to(env.coordinates, env.velocity)
    return simulator


def torque_of(env: SwimEnv, action: Any) -> Array:
    """Return the torques of an action from what the documentation says of it."""
    scene = env.scene
    limit = 1.0 if scene.actuation is None else scene.actuation.torque_limit
    until = 1.0 if scene.actuation is None else scene.actuation.active_until
    elements = scene.beam.elements
    driven = np.arange(1, elements) / elements <= until
    return np.where(driven, limit, 0.0) * np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)


def head_direction(simulator: Simulator) -> Array:
    mean = simulator.angles.mean()
    return -np.array([math.cos(mean), math.sin(mean)])


def place_of(simulator: Simulator) -> Array:
    """Return time, mean centre and element angles."""
    return np.array([simulator.time, *simulator.centres.mean(axis=0), *simulator.angles])


def expected_observation(simulator: Simulator, earlier: Array, goal: Any, is_point: bool) -> Array:
    """Return the documented observation of a simulator's state, in full precision.

    Velocities are means since an earlier `place_of` it, or at a start those of the start.
    """
    length = simulator.scene.beam.length
    centre = simulator.centres.mean(axis=0)
    moved = place_of(simulator) - earlier
    velocity = moved[1:] / moved[0] if moved[0] > 0.0 else simulator.velocity()
    turning = velocity[2:]
    ahead = head_direction(simulator)
    left = np.array([-ahead[1], ahead[0]])
    away = np.asarray(goal) - centre if is_point else np.asarray(goal)
    distance = float(np.hypot(*away))
    # Rates count per control interval.
    interval = simulator.scene.episode.control_interval
    speed = 0.002 * length / interval
    seen = [
        *(np.diff(simulator.angles) / 0.1),
        *(np.diff(turning) * interval / 0.1),
        left @ away / distance,
        ahead @ away / distance,
        ahead @ velocity[:2] / speed,
        left @ velocity[:2] / speed,
        turning.mean() * interval / 0.02,
    ]
    if is_point:
        seen.append(distance / length)
    return np.clip(seen, -100.0, 100.0)


def goal_of(env: SwimEnv, info: Mapping[str, Any]) -> Array:
    return np.asarray(info["target"] if "target" in info else env.scene.episode.heading)


def random_actions(env: SwimEnv, count: int, seed: int = 0) -> Array:
    return uniform(count, env.scene.beam.elements - 1, seed=seed)


# ---- observations, infos and rewards -----------------------------------------------------------


@each_task
@pytest.mark.parametrize("variant", VARIANTS)
def test_an_episode_is_what_the_documentation_says(task, variant):
    """Beside a simulator that plays the torques of the actions, which are clipped, and held."""
    scene, overrides = VARIANTS[variant]
    env = make(task, scene, overrides=overrides)
    env.reset(seed=2)
    env.step(np.ones(env.action_space.shape))  # of which nothing is left after a reset
    observation, info = env.reset(seed=3)
    simulator, goal, first = twin_of(env), goal_of(env, info), info
    length, interval = env.scene.beam.length, env.scene.episode.control_interval
    hold = round(interval / simulator.time_step)
    assert env.metadata["render_fps"] == round(1.0 / interval)
    np.testing.assert_array_equal(env.goal, goal)
    np.testing.assert_array_equal(env.torques, 0.0)
    size = 2 * (env.scene.beam.elements - 1) + 5 + (task == TARGET)
    start, total = simulator.centres.mean(axis=0), 0.0
    actions = 1.5 * random_actions(env, 3 if variant == "twelve panels" else 12)
    for count, action in enumerate([None, *actions]):
        reward = work = positive = 0.0
        earlier = place_of(simulator)
        if action is not None:
            observation, reward, terminated, truncated, info = env.step(action)
            assert terminated is truncated is False
            run = simulator.rollout(np.tile(torque_of(env, action), (hold, 1)))
            work, positive = run.work.sum(), run.positive_work.sum()
            np.testing.assert_array_equal(env.torques, torque_of(env, action))
        np.testing.assert_array_equal(env.coordinates, simulator.coordinates)
        np.testing.assert_allclose(env.velocity, simulator.velocity(), atol=1e-12)

        expected = expected_observation(simulator, earlier, goal, task == TARGET)
        assert observation.dtype == np.float32
        assert observation.shape == (size,) == env.observation_space.shape
        assert observation in env.observation_space
        np.testing.assert_allclose(observation, expected, rtol=2e-7, atol=1e-8)

        assert list(info) == list(first)
        centre, ahead = simulator.centres.mean(axis=0), head_direction(simulator)
        if task == TARGET:
            away = goal - centre
            progress = np.hypot(*(goal - start)) - np.hypot(*away)
            assert info["distance"] == pytest.approx(np.hypot(*away) / length, rel=1e-12)
            np.testing.assert_array_equal(info["target"], goal)
            assert info["success"] is info["is_success"] is False
        else:
            away = goal
            progress = (centre - start) @ goal
            assert "distance" not in info and "target" not in info
        error = math.atan2(ahead[0] * away[1] - ahead[1] * away[0], ahead @ away)
        total += reward
        assert info["time"] == pytest.approx(count * interval, rel=1e-12)
        np.testing.assert_allclose(info["position"], centre, rtol=0.0, atol=1e-14)
        assert info["progress"] == pytest.approx(progress / length, abs=1e-12)
        assert info["heading_error"] == pytest.approx(error, abs=1e-12)
        tolerance = 1e-14 if hold > 1 else 0.0
        assert info["work"] == pytest.approx(work, rel=0.0, abs=tolerance)
        assert info["positive_work"] == pytest.approx(positive, rel=0.0, abs=tolerance)
        assert info["termination_reason"] == ""
        assert info["reward_progress"] == reward
        assert info["reward_effort"] == info["reward_heading"] == 0.0
        assert total == pytest.approx(info["progress"], abs=1e-12)


def test_observations_are_clipped_and_finite_at_the_very_goal():
    env = make(TARGET)
    spin = {"velocity": (60.0, -75.0), "velocity_slope": 150.0, "turning_rate": 150.0}
    observation, _ = env.reset(options={"noise": 0.0, "target": (-300.0, 0.0), **spin})
    np.testing.assert_array_equal(observation[[18, 20, 21]], [-100.0, 100.0, 100.0])
    assert observation in env.observation_space
    rates = [0.0 if k % 2 else 1200.0 for k in range(9)]
    velocity = np.zeros((9, 2))
    for k in range(1, 9):
        swing = 0.5 * env.scene.beam.element_length * (rates[k] + rates[k - 1])
        velocity[k] = velocity[k - 1] + (0.0, swing)
    velocity -= velocity.mean(axis=0)
    observation, _ = env.reset(
        options={"noise": 0.0, "velocity": velocity.tolist(), "turning_rate": rates}
    )
    np.testing.assert_array_equal(observation[8:16], [-100.0, 100.0] * 4)
    env.reset(options={"noise": 0.0, "target": (0.5, 0.0)})
    assert np.isfinite(env.step(np.zeros(8))[0]).all()


@each_task
def test_spaces_are_as_documented(task):
    for elements in (2, 9, 20):
        env = make(task, overrides={"beam.elements": elements, "fluid": None})
        joints = elements - 1
        assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (joints,), np.float32)
        high = np.full(2 * joints + 5 + (task == TARGET), 100.0, dtype=np.float32)
        high[2 * joints : 2 * joints + 2] = 1.0
        low = -high
        if task == TARGET:
            low[-1] = 0.0
        assert env.observation_space == gymnasium.spaces.Box(low, high, dtype=np.float32)


@each_task
def test_rewards_of_an_episode_sum_to_its_net_displacement(task):
    """A whole episode of 20 s, also against a simulator that plays the same torques."""
    env = make(task)
    _, first = env.reset(seed=11)
    simulator = twin_of(env)
    goal = goal_of(env, first)
    actions = random_actions(env, 1000)
    rewards = []
    for count, action in enumerate(actions, start=1):
        _, reward, terminated, truncated, info = env.step(action)
        assert type(reward) is float
        rewards.append(reward)
        assert (terminated, truncated) == (False, count == 1000)
    simulator.rollout(np.repeat(actions, env.scene.steps_per_action, axis=0))
    np.testing.assert_array_equal(simulator.coordinates, env.coordinates)
    for last in (info["position"], simulator.coordinates[:2]):
        if task == TARGET:
            net = np.hypot(*(goal - first["position"])) - np.hypot(*(goal - last))
        else:
            net = (last - first["position"]) @ goal
        assert abs(sum(rewards) - net) < 1e-12
    if task == TARGET:
        assert abs(sum(rewards) - (first["distance"] - info["distance"])) < 1e-12
    assert abs(sum(rewards)) > 1e-3
    assert info["time"] == pytest.approx(20.0)


@each_task
def test_effort_and_heading_cost_what_their_weights_say(task):
    plain = make(task)
    weighted = make(task, effort_weight=0.7, heading_weight=1.3)
    for env in (plain, weighted):
        env.reset(seed=5)
    for action in 1.5 * random_actions(plain, 10):
        _, bare, *_ = plain.step(action)
        _, reward, _, _, info = weighted.step(action)
        effort = -0.7 * np.mean(np.clip(action, -1.0, 1.0) ** 2) * 0.02
        heading = -1.3 * (1.0 - math.cos(info["heading_error"])) * 0.02
        assert info["reward_effort"] == pytest.approx(effort, rel=1e-12)
        assert info["reward_heading"] == pytest.approx(heading, rel=1e-9)
        assert info["reward_progress"] == bare
        terms = (info["reward_progress"], info["reward_effort"], info["reward_heading"])
        assert reward == pytest.approx(sum(terms), rel=1e-14)
        assert effort < 0.0 and heading < 0.0
    _, info = weighted.reset()
    assert info["reward_effort"] == info["reward_heading"] == info["reward_progress"] == 0.0


def test_half_an_interval_costs_half():
    """Where the physics ends in the middle of an interval, only the time that passed counts."""
    overrides = {**LIVELY, "episode.control_interval": 0.4}
    env = make(overrides=overrides, effort_weight=1.0, heading_weight=1.0)
    partial = 0
    for seed in range(10):
        _, info = env.reset(seed=seed)
        action = np.sign(random_actions(env, 1, seed)[0])
        ended = False
        while not ended:
            before = info["time"]
            _, _, ended, _, info = env.step(action)
        passed = info["time"] - before
        partial += 0.0 < passed < 0.4
        assert info["reward_effort"] == pytest.approx(-passed, abs=1e-12)
        bend = 1.0 - math.cos(info["heading_error"])
        assert info["reward_heading"] == pytest.approx(-bend * passed, abs=1e-12)
    assert partial > 0


# ---- scenes ------------------------------------------------------------------------------------


@each_task
def test_a_scene_is_given_by_name_path_object_or_overrides(task, tmp_path):
    scene = load_scene("swimmer", ["beam.elements=5", "beam.bending_stiffness=3.0"])
    file = tmp_path / "mine.yaml"
    scene.save(file)
    for way in (
        {"scene": scene},
        {"scene": file},
        {"scene": str(file)},
        {"overrides": {"beam.elements": 5, "beam.bending_stiffness": 3.0}},
        {"overrides": ["beam.elements=5", "beam.bending_stiffness=3.0"]},
        {"scene": scene.replace("beam.elements", 7), "overrides": "beam.elements=5"},
    ):
        env = make(task, **way)  # type: ignore[arg-type]
        assert env.scene.beam == scene.beam
        assert env.reset(seed=0)[0].shape == (13 + (task == TARGET),)
    assert make(task).scene == load_scene("swimmer")
    assert isinstance(gymnasium.make(f"swim_env:{task}").unwrapped, SwimEnv)
    assert make(task, "paper_i").scene == load_scene("paper_i")


@pytest.mark.parametrize(
    "overrides",
    [
        {"episode.duration": 1e308},
        {"episode.control_interval": 1e308},
        {"episode.control_interval": 1e12},
    ],
    ids=str,
)
def test_an_episode_beyond_all_bounds_works_or_is_refused_by_name(overrides):
    try:
        env = make(overrides=overrides)
    except SceneError as error:
        assert_one_line(str(error), next(iter(overrides)))
        return
    assert env.reset(seed=0)[0] in env.observation_space


# ---- start -------------------------------------------------------------------------------------


def start_of(env: SwimEnv, **arguments: Any) -> tuple[Array, Array]:
    """Reset and return coordinates and velocities of the start."""
    env.reset(**arguments)
    return env.coordinates, env.velocity


@each_task
@pytest.mark.parametrize("overrides", [{}, ASKEW], ids=["straight", "askew"])
def test_without_noise_the_start_is_the_scenes(task, overrides):
    env = make(task, overrides=overrides)
    simulator = Simulator(env.scene)
    for seed in (0, 1):
        coordinates, velocity = start_of(env, seed=seed, options={"noise": 0})
        np.testing.assert_array_equal(coordinates, simulator.coordinates)
        np.testing.assert_allclose(velocity, simulator.velocity(), atol=1e-13)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_noise_of_the_start_fills_its_bounds(factor):
    overrides = {
        "fluid": None,
        "episode.bend_noise": 0.02,
        "episode.heading_noise": 0.3,
        "episode.velocity_noise": 0.01,
        "beam.length": 2.0,
    }
    env = make(overrides=overrides)
    start_of(env, seed=0)
    starts = [start_of(env, options={"noise": factor}) for _ in range(300)]
    coordinates, velocity = (np.array(part) for part in zip(*starts, strict=True))
    heading = np.cumsum(coordinates[:, 2:], axis=1).mean(axis=1)
    rates = velocity[:, 2:] * 2.0
    np.testing.assert_array_equal(rates, rates[:, :1] * np.ones(9))
    np.testing.assert_array_equal(coordinates[:, :2], [[1.0, 0.0]] * 300)
    for values, bound in (
        *((coordinates[:, 3 + k], 0.02) for k in range(8)),
        (heading, 0.3),
        (velocity[:, 0], 0.01),
        (velocity[:, 1], 0.01),
        (rates[:, 0], 0.01),
    ):
        bound = bound * factor
        assert np.abs(values).max() <= bound * (1.0 + 1e-12)
        assert values.max() > 0.9 * bound and values.min() < -0.9 * bound
        assert abs(values.mean()) < 0.15 * bound
        assert values.std() == pytest.approx(bound / math.sqrt(3.0), rel=0.1)


def test_a_body_is_turned_with_the_motion_that_it_has():
    """Noise of the heading leaves the velocity along and across the body as the scene has it."""
    overrides = {
        "initial.velocity": (-0.3, 0.1),
        "episode.heading_noise": 0.5,
        "episode.bend_noise": 0.0,
        "episode.velocity_noise": 0.0,
    }
    env = make(overrides=overrides)
    env.reset(seed=0)
    headings = []
    for _ in range(20):
        observation, info = env.reset()
        headings.append(info["heading_error"])
        np.testing.assert_allclose(observation[18:21], [3.0, -1.0, 0.0], rtol=1e-6, atol=1e-7)
    assert np.std(headings) > 0.1
    # A velocity given to reset is meant as it is, whatever the heading.
    _, velocity = start_of(env, options={"velocity": (-0.3, 0.1)})
    np.testing.assert_allclose(velocity[:2], [-0.3, 0.1], atol=1e-16)


@each_task
def test_options_change_only_what_they_name(task):
    env = make(task)
    plain, drift = start_of(env, seed=2)
    aim = env.goal - plain[:2]
    bend = [0.05 * math.cos(k) for k in range(8)]
    spin = {"velocity": (0.0, -0.5), "velocity_slope": 1.0, "turning_rate": 1.0}
    # Options, from where on coordinates are known, these, the velocity, and how exact that is.
    for options, first, place, velocity, tolerance in (
        ({"joint_angles": bend}, 3, bend, drift, 0.0),
        ({"heading": 0.6}, 2, [0.6, *plain[3:]], drift, 0.0),
        ({"velocity": (0.1, 0.2)}, 0, plain, [0.1, 0.2, *drift[2:]], 1e-16),
        ({"turning_rate": 0.0}, 0, plain, [*drift[:2], *[0.0] * 9], 1e-16),
        (spin, 0, plain, [0.0, 0.0, *[1.0] * 9], 1e-15),
        ({"position": (4.0, -3.0)}, 2, plain[2:], drift, 0.0),
    ):
        found, moving = start_of(env, seed=2, options=options)
        np.testing.assert_array_equal(found[first:], place, err_msg=str(options))
        np.testing.assert_allclose(moving, velocity, rtol=0.0, atol=tolerance)
    # The position, which was given last, is that of the head's end node.
    ahead = np.array([math.cos(found[2]), math.sin(found[2])])
    head = twin_of(env).centres[0] - 0.5 * env.scene.beam.element_length * ahead
    np.testing.assert_allclose(head, (4.0, -3.0), atol=1e-12)
    if task == TARGET:
        point = (-2.0, 1.0)
        _, info = env.reset(seed=2, options={"target": point})
        np.testing.assert_array_equal(info["target"], point)
        np.testing.assert_array_equal(env.coordinates, plain)
        for other in ({"joint_angles": bend}, {"position": (4.0, -3.0)}, {"noise": 0.0}):
            _, info = env.reset(seed=2, options=other)
            np.testing.assert_allclose(info["target"] - info["position"], aim, atol=1e-15)


@pytest.mark.parametrize(
    ("task", "options"),
    [
        (FORWARD, {"noise": 0.0}),
        (FORWARD, {"joint_angles": 0.05}),
        (FORWARD, {"velocity": (0.1, 0.0)}),
        (FORWARD, {"position": (3.0, 3.0), "heading": 0.5, "joint_angles": 0.0, "noise": 2}),
        (TARGET, {"heading": 1.0}),
        (TARGET, {"target": (1.0, 1.0)}),
        (TARGET, {}),
        (TARGET, None),
    ],
    ids=str,
)
def test_options_hold_for_one_start_and_leave_the_draws_alone(task, options):
    env, twin = make(task, overrides=SMALL), make(task, overrides=SMALL)
    given = copy.deepcopy(options)
    env.reset(seed=6, options=options)
    twin.reset(seed=6)
    assert options == given
    for _ in range(3):
        assert_same(env.reset(), twin.reset())


# ---- snapshots ---------------------------------------------------------------------------------


@each_task
def test_snapshots_of_an_ended_or_fresh_episode_are_what_they_were(task):
    env = make(task, overrides={**LIVELY, "actuation.torque_limit": 30.0})
    fresh = env.snapshot()
    env.reset(seed=0)
    while not env.step(np.ones(3))[2]:
        pass
    ended = env.snapshot()
    env.reset()
    env.step(np.zeros(3))
    env.restore(ended)
    with pytest.raises(SimulationEndedError):
        env.step(np.zeros(3))
    env.restore(fresh)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))


@each_task
def test_a_snapshot_holds_what_an_end_at_once_still_shows(task):
    """Where not one more step can be taken, the next observation is of the restored state."""
    overrides = {"actuation.torque_limit": 1e7}
    env, other = make(task, overrides=overrides), make(task, overrides=overrides)
    env.reset(seed=3)
    for action in 1e-7 * random_actions(env, 5):
        before, *_ = env.step(action)
    snapshot = env.snapshot()
    last = env.step(np.ones(8))
    assert last[2] and last[4]["time"] == pytest.approx(0.1)
    np.testing.assert_array_equal(last[0], before)
    other.reset(seed=4)
    for each in (env, other):
        each.restore(snapshot)
        assert_same(each.step(np.ones(8)), last)


@each_task
def test_state_torques_and_goal_are_copies_and_are_restored(task):
    def all_of(env: SwimEnv) -> list[Array]:
        return [env.coordinates, env.velocity, env.torques, env.goal]

    env, other = make(task), make(task)
    env.reset(seed=3)
    env.step(random_actions(env, 1)[0])
    snapshot, told = env.snapshot(), all_of(env)
    kept = copy.deepcopy(told)
    for value in all_of(env):
        value[:] = np.nan
    env.step(np.ones(8))
    assert_same(told, kept)
    other.reset(seed=9)
    for each in (env, other):
        each.restore(snapshot)
        assert_same(all_of(each), kept)


# ---- ends --------------------------------------------------------------------------------------


@each_task
@pytest.mark.parametrize(
    ("limit", "stiffness", "action", "reason"),
    [
        (3.0, 0.5, np.ones(8), "outline_degenerate"),
        (3.0, 0.5, np.eye(8)[4], "outline_degenerate"),
        (20.0, 5.0, np.ones(8), "under_resolved_gap"),
        (1e9, 5.0, np.ones(8), "step_not_solved"),
    ],
)
def test_violent_actions_end_the_episode_by_name(task, limit, stiffness, action, reason):
    overrides = {"actuation.torque_limit": limit, "beam.bending_stiffness": stiffness}
    env = make(task, overrides=overrides)
    for seed in range(2):
        observation, info = env.reset(seed=seed)
        simulator, goal = twin_of(env), goal_of(env, info)
        terminated = False
        actions = 0
        while not terminated:
            before, expected = info, observation
            observation, reward, terminated, _, info = env.step(action)
            actions += 1
        assert terminated is True and info["termination_reason"] == reason
        assert reason in TERMINATION_REASONS
        with pytest.raises(SimulationEndedError) as ended:
            for step in range(4 * actions):
                if step % 4 == 0:
                    earlier = place_of(simulator)
                simulator.step(torque_of(env, action))
        assert ended.value.reason == reason
        # The last state that was reached is the one that is observed.
        assert info["time"] == pytest.approx(simulator.time) and info["time"] >= before["time"]
        np.testing.assert_array_equal(env.coordinates, simulator.coordinates)
        if simulator.time > earlier[0]:
            expected = expected_observation(simulator, earlier, goal, task == TARGET)
        np.testing.assert_allclose(observation, expected, rtol=1e-6, atol=1e-6)
        assert reward == pytest.approx(info["progress"] - before["progress"], abs=1e-12)
        if task == FORWARD:
            assert reward == pytest.approx(before["position"][0] - info["position"][0], abs=1e-12)


@each_task
def test_a_step_after_the_end_is_refused_until_a_reset(task):
    """Also where the end came with the last step of the time limit: then it is both."""
    env = make(task, overrides={"actuation.torque_limit": 1e7, "episode.duration": 0.02})
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(np.ones(8))
    reason = info["termination_reason"]
    assert terminated and truncated and reason
    with refuses(SimulationEndedError, reason, "call reset", leaving=env) as caught:
        env.step(np.zeros(8))
    assert caught.value.reason == reason
    with pytest.raises(OptionError):
        env.reset(options={"nois": 1})
    with pytest.raises(SimulationEndedError):
        env.step(np.zeros(8))
    env.reset()
    assert not env.step(np.zeros(8))[2]


# ---- what Gymnasium and Stable-Baselines3 ask for ----------------------------------------------

CHECKED: list[dict[str, Any]] = [
    {},
    {"overrides": {"beam.elements": 2}},
    {"scene": "paper_x"},
    {"scene": "paper_ix", "effort_weight": 0.1, "heading_weight": 0.1},
    {"overrides": {"fluid": None}},
    {"overrides": LIVELY},
]


@each_task
@pytest.mark.parametrize("arguments", CHECKED, ids=str)
def test_the_checkers_find_nothing(task, arguments):
    """Their warnings are errors here."""
    env = make(task, **arguments)
    check_env(env, skip_render_check=True)
    check_returned_data_not_reused(env)
    assert env.spec is not None and env.spec.id == task
    direct = (SwimEnv if task == FORWARD else SwimTargetEnv)(**arguments)
    check_env(direct, skip_render_check=True)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(task, **arguments), warn=True, skip_render_check=True)


# ---- target ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "bearing", "heading"),
    [
        ((0.5, 1.5), 0.5 * math.pi, (-1.0, 0.0)),
        ((2.0, 2.5), math.pi, (0.6, 0.8)),
        ((0.7, 0.7), 0.2, (0.0, -1.0)),
        ((0.3, 4.0), 0.0, (-1.0, 0.0)),
    ],
)
def test_random_targets_fill_their_bounds(distance, bearing, heading):
    overrides = {"fluid": None, "episode.heading": heading, "beam.length": 2.0}
    env = make(TARGET, overrides=overrides, target_distance=distance, target_bearing=bearing)
    env.reset(seed=0)
    far, angles = [], []
    for _ in range(300):
        _, info = env.reset()
        away = info["target"] - info["position"]
        far.append(np.hypot(*away) / 2.0)
        ahead, left = away @ heading, away @ np.array([-heading[1], heading[0]])
        angles.append(math.atan2(left, ahead))
        assert info["distance"] == pytest.approx(far[-1])
        assert not info["success"] and info["termination_reason"] == ""
    low, high = distance
    assert low - 1e-12 <= min(far) <= low + 0.1 * (high - low) + 1e-12
    assert high - 0.1 * (high - low) - 1e-12 <= max(far) <= high + 1e-12
    assert -bearing - 1e-12 <= min(angles) <= -0.9 * bearing + 1e-12
    assert 0.9 * bearing - 1e-12 <= max(angles) <= bearing + 1e-12


@pytest.mark.parametrize("length", [1.0, 2.0])
def test_reaching_the_target_ends_the_episode(length):
    """A body that drifts to a point reaches it at the first step inside the radius."""
    radius = 0.2
    env = make(TARGET, overrides={"fluid": None, "beam.length": length}, target_radius=radius)
    options = {"noise": 0.0, "velocity": (-1.0, 0.0), "target": (0.0, 0.02)}
    _, info = env.reset(options=options)
    start, total, terminated = info["distance"], 0.0, False
    assert start == pytest.approx(math.hypot(0.5, 0.02 / length))
    while not terminated:
        assert info["distance"] > radius
        assert info["success"] is info["is_success"] is False
        observation, reward, terminated, truncated, info = env.step(np.zeros(8))
        total += reward
        assert not truncated and math.isfinite(reward)
        assert observation[-1] == np.float32(info["distance"])
    assert info["distance"] <= radius
    assert info["termination_reason"] == "target_reached"
    assert info["success"] is info["is_success"] is True
    assert abs(total - (start - info["distance"])) < 1e-12
    with pytest.raises(SimulationEndedError, match="target_reached.*call reset"):
        env.step(np.zeros(8))
    _, info = env.reset()
    assert info["success"] is False and info["termination_reason"] == ""


def test_passing_outside_the_radius_does_not_reach():
    env = make(TARGET, overrides={"fluid": None}, target_radius=0.1)
    options = {"noise": 0.0, "velocity": (-1.0, 0.0), "target": (0.0, 0.11)}
    _, info = env.reset(options=options)
    least = info["distance"]
    for _ in range(60):
        _, _, terminated, _, info = env.step(np.zeros(8))
        least = min(least, info["distance"])
        assert not terminated
    assert 0.1 < least < 0.12
    assert info["distance"] > 0.5 and info["progress"] < 0.0


def test_a_target_too_far_to_measure_is_refused_or_finite():
    env = make(TARGET, overrides={"fluid": None})
    env.reset(seed=0)
    try:
        env.reset(options={"target": (1e200, 0.0)})
    except OptionError as error:
        assert_one_line(str(error), "target")
        return
    assert math.isfinite(env.step(np.ones(8))[1])
