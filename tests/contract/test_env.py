"""The single environments: actions, observations, rewards, ends, seeds, options and bad input."""

from __future__ import annotations

import copy
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, check_returned_data_not_reused
from numpy.typing import NDArray

from swim_env import (
    TERMINATION_REASONS,
    ActionError,
    OptionError,
    SceneError,
    SimulationEndedError,
    Simulator,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    load_scene,
)

Array = NDArray[np.float64]

FORWARD = "swim_env/KirchhoffSwimmer-v0"
TARGET = "swim_env/KirchhoffSwimmerTarget-v0"
TASKS = (FORWARD, TARGET)

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
    "paper_x, no actuation": ("paper_x", {}),
    "askew": ("swimmer", ASKEW),
    "two elements": ("swimmer", {"beam.elements": 2}),
    "no fluid": ("swimmer", {"fluid": None}),
    "axial added mass": ("swimmer", {"axial_added_mass": True}),
    "twelve panels": ("swimmer", {"fluid.panels_per_element": 12}),
    "another torque limit": ("swimmer", {"actuation.torque_limit": 0.3}),
    "another interval": ("paper_i", {"episode.control_interval": 0.07}),
}
each_variant = pytest.mark.parametrize("variant", VARIANTS)
each_task = pytest.mark.parametrize("task", TASKS, ids=("forward", "target"))


def make(task: str = FORWARD, scene: Any = "swimmer", **arguments: Any) -> SwimEnv:
    """Make an environment without the wrappers around it."""
    env = gymnasium.make(task, scene=scene, **arguments).unwrapped
    assert isinstance(env, SwimEnv)
    return env


def make_variant(variant: str, task: str = FORWARD, **arguments: Any) -> SwimEnv:
    scene, overrides = VARIANTS[variant]
    return make(task, scene, overrides=overrides, **arguments)


def twin_of(env: SwimEnv) -> Simulator:
    """Return a simulator at the place where the environment has just started."""
    simulator = Simulator(env.scene)
    simulator.reset_to(env.episodes.bodies.coordinates[0], env.episodes.bodies.velocities[0])
    return simulator


def torque_of(env: SwimEnv, action: Any) -> Array:
    """Return the torques of an action from what the documentation says of it."""
    scene = env.scene
    limit = 1.0 if scene.actuation is None else scene.actuation.torque_limit
    until = 1.0 if scene.actuation is None else scene.actuation.active_until
    elements = scene.beam.elements
    driven = np.arange(1, elements) / elements <= until
    return np.where(driven, limit, 0.0) * np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)


def hold(simulator: Simulator, torque: Array, seconds: float) -> None:
    for _ in range(round(seconds / simulator.time_step)):
        simulator.step(torque)


def head_direction(simulator: Simulator) -> Array:
    mean = simulator.angles.mean()
    return -np.array([math.cos(mean), math.sin(mean)])


def expected_observation(simulator: Simulator, goal: Any, is_point: bool) -> Array:
    """Return the documented observation of a simulator's state, in full precision."""
    length = simulator.scene.beam.length
    centre = simulator.centres.mean(axis=0)
    velocity = simulator.velocity()
    turning = velocity[2:]
    ahead = head_direction(simulator)
    left = np.array([-ahead[1], ahead[0]])
    away = np.asarray(goal) - centre if is_point else np.asarray(goal)
    distance = float(np.hypot(*away))
    seen = [
        *(np.diff(simulator.angles) / 0.1),
        *(np.diff(turning) / 5.0),
        left @ away / distance,
        ahead @ away / distance,
        ahead @ velocity[:2] / (0.1 * length),
        left @ velocity[:2] / (0.1 * length),
        turning.mean() / 1.0,
    ]
    if is_point:
        seen.append(distance / length)
    return np.clip(seen, -100.0, 100.0)


def goal_of(env: SwimEnv, info: Mapping[str, Any]) -> Any:
    return info["target"] if "target" in info else env.scene.episode.heading


def random_actions(env: SwimEnv, count: int, seed: int = 0) -> Array:
    shape = (count, env.scene.beam.elements - 1)
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def assert_same(left: Any, right: Any) -> None:
    """Compare nested results of an environment, types and every bit."""
    assert type(left) is type(right), f"{type(left)} and {type(right)}"
    if isinstance(left, dict):
        assert list(left) == list(right)
        for key in left:
            assert_same(left[key], right[key])
    elif isinstance(left, (tuple, list)):
        assert len(left) == len(right)
        for one, other in zip(left, right, strict=True):
            assert_same(one, other)
    elif isinstance(left, np.ndarray):
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right)
    else:
        assert left == right


def play(env: SwimEnv, actions: Any) -> list[Any]:
    """Step through actions, starting anew after every end."""
    results: list[Any] = []
    for action in actions:
        step = env.step(action)
        results.append(step)
        if step[2] or step[3]:
            results.append(env.reset())
    return results


def assert_clear(error: BaseException, *parts: str) -> None:
    """Check that a message is one line that holds these parts."""
    message = str(error)
    assert message.strip() and "\n" not in message, message
    for part in parts:
        assert part in message, f"{part!r} is not in {message!r}"


# ---- what is observed --------------------------------------------------------------------------


@each_task
@each_variant
def test_observations_are_what_the_documentation_says(task: str, variant: str) -> None:
    env = make_variant(variant, task)
    observation, info = env.reset(seed=3)
    simulator = twin_of(env)
    goal = goal_of(env, info)
    actions = random_actions(env, 3 if variant == "twelve panels" else 12)
    size = 2 * (env.scene.beam.elements - 1) + 5 + (task == TARGET)
    for action in [None, *actions]:
        if action is not None:
            observation, _, terminated, _, info = env.step(action)
            assert not terminated
            hold(simulator, torque_of(env, action), env.scene.episode.control_interval)
        expected = expected_observation(simulator, goal, task == TARGET)
        assert observation.dtype == np.float32
        assert observation.shape == (size,) == env.observation_space.shape
        assert observation in env.observation_space
        np.testing.assert_allclose(observation, expected, rtol=2e-7, atol=1e-8)


@each_task
@each_variant
def test_infos_are_what_the_documentation_says(task: str, variant: str) -> None:
    env = make_variant(variant, task)
    _, info = env.reset(seed=4)
    simulator = twin_of(env)
    goal = np.asarray(goal_of(env, info))
    length = env.scene.beam.length
    interval = env.scene.episode.control_interval
    first, start = info, simulator.centres.mean(axis=0)
    total = 0.0
    actions = random_actions(env, 2 if variant == "twelve panels" else 8)
    for count, action in enumerate([None, *actions]):
        reward = work = positive = 0.0
        if action is not None:
            _, reward, _, _, info = env.step(action)
            torque = torque_of(env, action)
            for _ in range(round(interval / simulator.time_step)):
                before = simulator.joint_angles
                simulator.step(torque)
                done = torque * (simulator.joint_angles - before)
                work += done.sum()
                positive += np.maximum(done, 0.0).sum()
        assert list(info) == list(first)
        centre = simulator.centres.mean(axis=0)
        ahead = head_direction(simulator)
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
        assert info["work"] == pytest.approx(work, abs=1e-14)
        assert info["positive_work"] == pytest.approx(positive, abs=1e-14)
        assert info["termination_reason"] == ""
        assert info["reward_progress"] == reward
        assert info["reward_effort"] == info["reward_heading"] == 0.0
        assert total == pytest.approx(info["progress"], abs=1e-12)


