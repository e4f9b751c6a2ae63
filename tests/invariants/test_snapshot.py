"""The same bits: restored, step by step, in chunks, in any process and in environments."""

import hashlib
from dataclasses import fields, replace

import numpy as np
import pytest

from swim_env import Simulator, SwimEnv, SwimError, SwimVectorEnv, Trajectory, load_scene
from tests.invariants.runs import MODELS, VIOLENT, fluid_changes, with_scheme
from tests.support import Array, assert_same, held_torques, rollout, run_python, uniform

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
    **{
        model: load_scene("paper_i", {**fluid_changes(model), "initial.velocity": (0.1, 0.05)})
        for model in MODELS
    },
}
STEPS = 90
#: Changes to the swimmer.
TAKEN_OVER: dict[str, dict[str, object]] = {
    "swimmer": {},
    "composed": with_scheme("composed", "mean_angles"),
    "composed, cut steps": {
        **with_scheme("composed"),
        "integrator.time_step": 0.02,
        "actuation.torque_limit": 8.0,
    },
    "expansion": fluid_changes("expansion"),
}


def _torques(name: str) -> Array:
    torques = held_torques(SCENES[name], STEPS, 11, 0.2 if name in MODELS else 1.0, hold=3)
    if name.endswith("cut steps"):
        torques[[20, 31, 43]] = VIOLENT
    return torques


def _arrays(run: Trajectory) -> dict[str, Array]:
    values = {field.name: getattr(run, field.name) for field in fields(Trajectory)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


def _assert_is_part(found: Trajectory, whole: Trajectory, first: int) -> None:
    """Compare a run with what a longer one has from a step on."""
    for name, values in _arrays(found).items():
        assert_same(values, getattr(whole, name)[first : first + len(values)], name)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("cut", [1, 21, 45])
def test_a_restored_run_continues_bit_for_bit(name: str, cut: int) -> None:
    torques = _torques(name)
    whole = rollout(SCENES[name], torques)
    if name.endswith("cut steps"):
        assert whole.parts[20] > 1, "the step before the snapshot must be a cut one"
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
        assert rest.steps == STEPS - cut
        _assert_is_part(rest, whole, cut)


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
    whole = rollout(SCENES[name], torques)
    simulator = Simulator(SCENES[name])
    for first, last in ((0, 1), (1, 8), (8, 38), (38, STEPS)):
        _assert_is_part(simulator.rollout(torques[first:last]), whole, first)
    assert simulator.steps == STEPS


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
    total = hashlib.sha256()
    for values in _arrays(rollout(SCENES[name], _torques(name))).values():
        total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()


def test_every_process_gives_the_same_bits() -> None:
    here = {name: digest(name) for name in SCENES}
    code = (
        "import json, sys; import tests.invariants.test_snapshot as t; "
        "print(json.dumps({name: t.digest(name) for name in sys.argv[1:]}))"
    )
    for names in (list(here), list(here)[::-1]):
        there = run_python("-c", code, *names).figures()
        different = [name for name in names if there[name] != here[name]]
        assert not different, f"other bits in another process: {different}"


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", [*MODELS, "composed, mean angles"])
def test_simulator_and_environments_take_the_same_steps_bit_for_bit(
    name: str, threads: int
) -> None:
    composed = with_scheme("composed", "mean_angles")
    scene = load_scene("swimmer", fluid_changes(name) if name in MODELS else composed)
    assert scene.steps_per_action > 1
    simulators, singles = [Simulator(scene) for _ in range(3)], [SwimEnv(scene) for _ in range(3)]
    batch = SwimVectorEnv(3, scene, num_threads=threads)
    still = {"noise": 0.0}
    seen = [single.reset(seed=1, options=still)[0] for single in singles]
    all_seen, _ = batch.reset(seed=1, options=still)
    for actions in uniform(8, 3, 8, seed=8, size=0.5):
        assert np.array_equal(seen, all_seen)
        all_seen, rewards, ends, cuts, _ = batch.step(actions)
        assert not (ends.any() or cuts.any())
        assert np.isfinite(all_seen).all() and np.isfinite(rewards).all()
        bodies = batch.episodes.bodies
        for i, (simulator, single) in enumerate(zip(simulators, singles, strict=True)):
            seen[i], reward, terminated, truncated, _ = single.step(actions[i])
            assert reward == rewards[i] and not (terminated or truncated)
            # An action is held, whatever the scheme. The torque limit is 1 N m.
            simulator.rollout(np.tile(actions[i], (scene.steps_per_action, 1)))
            assert_same(single.coordinates, simulator.coordinates)
            assert_same(bodies.coordinates[i].copy(), simulator.coordinates)
            assert_same(single.velocity, simulator.velocity())
            assert_same(bodies.velocities[i].copy(), simulator.velocity())
    assert np.abs(simulators[1].joint_angles).max() > 0.01
    assert not np.array_equal(bodies.coordinates[0], bodies.coordinates[1])


@pytest.mark.parametrize("name", TAKEN_OVER)
def test_a_member_that_takes_over_anothers_state_in_mid_run_continues_it_bit_for_bit(
    name: str,
) -> None:
    """Neither the member's number nor what its work space remembers of its own motion counts."""
    scene = load_scene("swimmer", {**TAKEN_OVER[name], "integrator.tolerance": 1e-4})
    batch, single = SwimVectorEnv(3, scene), SwimEnv(scene)
    batch.reset(seed=4)
    actions = uniform(24, 3, 8, seed=5)
    for each in actions[:12]:
        batch.step(each)
    kept = batch.snapshot()
    whose = [1, 1, 0]
    batch.restore(
        replace(
            kept,
            arrays={key: array[whose] for key, array in kept.arrays.items()},
            randoms=[kept.randoms[member] for member in whose],
        )
    )
    seen = single.restore(kept.member(1))
    for each in actions[12:]:
        all_seen, rewards, *_ = batch.step(each[whose])
        seen, reward, *_ = single.step(each[1])
        for member in (0, 1):
            assert_same(all_seen[member], seen)
            assert rewards[member] == reward
            assert_same(batch.episodes.bodies.states[member], single.episodes.bodies.states[0])
    # The other one is still itself.
    last = batch.episodes.bodies.states[2].copy()
    batch.restore(kept)
    for each in actions[12:]:
        batch.step(each)
    assert_same(batch.episodes.bodies.states[0].copy(), last)
    assert not np.array_equal(batch.episodes.bodies.states[1], last)
