"""Smoothed actions: as large as independent ones, bending the body, the same when played again."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from swim_agents.learning.environment import make_training_env
from swim_agents.learning.saved import AgentError, load_agent, save_agent
from swim_agents.learning.smoothing import Smoothing

from swim_env import Scene, load_scene
from tests.learning.small_runs import small_config, untrained
from tests.learning.test_saved_agents import describe, model_of, observations
from tests.support import refuses

WIDTH = 0.15


def _body(joints: int) -> Scene:
    return load_scene("swimmer", {"beam.elements": joints + 1})


@pytest.mark.parametrize("joints", [5, 8, 14])
def test_smoothing_keeps_the_size_of_noise_and_moves_long_waves(joints):
    noise = 0.1 * np.random.default_rng(0).normal(size=(20_000, joints)).astype(np.float32)
    smooth = Smoothing(_body(joints), WIDTH)(noise)
    assert np.allclose(smooth.std(axis=0), 0.1, rtol=0.03)
    # The mean over the joints is what bends the whole body one way.
    assert smooth.mean(axis=1).std() > 1.5 * noise.mean(axis=1).std()
    assert smooth.shape == noise.shape and smooth.dtype == noise.dtype
    assert np.allclose(Smoothing(_body(joints), WIDTH)(noise[0]), smooth[0], atol=1e-6)
    assert Smoothing(_body(joints), None)(noise) is noise


def test_smoothed_actions_are_cut_off_at_one():
    full = np.ones((3, 8), dtype=np.float32)
    assert (Smoothing(_body(8), WIDTH)(full) == 1.0).all()
    assert (Smoothing(_body(8), WIDTH)(-full) == -1.0).all()


def test_an_agent_plays_the_smoothed_actions_that_it_was_trained_with(tmp_path):
    config = small_config(action_smoothing=WIDTH)
    model = model_of(config)
    save_agent(tmp_path / "agent", model, config, {})
    agent = load_agent(tmp_path / "agent")
    batch = observations(model, 50)
    bare = model.predict(batch, deterministic=True)[0]
    actions, _ = agent.predict(batch)
    assert (actions == Smoothing(_body(2), WIDTH)(bare)).all() and (actions != bare).any()
    env = make_training_env(config, 0, threads=1)
    env.reset()
    env.step(bare[:4])
    played = env.batch.episodes.torques[:, 0] / config.scene.torque_limit
    assert np.allclose(played, actions[:4], atol=1e-6)


@pytest.mark.parametrize("width", [0.0, -1.0, "wide", float("nan")])
def test_a_width_is_a_positive_number(width, tmp_path):
    with refuses(Exception, "action_smoothing"):
        small_config(action_smoothing=width)
    config = small_config()
    save_agent(tmp_path / "agent", untrained(config), config, {})
    describe(tmp_path / "agent", action_smoothing=width)
    with refuses(AgentError, "action_smoothing"):
        load_agent(tmp_path / "agent")


def test_every_axis_is_smoothed_by_itself():
    body = load_scene("eel_3d")
    noise = np.random.default_rng(0).standard_normal((3, 18)).astype(np.float32) * 0.1
    smooth = Smoothing(body, WIDTH)(noise)
    for axis in range(2):
        alone = Smoothing(_body(9), WIDTH)(noise[:, axis::2])
        assert np.allclose(smooth[:, axis::2], alone, rtol=0.0, atol=1e-7)