def test_joint_angles_run_from_head_to_tail() -> None:
    """A bend, or a torque, at the joint behind the head shows in the first entry."""
    env = make()
    angles = [0.1, *[0.0] * 6, -0.05]
    observation, _ = env.reset(options={"noise": 0.0, "joint_angles": angles})
    np.testing.assert_allclose(observation[:8], np.array(angles) / 0.1, rtol=1e-6)
    observation, _ = env.reset(options={"noise": 0.0})
    # A positive torque turns the element behind its joint counter-clockwise.
    observation, *_ = env.step([1.0, *[0.0] * 7])
    assert observation[0] > 0.1 and observation[0] > 2 * np.abs(observation[2:8]).max()


def test_a_goal_to_the_left_has_a_positive_sine() -> None:
    env = make(TARGET)
    head = np.array([0.5, 0.0])  # the middle of a body along +x whose head points along -x
    for away, sine, cosine in (
        ((-1.0, 0.0), 0.0, 1.0),
        ((0.0, -1.0), 1.0, 0.0),
        ((0.0, 1.0), -1.0, 0.0),
        ((1.0, 0.0), 0.0, -1.0),
    ):
        options = {"noise": 0.0, "target": tuple(head + away)}
        observation, info = env.reset(options=options)
        np.testing.assert_allclose(observation[16:18], [sine, cosine], atol=1e-7)
        assert info["heading_error"] == pytest.approx(math.atan2(sine, cosine))
        assert observation[-1] == pytest.approx(1.0)
    env.reset(options={"noise": 0.0, "target": (0.5, 0.0)})  # at the very point: straight ahead
    assert np.isfinite(env.step(np.zeros(8))[0]).all()


def test_forward_and_leftward_are_the_heads() -> None:
    env = make()
    observation, _ = env.reset(options={"noise": 0.0, "velocity": (-0.2, -0.03)})
    np.testing.assert_allclose(observation[18:20], [2.0, 0.3], rtol=1e-6)


def test_observations_are_clipped() -> None:
    env = make(TARGET)
    spin = {"velocity": (60.0, -75.0), "velocity_slope": 150.0, "turning_rate": 150.0}
    observation, _ = env.reset(options={"noise": 0.0, "target": (-300.0, 0.0), **spin})
    np.testing.assert_array_equal(observation[[18, 20, 21]], [-100.0, 100.0, 100.0])
    assert observation in env.observation_space
    rates = [0.0 if k % 2 else 1200.0 for k in range(9)]
    scene = load_scene("swimmer")
    velocity = np.zeros((9, 2))
    for k in range(1, 9):
        swing = 0.5 * scene.beam.element_length * (rates[k] + rates[k - 1])
        velocity[k] = velocity[k - 1] + (0.0, swing)
    velocity -= velocity.mean(axis=0)
    observation, _ = env.reset(
        options={"noise": 0.0, "velocity": velocity.tolist(), "turning_rate": rates}
    )
    np.testing.assert_array_equal(observation[8:16], [-100.0, 100.0] * 4)


def _turned(vector: Any, angle: float) -> tuple[float, float]:
    x, y = vector
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


