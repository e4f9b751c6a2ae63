"""Sweeps: the table is right whatever is killed, ends early, fails or does not fit on the disk."""

import csv
import importlib.util
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from swim_agents.commands.command_line import run
from swim_agents.commands.main import command
from swim_agents.sweep.config import load_sweep
from swim_agents.sweep.kinds import SweepError

from swim_env import load_scene
from swim_env.scene.yaml import dump_yaml
from swim_env.sim.replay import replay
from tests.support import ENVIRONMENT, ROOT, Done, assert_is_a_picture, refuses

HERE = Path(__file__).parent
MAIN = "import sys; from swim_agents.commands.main import main; sys.exit(main(sys.argv[1:]))"

has_ray = importlib.util.find_spec("ray") is not None
#: Ray takes a while to start.
each_place = pytest.mark.parametrize(
    "on",
    [
        "local",
        pytest.param(
            "ray",
            marks=[pytest.mark.slow, pytest.mark.skipif(not has_ray, reason="Ray is missing")],
        ),
    ],
)

#: Forty runs of milliseconds: one of them ends by name, one cannot be made.
STIFFNESSES = [0.1, *(1.0 + i for i in range(18)), -1.0]
FORTY: dict[str, Any] = {
    "run": "replay",
    "options": {"scene": "paper_i", "duration": 0.1},
    "set": {"beam.bending_stiffness": {"grid": STIFFNESSES}},
}
FORTY["set"]["actuation.amplitude"] = {"grid": [1.0, 2.0]}


def written(folder: Path, sweep: dict[str, Any], name: str = "forty") -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(dump_yaml(sweep))
    return path


def start(*arguments: str | Path, limit: int | None = None) -> subprocess.Popen[str]:
    """Start a sweep in a session of its own, with a limit on the size of files (bytes)."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.Popen(
        [sys.executable, "-c", MAIN, "sweep", *map(str, arguments)],
        env={**ENVIRONMENT, "RAY_USAGE_STATS_ENABLED": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=prepare,
    )


def sweep(*arguments: str | Path, limit: int | None = None) -> Done:
    process = start(*arguments, limit=limit)
    out, err = process.communicate(timeout=280)
    return Done(process.returncode, out, err)


def table(folder: Path) -> list[dict[str, str]]:
    with open(folder / "table.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def records(folder: Path) -> dict[str, bytes]:
    return {path.parent.name: path.read_bytes() for path in folder.glob("runs/*/record.json")}


def assert_is_right(folder: Path) -> None:
    """The forty runs have a row each, in their order, with what a replay in this process gives."""
    rows = table(folder)
    points = [(row["beam.bending_stiffness"], row["actuation.amplitude"]) for row in rows]
    assert points == [(str(one), str(other)) for one in STIFFNESSES for other in (1.0, 2.0)]
    assert len({row["run"] for row in rows}) == 40
    for row in rows:
        stiffness, amplitude = float(row["beam.bending_stiffness"]), row["actuation.amplitude"]
        if stiffness < 0.0:
            assert row["status"] == "failed", row
            assert "beam.bending_stiffness" in row["reason"]
            assert row["mean_speed"] == ""
            continue
        changes = [f"beam.bending_stiffness={stiffness}", f"actuation.amplitude={amplitude}"]
        scene = load_scene("paper_i", changes)
        trajectory, summary = replay(scene, 0.1)
        assert row["mean_speed"] == str(summary["mean_speed"])
        ended = trajectory.termination_reason
        assert (row["status"], row["reason"]) == ("ended" if ended else "finished", ended)
    assert {row["status"] for row in rows} == {"finished", "ended", "failed"}


def children(session: int) -> list[int]:
    """Return the processes that are left of a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


def wait_until(so: Callable[[], bool], seconds: float = 240.0) -> None:
    limit = time.monotonic() + seconds
    while not so():
        assert time.monotonic() < limit, "it does not come to the point"
        time.sleep(0.02)


@each_place
def test_a_killed_driver_loses_only_the_runs_under_way(on, tmp_path):
    file, folder = written(tmp_path, FORTY), tmp_path / "out"
    process = start(file, "--output", folder, "--on", on)
    wait_until(lambda: len(records(folder)) >= 5)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    if on == "local":  # Ray's own processes end a while later
        wait_until(lambda: not children(process.pid), 60.0)
    before = records(folder)
    assert 5 <= len(before) < 40
    done = sweep(file, "--output", folder, "--on", on, "--json")
    assert_is_right(folder)
    failed = [row["run"] for row in table(folder) if row["status"] == "failed"]
    after = records(folder)
    assert all(after[name] == before[name] for name in before if name not in failed)
    result = json.loads(done.out)
    assert done.code == 1 and result["failed"] == len(failed) == 2
    assert result["finished"] + result["ended"] == 38 and result["waiting"] == 0
    assert len(result["reasons"]) == result["ended"] + 2
    # The table is gathered from the records at any time.
    kept = (folder / "table.csv").read_bytes()
    (folder / "table.csv").unlink()
    assert sweep(file, "--output", folder, "--gather").code == 1
    assert (folder / "table.csv").read_bytes() == kept and records(folder) == after


