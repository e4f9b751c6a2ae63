"""Learning libraries that this project did not write use its environments as they are.

Each has a virtual environment of its own, filled with the pins next to its files here. It stays in
pytest's cache folder and is rebuilt when the pins or the interpreter change.
"""

import contextlib
import csv
import hashlib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest
from swim_agents.replay import replay_episode

from swim_env import load_scene
from tests.contract.test_wheel import copy_sources
from tests.support import FORWARD, ROOT, SPATIAL_TASKS, TARGET, TASKS

# An installation and a kernel compilation, with room for a slow network.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

HERE = Path(__file__).parent
INSTALL_SECONDS = 1200
RUN_SECONDS = 600

each_dimension = pytest.mark.parametrize("tasks", (TASKS, SPATIAL_TASKS), ids=("plane", "space"))


class Client(NamedTuple):
    """A client's virtual environment, and the folder in which its commands run."""

    folder: Path
    work: Path

    def run(
        self,
        *arguments: str | Path,
        seconds: float = RUN_SECONDS,
        python: str | None = None,
        **environment: str,
    ) -> str:
        """Run the client's Python with nothing of this one around it; return what it printed.

        A command that fails or takes too long fails the test with its last lines.
        """
        command = [python or str(self.folder / "bin" / "python"), *map(str, arguments)]
        clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        self.work.mkdir(parents=True, exist_ok=True)
        log = self.work / "output.txt"
        # Into a file: workers that outlive the command would keep a pipe open.
        with log.open("wb") as output:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=self.work,
                env={**clean, "NUMBA_CACHE_DIR": str(self.folder / "kernels"), **environment},
                start_new_session=True,
            )
            try:
                outcome = f"exit code {process.wait(seconds)}"
            except subprocess.TimeoutExpired:
                outcome = f"not done after {seconds:.0f} s"
            finally:
                with contextlib.suppress(ProcessLookupError):  # the command and workers it left
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        printed = log.read_text(encoding="utf-8", errors="replace").replace("\r", "\n")
        if outcome != "exit code 0":
            tail = "\n".join(printed.splitlines()[-60:])
            pytest.fail(f"{outcome}: {' '.join(command)}\n{tail}", pytrace=False)
        return printed


@pytest.fixture
def install(pytestconfig: pytest.Config, tmp_path: Path) -> Callable[[str], Client]:
    """Return a function that gives a client by its name, ready to run."""

    def ready(name: str) -> Client:
        folder, pins = pytestconfig.cache.mkdir("clients") / name, HERE / name / "requirements.txt"
        client, stamp = Client(folder, tmp_path / "work"), folder / "complete"
        mark = hashlib.sha256(f"{sys.base_prefix} {sys.version}\n{pins.read_text()}".encode())
        if not (stamp.is_file() and stamp.read_text() == mark.hexdigest()):
            shutil.rmtree(folder, ignore_errors=True)
            client.run("-m", "venv", folder, python=sys.executable)
            client.run("-m", "pip", "install", "-r", pins, seconds=INSTALL_SECONDS)
            stamp.write_text(mark.hexdigest())
        # The checkout as it is now, from a copy: a build leaves folders in its source.
        copy_sources(tmp_path / "copy")
        options = ("--no-deps", "--no-build-isolation", "--force-reinstall")
        client.run("-m", "pip", "install", *options, tmp_path / "copy")
        client.run("-m", "pip", "check")
        place = client.run("-c", "import swim_env; print(swim_env.__file__)").splitlines()[-1]
        assert Path(place).is_relative_to(folder)
        return client

    return ready


def matched(pattern: str, printed: str) -> float:
    """Return the number at the only group of a pattern, in the last place where it is."""
    found = re.findall(pattern, printed)
    assert found, f"nothing like {pattern!r} in\n{printed[-3000:]}"
    return float(found[-1])


def results(printed: str) -> list[dict[str, Any]]:
    """Return the lines of JSON in an output."""
    return [json.loads(line) for line in printed.splitlines() if line.startswith("{")]