@each_task
@pytest.mark.parametrize("angle", [0.0, 2.2])
def test_observations_do_not_depend_on_where_the_body_is(task: str, angle: float) -> None:
    """Shifted, and turned together with its goal, the body sees and gains the same."""
    bend = [0.1 * math.sin(k) for k in range(8)]
    velocity, shift, point = (-0.2, 0.05), np.array([7.0, -11.0]), (-0.7, 0.4)
    runs = []
    for turn, offset in ((0.0, np.zeros(2)), (angle, shift)):
        env = make(task, overrides={"episode.heading": _turned((-1.0, 0.0), turn)})
        options: dict[str, Any] = {
            "noise": 0.0,
            "position": offset,
            "heading": 0.3 + turn,
            "joint_angles": bend,
            "velocity": _turned(velocity, turn),
        }
        if task == TARGET:
            options["target"] = offset + _turned(point, turn)
        observation, _ = env.reset(options=options)
        seen, gained = [observation], []
        for action in random_actions(env, 15):
            observation, reward, *_ = env.step(action)
            seen.append(observation)
            gained.append(reward)
        runs.append((np.array(seen), np.array(gained)))
    np.testing.assert_allclose(runs[1][0], runs[0][0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(runs[1][1], runs[0][1], rtol=0.0, atol=1e-11)
    assert np.abs(runs[0][1]).max() > 1e-4


@each_task
def test_mirrored_actions_give_mirrored_observations(task: str) -> None:
    bend = np.array([0.1 * math.sin(k) for k in range(8)])
    runs = []
    for side in (1.0, -1.0):
        env = make(task)
        options: dict[str, Any] = {
            "noise": 0.0,
            "heading": side * 0.3,
            "joint_angles": side * bend,
            "velocity": (-0.2, side * 0.05),
        }
        if task == TARGET:
            options["target"] = (-0.7, side * 0.4)
        observation, _ = env.reset(options=options)
        seen, gained = [observation], []
        for action in random_actions(env, 15):
            observation, reward, *_ = env.step(side * action)
            seen.append(observation)
            gained.append(reward)
        runs.append((np.array(seen), np.array(gained)))
    odd = np.ones(runs[0][0].shape[1])
    odd[[*range(17), 19, 20]] = -1.0
    np.testing.assert_allclose(runs[1][0], odd * runs[0][0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(runs[1][1], runs[0][1], rtol=0.0, atol=1e-11)


# ---- what is gained ----------------------------------------------------------------------------


@each_task
def test_rewards_of_an_episode_sum_to_its_net_displacement(task: str) -> None:
    """A whole episode of 20 s, also against a simulator that plays the same torques."""
    env = make(task)
    _, first = env.reset(seed=11)
    simulator = twin_of(env)
    goal = np.asarray(goal_of(env, first))
    actions = random_actions(env, 1000)
    rewards = []
    for count, action in enumerate(actions, start=1):
        _, reward, terminated, truncated, info = env.step(action)
        assert type(reward) is float
        rewards.append(reward)
        assert (terminated, truncated) == (False, count == 1000)
    simulator.rollout(np.repeat(actions, 4, axis=0))
    np.testing.assert_array_equal(simulator.coordinates, env.episodes.bodies.coordinates[0])
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
def test_effort_and_heading_cost_what_they_weigh(task: str) -> None:
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


def test_half_an_interval_costs_half() -> None:
    """Where the physics ends in the middle of an interval, only the time that passed counts."""
    env = make(
        overrides={**LIVELY, "episode.control_interval": 0.4},
        effort_weight=1.0,
        heading_weight=1.0,
    )
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


# ---- what is played ----------------------------------------------------------------------------


@each_task
@each_variant
def test_without_noise_and_holding_it_is_the_simulator_bit_for_bit(task: str, variant: str) -> None:
    scene, overrides = VARIANTS[variant]
    step = load_scene(scene, overrides).integrator.time_step
    still = {
        "episode.bend_noise": 0.0,
        "episode.heading_noise": 0.0,
        "episode.velocity_noise": 0.0,
        "episode.control_interval": step,
    }
    env = make(task, scene, overrides={**overrides, **still})
    env.reset(seed=1)
    actions = random_actions(env, 8 if variant == "twelve panels" else 40)
    simulator = Simulator(env.scene)
    start = simulator.coordinates
    trajectory = simulator.rollout([torque_of(env, action) for action in actions])
    np.testing.assert_array_equal(env.episodes.bodies.coordinates[0], start)
    for count, action in enumerate(actions, start=1):
        _, _, _, _, info = env.step(action)
        coordinates = env.episodes.bodies.coordinates[0]
        np.testing.assert_array_equal(np.cumsum(coordinates[2:]), trajectory.angles[count])
        assert info["work"] == trajectory.work[count - 1]
        assert info["positive_work"] == trajectory.positive_work[count - 1]
        np.testing.assert_allclose(
            info["position"], trajectory.centres[count].mean(axis=0), atol=1e-14
        )
    np.testing.assert_array_equal(coordinates, simulator.coordinates)
    np.testing.assert_array_equal(info["position"], simulator.coordinates[:2])


def test_an_action_is_held_over_the_control_interval() -> None:
    for interval, steps in ((0.005, 1), (0.02, 4), (0.05, 10)):
        env = make(overrides={"episode.control_interval": interval})
        assert env.metadata["render_fps"] == round(1.0 / interval)
        env.reset(seed=0)
        simulator = twin_of(env)
        actions = random_actions(env, 5)
        simulator.rollout(np.repeat(actions, steps, axis=0))
        for action in actions:
            _, _, _, _, info = env.step(action)
        assert info["time"] == pytest.approx(5 * interval)
        np.testing.assert_array_equal(env.episodes.bodies.coordinates[0], simulator.coordinates)


def test_actions_beyond_one_count_as_one() -> None:
    wide, clipped = make(), make()
    for env in (wide, clipped):
        env.reset(seed=0)
    for action in 3.0 * random_actions(wide, 10):
        assert_same(wide.step(action), clipped.step(np.clip(action, -1.0, 1.0)))
    assert_same(wide.step(np.full(8, 1e308)), clipped.step(np.ones(8)))
    assert_same(wide.step(np.full(8, -1e308)), clipped.step(-np.ones(8)))


def test_double_precision_actions_are_used_in_full() -> None:
    env = make()
    env.reset(seed=0)
    simulator = twin_of(env)
    actions = random_actions(env, 10)
    assert not np.array_equal(actions, actions.astype(np.float32))
    for action in actions:
        env.step(action)
        hold(simulator, action, 0.02)
    exact = env.episodes.bodies.coordinates[0].copy()
    np.testing.assert_array_equal(exact, simulator.coordinates)
    env.reset(seed=0)
    for action in actions.astype(np.float32):
        env.step(action)
    assert not np.array_equal(exact, env.episodes.bodies.coordinates[0])


def _read_only(action: Array) -> Array:
    action = action.copy()
    action.setflags(write=False)
    return action


def _strided(action: Array) -> Array:
    wide = np.full((8, 3), np.nan)
    wide[:, 1] = action
    return wide[:, 1]


@pytest.mark.parametrize(
    "form",
    [
        _read_only,
        _strided,
        lambda action: action[::-1].copy()[::-1],
        lambda action: action.astype(">f8"),
        lambda action: action.astype(np.float16),
        lambda action: action.astype(np.longdouble),
        lambda action: action.tolist(),
        lambda action: tuple(action),
        lambda action: list(action.astype(np.float16)),
    ],
    ids=[
        "read-only",
        "strided",
        "reversed",
        "big-endian",
        "half",
        "long double",
        "list",
        "tuple",
        "list of halves",
    ],
)
def test_all_forms_of_the_same_numbers_do_the_same(form: Callable[[Array], Any]) -> None:
    action = np.linspace(-1.0, 0.75, 8)  # exact in half precision
    given, plain = make(overrides={"fluid": None}), make(overrides={"fluid": None})
    for env in (given, plain):
        env.reset(seed=0)
    for _ in range(3):
        assert_same(given.step(form(action)), plain.step(action))


def test_whole_numbers_are_actions() -> None:
    given, plain = make(overrides={"fluid": None}), make(overrides={"fluid": None})
    for env in (given, plain):
        env.reset(seed=0)
    for dtype in (np.int8, np.int64, int):
        action = np.array([1, 0, -1, 0, 1, 0, -1, 1])
        assert_same(given.step(action.astype(dtype)), plain.step(action.astype(np.float64)))
    assert_same(given.step(np.full(8, 200, dtype=np.uint8)), plain.step(np.ones(8)))


def test_tensors_are_actions() -> None:
    torch = pytest.importorskip("torch")
    given, plain = make(overrides={"fluid": None}), make(overrides={"fluid": None})
    for env in (given, plain):
        env.reset(seed=0)
    action = np.linspace(-1.0, 0.75, 8)
    for dtype in (torch.float32, torch.float64, torch.float16):
        assert_same(given.step(torch.tensor(action, dtype=dtype)), plain.step(action))


def test_a_tensor_with_a_gradient_is_refused_as_an_action_error() -> None:
    torch = pytest.importorskip("torch")
    env = make(overrides={"fluid": None})
    env.reset(seed=0)
    with pytest.raises(ActionError) as caught:
        env.step(torch.zeros(8, requires_grad=True))
    assert_clear(caught.value, "action")


# ---- scenes ------------------------------------------------------------------------------------


@each_task
def test_a_scene_is_given_by_name_path_object_or_overrides(task: str, tmp_path: Path) -> None:
    scene = load_scene("swimmer", ["beam.elements=5", "beam.bending_stiffness=3.0"])
    file = tmp_path / "mine.yaml"
    scene.save(file)
    changes = {"beam.elements": 5, "beam.bending_stiffness": 3.0}
    ways: list[dict[str, Any]] = [
        {"scene": scene},
        {"scene": file},
        {"scene": str(file)},
        {"overrides": changes},
        {"overrides": ["beam.elements=5", "beam.bending_stiffness=3.0"]},
        {"scene": scene.replace("beam.elements", 7), "overrides": "beam.elements=5"},
    ]
    runs = []
    for way in ways:
        env = make(task, **way)
        assert env.scene.beam.elements == 5
        start = env.reset(seed=0)
        runs.append((start, play(env, random_actions(env, 5))))
    for run in runs[1:]:
        assert_same(run, runs[0])
    assert make(task).scene == load_scene("swimmer")
    assert isinstance(gymnasium.make(f"swim_env:{task}").unwrapped, SwimEnv)
    assert make(task, "paper_i").scene == load_scene("paper_i")


def test_joints_without_drive_get_no_torque() -> None:
    """In scene ix the rear actions do nothing, the front ones do."""
    env, twin = make(FORWARD, "paper_ix"), make(FORWARD, "paper_ix")
    for each in (env, twin):
        each.reset(seed=0)
    for action in random_actions(env, 5):
        other = action.copy()
        other[4:] = -1.0
        assert_same(env.step(action), twin.step(other))
    other[3] += 0.1 if other[3] < 0.5 else -0.1
    assert env.step(action)[1] != twin.step(other)[1]


def test_a_scene_without_actuation_is_driven_with_the_default_limit() -> None:
    env = make(FORWARD, "paper_x")
    env.reset(options={"noise": 0.0})
    simulator = Simulator("paper_x")
    for _ in range(5):
        env.step([1.0, -0.5])
        hold(simulator, np.array([1.0, -0.5]), 0.02)
    np.testing.assert_array_equal(env.episodes.bodies.coordinates[0], simulator.coordinates)
    assert np.abs(simulator.joint_angles).max() > 1e-4


def test_the_prescribed_wave_plays_no_part() -> None:
    """Only actions drive an environment, whatever the scene would play by itself."""
    env = make()
    env.reset(options={"noise": 0.0})
    for _ in range(5):
        _, reward, _, _, info = env.step(np.zeros(8))
    assert info["work"] == 0.0
    np.testing.assert_allclose(info["position"], [0.5, 0.0], atol=1e-12)


# ---- start -------------------------------------------------------------------------------------


def start_of(env: SwimEnv, **arguments: Any) -> tuple[Array, Array]:
    """Reset and return coordinates and velocities of the start."""
    env.reset(**arguments)
    bodies = env.episodes.bodies
    return bodies.coordinates[0].copy(), bodies.velocities[0].copy()


@each_task
@pytest.mark.parametrize("overrides", [{}, ASKEW], ids=["straight", "askew"])
def test_without_noise_the_start_is_the_scenes(task: str, overrides: dict[str, object]) -> None:
    env = make(task, overrides=overrides)
    simulator = Simulator(env.scene)
    for seed in (0, 1):
        coordinates, velocity = start_of(env, seed=seed, options={"noise": 0})
        np.testing.assert_array_equal(coordinates, simulator.coordinates)
        np.testing.assert_allclose(velocity, simulator.velocity(), atol=1e-13)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_noise_of_the_start_fills_its_bounds(factor: float) -> None:
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
    coordinates = np.array([start[0] for start in starts])
    velocity = np.array([start[1] for start in starts])
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


def test_a_body_is_turned_with_the_motion_that_it_has() -> None:
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


def test_noise_scales_with_its_factor() -> None:
    env = make()
    bare, _ = start_of(env, seed=9, options={"noise": 0.0})
    full, full_velocity = start_of(env, seed=9)
    half, half_velocity = start_of(env, seed=9, options={"noise": 0.5})
    one, _ = start_of(env, seed=9, options={"noise": 1.0})
    np.testing.assert_array_equal(one, full)
    np.testing.assert_allclose(half - bare, 0.5 * (full - bare), atol=1e-15)
    np.testing.assert_allclose(half_velocity, 0.5 * full_velocity, atol=1e-18)
    assert (full - bare)[3:].all() and full_velocity.all()


@each_task
def test_options_change_only_what_they_name(task: str) -> None:
    env = make(task)
    plain, plain_velocity = start_of(env, seed=2)
    aim = env.episodes.info(0).get("target", 0.0) - plain[:2]
    bend = [0.05 * math.cos(k) for k in range(8)]

    coordinates, velocity = start_of(env, seed=2, options={"joint_angles": bend})
    np.testing.assert_array_equal(coordinates[3:], bend)
    np.testing.assert_array_equal(velocity, plain_velocity)

    coordinates, velocity = start_of(env, seed=2, options={"heading": 0.6})
    assert coordinates[2] == 0.6
    np.testing.assert_array_equal(coordinates[3:], plain[3:])
    np.testing.assert_array_equal(velocity, plain_velocity)

    coordinates, velocity = start_of(env, seed=2, options={"velocity": (0.1, 0.2)})
    np.testing.assert_array_equal(coordinates, plain)
    np.testing.assert_allclose(velocity, [0.1, 0.2, *plain_velocity[2:]], atol=1e-16)

    coordinates, velocity = start_of(env, seed=2, options={"turning_rate": 0.0})
    np.testing.assert_array_equal(coordinates, plain)
    np.testing.assert_allclose(velocity, [*plain_velocity[:2], *[0.0] * 9], atol=1e-16)

    spin = {"velocity": (0.0, -0.5), "velocity_slope": 1.0, "turning_rate": 1.0}
    coordinates, velocity = start_of(env, seed=2, options=spin)
    np.testing.assert_array_equal(coordinates, plain)
    np.testing.assert_allclose(velocity, [0.0, 0.0, *[1.0] * 9], atol=1e-15)

    coordinates, velocity = start_of(env, seed=2, options={"position": (4.0, -3.0)})
    np.testing.assert_allclose(coordinates[:2] - plain[:2], [4.0, -3.0], atol=0.03)
    np.testing.assert_array_equal(coordinates[2:], plain[2:])
    np.testing.assert_array_equal(velocity, plain_velocity)

    if task == TARGET:
        point = (-2.0, 1.0)
        _, info = env.reset(seed=2, options={"target": point})
        np.testing.assert_array_equal(info["target"], point)
        np.testing.assert_array_equal(env.episodes.bodies.coordinates[0], plain)
        for other in ({"joint_angles": bend}, {"position": (4.0, -3.0)}, {"noise": 0.0}):
            _, info = env.reset(seed=2, options=other)
            np.testing.assert_allclose(info["target"] - info["position"], aim, atol=1e-15)


@each_task
@pytest.mark.parametrize(
    "options",
    [
        {"noise": 0.0},
        {"joint_angles": 0.05},
        {"heading": 1.0},
        {"velocity": (0.1, 0.0)},
        {"position": (3.0, 3.0), "heading": 0.5, "joint_angles": 0.0, "noise": 2},
        {"target": (1.0, 1.0)},
        {},
        None,
    ],
    ids=str,
)
def test_options_hold_for_one_start_and_leave_the_draws_alone(task: str, options: Any) -> None:
    if task == FORWARD and options and "target" in options:
        options = {"noise": 0.3}
    env, twin = make(task, overrides=SMALL), make(task, overrides=SMALL)
    given = copy.deepcopy(options)
    env.reset(seed=6, options=options)
    twin.reset(seed=6)
    assert options == given
    for _ in range(3):
        assert_same(env.reset(), twin.reset())


def test_a_position_given_to_reset_is_the_heads_exactly() -> None:
    """Fields of `initial` given to reset are exact: this one is the head's end node."""
    env = make()
    env.reset(seed=0, options={"position": (4.0, -3.0)})
    simulator = twin_of(env)
    angle = simulator.angles[0]
    half = 0.5 * env.scene.beam.element_length
    head = simulator.centres[0] - half * np.array([math.cos(angle), math.sin(angle)])
    np.testing.assert_allclose(head, [4.0, -3.0], atol=1e-12)


# ---- seeds, snapshots, copies ------------------------------------------------------------------

FRESH = """
import hashlib, sys
import gymnasium, numpy as np
import swim_env

def digest():
    sha = hashlib.sha256()
    rng = np.random.default_rng(0)
    for task in ("KirchhoffSwimmer", "KirchhoffSwimmerTarget"):
        env = gymnasium.make(f"swim_env/{task}-v0", max_episode_steps=12)
        batch = gymnasium.make_vec(f"swim_env/{task}-v0", num_envs=3, max_episode_steps=12)
        observation, info = env.reset(seed=5)
        observations, infos = batch.reset(seed=5)
        for _ in range(30):
            action = rng.uniform(-1, 1, (3, 8))
            observation, reward, terminated, truncated, info = env.step(action[0])
            sha.update(observation.tobytes())
            sha.update(np.array([reward, info["progress"], info["work"]]).tobytes())
            observations, rewards, _, _, infos = batch.step(action)
            sha.update(observations.tobytes() + rewards.tobytes() + infos["position"].tobytes())
            if terminated or truncated:
                sha.update(env.reset()[0].tobytes())
    return sha.hexdigest()
"""


def test_the_same_seed_gives_the_same_bits_in_a_fresh_process() -> None:
    here: dict[str, Any] = {}
    exec(FRESH, here)
    other = subprocess.Popen(
        [sys.executable, "-c", FRESH + "print(digest())"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONHASHSEED": "1", "NUMBA_NUM_THREADS": "1"},
    )
    expected = here["digest"]()
    out, _ = other.communicate(timeout=120)
    assert other.returncode == 0
    assert out.strip() == expected
    changed: dict[str, Any] = {}
    exec(FRESH.replace("seed=5", "seed=6"), changed)
    assert changed["digest"]() != expected, "the digest does not see the seed"


@each_task
def test_seeds_decide_and_different_ones_differ(task: str) -> None:
    env = make(task, overrides=SMALL)
    first = [env.reset(seed=1), env.reset(), env.reset()]
    again = [env.reset(seed=1), env.reset(), env.reset()]
    assert_same(again, first)
    starts = {start[0].tobytes() for start in (*first, env.reset(seed=2), env.reset(seed=0))}
    assert len(starts) == 5
    assert env.reset(seed=2**70)[0] in env.observation_space
    fresh = {make(task, overrides=SMALL).reset()[0].tobytes() for _ in range(3)}
    assert len(fresh) == 3


def _noisy_episodes(env: SwimEnv, count: int = 30) -> list[Any]:
    return play(env, random_actions(env, count, seed=77))


@each_task
@pytest.mark.parametrize("overrides", [SMALL, LIVELY], ids=["calm", "lively"])
def test_a_snapshot_continues_bit_for_bit(task: str, overrides: dict[str, object]) -> None:
    """In the same environment and in another, through the ends of episodes."""
    overrides = {**overrides, "episode.duration": 0.7}
    env = make(task, overrides=overrides)
    env.reset(seed=8)
    play(env, random_actions(env, 10))
    snapshot = env.snapshot()
    kept = pickle.dumps(snapshot)
    observation = env.restore(snapshot)
    following = _noisy_episodes(env, 120)
    last = env.reset()
    assert sum(len(result) == 2 for result in following) >= 2
    others = (make(task, overrides=overrides), make(task, overrides=overrides))
    others[1].reset(seed=99)
    play(others[1], random_actions(env, 4))
    for other in (env, *others):
        assert_same(other.restore(pickle.loads(kept)), observation)
        assert_same(_noisy_episodes(other, 120), following)
        assert_same(other.reset(), last)
    assert_same(env.restore(snapshot), observation)
    assert_same(_noisy_episodes(env, 120), following)


@each_task
def test_snapshots_of_an_ended_or_fresh_episode_are_what_they_were(task: str) -> None:
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
def test_a_snapshot_holds_what_an_end_at_once_still_shows(task: str) -> None:
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
def test_state_torques_and_goal_can_be_read_and_are_restored(task: str) -> None:
    def all_of(env: SwimEnv) -> list[Array]:
        return [env.coordinates, env.velocity, env.torques, env.goal]

    env, other = make(task, "paper_ix"), make(task, "paper_ix")
    _, info = env.reset(seed=3)
    simulator = twin_of(env)
    np.testing.assert_array_equal(env.torques, np.zeros(8))
    for action in random_actions(env, 3):
        env.step(action)
        hold(simulator, torque_of(env, action), 0.02)
    np.testing.assert_array_equal(env.coordinates, simulator.coordinates)
    np.testing.assert_allclose(env.velocity, simulator.velocity(), atol=1e-12)
    np.testing.assert_array_equal(env.torques, torque_of(env, action))
    np.testing.assert_array_equal(env.goal, goal_of(env, info))
    snapshot, told = env.snapshot(), all_of(env)
    kept = copy.deepcopy(told)
    env.step(np.ones(8))
    assert_same(told, kept)
    for value in all_of(env):
        value[:] = np.nan
    other.reset(seed=9)
    for each in (env, other):
        each.restore(snapshot)
        assert_same(all_of(each), kept)
    with pytest.raises(ActionError):
        env.step([0.5] * 7 + [np.nan])
    assert_same(all_of(env), kept)


@pytest.mark.parametrize(
    ("task", "arguments"),
    [
        (FORWARD, {"overrides": {"beam.bending_stiffness": 5.1}}),
        (FORWARD, {"overrides": {"episode.duration": 19.0}}),
        (FORWARD, {"effort_weight": 0.1}),
        (FORWARD, {"heading_weight": 0.1}),
        (TARGET, {}),
    ],
    ids=str,
)
def test_a_snapshot_of_another_environment_is_refused(task: str, arguments: dict[str, Any]) -> None:
    env, twin = make(), make()
    other = make(task, **arguments)
    for each in (env, twin, other):
        each.reset(seed=0)
    with pytest.raises(SwimError) as caught:
        env.restore(other.snapshot())
    assert_clear(caught.value, "snapshot")
    assert_same(env.step(np.ones(8)), twin.step(np.ones(8)))


@pytest.mark.parametrize("changed", ["target_distance", "target_bearing", "target_radius"])
def test_a_snapshot_of_another_target_task_is_refused(changed: str) -> None:
    value = {"target_distance": (0.6, 1.5), "target_bearing": 1.0, "target_radius": 0.2}[changed]
    env, other = make(TARGET), make(TARGET, **{changed: value})
    other.reset(seed=0)
    with pytest.raises(SwimError, match="snapshot"):
        env.restore(other.snapshot())


@each_task
@pytest.mark.parametrize("how", ["deepcopy", "pickle"])
def test_a_copy_continues_bit_for_bit_on_its_own(task: str, how: str) -> None:
    env = gymnasium.make(task, overrides={**LIVELY, "episode.duration": 0.7})
    env.reset(seed=3)
    bare = env.unwrapped
    assert isinstance(bare, SwimEnv)
    play(bare, random_actions(bare, 5))
    other: Any = copy.deepcopy(env) if how == "deepcopy" else pickle.loads(pickle.dumps(env))
    assert other.unwrapped is not bare
    following = _noisy_episodes(bare, 80)
    assert_same(_noisy_episodes(other.unwrapped, 80), following)
    # The two share nothing.
    other.reset(seed=0)
    third = copy.deepcopy(env)
    other.step(np.ones(3))
    assert_same(env.step(np.zeros(3)), third.step(np.zeros(3)))


# ---- ends --------------------------------------------------------------------------------------


@each_task
def test_an_early_end_has_its_reason(task: str) -> None:
    env = make(task, overrides=LIVELY)
    _, first = env.reset(seed=0)
    keys = list(first)
    rng = np.random.default_rng(0)
    reasons = set()
    episodes = 0
    while episodes < 12:
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1.0, 1.0, 3))
        assert type(terminated) is type(truncated) is bool
        assert list(info) == keys
        assert np.isfinite(observation).all() and observation in env.observation_space
        assert math.isfinite(reward) and math.isfinite(info["progress"])
        assert terminated == (info["termination_reason"] != "")
        if terminated:
            reasons.add(info["termination_reason"])
        if terminated or truncated:
            episodes += 1
            _, info = env.reset()
            assert info["termination_reason"] == "" and info["time"] == 0.0
    assert len(reasons) >= 2 and reasons <= {"", *TERMINATION_REASONS}
    assert "under_resolved_gap" in reasons


@pytest.mark.parametrize(
    ("limit", "stiffness", "action", "reason"),
    [
        (3.0, 0.5, np.ones(8), "outline_degenerate"),
        (3.0, 0.5, np.eye(8)[4], "outline_degenerate"),
        (20.0, 5.0, np.ones(8), "under_resolved_gap"),
        (1e7, 5.0, np.ones(8), "step_not_solved"),
    ],
)
def test_violent_actions_end_the_episode_by_name(
    limit: float, stiffness: float, action: Array, reason: str
) -> None:
    env = make(overrides={"actuation.torque_limit": limit, "beam.bending_stiffness": stiffness})
    for seed in range(2):
        observation, info = env.reset(seed=seed)
        simulator = twin_of(env)
        terminated = False
        actions = 0
        while not terminated:
            before = info
            observation, reward, terminated, _, info = env.step(action)
            actions += 1
        assert info["termination_reason"] == reason
        with pytest.raises(SimulationEndedError) as ended:
            for _ in range(actions):
                hold(simulator, torque_of(env, action), 0.02)
        assert ended.value.reason == reason
        # The last state that was reached is the one that is observed.
        assert info["time"] == pytest.approx(simulator.time) and info["time"] >= before["time"]
        np.testing.assert_array_equal(env.episodes.bodies.coordinates[0], simulator.coordinates)
        expected = expected_observation(simulator, (-1.0, 0.0), False)
        np.testing.assert_allclose(observation, expected, rtol=1e-6, atol=1e-6)
        assert reward == pytest.approx(before["position"][0] - info["position"][0], abs=1e-12)


@each_task
def test_a_step_after_the_end_is_refused_until_a_reset(task: str) -> None:
    env = make(task, overrides={"actuation.torque_limit": 1e7})
    env.reset(seed=0)
    reason = env.step(np.ones(8))[4]["termination_reason"]
    for action in (np.zeros(8), np.ones(8), np.full(8, np.nan)):
        with pytest.raises(SimulationEndedError) as caught:
            env.step(action)
        assert_clear(caught.value, reason, "call reset")
        assert caught.value.reason == reason
    with pytest.raises(OptionError):
        env.reset(options={"nois": 1})
    with pytest.raises(SimulationEndedError):
        env.step(np.zeros(8))
    env.reset()
    assert not env.step(np.zeros(8))[2]


@each_task
@pytest.mark.parametrize(
    ("duration", "limit"), [(0.1, 5), (0.02, 1), (0.001, 1), (0.3, 15), (0.13, 6), (0.15, 8)]
)
def test_the_time_limit_is_met_exactly(task: str, duration: float, limit: int) -> None:
    env = make(task, overrides={**SMALL, "episode.duration": duration})
    for _ in range(2):
        env.reset()
        for count in range(1, limit + 1):
            _, _, terminated, truncated, info = env.step(np.zeros(2))
            assert (terminated, truncated) == (False, count == limit)
        assert info["termination_reason"] == ""


def test_an_end_in_the_last_step_is_both() -> None:
    env = make(overrides={"actuation.torque_limit": 1e7, "episode.duration": 0.02})
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(np.ones(8))
    assert terminated and truncated and info["termination_reason"] != ""


@each_task
def test_make_can_shorten_an_episode(task: str) -> None:
    env = gymnasium.make(task, overrides=SMALL, max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(np.zeros(2))[3] for _ in range(3)] == [False, False, True]


def test_a_step_before_the_first_reset_is_refused() -> None:
    for task in TASKS:
        with pytest.raises(gymnasium.error.ResetNeeded) as caught:
            make(task).step(np.zeros(8))
        assert_clear(caught.value, "reset")
        env = gymnasium.make(task)
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(np.zeros(8))


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
def test_gymnasiums_checker_finds_nothing(task: str, arguments: dict[str, Any]) -> None:
    """Its warnings are errors here."""
    env = make(task, **arguments)
    check_env(env, skip_render_check=True)
    check_returned_data_not_reused(env)
    assert env.spec is not None and env.spec.id == task
    direct = (SwimEnv if task == FORWARD else SwimTargetEnv)(**arguments)
    check_env(direct, skip_render_check=True)


@each_task
@pytest.mark.parametrize("arguments", CHECKED, ids=str)
def test_the_checker_of_stable_baselines3_finds_nothing(
    task: str, arguments: dict[str, Any]
) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = make(task, **arguments)
    checker.check_env(env, warn=True, skip_render_check=True)
    assert env.reset(seed=0)[0] in env.observation_space


@each_task
def test_spaces_are_as_documented(task: str) -> None:
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
def test_returned_arrays_are_the_callers(task: str) -> None:
    """Whoever changes or keeps what was returned neither harms the episode nor is surprised."""
    env, twin = make(task, overrides=SMALL), make(task, overrides=SMALL)
    observation, info = env.reset(seed=0)
    expected, first = twin.reset(seed=0)
    kept = []
    for action in random_actions(env, 8):
        kept.append((observation, copy.deepcopy(observation), info, copy.deepcopy(info)))
        given = action.copy()
        observation, reward, _, _, info = env.step(given)
        given[:] = np.nan
        np.testing.assert_array_equal(observation, twin.step(action)[0])
    for result, copied, told, told_then in kept:
        assert_same(result, copied)
        assert_same(told, told_then)
    observation[:] = np.nan
    for value in info.values():
        if isinstance(value, np.ndarray):
            value[:] = np.nan
    info.clear()
    assert_same(env.step(np.zeros(2)), twin.step(np.zeros(2)))
    env.restore(env.snapshot())[:] = np.nan
    assert_same(env.step(np.zeros(2)), twin.step(np.zeros(2)))
    assert math.isfinite(reward) and np.isfinite(expected).all() and first


def test_environments_beside_each_other_do_not_meet() -> None:
    """Interleaved with others, of other sizes, an environment does what it does alone."""
    actions = random_actions(make(overrides=LIVELY), 60)
    alone = make(overrides=LIVELY)
    expected = [alone.reset(seed=4), play(alone, actions)]
    env, other, third = make(overrides=LIVELY), make(overrides=LIVELY), make(TARGET)
    start = env.reset(seed=4)
    other.reset(seed=5)
    third.reset(seed=6)
    results: list[Any] = []
    for action in actions:
        play(other, [-action])
        results += play(env, [action])
        third.step(np.ones(8))
    assert_same([start, results], expected)


def test_reset_twice_and_close_twice_do_no_harm() -> None:
    env, twin = make(overrides=SMALL), make(overrides=SMALL)
    env.reset(seed=0)
    env.reset(seed=0)
    twin.reset(seed=0)
    assert_same(env.step(np.ones(2)), twin.step(np.ones(2)))
    env.close()
    env.close()
    assert_same(env.step(np.ones(2)), twin.step(np.ones(2)))
    wrapped = gymnasium.make(FORWARD)
    wrapped.close()
    wrapped.close()
    assert wrapped.unwrapped is not None


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
def test_random_targets_fill_their_bounds(
    distance: tuple[float, float], bearing: float, heading: tuple[float, float]
) -> None:
    overrides = {"fluid": None, "episode.heading": heading, "beam.length": 2.0}
    env = make(
        TARGET,
        overrides=overrides,
        target_distance=distance,
        target_bearing=bearing,
    )
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
def test_reaching_the_target_ends_the_episode(length: float) -> None:
    """A body that drifts to a point reaches it at the first step inside the radius."""
    radius = 0.2
    env = make(
        TARGET,
        overrides={"fluid": None, "beam.length": length},
        target_radius=radius,
    )
    centre = 0.5 * length
    target = (centre - 0.5 * length, 0.02)
    options = {"noise": 0.0, "velocity": (-1.0, 0.0), "target": target}
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


def test_passing_outside_the_radius_does_not_reach() -> None:
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


def test_a_target_too_far_to_measure_is_refused_or_finite() -> None:
    env = make(TARGET, overrides={"fluid": None})
    env.reset(seed=0)
    try:
        env.reset(options={"target": (1e200, 0.0)})
    except OptionError as error:
        assert_clear(error, "target")
        return
    _, reward, *_ = env.step(np.ones(8))
    assert math.isfinite(reward)


# ---- bad input ---------------------------------------------------------------------------------

BAD_ACTIONS: dict[str, tuple[Any, str]] = {
    "short": (np.zeros(7), "shape (8,), got (7,)"),
    "batched": (np.zeros((1, 8)), "shape (8,), got (1, 8)"),
    "scalar": (0.5, "shape (8,), got ()"),
    "empty": ([], "shape (8,), got (0,)"),
    "text": ("left", "numbers of shape (8,)"),
    "texts": (["0.5"] * 8, "numbers of shape (8,)"),
    "bytes": (b"12345678", "numbers of shape (8,)"),
    "none": (None, "numbers of shape (8,)"),
    "nones": ([None] * 8, "numbers of shape (8,)"),
    "ragged": ([[0.0], [0.0, 1.0]], "numbers of shape (8,)"),
    "bools": (np.ones(8, dtype=bool), "numbers of shape (8,), got bool"),
    "complex": (np.zeros(8, dtype=complex), "numbers of shape (8,), got complex128"),
    "dates": (np.zeros(8, dtype="datetime64[s]"), "numbers of shape (8,)"),
    "objects": ([object()] * 8, "numbers of shape (8,)"),
    "mapping": ({"torque": 1.0}, "numbers of shape (8,)"),
    "generator": ((x for x in range(8)), "numbers of shape (8,)"),
    "nan at the head": ([np.nan] + [0.0] * 7, "finite, got nan at joint 0"),
    "nan in the middle": ([1.0] * 5 + [np.nan] * 3, "finite, got nan at joint 5"),
    "inf": ([0.0] * 7 + [np.inf], "finite, got inf at joint 7"),
    "minus inf": (np.array([0.0] * 7 + [-np.inf], dtype=np.float32), "got -inf at joint 7"),
    "nan of half precision": (np.full(8, np.nan, dtype=np.float16), "got nan at joint 0"),
}


@each_task
@pytest.mark.parametrize("kind", BAD_ACTIONS)
def test_a_bad_action_is_refused_and_changes_nothing(task: str, kind: str) -> None:
    action, part = BAD_ACTIONS[kind]
    env, twin = make(task, effort_weight=1.0), make(task, effort_weight=1.0)
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.linspace(-1.0, 1.0, 8))
    with pytest.raises(ActionError) as caught:
        env.step(action)
    assert_clear(caught.value, part, "action")
    assert isinstance(caught.value, ValueError)
    for next_action in random_actions(env, 3):
        assert_same(env.step(next_action), twin.step(next_action))
    assert_same(env.reset(), twin.reset())


def test_a_refused_action_leaves_the_snapshot_alone() -> None:
    env = make()
    env.reset(seed=0)
    env.step(np.linspace(-1.0, 1.0, 8))
    before = env.snapshot()
    with pytest.raises(ActionError):
        env.step([0.5] * 7 + [np.nan])
    assert_same(env.snapshot().episodes.arrays, before.episodes.arrays)


def test_a_number_beyond_double_precision_is_refused_as_not_finite() -> None:
    huge = np.longdouble("1e4000") if np.finfo(np.longdouble).maxexp > 1024 else np.inf
    env = make(overrides={"fluid": None})
    env.reset(seed=0)
    with pytest.raises(ActionError) as caught:
        env.step(np.full(8, huge, dtype=np.longdouble))
    assert_clear(caught.value, "finite")


BAD_OPTIONS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "a list": ([], ("options must be a mapping", "list")),
    "text": ("noise", ("options must be a mapping", "noise")),
    "a number": (3, ("options must be a mapping", "3")),
    "a typing error": ({"nois": 1.0}, ("unknown option 'nois'", "nearest: noise")),
    "a capital": ({"Heading": 1.0}, ("unknown option 'Heading'", "heading")),
    "a key that is no text": ({1: 1.0}, ("unknown option 1", "noise")),
    "a mask": ({"reset_mask": np.array([True])}, ("unknown option 'reset_mask'",)),
    "negative noise": ({"noise": -0.1}, ("noise must be at least 0", "-0.1")),
    "noise as text": ({"noise": "1"}, ("noise must be a number", "'1'")),
    "noise as bool": ({"noise": True}, ("noise must be a number", "true")),
    "noise as nothing": ({"noise": None}, ("noise must be a number",)),
    "noise not finite": ({"noise": math.inf}, ("noise must be a finite number", "inf")),
    "heading as text": ({"heading": "north"}, ("heading must be a number in rad", "north")),
    "heading as nan": ({"heading": math.nan}, ("heading must be a finite number", "nan")),
    "position as number": ({"position": 3.0}, ("position must be two numbers", "3.0")),
    "position of three": ({"position": (1, 2, 3)}, ("position must be two numbers", "3")),
    "few joint angles": ({"joint_angles": (0.1,)}, ("joint_angles", "8", "got 1")),
    "joint angle as text": ({"joint_angles": ["a"] * 8}, ("joint_angles[0]", "'a'")),
    "velocity as text": ({"velocity": "fast"}, ("velocity must be two numbers", "fast")),
    "a spin that tears": ({"turning_rate": 1.0}, ("turning_rate", "inextensibility")),
    "good and bad": ({"heading": 0.5, "noise": "x"}, ("noise must be a number",)),
}
BAD_TARGETS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "one number": ({"target": 1.0}, ("target must be two numbers", "1.0")),
    "three numbers": ({"target": (1, 2, 3)}, ("target must be two numbers", "3")),
    "letters": ({"target": "ab"}, ("target must be two numbers", "ab")),
    "nan": ({"target": (math.nan, 0.0)}, ("target[0] must be a finite number in m", "nan")),
    "nothing": ({"target": None}, ("target must be two numbers",)),
    "bools": ({"target": (True, False)}, ("target[0] must be a number", "true")),
}


