"""A training run: rounds of stable-baselines3, between which its whole state can be saved.

A run is one folder:

============================  ======================================================================
``config.yaml``               the resolved configuration, the scene in full
``scene.yaml``                the scene alone
``run.json``                  seed, device, versions, machine and commit; its progress
``progress.csv``              a line per log interval; ``tensorboard/`` has the same
``evaluations.csv``           a line per periodic evaluation
``checkpoint.zip``            everything the run needs to continue, replaced whole
``agent/``                    the agent with the best evaluation so far, replaced whole
``final_agent/``              the agent at the end
============================  ======================================================================

A run that was killed continues from its last checkpoint and ends bit for bit as it would have
without the kill: the checkpoint has the networks and their optimisers, the replay buffer, every
random number generator and the state of every episode. A run that is continued with more steps,
finished or not, goes on to their number, with the learning rate that they give.
"""

from __future__ import annotations

import contextlib
import numbers
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]

from swim_agents.files import INTACT, read_json, write_json, writing
from swim_agents.learning.checkpoints import CheckpointError, load_checkpoint, save_checkpoint
from swim_agents.learning.config import ConfigError, TrainingConfig, load_config
from swim_agents.learning.environment import make_batch, make_training_env
from swim_agents.learning.logs import CsvLog, TensorBoardLog
from swim_agents.learning.models import (
    checked_device,
    make_model,
    model_state,
    set_model_state,
    torch_threads,
)
from swim_agents.learning.saved import save_agent
from swim_agents.learning.smoothing import SmoothedPolicy
from swim_agents.policies import run_label
from swim_agents.rollout import play_episodes
from swim_env import __version__, characterise
from swim_env.errors import SwimError, require_packages
from swim_env.files.provenance import where_and_when
from swim_env.recording import recording_file, write_recording
from swim_env.scene.checks import got

# After swim_agents.vec_env, which says in one line what is missing where this is not installed.
import torch  # isort: skip
from stable_baselines3.common.logger import Logger  # isort: skip
from stable_baselines3.common.utils import FloatSchedule, set_random_seed  # isort: skip

__all__ = ["EVALUATION_COLUMNS", "RunExistsError", "check_run", "run_status", "train"]

#: Columns of ``progress.csv`` that every algorithm has, and those of each.
_COMMON = ("steps", "seconds", "return_mean", "length_mean", "success_rate", "learning_rate")
_OWN = {
    "PPO": (
        "approx_kl",
        "clip_fraction",
        "explained_variance",
        "policy_gradient_loss",
        "value_loss",
        "std",
    ),
    "SAC": ("actor_loss", "critic_loss", "ent_coef", "ent_coef_loss"),
}

#: Columns of ``evaluations.csv``; the net displacement (BL) counts as of `Task.displacement_aim`.
EVALUATION_COLUMNS = (
    "steps",
    "seconds",
    "net_displacement_median",
    "net_displacement_min",
    "net_displacement_max",
    "return_mean",
    "success_rate",
    "ended_early",
)

#: Environment steps between lines of ``progress.csv``, unless a round is longer.
_LOG_EVERY = 8192

#: Nothing was learned if after this share of the steps no evaluation's mean return is farther above
#: that of the untrained policy than its returns differ from start to start.
_ENOUGH = 0.25


class RunExistsError(SwimError):
    """A folder holds a run already, or another process uses it."""


