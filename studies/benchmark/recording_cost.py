"""What recording costs: episodes with and without the wrapper in turn, as one JSON line.

``python -m studies.benchmark.recording_cost``
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.single import SwimEnv
from swim_env.files.provenance import where_and_when
from swim_env.recording.swimmer import Swimmer
from swim_env.recording.wrappers import RecordEpisodes
from swim_env.recording.writer import write_recording
from swim_env.sim.simulator import Simulator


def measure_cost(episodes: int = 10, policy: Any = None) -> dict[str, Any]:
    """Play the default episode of 20 s, recorded and not, without flow.

    Two environments take every action in turn, one of them recorded, and swap the order after each
    action, so that both find the machine in the same state. All episodes are the same: the first
    file of a new layout takes twice as long. Resets do not count. Actions are those of a `policy`,
    or random ones.

    Returns
    -------
    dict
        Medians with their quartiles: ``bare_seconds`` of an episode with its policy;
        ``while_playing`` and ``with_file``, what recording adds to it as shares, without and with
        the last action, at whose end the file is written; ``file_seconds``; ``bytes`` of the file.
        Beside them ``frame_seconds``, what a frame adds to a file's time, and ``fixed_seconds``,
        the rest of it, from the shortest of ten files each with few and with many frames.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        recorded = RecordEpisodes(SwimEnv(), folder, lambda episode: True)
        bare = SwimEnv()
        actions = np.random.default_rng(0).uniform(-1.0, 1.0, (bare.scene.actions_per_episode, 8))
        for episode in range(-1, episodes):
            times = _play(bare, recorded, actions, policy)
            if episode < 0:  # kernels and modules are being loaded
                continue
            whole, added = times[:, 0].sum(), times[:, 1] - times[:, 0]
            shares = added[:-1].sum() / times[:-1, 0].sum(), added.sum() / whole
            file = recorded.written[-1]
            rows.append([whole, *shares, file.logging_seconds])
    quartiles = np.quantile(rows, (0.25, 0.5, 0.75), axis=0).T.round(4).tolist()
    names = ("bare_seconds", "while_playing", "with_file", "file_seconds")
    figures = {
        name: {"median": middle, "quartiles": [low, high]}
        for name, (low, middle, high) in zip(names, quartiles, strict=True)
    }
    about = {"bytes": file.size, "episodes": episodes, **where_and_when()}
    return {**figures, **_measure_files(), **about}


def _measure_files(repeats: int = 10) -> dict[str, float]:
    """Return the time of a frame in a file, and the rest."""
    simulator = Simulator("swimmer")
    swimmer = Swimmer("x", simulator.rollout(simulator.prescribed_torques(4000)))
    found = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "cost.rrd"
        for rate in (0.5, 200.0):
            options: dict[str, Any] = {"flow_rate": None, "frame_rate": rate}
            files = [write_recording(place, [swimmer], **options) for _ in range(repeats)]
            found.append((files[0].frames, min(file.logging_seconds for file in files)))
    (few, short), (many, long) = found
    frame = (long - short) / (many - few)
    return {"frame_seconds": round(frame, 8), "fixed_seconds": round(short - few * frame, 4)}


def _play(
    bare: SwimEnv, recorded: RecordEpisodes, actions: NDArray[np.float64], policy: Any
) -> NDArray[np.float64]:
    """Return the seconds of every action, in the bare environment and in the other, (A, 2)."""
    times = np.empty((len(actions), 2))
    observation, _ = recorded.reset(seed=0)
    bare.reset(seed=0)
    for number, action in enumerate(actions):
        for which in (0, 1) if number % 2 else (1, 0):
            begin = time.perf_counter()
            if policy is not None:
                action = policy.predict(observation, None, None, True)[0]
            after = (bare, recorded)[which].step(action)[0]
            times[number, which] = time.perf_counter() - begin
        observation = after
    return times


if __name__ == "__main__":
    print(json.dumps(measure_cost()))