def _refused_reset(
    task: str, error: type[Exception], parts: tuple[str, ...], **arguments: Any
) -> None:
    """Check that a reset is refused and that the episode and its random numbers go on."""
    env, twin = make(task), make(task)
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.linspace(-1.0, 1.0, 8))
    with pytest.raises(error) as caught:
        env.reset(**arguments)
    assert_clear(caught.value, *parts)
    for action in random_actions(env, 2):
        assert_same(env.step(action), twin.step(action))
    for _ in range(2):
        assert_same(env.reset(), twin.reset())
    # The very first call of an environment may be a bad one, too.
    fresh = make(task)
    with pytest.raises(error):
        fresh.reset(**arguments)
    with pytest.raises(gymnasium.error.ResetNeeded):
        fresh.step(np.zeros(8))


@each_task
@pytest.mark.parametrize("kind", BAD_OPTIONS)
def test_a_bad_option_is_refused_and_changes_nothing(task: str, kind: str) -> None:
    options, parts = BAD_OPTIONS[kind]
    _refused_reset(task, OptionError, parts, seed=5, options=options)


@pytest.mark.parametrize("kind", BAD_TARGETS)
def test_a_bad_target_is_refused_and_changes_nothing(kind: str) -> None:
    options, parts = BAD_TARGETS[kind]
    _refused_reset(TARGET, OptionError, parts, options=options)