@each_place
def test_a_run_whose_process_is_killed_is_begun_again_once(on, tmp_path):
    once = f"mark={tmp_path / 'mark'}"
    plan = {
        "run": "replay",
        "options": {
            "scene": "swimmer",
            "env": True,
            "duration": 0.1,
            "policy": "zero",
            "task": os.path.relpath(HERE / "lethal_task.py", tmp_path) + ":LethalTask",
            "task-option": {"grid": [[once], ["mark=''"]]},
        },
    }
    file, folder = written(tmp_path, plan), tmp_path / "out"
    done = sweep(file, "--output", folder, "--on", on, "--workers", "1")
    assert done.code == 1, done.err
    finished, failed = table(folder)
    assert finished["status"] == "finished" and failed["status"] == "failed"
    assert "its process was lost" in failed["reason"] and failed["reason"] in done.out


RECORD, TABLE = "cannot write the record of a run: ", "cannot write the table: "


@pytest.mark.parametrize(
    ("limit", "what"), [(60, RECORD), pytest.param(6000, TABLE, marks=pytest.mark.slow)]
)
def test_a_full_disk_ends_a_sweep_which_then_continues(limit, what, tmp_path):
    """A limit on the size of files stands for it: records of 2 kB, a table of 10 kB."""
    file, folder = written(tmp_path, FORTY), tmp_path / "out"
    done = sweep(file, "--output", folder, limit=limit)
    assert (done.code, done.out) == (1, "")
    line = done.err.splitlines()[-1]
    assert line.startswith(f"error: {what}File too large")
    assert line.endswith("; what was done is kept, start again to continue")
    assert not list(folder.rglob("*.tmp"))
    assert not (folder / "table.csv").exists() or len(table(folder)) == 40, "an older one, whole"
    before = records(folder)
    assert all(json.loads(record)["status"] for record in before.values())
    sweep(file, "--output", folder)
    assert_is_right(folder)


def test_ctrl_c_keeps_what_is_done_and_the_table(tmp_path):
    file, folder = written(tmp_path, FORTY), tmp_path / "out"
    process = start(file, "--output", folder, "--workers", "1")
    wait_until(lambda: len(records(folder)) >= 3)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.endswith("interrupted; start again to continue\n") and "Traceback" not in err
    wait_until(lambda: not children(process.pid), 20.0)
    statuses = [row["status"] for row in table(folder)]
    assert len(statuses) == 40 and statuses.count("waiting") == 40 - len(records(folder))


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Done:
    """Run a sweep's command here."""
    capsys.readouterr()
    code = run(command("sweep"), [str(each) for each in arguments])
    return Done(code, *capsys.readouterr())


TWO = {
    "run": "replay",
    "options": {"scene": "paper_i", "duration": 0.05},
    "set": {"beam.bending_stiffness": {"grid": [1.0, 2.0]}},
}


def test_tables_in_parquet_and_plots(tmp_path, capsys):
    pyarrow = pytest.importorskip("pyarrow.parquet")
    pytest.importorskip("matplotlib")
    plan = {
        **TWO,
        "set": {**TWO["set"], "actuation.amplitude": {"uniform": [0.5, 1.0]}},
        "samples": 2,
    }
    arguments = [written(tmp_path, plan), "--output", tmp_path / "out"]
    plot = ("--plot", "beam.bending_stiffness", "actuation.amplitude", "mean_speed")
    done = call(capsys, *arguments, "--workers", "1", *plot)
    assert done.code == 0, done.err
    assert_is_a_picture(tmp_path / "out" / "plot.png")
    assert call(capsys, *arguments, "--table", "parquet", "--plot", plot[1], plot[3]).code == 0
    kept = pyarrow.read_table(tmp_path / "out" / "table.parquet").to_pylist()
    for row, other in zip(kept, table(tmp_path / "out"), strict=True):
        assert {name: "" if value is None else str(value) for name, value in row.items()} == other
    call(capsys, *arguments, "--plot", "nothing", "mean_speed").assert_refused("no such column")
    call(capsys, *arguments, "--plot", "mean_speed").assert_refused("one or two fields")


