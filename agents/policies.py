"""Finding a policy by its name."""

from __future__ import annotations

from agents.baselines import (
    POLICY_NAMES,
    Policy,
    RandomPolicy,
    ZeroPolicy,
    paper_wave,
    tuned_wave,
)
from swim_env.env_interface import SceneLike
from swim_env.errors import OptionError
from swim_env.scene import load_scene
from swim_env.scene_checks import nearest

__all__ = ["load_policy"]


def load_policy(
    policy: str,
    scene: SceneLike = "swimmer",
    seed: int | None = None,
) -> Policy:
    """Return a policy for a scene.

    Parameters
    ----------
    policy : str
        ``paper_wave``: the scene's prescribed wave, no torque where it has none. ``tuned_wave``:
        the wave that was found to swim farthest on scene swimmer. ``zero``: no torque. ``random``:
        uniform torques.
    scene : Scene, str or os.PathLike
        The scene that it is to play.
    seed : int, optional
        Seed of a random policy.

    Returns
    -------
    Policy
        With the call ``predict(observation, state, episode_start, deterministic)``.

    Raises
    ------
    OptionError
        If there is no such policy.
    SceneError
        If there is no such scene.
    """
    found = load_scene(scene)
    name = str(policy)
    if name == "paper_wave":
        return paper_wave(found)
    if name == "tuned_wave":
        return tuned_wave(found)
    if name == "zero":
        return ZeroPolicy(found)
    if name == "random":
        return RandomPolicy(found, seed)
    hint = nearest(name, POLICY_NAMES)
    raise OptionError(f"unknown policy {policy!r}{hint}; policies: {', '.join(POLICY_NAMES)}")