def test_the_forward_task_knows_no_target() -> None:
    _refused_reset(FORWARD, OptionError, ("unknown option 'target'",), options={"target": (1, 1)})


@pytest.mark.parametrize("seed", ["1", 1.0, -1, True, np.True_, [1], (), np.array(1), {}], ids=repr)
def test_a_bad_seed_is_refused_and_changes_nothing(seed: Any) -> None:
    _refused_reset(FORWARD, gymnasium.error.Error, ("eed must be",), seed=seed)


@pytest.mark.parametrize("options", [{"joint_angles": 2.9}, {"velocity": (1e200, 0.0)}], ids=str)
@pytest.mark.parametrize("seed", [None, 5])
def test_a_start_that_cannot_be_simulated_is_refused_and_changes_nothing(
    options: dict[str, Any], seed: int | None
) -> None:
    parts = ("t = 0 s",)
    _refused_reset(FORWARD, SimulationEndedError, parts, seed=seed, options=options)


BAD_ARGUMENTS: list[tuple[str, Any, type[Exception], tuple[str, ...]]] = [
    ("scene", "swimer", SceneError, ("unknown scene 'swimer'", "nearest: swimmer")),
    ("scene", "no/such/scene.yaml", SceneError, ("no such scene file", "no/such/scene.yaml")),
    ("scene", None, SceneError, ("scene", "NoneType")),
    ("scene", 3, SceneError, ("scene", "int")),
    ("overrides", ["beam.element=9"], SceneError, ("beam.element", "beam.elements")),
    ("overrides", ["beam.elements=1"], SceneError, ("beam.elements", "at least 2")),
    ("overrides", ["beam.elements"], SceneError, ("beam.elements", "=")),
    (
        "overrides",
        {"episode.control_interval": 0.012},
        SceneError,
        ("episode.control_interval", "0.005", "0.012"),
    ),
    (
        "overrides",
        {"episode.control_interval": 0.001},
        SceneError,
        ("episode.control_interval", "0.005", "0.001"),
    ),
    ("overrides", {"episode.duration": 0.0}, SceneError, ("episode.duration", "above 0")),
    ("overrides", {"episode.heading": (2.0, 0.0)}, SceneError, ("episode.heading", "unit vector")),
    ("effort_weight", -0.1, OptionError, ("effort_weight must be at least 0", "-0.1")),
    ("effort_weight", math.nan, OptionError, ("effort_weight must be a finite number", "nan")),
    ("effort_weight", "1", OptionError, ("effort_weight must be a number", "'1'")),
    ("effort_weight", True, OptionError, ("effort_weight must be a number", "true")),
    ("heading_weight", -1, OptionError, ("heading_weight must be at least 0", "-1")),
    ("heading_weight", None, OptionError, ("heading_weight must be a number",)),
    ("heading_weight", math.inf, OptionError, ("heading_weight must be a finite number", "inf")),
]
BAD_TARGET_ARGUMENTS: list[tuple[str, Any, tuple[str, ...]]] = [
    ("target_distance", 1.0, ("target_distance", "1.0")),
    ("target_distance", (1.0,), ("target_distance must be two numbers", "[1.0]")),
    ("target_distance", (1.0, 2.0, 3.0), ("target_distance must be two numbers",)),
    ("target_distance", (2.0, 1.0), ("target_distance", "[2.0, 1.0]")),
    ("target_distance", (0.1, 1.0), ("target_distance", "target_radius")),
    ("target_distance", (-1.0, 1.0), ("target_distance", "[-1.0, 1.0]")),
    ("target_distance", (math.nan, 1.0), ("target_distance[0]", "finite", "nan")),
    ("target_distance", (0.5, math.inf), ("target_distance[1]", "finite", "inf")),
    ("target_distance", "ab", ("target_distance", "ab")),
    ("target_distance", None, ("target_distance",)),
    ("target_bearing", -0.1, ("target_bearing must be at least 0", "-0.1")),
    ("target_bearing", 3.2, ("target_bearing must be at most", "3.2")),
    ("target_bearing", "wide", ("target_bearing must be a number", "wide")),
    ("target_bearing", math.nan, ("target_bearing", "finite")),
    ("target_radius", 0.0, ("target_radius must be above 0", "0")),
    ("target_radius", -1.0, ("target_radius must be above 0", "-1")),
    ("target_radius", 0.5, ("target_distance", "target_radius (0.5)")),
    ("target_radius", None, ("target_radius must be a number",)),
]


