"""The effects' public surface: what scenes may say, recordings, environments, old files."""

from __future__ import annotations

import copy
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from swim_env import (
    EFFECTS,
    TERMINATION_REASONS,
    OptionError,
    Scene,
    SceneError,
    SimulationEndedError,
    Simulator,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    SwimVectorEnv,
    Trajectory,
    TrajectoryError,
    load_scene,
)
from swim_env.scene import (
    AxialAddedMass,
    CrossFlowDrag,
    Damping,
    InternalForces,
    Recording,
    SelfContact,
    Stream,
)

Array = NDArray[np.float64]

ALL: dict[str, object] = {
    "axial_added_mass": AxialAddedMass(),
    "damping": Damping(0.002),
    "cross_flow_drag": CrossFlowDrag(1.5),
    "stream": Stream((0.25, -0.5)),
    "self_contact": SelfContact(),
    "internal_forces": InternalForces(),
    "recording": Recording(),
}
BARE = ("axial_added_mass", "self_contact", "internal_forces", "recording")
RECORDED = load_scene("swimmer", {"recording": {}})


def _torques(steps: int, seed: int, joints: int = 8) -> Array:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, joints))


def _assert_same(one: Trajectory, other: Trajectory) -> None:
    for field in fields(Trajectory):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert np.array_equal(a, b, equal_nan=True), field.name
        else:
            assert a == b, field.name


# ---- scenes ------------------------------------------------------------------------------------


def test_effects_are_listed_in_one_order() -> None:
    assert EFFECTS[0] == "bending_stiffness" and EFFECTS[1:] == tuple(ALL)
    scene = load_scene("paper_i")
    assert scene.effects == ("bending_stiffness",)
    # Whatever the order in which they are put in.
    for name in reversed(ALL):
        scene = scene.replace(name, ALL[name])
    assert scene.effects == EFFECTS
    for name in ALL:
        assert name not in scene.replace(name, None).effects
        assert len(scene.replace(name, None).effects) == len(EFFECTS) - 1


def test_no_bending_stiffness_is_an_effect_less() -> None:
    scene = load_scene("paper_i")
    without = scene.replace("beam.bending_stiffness", None)
    assert without.effects == ()
    assert without == scene.replace("beam.bending_stiffness", 0.0)
    assert Scene.from_dict({"beam": {"bending_stiffness": None}}).effects == ()
    assert scene.replace("beam.bending_stiffness", [0.0] * 7 + [1.0]).effects == EFFECTS[:1]


def test_effects_survive_the_file(tmp_path: Path) -> None:
    scene = load_scene("paper_i", ALL)
    file = tmp_path / "all.yaml"
    scene.save(file)
    assert Scene.from_yaml(file) == scene
    assert load_scene(file).effects == EFFECTS
    assert Scene.from_dict(scene.to_dict()) == scene
    # Absent effects leave no trace in a file, and plain values do for the blocks.
    assert not set(ALL) & set(load_scene("paper_i").to_dict())
    text = "name: short\nfluid: {density: 10}\ncross_flow_drag: {}\nstream: {velocity: [1, 0]}\n"
    file.write_text(text + "self_contact: {}\nrecording: true\ninternal_forces: {}\n")
    short = Scene.from_yaml(file)
    assert short.cross_flow_drag == CrossFlowDrag(1.0) and short.stream == Stream((1.0, 0.0))
    assert short.effects == (EFFECTS[0], *EFFECTS[3:])


@pytest.mark.parametrize("name", ["cross_flow_drag", "stream", "damping"])
def test_blocks_with_fields_are_absent_where_null(name: str) -> None:
    data = {**load_scene("paper_i").to_dict(), name: None}
    assert name not in Scene.from_dict(data).effects