def run_status(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return what ``run.json`` of a run's folder says, None where there is no run."""
    path = Path(folder) / "run.json"
    try:
        found = read_json(path, "cannot read the run's record")
    except FileNotFoundError:
        return None
    if (
        not isinstance(found, dict)
        or not isinstance(found.get("steps"), int)
        or not {"finished", "seed", "device"} <= found.keys()
    ):
        raise SwimError(f"not the record of a training run ({path})")
    return found


def train(
    config: TrainingConfig,
    folder: str | os.PathLike[str],
    seed: int = 0,
    *,
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    command: str | None = None,
    record: str | os.PathLike[str] | None = None,
    progress: Callable[[int, str], object] | None = None,
    notice: Callable[[str], object] | None = None,
) -> dict[str, Any]:
    """Train an agent, or continue a run.

    Parameters
    ----------
    config : TrainingConfig
        The run.
    folder : str or os.PathLike
        Where the run goes; made where it is missing.
    seed : int
        Of starts, first weights, exploration and minibatches.
    resume : bool
        Whether to continue from the folder's last checkpoint; a run without one starts afresh,
        and a finished one is left as it is unless `config` has more steps than it took. All other
        fields must be those of the run.
    device : str
        For PyTorch: ``cpu``, ``cuda``, ``auto``.
    threads : int, optional
        Threads of the batch; the results do not depend on it.
    command : str, optional
        What the user typed, for the record.
    record : str or os.PathLike, optional
        Folder for a recording of every evaluation's first episode,
        ``RUN/evaluation-STEPS.rrd``, where RUN is named after the run, so that those of several
        runs go together; the training does not depend on it.
    progress : callable, optional
        Called with the number of environment steps since the last call (or since the start, after
        a resume) and a short text on the latest evaluation; with 0 and "evaluating" before one.
    notice : callable, optional
        Called with a line of text once, if evaluations show that nothing is being learned: what
        was found, and what to look at.

    Returns
    -------
    dict
        What ``run.json`` says: ``steps``, ``seconds``, ``finished``, ``best`` and the
        ``last`` evaluation (EVALUATION_COLUMNS), seed, versions, machine, commit.

    Raises
    ------
    ConfigError
        If the folder's run has another configuration, or took as many steps as another one has.
    RunExistsError
        If the folder holds a run and `resume` is not set, or another process uses it.
    CheckpointError, SwimError
        If a file cannot be written or read; the last checkpoint is intact.
    """
    place = Path(folder)
    seed, device = _checked_start(config, seed, device)
    recordings = None
    if record is not None:
        label = _recordings_label(config, place, seed)
        recordings = recording_file(Path(record) / label / "any.rrd", "any").parent
    with writing("the run's folder", place, verb="make"):
        place.mkdir(parents=True, exist_ok=True)
    with _alone(place), torch_threads(config.torch_threads):
        before = _run_before(config, place, seed, resume, device)
        _clear_scratch(place)
        if before is not None and before["finished"]:
            return before
        run = _Run(config, place, seed, device, threads, command, before, recordings)
        with contextlib.closing(run):
            return run.play(progress, notice)


def _recordings_label(config: TrainingConfig, folder: Path, seed: int) -> str:
    """Return what the recordings of a run are called, prolonged or not, and of no other run."""
    settings = {name: value for name, value in config.to_dict().items() if name != "steps"}
    names, place = [config.name, f"seed_{seed}"], str(folder.resolve())
    return run_label(config.scene, names, config.task, config=settings, folder=place)


def check_run(
    config: TrainingConfig,
    folder: str | os.PathLike[str],
    seed: int,
    *,
    resume: bool = False,
    device: str = "cpu",
) -> dict[str, Any] | None:
    """Refuse what `train` would refuse, without touching anything.

    Returns what ``run.json`` says of the run that would be continued, None without one.
    """
    place = Path(folder)
    seed, device = _checked_start(config, seed, device)
    with _alone(place) if (place / ".lock").exists() else contextlib.nullcontext():
        return _run_before(config, place, seed, resume, device)


def _checked_start(config: TrainingConfig, seed: Any, device: str) -> tuple[int, str]:
    """Return the seed as a plain number, and the device that PyTorch is to use."""
    require_packages("training needs", {"tensorboard": "tensorboard"}, "train")
    most = config.evaluation.seed // config.members
    whole = isinstance(seed, numbers.Integral) and not isinstance(seed, bool)
    if not whole or not 0 <= int(seed) < most:
        raise ConfigError(
            f"seed must be a whole number from 0 to {most - 1}, so that training draws other "
            f"starts than evaluations, got {got(seed)}"
        )
    return int(seed), checked_device(device)


def _run_before(
    config: TrainingConfig, folder: Path, seed: int, resume: bool, device: str
) -> dict[str, Any] | None:
    """Return the record of the run that is to be continued, None without one.

    A run that is not to be continued, or that has other settings, is refused. One that is to be
    prolonged is not ``finished``.
    """
    before = run_status(folder)
    if before is None:
        if (folder / "checkpoint.zip").exists():
            raise RunExistsError(
                "the folder holds a checkpoint but no run.json, so that nothing says which run it "
                f"belongs to; name another folder ({folder})"
            )
        return None
    if not resume:
        state = "finished" if before["finished"] else f"at {before['steps']:,} steps"
        raise RunExistsError(
            f"the folder holds a run ({state}); continue it with --resume, or name another folder "
            f"({folder})"
        )
    try:
        kept = load_config(folder / "config.yaml").to_dict()
    except ConfigError as error:
        raise SwimError(f"cannot read the run's configuration: {error} ({folder})") from None
    now = config.to_dict()
    for name in dict.fromkeys([*kept, *now]):
        if name != "steps" and kept.get(name) != now.get(name):
            raise ConfigError(
                f"the run was begun with another configuration, {name} differs; continue with the "
                f"configuration in {folder / 'config.yaml'}, or name another folder"
            )
    for name, value in (("seed", seed), ("device", device)):
        if before[name] != value:
            raise ConfigError(
                f"the run was begun with {name} {before[name]}, not {value} ({folder})"
            )
    if config.steps != kept["steps"]:
        if config.steps <= before["steps"]:
            raise ConfigError(
                f"the run has taken {before['steps']:,} steps of {kept['steps']:,}: steps must be "
                f"more to prolong it, got {config.steps:,} ({folder})"
            )
        if before["finished"] and not (folder / "checkpoint.zip").exists():
            raise CheckpointError(
                f"the run cannot be prolonged without its checkpoint.zip ({folder})"
            )
        before["finished"] = False
    return before


def _clear_scratch(folder: Path) -> None:
    """Remove what a killed process was writing; no other process uses the folder, see `_alone`.

    A process that was killed while one agent replaced another has left the older one aside; it is
    put back.
    """
    for path in folder.glob(".*.tmp"):
        path.unlink(missing_ok=True)
    for name in ("agent", "final_agent"):
        for aside in folder.glob(f".{name}.*"):
            if (aside / "old").is_dir() and not (folder / name).exists():
                (aside / "old").rename(folder / name)
            shutil.rmtree(aside, ignore_errors=True)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes out of a run's folder; the system drops a killed process's lock."""
    with writing("into the run's folder", folder):
        file = open(folder / ".lock", "w", encoding="utf-8")  # noqa: SIM115
    with file:
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RunExistsError(f"another process is training there ({folder})") from None
        yield


class _Run:
    """A run in progress."""

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        seed: int,
        device: str,
        threads: int | None,
        command: str | None,
        before: dict[str, Any] | None,
        recordings: Path | None,
    ) -> None:
        self.config, self.folder, self.recordings = config, folder, recordings
        self.seconds = 0.0
        self.best: dict[str, float] | None = None
        #: Mean return of the untrained policy and its standard deviation over the starts, and the
        #: largest mean since; None in a run that an earlier version began.
        self.returns: dict[str, float] | None = None
        self.last: dict[str, float] | None = None
        self.env = make_training_env(config, seed, threads)
        self.evaluation_env = make_batch(
            config, config.evaluation.episodes, threads, AutoresetMode.NEXT_STEP
        )
        self.model = make_model(config, self.env, seed, device)
        self.about: dict[str, Any] = {
            "name": config.name,
            "seed": seed,
            "device": device,
            "command": command,
            "version": __version__,
            **where_and_when(),
        }
        if before is not None:
            # What a run was begun with stays; what continues it is added.
            now = {name: self.about[name] for name in ("command", "commit", "versions", "date")}
            self.about = {name: before[name] for name in self.about if name in before}
            self.about["resumed"] = [*before.get("resumed", []), now]
        # It keeps the last values and writes nothing.
        self.model.set_logger(Logger(folder=None, output_formats=[]))
        self._checkpoint = folder / "checkpoint.zip"
        if self._checkpoint.exists():
            state = load_checkpoint(self._checkpoint)
            self.env.set_state(state["environment"])
            set_model_state(self.model, state["model"])
            self.seconds, self.best, self.last = state["seconds"], state["best"], state["last"]
            self.returns = state.get("returns")
        else:
            # The numbers that a run draws do not depend on what was played before in the process.
            self.model._last_obs = self.env.reset()
            self.model._last_episode_starts = np.ones(config.members, dtype=np.bool_)
            # Not `set_random_seed` of the model, which would seed the environment as well.
            set_random_seed(seed, using_cuda=self.model.device.type == "cuda")
            self.model.action_space.seed(seed)
        steps = self.steps
        columns = (*_COMMON, *_OWN[config.algorithm])
        self.progress_log = CsvLog(folder / "progress.csv", columns, steps)
        self.evaluation_log = CsvLog(folder / "evaluations.csv", EVALUATION_COLUMNS, steps)
        self.board = TensorBoardLog(folder / "tensorboard", steps)
        with writing("the run's configuration", folder):
            config.save(folder / "config.yaml")
            config.scene.save(folder / "scene.yaml")
        self._write_record(finished=False)

    @property
    def steps(self) -> int:
        """Environment steps taken."""
        return int(self.model.num_timesteps)

    def close(self) -> None:
        """Close what is open."""
        self.board.close()
        self.env.close()
        self.evaluation_env.close()

    def play(
        self,
        progress: Callable[[int, str], object] | None,
        notice: Callable[[str], object] | None,
    ) -> dict[str, Any]:
        """Train to the end."""
        config, model = self.config, self.model
        reported = 0
        begin = time.perf_counter() - self.seconds
        if self.steps == 0:
            self._evaluate(progress)
        while self.steps < config.steps:
            before = self.steps
            rate = config.learning_rate_at(before)
            model.learning_rate, model.lr_schedule = rate, FloatSchedule(rate)
            model.learn(config.round_steps, log_interval=None, reset_num_timesteps=False)
            now = self.steps
            self.seconds = time.perf_counter() - begin
            ends = now >= config.steps
            if ends or _passed(before, now, max(_LOG_EVERY, config.round_steps)):
                self._log()
            if ends or _passed(before, now, config.evaluation.every):
                earlier = self.last["steps"] if self.last else 0
                self._evaluate(progress)
                self.seconds = time.perf_counter() - begin
                if notice is not None and self._has_just_failed(earlier):
                    notice(self._why_nothing_is_learned())
            if ends or _passed(before, now, config.checkpoint_every):
                self._save_checkpoint()
            if progress is not None:
                progress(now - reported, self._status())
                reported = now
        save_agent(self.folder / "final_agent", model, config, self._record())
        return self._write_record(finished=True)

    # ---- parts of a run ------------------------------------------------------------------------

    def _log(self) -> None:
        model, config = self.model, self.config
        recorded, episodes = model.logger.name_to_value, model.ep_info_buffer
        values: dict[str, float] = {"learning_rate": config.learning_rate_at(self.steps)}
        if episodes:
            values["return_mean"] = float(np.mean([float(one["r"]) for one in episodes]))
            values["length_mean"] = float(np.mean([one["l"] for one in episodes]))
        if model.ep_success_buffer:
            values["success_rate"] = float(np.mean(model.ep_success_buffer))
        for name in _OWN[config.algorithm]:
            if f"train/{name}" in recorded:
                values[name] = float(recorded[f"train/{name}"])
        values = {name: value for name, value in values.items() if np.isfinite(value)}
        self.board.add("train", values, self.steps)
        self.progress_log.add({"steps": self.steps, "seconds": round(self.seconds, 3), **values})

    def _evaluate(self, progress: Callable[[int, str], object] | None) -> None:
        """Play the fixed starts without exploration; keep the agent if it is the best so far."""
        if progress is not None:
            progress(0, "evaluating")
        config, first = self.config, self.config.evaluation.seed
        # Training draws the same random numbers as it would without evaluations.
        numbers, others = torch.get_rng_state(), np.random.get_state()
        rollouts = play_episodes(
            self.evaluation_env,
            SmoothedPolicy(self.model.policy, self.env.smoothing),
            range(first, first + config.evaluation.episodes),
        )
        torch.set_rng_state(numbers)
        np.random.set_state(others)
        reached = [one.net_displacement for one in rollouts]
        returns = [float(one.rewards.sum()) for one in rollouts]
        early = [one.terminated and not one.info.get("success") for one in rollouts]
        values = {
            "net_displacement_median": float(np.median(reached)),
            "net_displacement_min": min(reached),
            "net_displacement_max": max(reached),
            "return_mean": float(np.mean(returns)),
            "success_rate": float(np.mean([one.info.get("success", False) for one in rollouts])),
            "ended_early": float(np.mean(early)),
        }
        self.board.add("evaluation", values, self.steps)
        self.last = {"steps": self.steps, "seconds": round(self.seconds, 3), **values}
        if self.steps == 0:
            mean = values["return_mean"]
            self.returns = {"untrained": mean, "spread": float(np.std(returns)), "most": mean}
        elif self.returns is not None:
            self.returns["most"] = max(self.returns["most"], values["return_mean"])
        self.evaluation_log.add(self.last)
        if self.recordings is not None:
            swimmer = rollouts[0].swimmer(f"{config.name}-{self.steps}")
            file = self.recordings / f"evaluation-{self.steps}.rrd"
            write_recording(file, [swimmer], flow_rate=None)
        if self.best is None or self._merit(values) > self._merit(self.best):
            self.best = self.last
            save_agent(self.folder / "agent", self.model, config, self._record())

    def _has_just_failed(self, earlier: float) -> bool:
        """Return whether nothing was learned, at the first evaluation after a share of the run."""
        found, due = self.returns, _ENOUGH * self.config.steps
        if found is None or not earlier < due <= self.steps:
            return False
        return found["most"] - found["untrained"] <= found["spread"]

    def _why_nothing_is_learned(self) -> str:
        """Return a line on what was found and what to look at."""
        assert self.returns is not None
        gain = self.returns["most"] - self.returns["untrained"]
        unit = self.evaluation_env.task.unit
        advice = characterise(self.config.scene).advice or (
            "the body's modes can be commanded and are resolved: look at the returns and, of PPO, "
            "explained_variance (above 0) in progress.csv, at reward_scale, and try more steps",
        )
        return (
            f"nothing learned after {self.steps:,} steps: returns have gained {gain:.2g} {unit} on "
            f"the untrained policy's, which differ by {self.returns['spread']:.2g} {unit} from "
            "start to start; " + "; ".join(advice)
        )

    def _merit(self, values: dict[str, float]) -> tuple[float, float]:
        """Return what decides which of two evaluations is better."""
        task = self.evaluation_env.task
        if task.has_success:
            return (values["success_rate"], values["return_mean"])
        if not task.scored_by_displacement:
            return (values["return_mean"], 0.0)
        # Episodes all count: an agent that cannot start from some poses is no better for the rest.
        return (values["net_displacement_median"] + values["net_displacement_min"], 0.0)

    def _status(self) -> str:
        if self.last is None:
            return ""
        task = self.evaluation_env.task
        if task.has_success:
            return f"{self.last['success_rate']:.0%} succeed"
        if not task.scored_by_displacement:
            return f"return {self.last['return_mean']:.3g} {task.unit}"
        return f"{self.last['net_displacement_median']:.2f} BL"

    def _record(self) -> dict[str, Any]:
        return {
            **self.about,
            "steps": self.steps,
            "seconds": round(self.seconds, 1),
            "evaluation": self.last,
        }

    def _write_record(self, finished: bool) -> dict[str, Any]:
        record = {**self._record(), "finished": finished, "best": self.best}
        record["last"] = record.pop("evaluation")
        with writing("the run's record", self.folder, advice=INTACT):
            write_json(self.folder / "run.json", record)
        return record

    def _save_checkpoint(self) -> None:
        state = {
            "model": model_state(self.model),
            "environment": self.env.state(),
            "seconds": self.seconds,
            "best": self.best,
            "returns": self.returns,
            "last": self.last,
        }
        save_checkpoint(self._checkpoint, state)
        self._write_record(finished=False)


def _passed(before: int, now: int, every: int) -> bool:
    """Return whether a multiple of `every` lies between two numbers of steps."""
    return now // every > before // every