@each_dimension
def test_rl_zoo3(tasks, install):
    """Its command line trains in one process and in several, and plays what was trained."""
    zoo = install("rl-zoo3")
    forward, target = tasks
    first_episodes = {}
    for name, vec_env in ((forward, "dummy"), (forward, "subproc"), (target, "subproc")):
        logs, saved = f"logs-{vec_env}", name.replace("/", "-")
        common = ["--algo", "ppo", "--env", name, "--gym-packages", "swim_env", "--seed", "0"]
        common += ["--device", "cpu", "-f", logs]
        zoo.run(
            *("-m", "rl_zoo3.train", *common),
            *("--conf-file", HERE / "rl-zoo3" / "ppo.yml", "--vec-env", vec_env),
            *("--eval-freq", "512", "--eval-episodes", "2"),
            *("--eval-env-kwargs", "overrides:'episode.duration=1.0'"),
        )
        run_folder = zoo.work / logs / "ppo" / f"{saved}_1"
        assert (run_folder / f"{saved}.zip").stat().st_size > 10_000
        assert (run_folder / "best_model.zip").is_file()
        assert (run_folder / saved / "vecnormalize.pkl").is_file()
        evaluations = np.load(run_folder / "evaluations.npz")
        assert evaluations["timesteps"].tolist() == [512, 1024]
        assert np.isfinite(evaluations["results"]).all()
        assert (evaluations["ep_lengths"] == 50).all()
        members = [run_folder / f"{i}.monitor.csv" for i in range(2)]
        episodes = [np.loadtxt(m, delimiter=",", skiprows=2, ndmin=2) for m in members]
        assert all(len(rows) == 10 and (rows[:, 1] == 50).all() for rows in episodes)
        # Two episodes end before the first update; it may round differently from run to run.
        first_episodes[name, vec_env] = [rows[:2, 0] for rows in episodes]

        printed = zoo.run("-m", "rl_zoo3.enjoy", *common, "--no-render", "--n-timesteps", "200")
        assert matched(r"(\d+) Episodes", printed) == 4
        assert math.isfinite(matched(r"Mean reward: (\S+) \+/-", printed))
        assert matched(r"Mean episode length: (\S+) \+/-", printed) == 50
        if name == target:
            assert 0 <= matched(r"Success rate: (\S+)%", printed) <= 100
    np.testing.assert_allclose(
        first_episodes[forward, "subproc"], first_episodes[forward, "dummy"], atol=2e-6
    )


def test_rl_zoo3_learns_with_the_shipped_hyperparameters(install):
    """Less than half of the shipped training swims ten times as far as the paper's wave."""
    zoo = install("rl-zoo3")
    printed = zoo.run(
        *("-m", "rl_zoo3.train", "--algo", "ppo", "--env", FORWARD, "--gym-packages", "swim_env"),
        *("--conf-file", ROOT / "configs" / "rl-zoo3" / "ppo.yml", "--n-timesteps", "131072"),
        *("--vec-env", "subproc", "--eval-freq", "-1", "--seed", "0", "--device", "cpu"),
        *("-f", "logs"),
        seconds=2400,
    )
    assert matched(r"total_timesteps\s+\|\s+(\d+)", printed) == 131072
    # Episodes of the whole scene, 20 s, with exploration: the paper's wave reaches 0.05 BL.
    assert matched(r"ep_len_mean\s+\|\s+(\S+)", printed) == 1000
    assert matched(r"ep_rew_mean\s+\|\s+(\S+)", printed) > 0.5


@each_dimension
def test_torchrl(tasks, install):
    """Its check of specifications passes: alone, in processes, and on our batched form."""
    printed = install("torchrl").run(HERE / "torchrl" / "check_specs.py", *tasks)
    assert printed.count("check_env_specs succeeded!") == 10
    played = results(printed)
    assert [result.pop("name") for result in played] == list(tasks)
    for result in played:
        assert result == {
            "full_length": [100],
            "short": [49, 99],
            "native": [49, 99],
            "native_is_single": True,
            "parallel": [49, 99],
        }


def test_skrl(install):
    """It trains on our batched form and evaluates what it saved."""
    skrl = install("skrl")
    for name in (FORWARD, TARGET):
        (result,) = results(skrl.run(HERE / "skrl" / "ppo.py", name))
        assert (skrl.work / "runs" / "ppo" / "checkpoints" / "agent_256.pt").is_file()
        assert result["episodes"] == 20
        assert result["lengths"] == [50]
        assert math.isfinite(result["mean_return"])
        shutil.rmtree(skrl.work / "runs")


def test_cleanrl(install):
    """PPO in one file, in its manner, on our batched form."""
    client = install("cleanrl")
    for name in (FORWARD, TARGET):
        script = HERE / "cleanrl" / "ppo_continuous_action.py"
        (result,) = results(client.run(script, name))
        assert result.pop("episodes") == 12 and result.pop("lengths") == [50]
        assert result.pop("learned") and all(map(math.isfinite, result.values()))


@each_dimension
def test_tianshou(tasks, install):
    """Its PPO trains on environments in processes, and is evaluated."""
    client = install("tianshou")
    for name in tasks:
        (result,) = results(client.run(HERE / "tianshou" / "ppo.py", name))
        assert (result["steps"], result["episodes"], result["lengths"]) == (800, 8, [50])
        assert result["learned"] and math.isfinite(result["mean_return"])