# What is changed in paper_i, and what the message has to say: the field, and what would be right.
REFUSED: list[tuple[dict[str, object], tuple[str, ...]]] = [
    *(
        ({name: block, "fluid": fluid}, (f"{name} has no meaning without a fluid", "leave it out"))
        for name, block in (("cross_flow_drag", {}), ("stream", {"velocity": [0.1, 0.0]}))
        for fluid in (None, {"model": "none", "density": None})
    ),
    *(
        ({"cross_flow_drag": {"coefficient": value}}, ("cross_flow_drag.coefficient must be", says))
        for value, says in (
            (0, "above 0, got 0"),
            (-1.0, "above 0, got -1.0"),
            (float("nan"), "finite number"),
            (float("inf"), "finite number"),
            (None, "a number, got null"),
            (True, "a number, got true"),
            ("1", "a number, got text '1'"),
        )
    ),
    ({"cross_flow_drag": True}, ("cross_flow_drag must be a mapping of fields, got true",)),
    ({"cross_flow_drag": 1.0}, ("cross_flow_drag must be a mapping of fields, got 1.0",)),
    ({"cross_flow_drag": {"c": 1}}, ("unknown field cross_flow_drag.c", "coefficient")),
    ({"stream": {}}, ("stream.velocity is missing",)),
    ({"stream": True}, ("stream must be a mapping of fields, got true",)),
    ({"stream": [1.0, 0.0]}, ("stream must be a mapping of fields, got a list of 2",)),
    ({"stream": {"velocity": 1.0}}, ("stream.velocity must be two numbers [x, y] in m/s",)),
    ({"stream": {"velocity": [1.0] * 3}}, ("stream.velocity must be two numbers", "list of 3")),
    ({"stream": {"velocity": [1.0, None]}}, ("stream.velocity[1] must be a number in m/s",)),
    ({"stream": {"speed": 1.0}}, ("unknown field stream.speed", "velocity")),
    (
        {"fluid": None, "beam.half_thickness": 0.0, "self_contact": {}},
        ("self_contact needs beam.half_thickness, a number above 0 in m, got 0.0",),
    ),
    *(({name: {"a": 1}}, (f"unknown field {name}.a; it has no fields",)) for name in BARE),
    *(({name: 1}, (f"{name} must be a mapping of fields, got 1",)) for name in BARE),
    *(({name: False}, (f"{name} must be {{}} or true, or left out", "false")) for name in BARE),
    *(
        (
            {"damping": {"retardation_time": 0.001}, "beam.bending_stiffness": nothing},
            ("damping has no meaning where beam.bending_stiffness is zero", "leave damping out"),
        )
        for nothing in (None, 0, [0.0] * 8)
    ),
    (
        {"axial_added_mass": {}, "fluid.model": "strip"},
        ("axial_added_mass has no meaning without fluid.model panels", "got strip"),
    ),
]


@pytest.mark.parametrize(("changes", "says"), REFUSED, ids=lambda given: str(given)[:70])
def test_scenes_that_make_no_sense_are_refused(
    changes: dict[str, object], says: tuple[str, ...]
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene("paper_i", changes)
    message = str(caught.value)
    assert "\n" not in message
    for part in says:
        assert part in message, message


@pytest.mark.parametrize("name", BARE)
def test_blocks_without_fields_are_there_or_left_out(name: str) -> None:
    # A bare `recording:` might be meant as its presence.
    plain = load_scene("paper_i")
    for present in (True, {}, ALL[name]):
        assert name in plain.replace(name, present).effects
    for unclear, called in ((None, "null"), (False, "false")):
        with pytest.raises(SceneError, match=rf"{name} must be .* true, .* got {called}"):
            Scene.from_dict({**plain.to_dict(), name: unclear})


def test_refusals_name_the_file(tmp_path: Path) -> None:
    file = tmp_path / "dry.yaml"
    file.write_text("name: dry\ncross_flow_drag: {}\n")
    with pytest.raises(SceneError, match=r"^cross_flow_drag has no meaning .* \(.*dry.yaml\)$"):
        load_scene(file)
    with pytest.raises(SceneError, match="damping has no meaning"):
        load_scene("swimmer", ["beam.bending_stiffness=0"])


# ---- recordings --------------------------------------------------------------------------------

BASES: dict[str, dict[str, object]] = {
    "plain": {},
    "forces": {"internal_forces": {}, "cross_flow_drag": {}},
    "composed": {"integrator.scheme": "composed"},
    "no fluid": {"fluid": None},
}


@pytest.mark.parametrize("name", BASES)
def test_what_is_recorded_is_the_rollout(name: str) -> None:
    scene = RECORDED.replace(BASES[name]) if BASES[name] else RECORDED
    torques = _torques(250, 1)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques)
    assert whole.steps == 250
    _assert_same(simulator.recorded(), whole)
    # Asking for it changes nothing, nor does watching, nor doing it in pieces.
    simulator.reset()
    simulator.rollout(torques[:100], progress=lambda steps: simulator.recorded())
    simulator.rollout(torques[100:220])
    for row in torques[220:]:
        simulator.step(row)
    _assert_same(simulator.recorded(), whole)


