"""The benchmark command: bad input, figures, report, picture."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from PIL import Image
from swim_agents.learning.config import load_config

from studies.benchmark import report
from studies.benchmark.checkouts import compare_checkouts
from studies.benchmark.environments import Workload, environment_workload, step_loop, wave_actions
from studies.benchmark.growth import fit_growth, growth_of
from studies.benchmark.memory import measure_memory
from studies.benchmark.picture import draw_benchmark
from studies.benchmark.report import REPORT_FILES, report_page, report_tables, write_report
from studies.benchmark.subprocesses import run_python
from studies.benchmark.suite import kernel_scenes, measure_speeds
from studies.benchmark.timing import ratio, spread_of, time_in_turn
from studies.benchmark.training_cost import PARTS, Timers, measure_training
from swim_env import FLUID_MODELS, SwimError, load_scene
from swim_env.plots import save_figure
from tests.support import ROOT, call_script, files_of, full_disk, run_script

SPREAD = {"median", "low", "high", "smallest", "rounds"}


def kept() -> dict:
    """Return the stored record, which has every section."""
    return json.loads((ROOT / "docs" / "benchmark" / "benchmark.json").read_text(encoding="utf-8"))


def speed(label: str, rate: float, peer: bool = True, **more: object) -> dict:
    """Return a made-up speed."""
    names = ("steps_per_second", "simulated_seconds_per_second")
    rates = spread_of(rate * np.array([0.9, 1.0, 1.2])).as_dict()
    return {"label": label, "peer": peer, **dict.fromkeys(names, rates), **more}


# ---- the command -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--only", "kernels"], "invalid choice: 'kernels'"),
        (["--rounds", "0"], "--rounds must be between 1 and 1000, got 0"),
        (["--rounds", "many"], "invalid int value: 'many'"),
        (["--output", __file__], "results go into a folder, this is a file"),
        (["--output", str(Path(__file__).parent)], "the folder holds other files"),
        (["--output", str(Path(__file__) / "run")], "cannot"),
    ],
)
def test_bad_input_is_one_line_and_code_2(capsys, arguments, part):
    done = call_script(capsys, "benchmark", *arguments)
    assert (done.code, done.out) == (2, "")
    assert [part in line for line in done.err.splitlines() if "error: " in line] == [True]


def test_the_environments_as_one_json_line(tmp_path):
    """One section alone: its keys, positive figures in order, and nothing of the others."""
    folder = tmp_path / "above" / "run"
    record = run_script(
        "benchmark", "--quick", "--only", "environments", "--json", "--output", folder
    ).figures()
    assert record.keys() >= {
        "command", "commit", "machine", "versions", "date", "load_average", "quick", "rounds",
        "sections", "speeds", "ratios", "memory", "skipped", "wall_seconds",
    }  # fmt: skip
    assert not record.keys() & {"kernel", "growth", "startup", "training"}
    assert record["sections"] == ["environments"]
    ours = {"agent", "random", "violent", "paper_i_wave", "batch_1_thread"}
    assert record["speeds"].keys() >= ours
    for name, one in record["speeds"].items():
        assert one["physics_steps_per_step"] == (2 if name.startswith("paper_i") else 4)
        assert one["peer"] is False
        for rate in ("steps_per_second", "microseconds_per_step", "simulated_seconds_per_second"):
            assert one[rate].keys() == SPREAD
            values = [one[rate][name] for name in ("smallest", "low", "median", "high")]
            assert 0 < values[0] and values == sorted(values)
            assert one[rate]["rounds"] == record["rounds"]
        one_action = one["simulated_seconds_per_second"]["median"]
        assert one_action == pytest.approx(0.02 * one["steps_per_second"]["median"])
    assert files_of(folder).keys() == set(REPORT_FILES)
    assert json.loads((folder / "benchmark.json").read_text()) == record
    assert f"`{record['command']}`" in (folder / "benchmark.md").read_text()


# ---- what is measured --------------------------------------------------------------------------


def test_the_scenes_cover_models_elements_and_panels():
    cells = {model: set() for model in FLUID_MODELS}
    for scene in kernel_scenes((3, 9), (2, 4, 8)):
        cells[scene.fluid.model].add((scene.beam.elements, scene.fluid.panels_per_element))
    usual = dict.fromkeys(FLUID_MODELS, {(3, 4), (9, 4)})
    every = {(n, p) for n in (3, 9) for p in (2, 4, 8)}
    # The last is there for comparison with the printed equations.
    assert cells == {**usual, "panels": every, "centreline": set()}
    large = [(scene.fluid.model, scene.beam.elements) for scene in kernel_scenes((27, 81), (4,))]
    assert ("panels", 81) in large and ("expansion", 27) in large and ("expansion", 81) not in large


def test_growth_recovers_exponent_and_deviation_of_each_model():
    n = np.array([3, 5, 9, 18, 27, 54, 81])
    fit = fit_growth(n, 0.4 * n**2.3)
    assert fit["exponent"] == pytest.approx(2.3)
    assert fit["microseconds_of_one"] == pytest.approx(0.4)
    assert (fit["elements_from"], fit["elements_to"], fit["points"]) == (3, 81, 7)
    assert fit["largest_deviation"] < 1e-9
    off = 0.4 * n**2.3 * np.where(n == 18, 1.5, 1.0)
    assert 0.2 < fit_growth(n, off)["largest_deviation"] < 0.5
    cells = [
        {"fluid_model": m, "panels_per_element": 4, "elements": n, "step": {"median": n**a}}
        for m, a in (("panels", 3.0), ("none", 1.0))
        for n in (2, 4, 8, 16)
    ]
    cells[0]["step"]["median"] = 1e9  # of too few elements to count
    fits = {fit["fluid_model"]: fit["exponent"] for fit in growth_of(cells, 4)}
    assert fits == pytest.approx({"panels": 3.0, "none": 1.0})
    assert growth_of(cells, 16) == []


def test_a_ratio_is_that_of_speeds_round_by_round(monkeypatch):
    """Twice the steps in the same time is a ratio of 2, however the machine's speed drifts."""
    drift = np.array([1.0, 5.0, 0.3])
    monkeypatch.setattr(
        "studies.benchmark.suite.time_in_turn",
        lambda calls, **_: {name: drift.copy() for name in calls},
    )
    work = {
        "batch_all_cores": Workload("fast", lambda: None, 20, 0.4, 80),
        "batch_1_thread": Workload("slow", lambda: None, 10, 0.2, 40),
    }
    speeds, ratios = measure_speeds(work, 3)
    one = ratios["batch_all_cores_to_1_thread"]
    assert one["ratio"]["median"] == one["ratio"]["low"] == one["ratio"]["high"] == 2.0
    assert (one["aim"], one["met"]) == (1.6, True)
    assert speeds["batch_all_cores"]["steps_per_second"]["median"] == 20.0
    assert speeds["batch_1_thread"]["simulated_seconds_per_second"]["median"] == 0.2
    assert measure_speeds({"batch_1_thread": work["batch_1_thread"]}, 3)[1] == {}