@pytest.fixture
def ray_settings() -> Iterator[dict[str, str]]:
    """Give Ray a folder of its own for its token and its sockets, whose path must be short."""
    with TemporaryDirectory() as folder:
        yield {"HOME": folder, "RAY_TMPDIR": folder, "RAY_USAGE_STATS_ENABLED": "0"}


@each_dimension
def test_rllib(tasks, install, ray_settings):
    """PPO of its new stack trains on single and batched forms, and restores what it saved."""
    rllib, names = install("rllib"), [f"swim_env:{task}" for task in tasks]
    runs = results(rllib.run(HERE / "rllib" / "ppo.py", *names, seconds=1200, **ray_settings))
    assert [run["name"] for run in runs] == [name for name in names for _ in range(3)]
    for sync, native, remote in zip(runs[::3], runs[1::3], runs[2::3], strict=True):
        assert sync["kinds"] == ["SyncVectorEnv"]
        (kind,) = native["kinds"]
        assert re.fullmatch(r"Swim\w*VectorEnv\w*", kind) and remote["kinds"] == [kind, kind]
        assert native["iterations"] == sync["iterations"]
        assert remote["restored"]
        for run in (sync, native, remote):
            assert run["learned"]
            for number, figures in enumerate(run["iterations"], 1):
                assert figures["steps"] == 512 * number
                # RLlib 2.60 may count a step too many where its runner is this process, and an
                # episode goes on from one sample to the next (so it does with Pendulum-v1).
                assert figures["len_min"] == 50
                assert figures["len_max"] <= (50 if run is remote or number == 1 else 51)
                assert math.isfinite(figures["return_min"] + figures["return_max"])
        assert len(remote["iterations"]) == 4


def test_ray_tune(install, ray_settings):
    """It trains on a grid of bodies by the environment's name, and finds the best."""
    rllib = install("rllib")
    arguments = (HERE / "rllib" / "grid.py", f"swim_env:{FORWARD}")
    *runs, best = results(rllib.run(*arguments, seconds=1200, **ray_settings))
    assert [run["iterations"] for run in runs] == [2, 2]
    assert {run["stiffness"] for run in runs} == {2.5, 10.0}
    assert runs[0]["return"] != runs[1]["return"], "both trained on one body"
    assert best == max(runs, key=lambda run: run["return"])


def test_rllib_example(install, ray_settings, tmp_path):
    """The example trains, restores what it saved, evaluates it and exports it to be played."""
    rllib, folder = install("rllib"), tmp_path / "out"
    printed = rllib.run(
        *(ROOT / "examples" / "rllib_ppo.py", "--scene", "swimmer", "--iterations", "1"),
        *("--members", "2", "--output", folder),
        **ray_settings,
    )
    assert math.isfinite(matched(r"swam (\S+) body lengths", printed))
    code = f"""
import numpy as np, torch
from ray.rllib.algorithms.algorithm import Algorithm
from swim_agents.policies import load_policy
from swim_agents.rllib import register
register()
module = Algorithm.from_checkpoint({str(folder / "checkpoint")!r}).get_module()
seen = np.random.default_rng(0).normal(size=(50, 21)).astype(np.float32)
found = module.forward_inference({{"obs": torch.from_numpy(seen)}})["action_dist_inputs"][:, :8]
played, _ = load_policy({str(folder / "agent")!r}).predict(seen)
print("off by", np.abs(played - found.detach().numpy().clip(-1, 1)).max())
"""
    assert matched(r"off by (\S+)", rllib.run("-c", code, **ray_settings)) < 1e-6
    # Here, where there is no Ray.
    rollout, _, summary = replay_episode(
        load_scene("swimmer", "episode.duration=0.2"), str(folder / "agent")
    )
    assert len(rollout.rewards) == summary["actions"] == 10


def test_a_sweep_on_ray(install, ray_settings, tmp_path):
    """The command from the installed package gives with Ray what it gives without."""
    rllib, code = install("rllib"), "import sys; from swim_agents.commands.main import main; main()"
    tables = []
    for place in ("local", "ray"):
        sweep = (ROOT / "examples" / "sweep.yaml", "--output", tmp_path / place, "--on", place)
        rllib.run("-c", code, "sweep", *sweep, **ray_settings)
        with open(tmp_path / place / "table.csv", newline="", encoding="utf-8") as file:
            tables.append(list(csv.DictReader(file)))
    for row in (*tables[0], *tables[1]):
        assert row["status"] in ("finished", "ended")
        del row["seconds"], row["wall_seconds"]
    assert tables[0] == tables[1] and len(tables[0]) == 40
