"""PPO with plain stable-baselines3 on the batched environment: train, save, load, play."""

import argparse
import tempfile
from pathlib import Path

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor
from swim_agents.vec_env import SwimVecEnv

import swim_env  # noqa: F401  registers the environments

ID = "swim_env/KirchhoffSwimmer-v0"


def main() -> None:
    parser = argparse.ArgumentParser(description="Train and play an agent.")
    parser.add_argument("--steps", type=int, default=200_000, help="of training")
    parser.add_argument("--members", type=int, default=64, help="episodes side by side")
    options = parser.parse_args()

    batch = gymnasium.make_vec(ID, options.members, scene="swimmer", autoreset_mode="SameStep")
    # Gymnasium's wrappers of batches go here, on the inside.
    batch = gymnasium.wrappers.vector.TransformReward(batch, lambda reward: 10.0 * reward)
    venv = VecMonitor(SwimVecEnv(batch))
    venv.seed(0)
    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=128,
        batch_size=min(1024, 128 * options.members),
        learning_rate=5e-4,
        gamma=0.998,
        use_sde=True,  # noise at every action would feed the fast modes of the body
        sde_sample_freq=4,
        policy_kwargs={"log_std_init": -1.0, "net_arch": [64, 64]},
        seed=0,
        device="cpu",
    )
    model.learn(options.steps)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "swimmer.zip"
        model.save(file)
        model = PPO.load(file, device="cpu")
    env = gymnasium.make(ID, scene="swimmer")
    observation, info = env.reset(seed=1)
    ended = False
    while not ended:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    print(f"swam {info['progress']:.3f} body lengths in {info['time']:.0f} s")


if __name__ == "__main__":
    main()
