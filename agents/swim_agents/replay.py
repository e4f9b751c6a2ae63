"""Playing a policy as an episode of the environment, with the figures of a replay."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium

from swim_agents.files import check_file, writing
from swim_agents.policies import load_policy, policy_label, run_label
from swim_agents.rollout import Rollout, play_episode
from swim_env.envs.registration import FORWARD_ID
from swim_env.envs.tasks import NOISE, SEED, check_task
from swim_env.errors import SwimError, require_packages
from swim_env.files.atomic import write_atomically
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option
from swim_env.sim.trajectory import Trajectory

__all__ = ["replay_episode"]


def replay_episode(
    scene: Scene,
    policy: str = "paper_wave",
    task: str = "forward",
    seed: int = 0,
    noise: float = 1.0,
    video_folder: str | os.PathLike[str] | None = None,
    progress: Callable[[int], object] | None = None,
    task_options: Mapping[str, Any] | None = None,
) -> tuple[Rollout, Trajectory, dict[str, Any]]:
    """Play one episode through Gymnasium, and its torques again in the simulator.

    Parameters
    ----------
    scene : Scene
        The scene; its episode gives the duration, and how often the policy acts.
    policy : str
        A name or a path that `load_policy` knows.
    task : str
        As for `swim_env.envs.tasks.find_task`.
    seed, noise
        Of the start's noise (and of a random policy), and the factor on it.
    video_folder : path, optional
        Where a video of the episode goes, by Gymnasium's own wrapper.
    progress : callable, optional
        Called with 1 after every action.
    task_options : mapping, optional
        Arguments of the task's class beside the scene.

    Returns
    -------
    rollout : Rollout
        The episode.
    trajectory : Trajectory
        The same motion, to the bit, with energy, momentum and work.
    summary : dict
        `Trajectory.summary`; ``wall_seconds`` that the episode took; ``policy``, ``task``,
        ``task_options``, ``seed``, ``noise``; ``actions`` and ``control_interval`` (s);
        ``return``, the sum of the rewards, and ``net_displacement`` (BL); ``terminated``,
        ``truncated`` and the last ``info``; ``video``, where one was made.
    """
    task = check_task(task)
    seed = checked_option(SEED, seed, "the seed")
    noise = checked_option(NOISE, noise, "the noise")
    chosen = load_policy(policy, scene, seed, task)
    video = None
    if video_folder is not None:
        settings = {
            "noise": None if noise == 1.0 else noise,
            "task_options": dict(task_options or {}) or None,
        }
        name = run_label(scene, [policy_label(policy)], task, seed, **settings)
        video = Path(video_folder) / f"{name}.mp4"
        with writing("the video", video.parent, verb="make the folder for"):
            video.parent.mkdir(parents=True, exist_ok=True)
        check_file(video, "the video")
    with tempfile.TemporaryDirectory() as scratch:
        mode = None if video is None else "rgb_array"
        env = gymnasium.make(
            FORWARD_ID, scene=scene, task=task, task_options=task_options, render_mode=mode
        )
        if video is not None:
            env = _recorded(env, scratch)
        with contextlib.closing(env):
            start = time.perf_counter()
            rollout = play_episode(env, chosen, seed, {"noise": noise}, progress=progress)
            seconds = time.perf_counter() - start
        if video is not None:
            _keep(scratch, video)
    trajectory = rollout.simulate()
    summary = {
        **trajectory.summary(),
        "termination_reason": rollout.info["termination_reason"],
        "wall_seconds": seconds,
        "policy": policy,
        "task": task,
        "task_options": dict(task_options or {}),
        "seed": seed,
        "noise": noise,
        "actions": len(rollout.rewards),
        "control_interval": scene.episode.control_interval,
        "return": float(rollout.rewards.sum()),
        "net_displacement": rollout.net_displacement,
        "terminated": rollout.terminated,
        "truncated": rollout.truncated,
        "info": {key: _plain(value) for key, value in rollout.info.items() if key != "episode"},
    }
    if video is not None:
        summary["video"] = os.fspath(video)
    return rollout, trajectory, summary


def _plain(value: Any) -> Any:
    """Return a value of an info for JSON, what is not finite as None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value.tolist() if hasattr(value, "tolist") else value


def _recorded(env: gymnasium.Env[Any, Any], folder: str) -> gymnasium.Env[Any, Any]:
    """Return the environment in Gymnasium's wrapper that records videos."""
    require_packages("videos need", {"moviepy": "MoviePy"}, "view")
    with warnings.catch_warnings():
        # The folder is there already, and empty.
        warnings.filterwarnings("ignore", message=".*Overwriting existing videos.*")
        return gymnasium.wrappers.RecordVideo(
            env, folder, episode_trigger=lambda episode: True, disable_logger=True
        )


def _keep(scratch: str, video: Path) -> None:
    """Move the finished video to its place."""
    made = sorted(Path(scratch).glob("*.mp4"))
    if len(made) != 1:
        raise SwimError(f"one video was to be made, found {len(made)}")
    with writing("the video", video):
        content = made[0].read_bytes()
        if not _is_whole_video(content):
            # The encoder does not report that it ran out of space.
            raise OSError(errno.EIO, "the encoder left only a part of it; is the disk full?")
        write_atomically(video, lambda file: file.write(content))


def _is_whole_video(content: bytes) -> bool:
    """Return whether an MP4 file's boxes fill it exactly and its index is among them."""
    kinds, at = set(), 0
    while at + 8 <= len(content):
        size, header = int.from_bytes(content[at : at + 4], "big"), 8
        if size == 1:  # a 64-bit size follows
            size, header = int.from_bytes(content[at + 8 : at + 16], "big"), 16
        if size < header:
            return False
        kinds.add(content[at + 4 : at + 8])
        at += size
    return at == len(content) and {b"mdat", b"moov"} <= kinds
