"""What keeps the steps of bodies: tables that grow, and snapshots that nothing writes into."""

from __future__ import annotations

import numpy as np
from swim_env.physics.solve.integrator import RECORD_NAMES

from swim_env import load_scene
from swim_env.sim.batch import Bodies
from swim_env.sim.recorder import Recorder
from swim_env.sim.trajectory import Trajectory

SCENE = load_scene("swimmer", {"beam.elements": 3, "fluid.model": "frozen", "recording": {}})


def started(members: int) -> Bodies:
    """Return bodies that lie straight and at rest."""
    bodies = Bodies(SCENE, members)
    for member in range(members):
        bodies.start(member, np.zeros(5), np.zeros(5))
    return bodies


def recorder_of(bodies: Bodies) -> Recorder:
    assert bodies.recorder is not None
    return bodies.recorder


def advance(bodies: Bodies, torques: np.ndarray, hold: int) -> np.ndarray:
    """Play rows of torques (M, R, N - 1), and return the record."""
    record = np.empty((len(bodies.states), torques.shape[1] * hold, 12))
    bodies.advance(torques, hold, record)
    return record


def assert_equal(left: Trajectory, right: Trajectory) -> None:
    for name in ("time", "centres", "angles", "torques", "momentum", "energy", "work", "impulse"):
        assert getattr(left, name).tobytes() == getattr(right, name).tobytes(), name


def test_a_long_recording_is_the_steps_in_their_order() -> None:
    """Of several thousand steps, taken in pieces of any size: tables have grown more than once."""
    random = np.random.default_rng(0)
    torques = random.uniform(-0.3, 0.3, (1, 2500, 2))
    whole, pieces = started(1), started(1)
    record = advance(whole, torques, 1)
    begin = 0
    while begin < 2500:
        count = int(random.integers(1, 90))
        advance(pieces, torques[:, begin : begin + count], 1)
        begin += count
    found = recorder_of(pieces).trajectory(0, "")
    assert found.steps == 2500
    assert (found.torques == torques[0]).all()
    assert (found.energy[1:] == record[0, :, RECORD_NAMES.index("energy")]).all()
    assert_equal(found, recorder_of(whole).trajectory(0, ""))


def test_rows_of_torques_stand_at_every_step_that_holds_them() -> None:
    """Also where a member ends within a row."""
    bodies = started(2)
    torques = np.zeros((2, 3, 2))
    torques[0] = [[0.1, 0.0], [0.0, 0.2], [0.3, 0.3]]
    torques[1] = [[0.1, 0.1], [1e7, -1e7], [0.0, 0.0]]
    advance(bodies, torques, 4)
    calm, violent = (recorder_of(bodies).trajectory(member, "") for member in (0, 1))
    assert (calm.torques == np.repeat(torques[0], 4, axis=0)).all()
    taken = int(bodies.outcome[1, 0])
    assert bodies.outcome[1, 1] != 0
    assert 4 <= taken < 12
    assert violent.steps == taken
    assert (violent.torques == np.repeat(torques[1], 4, axis=0)[:taken]).all()


def test_nothing_writes_into_a_snapshot() -> None:
    """Neither the recording it was taken of, nor the ones that go on from it."""
    bodies = started(2)
    recorder = recorder_of(bodies)
    random = np.random.default_rng(1)
    first = random.uniform(-0.3, 0.3, (2, 10, 2))
    advance(bodies, first, 1)
    states, velocities = bodies.states.copy(), bodies.velocities.copy()
    snapshot = recorder.snapshot()
    before = [recorder.trajectory(member, "") for member in (0, 1)]
    ends = []
    for seed in (2, 2, 3):
        recorder.restore(snapshot)
        bodies.states[:], bodies.velocities[:] = states, velocities
        for member in (0, 1):
            assert_equal(recorder.trajectory(member, ""), before[member])
        advance(bodies, np.random.default_rng(seed).uniform(-0.3, 0.3, (2, 5, 2)), 1)
        ends.append(recorder.trajectory(1, ""))
    assert ends[0].steps == 15
    assert_equal(ends[0], ends[1])
    assert (ends[0].torques[:10] == ends[2].torques[:10]).all()
    assert (ends[0].torques[10:] != ends[2].torques[10:]).all()
    bodies.start(0, np.zeros(5), np.zeros(5))
    assert recorder.trajectory(0, "").steps == 0
    assert recorder.trajectory(1, "").steps == 15
