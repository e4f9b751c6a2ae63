"""Train with skrl on the project's own batched environment, load what was saved, evaluate it.

python ppo.py swim_env/KirchhoffSwimmer-v0
"""

import json
import sys
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from skrl.envs.wrappers.torch import wrap_env
from skrl.utils.runner.torch import Runner

import swim_env

MEMBERS = 4


def environment(name: str) -> RecordEpisodeStatistics:
    """Return the batched environment, with episodes of one second."""
    vector = gymnasium.make_vec(name, num_envs=MEMBERS, overrides="episode.duration=1.0")
    assert isinstance(vector.unwrapped, swim_env.SwimVectorEnv)
    return RecordEpisodeStatistics(vector)


def main() -> None:
    """Train, evaluate, print the figures of the evaluation as one line of JSON."""
    (name,) = sys.argv[1:]
    settings = Runner.load_cfg_from_yaml(str(Path(__file__).with_name("ppo.yaml")))
    training = Runner(wrap_env(environment(name)), settings)
    training.run("train")

    played = environment(name)
    evaluation = Runner(wrap_env(played), settings)
    evaluation.agent.load("runs/ppo/checkpoints/agent_256.pt")
    evaluation.run("eval")
    figures = {
        "episodes": len(played.return_queue),
        "mean_return": float(np.mean(played.return_queue)),
        "lengths": sorted({int(length) for length in played.length_queue}),
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
