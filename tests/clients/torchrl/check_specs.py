"""TorchRL's own check of specifications, and its rollouts, on the environments given by name.

python check_specs.py swim_env/KirchhoffSwimmer-v0
"""

import json
import sys
from functools import partial

import gymnasium
import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, GymEnv, GymWrapper, ParallelEnv
from torchrl.envs.utils import check_env_specs

import swim_env

SHORT = "episode.duration=1.0"  # 50 actions


def batched(name: str, mode: str) -> GymWrapper:
    """Wrap a batched environment: the project's own, or Gymnasium's of single ones."""
    disabled = {"autoreset_mode": "Disabled"}
    native = mode == "vector_entry_point"
    vector = gymnasium.make_vec(
        name,
        num_envs=3,
        vectorization_mode=mode,
        vector_kwargs=None if native else disabled,
        overrides=SHORT,
        **(disabled if native else {}),
    )
    assert isinstance(vector.unwrapped, swim_env.SwimVectorEnv) is native
    return GymWrapper(vector)


def played(environment: EnvBase, steps: int) -> TensorDictBase:
    """Check an environment, play random actions beyond the ends of episodes, and close it."""
    environment.set_seed(0)
    torch.manual_seed(0)
    check_env_specs(environment)
    rollout = environment.rollout(steps, break_when_any_done=False)
    environment.close()
    assert rollout.batch_size[-1] == steps
    assert rollout["next", "observation"].isfinite().all()
    assert rollout["next", "reward"].isfinite().all()
    return rollout


def ends(rollout: TensorDictBase) -> list[int]:
    """Return in which steps time was up: the same ones for every member."""
    truncated = rollout["next", "truncated"].flatten(-2).reshape(-1, rollout.batch_size[-1])
    assert (truncated == truncated[0]).all()
    return truncated[0].nonzero().flatten().tolist()


def main() -> None:
    """Play every form of every environment; print one line of JSON for each."""
    for name in sys.argv[1:]:
        native = played(batched(name, "vector_entry_point"), 120)
        single = played(batched(name, "sync"), 120)
        figures = {
            "full_length": list(played(GymEnv(name), 100).batch_size),
            "short": ends(played(GymEnv(name, overrides=SHORT), 120)),
            "native": ends(native),
            "native_is_single": bool((native == single).all()),
            "parallel": ends(played(ParallelEnv(2, partial(GymEnv, name, overrides=SHORT)), 120)),
        }
        print(json.dumps({"name": name, **figures}), flush=True)


if __name__ == "__main__":
    main()