def test_steps_are_recorded_one_by_one() -> None:
    scene = RECORDED.replace("internal_forces", {})
    torques = _torques(40, 2)
    whole = Simulator(scene.replace("recording", None)).rollout(torques)
    simulator = Simulator(scene)
    for count, row in enumerate(torques, start=1):
        simulator.step(row)
        assert simulator.recorded().steps == count
    found = simulator.recorded()
    assert found.scene == scene
    for field in fields(Trajectory):
        if field.name not in ("scene", "termination_reason"):
            a, b = getattr(found, field.name), getattr(whole, field.name)
            assert np.array_equal(a, b, equal_nan=True), field.name


def test_a_recording_begins_with_a_reset() -> None:
    simulator = Simulator(RECORDED)
    assert simulator.recorded().steps == 0
    simulator.rollout(_torques(10, 3))
    simulator.reset(RECORDED.replace("initial.position", (1.0, 2.0)).initial)
    empty = simulator.recorded()
    assert empty.steps == 0 and empty.time.tolist() == [0.0]
    assert np.array_equal(empty.centres[0], simulator.centres)
    assert empty.summary()["mean_speed"] == 0.0
    _assert_same(simulator.rollout(_torques(5, 4)), simulator.recorded())
    # A start that is refused leaves the recording as it was.
    with pytest.raises(SimulationEndedError):
        simulator.reset_to([0.0] * 3 + [2.9] * 8, np.zeros(11))
    assert simulator.recorded().steps == 5
    simulator.step(np.zeros(8))
    assert simulator.recorded().steps == 6


def test_an_empty_recording_has_shapes() -> None:
    scene = RECORDED.replace("internal_forces", {})
    empty = Simulator(scene).recorded()
    assert empty.internal_forces is not None and empty.internal_forces.shape == (0, 8, 2)
    assert empty.torques.shape == (0, 8) and empty.impulse.shape == (0, 3)
    assert empty.momentum.shape == (1, 3)


def test_after_a_restore_the_recording_begins_there() -> None:
    torques = _torques(30, 5)
    simulator = Simulator(RECORDED)
    simulator.rollout(torques[:10])
    kept = simulator.snapshot()
    first = simulator.rollout(torques[10:20])
    simulator.restore(kept)
    assert simulator.recorded().steps == 0
    assert simulator.recorded().time[0] == 10 * simulator.time_step == simulator.time
    simulator.rollout(torques[10:20])
    _assert_same(simulator.recorded(), first)


def test_a_recording_tells_why_a_run_ended() -> None:
    simulator = Simulator(RECORDED)
    whole = simulator.rollout(np.full((500, 8), 40.0))
    assert 0 < whole.steps < 500 and whole.termination_reason
    _assert_same(simulator.recorded(), whole)
    with pytest.raises(SimulationEndedError):
        simulator.step(np.zeros(8))
    assert simulator.recorded().steps == whole.steps


