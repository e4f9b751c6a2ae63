"""What recording costs: episodes with and without the wrapper in turn, as one JSON line.

``python -m swim_env.viewer.recording.cost``
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swim_env.env import SwimEnv
from swim_env.provenance import where_and_when
from swim_env.simulator import Simulator
from swim_env.viewer.recording.swimmer import Swimmer
from swim_env.viewer.recording.wrappers import RecordEpisodes
from swim_env.viewer.recording.writer import write_recording

__all__ = ["measure_cost"]


def measure_cost(pairs: int = 20, policy: Any = None) -> dict[str, Any]:
    """Play the default episode of 20 s, recorded and not, without flow.

    Parameters
    ----------
    pairs : int
        How often.
    policy : optional
        Who plays, with the call ``predict(observation, state, episode_start, deterministic)``;
        random actions that are drawn before unless given.

    Returns
    -------
    dict
        Medians with their quartiles: ``bare_seconds`` of an episode; ``while_playing`` and
        ``with_file``, what recording adds to an episode but its last step, and to all of it with
        the file that is written there, as shares; ``file_seconds``; ``bytes`` of the file. Beside
        them ``frame_seconds``, what a frame adds to a file's time, and ``fixed_seconds``, the rest
        of it, from the shortest of ten files each with few and with many frames.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        recorded = RecordEpisodes(SwimEnv(), folder, lambda episode: True)
        bare = SwimEnv()
        actions = np.random.default_rng(0).uniform(-1.0, 1.0, (bare.scene.actions_per_episode, 8))
        for pair in range(-1, pairs):
            order = (recorded, bare) if pair % 2 else (bare, recorded)
            times = {id(env): _play(env, actions, policy) for env in order}
            if pair < 0:  # kernels and modules are being loaded
                continue
            (played, end), (bare_played, bare_end) = times[id(recorded)], times[id(bare)]
            whole = bare_played + bare_end
            file = recorded.written[-1].logging_seconds
            rows.append([whole, played / bare_played - 1.0, (played + end) / whole - 1.0, file])
        size = recorded.written[-1].size
    quartiles = np.quantile(np.array(rows), (0.25, 0.5, 0.75), axis=0).T.round(4).tolist()
    names = ("bare_seconds", "while_playing", "with_file", "file_seconds")
    figures = {
        name: {"median": middle, "quartiles": [low, high]}
        for name, (low, middle, high) in zip(names, quartiles, strict=True)
    }
    return {**figures, **_measure_files(), "bytes": size, "pairs": pairs, **where_and_when()}


def _measure_files(repeats: int = 10) -> dict[str, float]:
    """Return what a file takes, and what a frame adds."""
    simulator = Simulator("swimmer")
    run = simulator.rollout(simulator.prescribed_torques(4000))
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for rate in (0.5, 200.0):
            files = [
                write_recording(
                    Path(folder) / "cost.rrd", [Swimmer("x", run)], flow_rate=None, frame_rate=rate
                )
                for _ in range(repeats)
            ]
            found.append((files[0].frames, min([file.logging_seconds for file in files])))
    (few, short), (many, long) = found
    frame = (long - short) / (many - few)
    return {"frame_seconds": round(frame, 8), "fixed_seconds": round(short - few * frame, 4)}


def _play(
    env: gymnasium.Env[Any, Any], actions: NDArray[np.float64], policy: Any
) -> tuple[float, float]:
    """Return the seconds of all steps but the last, and of the last."""
    observation, _ = env.reset(seed=0)
    begin = time.perf_counter()
    for action in actions[:-1]:
        if policy is not None:
            action = policy.predict(observation, None, None, True)[0]
        observation = env.step(action)[0]
    before = time.perf_counter()
    env.step(actions[-1])
    return before - begin, time.perf_counter() - before


if __name__ == "__main__":
    print(json.dumps(measure_cost()))