def test_times_of_one_round_have_one_index():
    order = []
    calls = {name: lambda name=name: order.append(name) for name in ("a", "b")}
    times = time_in_turn(calls, rounds=3)
    assert order == ["a", "b"] * 4
    assert all(values.shape == (3,) and (values > 0.0).all() for values in times.values())
    assert ratio(np.array([2.0, 8.0]), np.array([1.0, 2.0])).median == 3.0


class Counting(gymnasium.Env):
    """Episodes of three steps that keep what is done to them."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def reset(self, *, seed=None, options=None):
        self.done.append("reset" if seed is None else f"reset {seed}")
        self.left = 3
        return 0, {}

    def step(self, action):
        self.left -= 1
        self.done.append(action)
        return 0, 0.0, False, self.left == 0, {}


def test_a_loop_continues_and_starts_ended_episodes_anew():
    env = Counting()
    play = step_loop(env, np.array(["a", "b", "c", "d"]), 5, seed=7)
    play()
    assert env.done == ["reset 7", *"abc", "reset", *"da"]
    play()
    assert env.done[7:] == [*"b", "reset", *"cda", "reset", *"b"]


@pytest.mark.parametrize(("batch", "steps"), [(None, 4), ((5, 1), 20)])
def test_workloads_say_what_a_call_plays(batch, steps):
    scene = load_scene("swimmer", {"beam.elements": 3, "episode.duration": 0.06})
    work = environment_workload("label", scene, 4, batch=batch)
    assert (work.steps, work.physics_steps) == (steps, scene.steps_per_action * steps)
    assert work.seconds == pytest.approx(0.02 * steps)
    work.call()


def test_the_wave_is_the_scenes_own_torque():
    scene = load_scene("paper_i").replace("actuation.torque_limit", 2.0)
    wave = wave_actions(scene, 3)
    assert wave.dtype == np.float32
    times = [0.0, 0.02, 0.04]
    assert wave == pytest.approx(scene.actuation.torques(times, scene.beam) / 2.0, abs=1e-6)
    assert not wave_actions(scene.replace("actuation", None), 3).any()


def test_memory_is_linear_in_the_batch():
    memory = measure_memory("swimmer", (1, 3, 6))
    arrays = memory["arrays"]
    assert arrays["linearity"] < 0.01
    assert arrays["bytes"]["6"] > 5 * arrays["bytes_per_member"] > 0
    assert memory["many_elements"]["bytes_per_member"] > 20 * arrays["bytes_per_member"]
    resident = memory["resident"]
    if resident is not None:
        assert resident["process"] > 10e6
        assert resident["growth"]["6"] < 100 * arrays["bytes"]["6"]


def test_timers_count_nothing_twice():
    """What a timer inside another one counts is subtracted from the outer one."""
    timers = Timers()
    clock = iter(range(100))  # one second at every look
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.benchmark.training_cost.time.perf_counter", lambda: next(clock))
        with timers.running("outer"), timers.running("inner"):
            pass
        with timers.running("outer"):
            pass
    assert timers.seconds == {"inner": 1, "outer": 2 + 1}


def test_shares_of_training_sum_to_one():
    changes = {"members": 4, "ppo.rollout": 16, "ppo.minibatch": 32, "ppo.epochs": 2}
    run = measure_training(load_config("ppo_forward", changes), seconds=0.0, threads=1)
    assert tuple(run["shares"]) == PARTS
    assert sum(run["shares"].values()) == pytest.approx(1.0, abs=1e-12)
    assert min(run["shares"].values()) > 0.0
    assert (run["rounds"], run["steps"], run["torch_threads"]) == (2, 128, 1)
    assert run["steps_per_second"]["median"] > 0.0


def test_a_failed_process_is_one_error_with_its_last_words():
    done = run_python("import sys; print('out'); print('err', file=sys.stderr)")
    assert done.output == "out\n"
    assert [line for _, line in done.messages] == ["err"]
    assert 0.0 < done.messages[0][0] <= done.seconds
    with pytest.raises(SwimError, match="ZeroDivisionError"):
        run_python("1 / 0")


# ---- the report --------------------------------------------------------------------------------


@pytest.mark.release
def test_the_stored_page_is_made_of_the_stored_data():
    folder = ROOT / "docs" / "benchmark"
    assert report_page(kept()) == (folder / "benchmark.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("absent", [(), ("kernel", "growth"), ("speeds",), ("kernel", "speeds")])
def test_the_picture_fits_a_page_and_shows_each_peer_once(tmp_path, absent):
    """In its fastest way; whatever was measured, there is a picture."""
    record = {name: value for name, value in kept().items() if name not in absent}
    if "speeds" in record:
        record["speeds"] = {
            "swimmer": speed("swimmer", 50.0, False),
            "chain/slow": speed("slow", 10.0, fluid="drag"),
            "chain/fast": speed("fast", 90.0, fluid="drag"),
            "chain/bare": speed("bare", 99.0, fluid="none"),
        }
    figure = draw_benchmark(record)
    growth, parts, speeds = figure.axes
    if not absent:
        labels = [
            {text.get_text() for text in axes.get_legend().get_texts()} for axes in figure.axes
        ]
        assert "floor" in labels[0] & labels[1]
        # Those without a fluid have a colour of their own.
        assert len(labels[2]) == 3 and "peers without fluid" in labels[2]
        shown = [text.get_text() for text in speeds.get_yticklabels()]
        assert shown == ["swimmer", "fast", "bare"]
        tops = [bar.get_y() + bar.get_height() for bar in parts.patches]
        assert max(tops) == pytest.approx(100.0)
        assert "(s/s)" in speeds.get_xlabel() and "\u00b5s" in growth.get_ylabel()
    save_figure(figure, tmp_path / "picture.png")
    with Image.open(tmp_path / "picture.png") as picture:
        assert (picture.format, picture.size) == ("PNG", (1200, 900))


def tripled(value: Any) -> Any:
    """Return data with every number three times as large."""
    if isinstance(value, dict):
        return {name: tripled(one) for name, one in value.items()}
    if isinstance(value, list):
        return [tripled(one) for one in value]
    return value if value is None or isinstance(value, (bool, str)) else 3 * value


@pytest.mark.parametrize("name", ["kernel", "growth", "ratios", "memory", "startup", "training"])
def test_every_row_of_a_section_shows_its_figures(name):
    record = kept()
    others = {key: value for key, value in record.items() if key != name}
    given = (record, others, {**record, name: tripled(record[name])})
    whole, without, changed = (report_tables(one).splitlines() for one in given)
    rows = [line for line in whole if line not in without and re.search(r"\d .*\|$", line)]
    assert len(rows) >= 2 and not set(rows) & set(changed)


def test_the_page_says_which_peers_are_ahead_and_what_is_missing():
    record = kept()
    record["skipped"] = {"another peer": "it is not installed"}
    record["speeds"] = {
        "paper_i_rollout": speed("physics alone", 100.0, False, physics_steps_per_step=2),
        "mujoco_chain/a": speed("chain a", 250.0, physics_steps_per_step=1),
        "mujoco_chain/b": speed("chain b", 50.0, physics_steps_per_step=80),
        "elastica_rod/1": speed("rod", 1.0, physics_steps_per_step=1000),
    }
    for one in record["speeds"].values():
        one["microseconds_per_step"] = one["steps_per_second"]
    text = report_tables(record)
    ahead = text[text.index("Ahead of this package") : text.index("Behind it")]
    behind = text[text.index("Behind it") : text.index("In plain steps per second")]
    assert "2.5 times: chain a" in ahead and "chain b" not in ahead
    assert behind.index("0.5 times: chain b") < behind.index("0.01 times: rod")
    assert "4,000 of chain b" in text and "200 here" in text
    assert "another peer: it is not installed" in text


def test_a_report_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    """An earlier report stays until the new one is complete; other files are never replaced."""
    folder = tmp_path / "run"
    first = kept()
    write_report(first, folder)
    before = files_of(folder)
    assert before.keys() == set(REPORT_FILES)
    second = {**first, "commit": "another"}
    with monkeypatch.context() as patch:
        patch.setattr(report, "save_figure", full_disk)
        with pytest.raises(SwimError, match="No space left"):
            write_report(second, folder)
    assert files_of(folder) == before
    write_report(second, folder)
    assert "commit another" in (folder / "benchmark.md").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    (folder / "thesis.tex").write_text("dear")
    with pytest.raises(SwimError, match=r"thesis\.tex"):
        write_report(first, folder)
    assert "commit another" in (folder / "benchmark.md").read_text()


# ---- two checkouts -----------------------------------------------------------------------------


def test_folders_that_cannot_be_timed_are_refused(tmp_path):
    with pytest.raises(SwimError, match="no package swim_env"):
        compare_checkouts(tmp_path)
    with pytest.raises(SwimError, match="this checkout itself"):
        compare_checkouts(ROOT)
    (tmp_path / "swim_env").mkdir()
    (tmp_path / "swim_env" / "__init__.py").write_text("raise ImportError('broken')\n")
    with pytest.raises(SwimError, match="could not be timed"):
        compare_checkouts(tmp_path, rounds=1)


@pytest.mark.release
@pytest.mark.timeout(600)
def test_a_copy_is_as_fast_and_a_slow_one_is_slower(tmp_path):
    shutil.copytree(ROOT / "swim_env", tmp_path / "swim_env")
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    simulator = tmp_path / "swim_env" / "sim" / "simulator.py"
    plain = simulator.read_text(encoding="utf-8")
    start = "        held = self._checked(torques, many=False)\n"
    assert plain.count(start) == 1
    found = compare_checkouts(tmp_path, rounds=41)
    for name, one in found.items():
        assert 0.8 < one["ratio"]["median"] < 1.25, f"{name}: {one['ratio']}"
    wait = "        sum(range(200_000))\n"
    simulator.write_text(plain.replace(start, wait + start), encoding="utf-8")
    slow = compare_checkouts(tmp_path, rounds=11)
    assert slow["no fluid"]["ratio"]["median"] < 0.9, slow["no fluid"]