def test_a_copy_records_for_itself() -> None:
    first = Simulator(RECORDED)
    first.rollout(_torques(5, 6))
    second = copy.deepcopy(first)
    second.rollout(_torques(7, 7))
    assert (first.recorded().steps, second.recorded().steps) == (5, 12)


def test_recordings_are_saved_like_any_trajectory(tmp_path: Path) -> None:
    simulator = Simulator(load_scene("paper_i", ALL))
    simulator.rollout(0.1 * _torques(20, 8))
    found = simulator.recorded()
    assert found.steps == 20 and found.internal_forces is not None
    found.save(tmp_path / "run.npz")
    _assert_same(Trajectory.load(tmp_path / "run.npz"), found)


@pytest.mark.parametrize("make", [Simulator, SwimEnv, lambda scene: SwimVectorEnv(2, scene)])
def test_without_the_effect_nothing_is_recorded(make) -> None:
    one = make(load_scene("swimmer"))
    with pytest.raises(OptionError, match=r"^nothing was recorded: .* the block recording \(.*\)$"):
        one.recorded(0) if isinstance(one, SwimVectorEnv) else one.recorded()


# ---- recordings of environments ----------------------------------------------------------------


def _again(scene: Scene, start: tuple[Array, Array], actions: Array, hold: int = 4) -> Trajectory:
    """Return what a simulator makes of an episode's start and actions."""
    simulator = Simulator(scene)
    simulator.reset_to(*start)
    return simulator.rollout(np.repeat(actions, hold, axis=0))


def _start(env: SwimEnv | SwimVectorEnv, member: int = 0) -> tuple[Array, Array]:
    bodies = env.episodes.bodies
    return bodies.coordinates[member].copy(), bodies.velocities[member].copy()


@pytest.mark.parametrize("name", BASES)
def test_an_environment_records_every_step_of_an_episode(name: str) -> None:
    env = SwimEnv(RECORDED.replace(BASES[name]) if BASES[name] else RECORDED)
    for seed in (1, 2):
        env.reset(seed=seed)
        assert env.recorded().steps == 0
        start = _start(env)
        actions = _torques(6, seed)
        for action in actions:
            env.step(action)
        _assert_same(env.recorded(), _again(env.scene, start, actions))


def test_an_environments_recording_begins_at_a_restored_snapshot() -> None:
    env = SwimEnv(RECORDED)
    env.reset(seed=3)
    actions = _torques(5, 9)
    for action in actions[:2]:
        env.step(action)
    kept = env.snapshot()
    env.step(actions[2])
    whole = env.recorded()
    env.restore(kept)
    assert env.recorded().steps == 0 and env.recorded().time[0] == whole.time[8]
    env.step(actions[2])
    again = env.recorded()
    assert np.array_equal(again.centres, whole.centres[8:])
    assert np.array_equal(again.energy, whole.energy[8:])


@pytest.mark.parametrize("threads", [1, 2])
def test_every_member_has_its_own_recording(threads: int) -> None:
    env = SwimVectorEnv(3, RECORDED, num_threads=threads)
    env.reset(seed=4)
    starts = [_start(env, member) for member in range(3)]
    actions = _torques(15, 10).reshape(5, 3, 8)
    for row in actions:
        env.step(row)
    for member, start in enumerate(starts):
        _assert_same(env.recorded(member), _again(env.scene, start, actions[:, member]))


def test_members_that_are_reset_begin_anew_alone() -> None:
    env = SwimVectorEnv(3, RECORDED, autoreset_mode="Disabled", num_threads=1)
    env.reset(seed=5)
    actions = _torques(12, 11).reshape(4, 3, 8)
    env.step(actions[0])
    env.reset(options={"reset_mask": np.array([False, True, False])})
    assert [env.recorded(member).steps for member in range(3)] == [4, 0, 4]
    start = _start(env, 1)
    env.step(actions[1])
    _assert_same(env.recorded(1), _again(env.scene, start, actions[1:2, 1]))
    assert env.recorded(0).steps == 8


