"""What all commands share: places of results, numbers, streams, and Ctrl-C at any moment."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from swim_agents.commands import main as console
from swim_agents.commands.command_line import check_places
from swim_agents.comparison.contest import entries_of, hold_contest
from swim_agents.replay import replay_episode

from swim_env import OptionError, SwimEnv, SwimError, SwimVectorEnv, load_scene
from swim_env.sim.batch import Bodies
from swim_env.sim.replay import steps_of
from tests.support import ENVIRONMENT, ROOT, call_script, files_of, hear_interrupts, refuses

SCRIPTS = ROOT / "scripts"

# ---- places, before anything is computed -------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "part"),
    [
        ("replay --scene paper_i --output X --record X", "--output and --record need different"),
        ("replay --scene paper_i --output X --record X/a.rrd", "need different places"),
        ("replay --scene paper_i --output X.rrd --record X.rrd", "need different places"),
        ("replay --scene paper_i --env --output X --record-video X/v", "need different places"),
        ("replay --scene in/s.yaml --output in", "--output would replace what is read (in/s.yaml)"),
        ("replay --scene paper_i --output s.yaml/x", "cannot use the folder: Not a directory"),
        ("replay --scene paper_i --output /proc/x", "cannot use the folder"),
        ("replay --scene paper_i --record s.yaml/x", "cannot make the folder for the recording"),
        ("replay --scene paper_i --env --record-video s.yaml", "cannot make the folder for the"),
        ("replay --scene paper_i --env --record-video /proc", "cannot write the video"),
        ("compare --policies zero --output X --record X", "need different places"),
        ("compare --policies in --output in", "--output would replace what is read (in)"),
        ("tune_wave --output x --plot x", "--output and --plot need different places"),
        ("tune_wave --output none/x", "cannot write a file there: No such file"),
        ("tune_wave --output in", "cannot write a file there: Is a directory"),
        ("tune_wave --scene s.yaml --output s.yaml", "--output would replace what is read"),
        ("visualise --picture no/x.png", "no such folder for the picture"),
        ("train demo --output s.yaml", "Not a directory"),
        ("train demo --seeds 0 1 --output T", "Not a directory"),
        ("train demo --output T --seeds 0 --record s.yaml", "cannot make the folder"),
        ("benchmark --output s.yaml/x", "cannot use the folder"),
        ("gallery --output s.yaml/x", "cannot use the folder"),
        ("accuracy_cost --held-out --output folders", "cannot write a file there: Is a directory"),
        ("stability --output folders", "cannot write a file there: Is a directory"),
        ("reproduce_paper --output folders", "cannot write a file there: Is a directory"),
        # numbers
        ("compare --duration nan", "episode.duration must be a finite number in s, got nan"),
        ("compare --duration 1e6", "at most 2,000,000 time steps"),
        ("compare --noise nan", "--noise must be a finite number, got nan"),
        ("compare --seeds 3 3", "seeds must be different whole numbers of at least 0"),
        ("compare --seeds -1", "seeds must be different whole numbers of at least 0"),
        ("replay --scene paper_i --env --noise 1e9", "--noise must be at most 1e+06"),
        ("replay --scene paper_i --env --seed -1", "--seed must be at least 0, got -1"),
        ("replay --scene paper_i --duration inf", "the duration must be a positive number"),
        ("replay --scene paper_i --duration 0 --accuracy 0.1", "must be a positive number"),
        ("visualise --scene paper_i --compare-with zero --seed -1", "--seed must be at least 0"),
        ("gallery --seed -1", "the seed must be a whole number of at least 0, got -1"),
        ("train demo --seeds -1", "seed must be a whole number from 0"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_computed(
    command, part, tmp_path, capsys, monkeypatch
):
    """One line and no file, long before a kernel is needed."""
    monkeypatch.chdir(tmp_path)
    for folder in ("in", "T", "folders"):
        Path(folder).mkdir()
    for file in ("s.yaml", "in/s.yaml"):
        load_scene("paper_iv").save(file)
    Path("T/seed_1").touch()
    for name in ("held_out.md", "tables.md", "verdicts.json"):
        Path("folders", name).mkdir()
    before = files_of(tmp_path)
    monkeypatch.setattr(Bodies, "__init__", lambda *_, **__: pytest.fail("it computes"))
    name, *arguments = command.split()
    call_script(capsys, name, *arguments).assert_refused(part)
    assert files_of(tmp_path) == before


def test_the_scene_with_chosen_settings_does_not_replace_the_scene(tmp_path, capsys):
    scene = tmp_path / "s.yaml"
    load_scene("paper_iv").save(scene)
    brief = ["accuracy", "--scene", str(scene), "--tolerance", "0.1", "--output", str(scene)]
    assert console.main(brief) == 2
    assert "--output would replace what is read" in capsys.readouterr().err


def test_numpys_numbers_are_numbers_and_others_are_refused():
    scene = load_scene("paper_iv").replace("episode.duration", 0.2)
    durations = (np.float32(0.2), np.float64(0.2), np.int64(1), None)
    assert [steps_of(scene, duration) for duration in durations] == [20, 20, 100, 20]
    for bad in (0, -1.0, np.nan, np.inf, 10**400, True, "1", np.float32(-1)):
        with refuses(SwimError, "the duration must be a positive number of seconds, got"):
            steps_of(scene, bad)
    *_, summary = replay_episode(scene, "zero", seed=np.int64(3), noise=np.float32(0.5))
    assert json.loads(json.dumps(summary))["seed"] == 3
    for bad in (-1, 1.5, np.nan, "1", True):
        with refuses(OptionError, "the seed must be"):
            replay_episode(scene, "zero", seed=bad)
    first = SwimEnv(scene).reset(seed=3)[0]
    assert (SwimEnv(scene).reset(seed=np.int64(3))[0] == first).all()
    batch = SwimVectorEnv(2, scene)
    for seeds in (np.int64(3), [np.int64(3), np.uint8(4)], np.array([3, 4])):
        assert (batch.reset(seed=seeds)[0][0] == first).all()
    contest = hold_contest(scene, entries_of(["zero"], scene), np.arange(2), noise=np.float32(1))
    assert json.loads(json.dumps(contest.record))["seeds"] == [0, 1]
    for bad in ([], [1.5], [-1], [1, 1], ["a"], [True]):
        with refuses(OptionError, "seeds must be different whole numbers"):
            hold_contest(scene, [], bad)


# ---- streams -----------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="a shell's redirections")
@pytest.mark.parametrize(
    ("redirected", "encoding"),
    [
        (">&-", ""), (">out 2>&-", ""), (">&- 2>&- <&-", ""), (">out 2>/dev/full", ""),
        (">out 2>err", "ascii"), (">out 2>err", "cp1252"), ("2>&1 | head -c 1 >out", ""),
    ],
)  # fmt: skip
def test_any_standard_output_and_error_will_do(redirected, encoding, tmp_path):
    """Everything is done, and said as far as it can be; the JSON line is the last one."""
    scene = tmp_path / "s.yaml"
    load_scene("paper_iv").replace({"name": "\u9c7c", "episode.duration": 0.2}).save(scene)
    script = f"'{sys.executable}' '{SCRIPTS / 'replay.py'}' --scene s.yaml --output \u9c7c --json"
    done = subprocess.run(
        ["bash", "-c", f"{script} {redirected}"], cwd=tmp_path, capture_output=True, text=True,
        env={**ENVIRONMENT, "PYTHONIOENCODING": encoding},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    assert len(list((tmp_path / "\u9c7c").iterdir())) == 4
    if redirected.startswith(">out"):
        assert json.loads((tmp_path / "out").read_text())["scene"] == "\u9c7c"
    if redirected.endswith("2>err"):
        assert (tmp_path / "err").read_text().endswith("results are in \\u9c7c\n")


def test_the_json_line_is_the_last_even_where_streams_are_one(tmp_path):
    done = subprocess.run(
        [sys.executable, SCRIPTS / "replay.py", "--scene", "paper_iv", "--duration", "0.1",
         "--output", tmp_path / "x", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT,
    )  # fmt: skip
    assert json.loads(done.stdout.splitlines()[-1])["scene"] == "paper_iv", done.stdout


# ---- Ctrl-C ------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("wait", [0.1, 0.3, 0.6, 1.0, 1.5, 2.0])
def test_ctrl_c_is_one_line_from_the_beginning_on(wait):
    """While modules are imported and kernels are loaded, which swallow or break it, too."""
    process = subprocess.Popen(
        [sys.executable, SCRIPTS / "replay.py", "--scene", "paper_i", "--duration", "3000"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT,
        preexec_fn=hear_interrupts,
    )  # fmt: skip
    try:
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    said = "interrupted; files that were finished are kept, no others were written"
    last = err.replace("\r", "\n").strip().splitlines()[-1]
    assert (process.returncode, out, last) == (130, "", said), err
    assert "Traceback" not in err


@pytest.mark.parametrize("place", ["importlib", "llvmlite", "serialization", "abstract"])
def test_an_interrupt_is_raised_after_an_import_or_a_callback(place, tmp_path):
    """Not in it: there it would be swallowed (llvmlite) or abort the process (torch)."""
    module = tmp_path / f"like_{place}.py"
    module.write_text(
        "import signal, time\ntry:\n    signal.raise_signal(signal.SIGINT)\n    time.sleep(0.2)\n"
        "except KeyboardInterrupt:\n    print('in it')\n"
    )
    run = f"import {module.stem}" if place == "importlib" else f"runpy.run_path('{module}')"
    code = (
        f"import runpy, sys, time\nimport swim_agents.commands\nsys.path.insert(0, '{tmp_path}')\n"
        f"try:\n    {run}\n    time.sleep(5)\nexcept KeyboardInterrupt:\n    print('after it')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=ENVIRONMENT,
        preexec_fn=hear_interrupts,
    )  # fmt: skip
    assert done.stdout == "after it\n", done.stderr


def test_a_shared_place_is_not_what_is_read(tmp_path):
    scene = tmp_path / "in.rrd"
    scene.write_text("name: mine\n")
    with refuses(SwimError, "--record would replace what is read"):
        check_places([str(scene)], {}, {"--record": str(scene)})
    check_places([str(scene)], {}, {"--record": str(tmp_path)})


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a full device")
def test_a_version_that_cannot_be_printed_is_one_line():
    code = "from swim_agents.commands.main import main; main(['--version'])"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
    assert "Traceback" not in done.stderr and "No space left" in done.stderr