@each_task
@pytest.mark.parametrize(("name", "value", "error", "parts"), BAD_ARGUMENTS)
def test_a_bad_argument_is_refused(
    task: str, name: str, value: Any, error: type[Exception], parts: tuple[str, ...]
) -> None:
    with pytest.raises(error) as caught:
        gymnasium.make(task, **{name: value})
    assert_clear(caught.value, *parts)
    assert isinstance(caught.value, (SwimError, ValueError))


@pytest.mark.parametrize(("name", "value", "parts"), BAD_TARGET_ARGUMENTS)
def test_a_bad_argument_of_the_target_is_refused(
    name: str, value: Any, parts: tuple[str, ...]
) -> None:
    with pytest.raises(OptionError) as caught:
        gymnasium.make(TARGET, **{name: value})
    assert_clear(caught.value, *parts)


@pytest.mark.parametrize("mode", ["rgb", "RGB_ARRAY", "", 3, []], ids=repr)
def test_an_unknown_render_mode_is_refused(mode: Any) -> None:
    with pytest.raises(OptionError) as caught:
        SwimEnv(render_mode=mode)
    assert_clear(caught.value, "render_mode", repr(mode), "rgb_array")


@pytest.mark.parametrize(
    "overrides",
    [
        {"episode.duration": 1e308},
        {"episode.control_interval": 1e308},
        {"episode.control_interval": 1e12},
    ],
    ids=str,
)
def test_an_episode_beyond_all_bounds_is_refused_by_name(overrides: dict[str, object]) -> None:
    """An absurd time is a mistake to be told of, or works; it is no fault of Python's numbers."""
    try:
        env = make(overrides=overrides)
    except SceneError as error:
        assert_clear(error, next(iter(overrides)))
        return
    assert env.reset(seed=0)[0] in env.observation_space