def test_next_step_autoreset_keeps_the_last_episode_until_the_next_step() -> None:
    env = SwimVectorEnv(2, RECORDED, max_episode_steps=3, num_threads=1)
    env.reset(seed=6)
    actions = _torques(10, 12).reshape(5, 2, 8)
    starts = [_start(env, member) for member in range(2)]
    for row in actions[:3]:
        *_, truncated, _ = env.step(row)
    assert truncated.all()
    for member, start in enumerate(starts):
        _assert_same(env.recorded(member), _again(env.scene, start, actions[:3, member]))
    env.step(actions[3])
    assert [env.recorded(member).steps for member in range(2)] == [0, 0]
    start = _start(env, 1)
    env.step(actions[4])
    _assert_same(env.recorded(1), _again(env.scene, start, actions[4:, 1]))


def test_same_step_autoreset_begins_the_next_recording_at_once() -> None:
    env = SwimVectorEnv(2, RECORDED, max_episode_steps=2, autoreset_mode="SameStep", num_threads=1)
    env.reset(seed=7)
    actions = _torques(6, 13).reshape(3, 2, 8)
    env.step(actions[0])
    env.step(actions[1])
    assert [env.recorded(member).steps for member in range(2)] == [0, 0]
    start = _start(env)
    env.step(actions[2])
    _assert_same(env.recorded(0), _again(env.scene, start, actions[2:, 0]))


def test_a_batch_records_from_a_restored_snapshot_on() -> None:
    env = SwimVectorEnv(2, RECORDED, num_threads=1)
    env.reset(seed=8)
    actions = _torques(4, 14).reshape(2, 2, 8)
    env.step(actions[0])
    kept = env.snapshot()
    env.step(actions[1])
    wanted = [env.recorded(member).centres[4:] for member in range(2)]
    env.restore(kept)
    assert [env.recorded(member).steps for member in range(2)] == [0, 0]
    env.step(actions[1])
    for member in range(2):
        assert np.array_equal(env.recorded(member).centres, wanted[member])


def test_the_target_environment_records_as_well() -> None:
    env = SwimTargetEnv(RECORDED)
    env.reset(seed=9)
    env.step(np.zeros(8))
    assert env.recorded().steps == 4


@pytest.mark.parametrize("member", [-1, 2, 100])
def test_members_that_are_not_there_are_refused(member: int) -> None:
    env = SwimVectorEnv(2, RECORDED)
    env.reset(seed=1)
    with pytest.raises(OptionError, match=f"member must be 0 to 1, got {member}"):
        env.recorded(member)


def test_before_the_first_reset_no_member_has_a_recording() -> None:
    env = SwimVectorEnv(2, RECORDED)
    with pytest.raises((SwimError, ResetNeeded)):
        env.recorded(1)


def test_a_reset_that_fails_leaves_the_recordings() -> None:
    # So fast across itself that its energy overflows, unless noise has turned a member along.
    env = SwimVectorEnv(2, RECORDED, num_threads=1)
    for seed in range(20):
        env.reset(seed=1)
        env.step(np.zeros((2, 8)))
        starts = [env.recorded(member).centres[0].copy() for member in range(2)]
        try:
            with np.errstate(all="ignore"):
                env.reset(seed=seed, options={"velocity": (0.0, 1.1e154), "noise": 30.0})
        except SimulationEndedError:
            env.step(np.zeros((2, 8)))
            for member in range(2):
                recorded = env.recorded(member)
                assert np.array_equal(recorded.centres[0], starts[member]), f"seed {seed}"
                assert recorded.steps == 8


# ---- environments ------------------------------------------------------------------------------

CURL = load_scene(
    "swimmer",
    {
        "beam.bending_stiffness": 0.5,
        "damping.retardation_time": 0.02,
        "actuation.torque_limit": 8.0,
        "self_contact": {},
        "recording": {},
    },
)