def test_two_processes_do_not_do_one_sweep(tmp_path, capsys):
    file, folder = written(tmp_path, FORTY), tmp_path / "out"
    process = start(file, "--output", folder, "--workers", "1")
    try:
        wait_until(lambda: len(records(folder)) >= 1)
        call(capsys, file, "--output", folder).assert_refused("another process does this sweep")
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of libraries that the trainer loads
def test_trainings_are_swept_and_tuned_waves_as_well(tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    from tests.learning.small_runs import small_config

    small_config("ppo", steps=800).save(tmp_path / "small.yaml")
    plan = {"run": "train", "options": {"config": "small.yaml", "seeds": {"grid": [0, 1]}}}
    plan["set"] = {"learning_rate": {"log_uniform": [1e-3, 1e-2]}}
    done = call(capsys, written(tmp_path, plan), "--output", tmp_path / "out", "--workers", "1")
    assert done.code == 0, done.out
    rows = table(tmp_path / "out")
    assert [(row["seeds"], row["steps"]) for row in rows] == [("0", "832"), ("1", "832")]
    for row in rows:
        folder = tmp_path / "out" / "runs" / row["run"] / f"seed_{row['seeds']}"
        best = json.loads((folder / "run.json").read_text())["best"]
        assert row["best.net_displacement_median"] == str(best["net_displacement_median"])
        assert (folder / "agent" / "agent.json").is_file()


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "no command": ({}, "run must be one of replay, tune, optimise, train"),
    "unknown command": ({"run": "tain"}, "'tain' (nearest: train)"),
    "unknown field": ({**TWO, "seeds": 3}, "unknown field seeds (nearest: seed)"),
    "unknown option": ({**TWO, "options": {"scene": "paper_i", "dration": 1}}, "--dration=1"),
    "no such scene": ({**TWO, "options": {"scene": "papr_i"}}, "(nearest: paper_i)"),
    "unknown scene field": ({**TWO, "set": {"beam.lenght": 1}}, "beam.lenght"),
    "own option": ({**TWO, "options": {"output": "x"}}, "output is for the sweep to give"),
    "samples of nothing": ({**TWO, "samples": 3}, "samples has no meaning"),
    "empty grid": ({**TWO, "set": {"beam.length": {"grid": []}}}, "must be a list of values"),
    "twice": ({**TWO, "set": {"beam.length": {"grid": [1, 1]}}}, "two runs are the same"),
    "bounds": ({**TWO, "set": {"beam.length": {"uniform": [2, 1]}}}, "from the lower bound"),
    "one bound": ({**TWO, "set": {"beam.length": {"uniform": [2]}}}, "a list of two bounds"),
    "logarithm": ({**TWO, "set": {"beam.length": {"log_uniform": [0, 1]}}}, "must be above 0"),
    "seeds": ({"run": "train", "options": {"seeds": [0, 1]}}, "seeds of a run must be one"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_cannot_be_used_is_one_clear_error(name, tmp_path):
    plan, complaint = BAD[name]
    path = written(tmp_path, plan)
    with refuses(SweepError, complaint, str(path)):
        load_sweep(path)


def test_draws_are_within_bounds_and_more_samples_add_runs(tmp_path):
    drawn = {
        "beam.length": {"uniform": [0.5, 1.5]},
        "beam.bending_stiffness": {"log_uniform": [0.1, 10.0]},
        "beam.elements": {"integers": [3, 5]},
        "fluid.model": {"choice": ["frozen", "panels"]},
    }
    plan = {**TWO, "set": drawn, "samples": 50}
    runs = load_sweep(written(tmp_path, plan)).runs
    assert load_sweep(written(tmp_path, {**plan, "samples": 20})).runs == runs[:20]
    assert load_sweep(written(tmp_path, {**plan, "seed": 1})).runs[0] not in runs
    columns = {name: [run.values[name] for run in runs] for name in drawn}
    assert all(0.5 <= length <= 1.5 for length in columns["beam.length"])
    assert all(0.1 <= stiffness <= 10.0 for stiffness in columns["beam.bending_stiffness"])
    assert 10 < sum(stiffness < 1.0 for stiffness in columns["beam.bending_stiffness"]) < 40
    assert set(columns["beam.elements"]) == {3, 4, 5}
    assert set(columns["fluid.model"]) == {"frozen", "panels"}


def test_the_example_can_be_read():
    assert len(load_sweep(ROOT / "examples" / "sweep.yaml").runs) == 40
