"""What recording costs: episodes with and without the wrapper in turn, as one JSON line.

``python -m swim_env.viewer.recording.cost``
"""

from __future__ import annotations

import json
import tempfile
import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swim_env.env import SwimEnv
from swim_env.provenance import where_and_when
from swim_env.viewer.recording.wrappers import RecordEpisodes

__all__ = ["measure_cost"]


def measure_cost(pairs: int = 20) -> dict[str, Any]:
    """Play the default episode of 20 s with random actions, recorded and not, without flow.

    Parameters
    ----------
    pairs : int
        How often.

    Returns
    -------
    dict
        Medians with their quartiles: ``bare_seconds`` of an episode; ``while_playing`` and
        ``with_file``, what recording adds to an episode but its last step, and to all of it with
        the file that is written there, as shares; ``file_seconds``; ``bytes`` of the file.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        recorded = RecordEpisodes(SwimEnv(), folder, lambda episode: True)
        bare = SwimEnv()
        actions = np.random.default_rng(0).uniform(-1.0, 1.0, (bare.scene.actions_per_episode, 8))
        for pair in range(-1, pairs):
            order = (recorded, bare) if pair % 2 else (bare, recorded)
            times = {id(env): _play(env, actions) for env in order}
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
    return {**figures, "bytes": size, "pairs": pairs, **where_and_when()}


def _play(env: gymnasium.Env[Any, Any], actions: NDArray[np.float64]) -> tuple[float, float]:
    """Return the seconds of all steps but the last, and of the last."""
    env.reset(seed=0)
    begin = time.perf_counter()
    for action in actions[:-1]:
        env.step(action)
    before = time.perf_counter()
    env.step(actions[-1])
    return before - begin, time.perf_counter() - before


if __name__ == "__main__":
    print(json.dumps(measure_cost()))