def test_self_contact_is_a_reason_with_a_meaning() -> None:
    assert "touches itself" in TERMINATION_REASONS["self_contact"]


def test_an_episode_ends_where_the_body_touches_itself() -> None:
    env = SwimEnv(CURL)
    env.reset(seed=1, options={"noise": 0.0})
    terminated, actions = False, 0
    while not terminated and actions < 50:
        _, _, terminated, truncated, info = env.step(np.ones(8))
        actions += 1
        assert info["termination_reason"] == ("self_contact" if terminated else "")
    assert terminated and not truncated
    # It may end in the middle of an action: only the steps that were taken count.
    recorded = env.recorded()
    assert recorded.termination_reason == "self_contact"
    assert 4 * (actions - 1) <= recorded.steps < 4 * actions
    assert recorded.time[-1] == pytest.approx(info["time"], abs=1e-15)
    assert np.allclose(recorded.path[-1], info["position"], atol=1e-15)
    with pytest.raises(SimulationEndedError, match="self_contact"):
        env.step(np.ones(8))
    env.reset(seed=1)
    assert env.recorded().termination_reason == ""


def test_a_member_ends_where_it_touches_itself() -> None:
    env = SwimVectorEnv(2, CURL, autoreset_mode="Disabled", num_threads=2)
    env.reset(seed=1, options={"noise": 0.0})
    actions = np.stack([np.ones(8), np.zeros(8)])
    terminated = np.zeros(2, dtype=bool)
    for _ in range(50):
        _, _, terminated, _, info = env.step(actions)
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert info["termination_reason"].tolist() == ["self_contact", ""]
    assert env.recorded(0).termination_reason == "self_contact"
    assert env.recorded(1).termination_reason == ""
    assert env.recorded(1).steps % 4 == 0 and env.recorded(0).steps < env.recorded(1).steps


STREAM = np.array([0.25, -0.5])
DRIFTING = load_scene(
    "swimmer",
    {
        "cross_flow_drag": {},
        "stream.velocity": tuple(STREAM),
        "initial.velocity": tuple(STREAM),
    },
)


def test_what_is_observed_is_the_velocity_over_ground() -> None:
    resting = SwimEnv(DRIFTING.replace({"stream": None, "initial": {}}))
    drifting = SwimEnv(DRIFTING)
    seen, info = resting.reset(seed=1, options={"noise": 0.0})
    carried, _ = drifting.reset(seed=1, options={"noise": 0.0})
    # The head looks along -x: what drifts along +x, -y goes backwards, and to its left.
    wanted = np.zeros(21)
    wanted[18:20] = -2.5, 5.0
    assert np.allclose(carried - seen, wanted, atol=1e-6)
    for action in _torques(5, 15):
        seen, *_, info = resting.step(action)
        carried, *_, there = drifting.step(action)
        assert np.array_equal(drifting.coordinates[2:], resting.coordinates[2:])
        shift = there["position"] - info["position"] - there["time"] * STREAM
        assert np.abs(shift).max() < 1e-14
        gap = drifting.velocity - resting.velocity
        assert np.allclose(gap, np.concatenate([STREAM, np.zeros(9)]), atol=1e-14)
        ahead = -np.array([np.cos(a := resting.coordinates[2:].cumsum().mean()), np.sin(a)])
        wanted[18:20] = STREAM @ ahead, STREAM @ [-ahead[1], ahead[0]]
        wanted[18:20] /= 0.1
        assert np.allclose(carried - seen, wanted, atol=1e-5)
        # Progress is made over ground as well, towards -x.
        gain = there["progress"] - info["progress"]
        assert gain == pytest.approx(-STREAM[0] * there["time"], abs=1e-12)


def test_noise_of_a_start_in_a_stream_is_that_at_rest() -> None:
    resting = SwimEnv(DRIFTING.replace({"stream": None, "initial": {}}))
    drifting = SwimEnv(DRIFTING)
    resting.reset(seed=1)
    drifting.reset(seed=1)
    gap = drifting.velocity[:2] - resting.velocity[:2] - STREAM
    assert np.abs(gap).max() < 1e-12, f"relative to the stream it starts {gap} m/s faster"


