"""Results are the same to the bit: restored, step by step, in chunks, and in any process."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from swim_env import Simulator, SwimError, Trajectory, load_scene

ROOT = Path(__file__).parents[2]
SCENES = {
    "paper_i": load_scene("paper_i"),
    "swimmer": load_scene("swimmer"),
    "no fluid": load_scene("paper_i", {"fluid": None}),
    "axial": load_scene("paper_i", {"axial_added_mass": {}}),
    "cut steps": load_scene("swimmer", {"integrator.time_step": 0.01}),
    "mean angles": load_scene("paper_i", {"integrator.strain": "mean_angles"}),
    "composed": load_scene("paper_i", {"integrator.scheme": "composed"}),
    "composed, cut steps": load_scene(
        "swimmer",
        {
            "integrator": {"time_step": 0.01, "scheme": "composed", "strain": "mean_angles"},
            "initial.velocity": (0.2, 0.1),
        },
    ),
}
STEPS = 90


def _torques(name: str) -> np.ndarray:
    scene = SCENES[name]
    rng = np.random.default_rng(11)
    torques = np.repeat(rng.uniform(-1.0, 1.0, (STEPS // 3, scene.beam.elements - 1)), 3, axis=0)
    if name.endswith("cut steps"):
        torques[[20, 31, 43]] = 20.0 * np.tile([1.0, -1.0], 4)
    return torques


def _assert_equal(one: Trajectory, other: Trajectory, leave_out: tuple[str, ...] = ()) -> None:
    for field in fields(Trajectory):
        if field.name in leave_out:
            continue
        a, b = getattr(one, field.name), getattr(other, field.name)
        same = np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
        gap = np.abs(a - b).max() if isinstance(a, np.ndarray) and a.shape == b.shape else "all"
        assert same, f"{field.name} differs by {gap}"


def _part(trajectory: Trajectory, first: int) -> dict[str, np.ndarray]:
    # None of these scenes asks for internal forces.
    without = ("scene", "termination_reason", "internal_forces")
    names = [f.name for f in fields(Trajectory) if f.name not in without]
    return {name: getattr(trajectory, name)[first:] for name in names}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("cut", [1, 21, 45])
def test_a_restored_run_continues_bit_for_bit(name: str, cut: int) -> None:
    torques = _torques(name)
    whole = Simulator(SCENES[name]).rollout(torques)
    if name.endswith("cut steps"):
        assert whole.parts[20] > 1, "the step before the snapshot was to be a cut one"
    simulator = Simulator(SCENES[name])
    simulator.rollout(torques[:cut])
    kept = simulator.snapshot()
    simulator.rollout(0.5 * torques)
    simulator.restore(kept)
    other = Simulator(SCENES[name])
    other.restore(kept)
    for restored in (simulator, other):
        assert restored.steps == cut
        rest = restored.rollout(torques[cut:])
        for field, wanted in _part(whole, cut).items():
            found = getattr(rest, field)
            gap = np.abs(found - wanted).max()
            assert np.array_equal(found, wanted), f"{field} differs by {gap:.2g}"


@pytest.mark.parametrize("name", SCENES)
def test_single_steps_are_the_rollout_bit_for_bit(name: str) -> None:
    torques = _torques(name)
    simulator = Simulator(SCENES[name])
    whole = simulator.rollout(torques)
    stepped = Simulator(SCENES[name])
    for n, held in enumerate(torques):
        assert np.array_equal(stepped.centres, whole.centres[n]), f"centres differ at step {n}"
        assert np.array_equal(stepped.angles, whole.angles[n]), f"angles differ at step {n}"
        assert np.array_equal(stepped.momentum(), whole.momentum[n]), f"momentum, step {n}"
        assert stepped.energy() == whole.energy[n], f"energy differs at step {n}"
        assert stepped.time == whole.time[n]
        stepped.step(held)
    assert stepped.snapshot() == simulator.snapshot()


@pytest.mark.parametrize("name", SCENES)
def test_a_rollout_in_chunks_is_one_rollout(name: str) -> None:
    torques = _torques(name)
    whole = Simulator(SCENES[name]).rollout(torques)
    simulator = Simulator(SCENES[name])
    at = 0
    for size in (1, 7, 30, 52):
        piece = simulator.rollout(torques[at : at + size])
        for field, wanted in _part(whole, at).items():
            found = getattr(piece, field)
            assert np.array_equal(found, wanted[: len(found)]), f"{field} differs from step {at}"
        at += size
    assert at == STEPS


def test_watching_the_progress_changes_nothing() -> None:
    torques = np.tile(_torques("swimmer"), (6, 1))
    told: list[int] = []
    watched = Simulator("swimmer").rollout(torques, told.append)
    _assert_equal(Simulator("swimmer").rollout(torques), watched)
    assert sum(told) == len(torques)
    assert len(told) > 1


def test_reading_the_state_changes_nothing() -> None:
    torques = _torques("swimmer")
    simulator = Simulator("swimmer")
    simulator.rollout(torques[:30])
    before = simulator.snapshot()
    simulator.coordinates[:] = 7.0
    simulator.momentum()[:] = 7.0
    simulator.velocity()[:] = 7.0
    simulator.energy()
    simulator.prescribed_torques(10)
    assert simulator.snapshot() == before


def test_simulators_do_not_influence_each_other() -> None:
    names = list(SCENES)
    alone = {name: Simulator(SCENES[name]).rollout(_torques(name)) for name in names}
    together = {name: Simulator(SCENES[name]) for name in names}
    for n in range(STEPS):
        for name in names:
            together[name].step(_torques(name)[n])
    for name in names:
        gap = np.abs(together[name].centres - alone[name].centres[-1]).max()
        assert np.array_equal(together[name].centres, alone[name].centres[-1]), f"{name}: {gap:.2g}"
        assert together[name].energy() == alone[name].energy[-1], name


def test_a_snapshot_of_another_scene_is_refused() -> None:
    kept = Simulator("paper_i").snapshot()
    with pytest.raises(SwimError, match="another scene"):
        Simulator("swimmer").restore(kept)


def test_a_snapshot_remembers_the_end() -> None:
    simulator = Simulator("swimmer")
    with pytest.raises(SwimError):
        simulator.step(np.full(8, 1e6))
    kept = simulator.snapshot()
    simulator.reset()
    simulator.restore(kept)
    assert simulator.termination_reason == kept.reason != ""


def digest(name: str) -> str:
    """Return a hash of all numbers of one run."""
    trajectory = Simulator(SCENES[name]).rollout(_torques(name))
    total = hashlib.sha256()
    for values in _part(trajectory, 0).values():
        total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()


def test_every_process_gives_the_same_bits() -> None:
    names = list(SCENES)
    here = {name: digest(name) for name in names}
    code = (
        "import json, sys; sys.path[:0] = sys.argv[1:3]; import test_snapshot as t; "
        "print(json.dumps({name: t.digest(name) for name in sys.argv[3:]}))"
    )
    folders = [str(ROOT), str(Path(__file__).parent)]
    for order in (names, names[::-1]):
        command = [sys.executable, "-c", code, *folders, *order]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=280, env=dict(os.environ), check=False
        )
        assert done.returncode == 0, done.stderr
        there = json.loads(done.stdout)
        different = [name for name in names if there[name] != here[name]]
        assert not different, f"other bits in another process: {different}"