# ---- internal forces ---------------------------------------------------------------------------


def test_internal_forces_are_there_where_asked_for(tmp_path: Path) -> None:
    plain = load_scene("swimmer")
    without = Simulator(plain).rollout(_torques(10, 16))
    assert without.internal_forces is None
    without.save(tmp_path / "without.npz")
    assert Trajectory.load(tmp_path / "without.npz").internal_forces is None
    found = Simulator(plain.replace("internal_forces", {})).rollout(_torques(10, 16))
    assert found.internal_forces is not None
    assert found.internal_forces.shape == (10, 8, 2)
    found.save(tmp_path / "found.npz")
    _assert_same(Trajectory.load(tmp_path / "found.npz"), found)
    assert found.summary() == without.summary()
    with np.load(tmp_path / "found.npz") as file:
        content = dict(file)
    content["internal_forces"] = content["internal_forces"][:, :7]
    np.savez(tmp_path / "wrong.npz", **content)
    with pytest.raises(TrajectoryError, match=r"internal_forces must have shape \(10, 8, 2\)"):
        Trajectory.load(tmp_path / "wrong.npz")


def test_an_empty_rollout_has_internal_forces_of_no_step() -> None:
    forces = Simulator(load_scene("swimmer", {"internal_forces": {}})).rollout(np.zeros((0, 8)))
    assert forces.internal_forces is not None and forces.internal_forces.shape == (0, 8, 2)


# ---- files of older versions -------------------------------------------------------------------


@pytest.fixture
def content(tmp_path: Path) -> dict[str, Array]:
    """What the file of a run holds now."""
    run = Simulator("swimmer").rollout(_torques(6, 17))
    run.save(tmp_path / "now.npz")
    with np.load(tmp_path / "now.npz") as file:
        return dict(file)


def test_files_of_version_2_are_read(tmp_path: Path, content: dict[str, Array]) -> None:
    # They know nothing of impulses from outside, of which there were none.
    content.pop("impulse")
    content["format_version"] = np.array(2)
    np.savez(tmp_path / "old.npz", **content)
    old, now = (Trajectory.load(tmp_path / f"{name}.npz") for name in ("old", "now"))
    assert old.impulse.shape == (6, 3) and not old.impulse.any()
    assert old.internal_forces is None
    _assert_same(old, now)
    assert old.summary() == now.summary()
    old.save(tmp_path / "again.npz")
    _assert_same(Trajectory.load(tmp_path / "again.npz"), now)


@pytest.mark.parametrize("version", [0, 1, 4, 99, -2, "2", 2.5])
def test_other_versions_are_refused(
    tmp_path: Path, content: dict[str, Array], version: object
) -> None:
    np.savez(tmp_path / "odd.npz", **{**content, "format_version": np.array(version)})
    with pytest.raises(TrajectoryError, match=f"has format version {version}, .* reads 2 and 3"):
        Trajectory.load(tmp_path / "odd.npz")


def test_files_that_lack_something_say_what(tmp_path: Path, content: dict[str, Array]) -> None:
    # A file of version 3 has to have its impulses, one of version 2 all the rest.
    impulse = content.pop("impulse")
    np.savez(tmp_path / "short.npz", **content)
    with pytest.raises(TrajectoryError, match="it lacks impulse "):
        Trajectory.load(tmp_path / "short.npz")
    content["format_version"] = np.array(2)
    content.pop("torques")
    np.savez(tmp_path / "short.npz", **content)
    with pytest.raises(TrajectoryError, match="it lacks .*torques"):
        Trajectory.load(tmp_path / "short.npz")
    np.savez(tmp_path / "short.npz", impulse=impulse)
    with pytest.raises(TrajectoryError, match="it lacks format_version"):
        Trajectory.load(tmp_path / "short.npz")
