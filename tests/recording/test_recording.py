"""Recordings, read back with rerun's own reader and compared with the run's numbers."""

import io
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from PIL import Image

from swim_env import OptionError, Simulator, SwimError, load_scene
from swim_env.analysis.energy import elastic_energy, split_energy
from swim_env.analysis.flow import BodyFlow
from swim_env.physics.invariants import momentum_drift
from swim_env.recording import (
    SCHEMA_VERSION,
    RecordingError,
    Swimmer,
    open_viewer,
    read_recording,
    recording_file,
    take_picture,
    write_recording,
)
from swim_env.recording.palette import shades_of_torque
from swim_env.recording.reader import ReadRecording
from swim_env.recording.schema import DETAILS, GROUPS, UNSPLIT_ENERGY, label_of
from swim_env.recording.swimmer import frames_of
from swim_env.recording.viewer import rerun_command
from swim_env.recording.water import picture_of, pressure_of
from swim_env.recording.writer import _fixed_parts
from tests.support import full_disk, refuses

#: Three tenths of a second of the prescribed wave, with flow, written by schema 1; without its
#: blueprint and legend, which are not read.
STORED = Path(__file__).with_name("recording_schema_1.rrd")
SCENE = load_scene("swimmer")
HOLD = SCENE.steps_per_action
REWARDS = 0.01 * np.arange(1, 51)


@pytest.fixture(scope="module")
def run():
    simulator = Simulator(SCENE)
    return simulator.rollout(simulator.prescribed_torques(50 * HOLD))


@pytest.fixture(scope="module")
def swimmer(run) -> Swimmer:
    return Swimmer("the wave", run, REWARDS, start_velocity=np.zeros(11))


@pytest.fixture(scope="module")
def recording(tmp_path_factory, swimmer) -> tuple[Path, ReadRecording]:
    path = tmp_path_factory.mktemp("recording") / "one.rrd"
    written = write_recording(path, [swimmer], flow_rate=10.0)
    assert written.size == path.stat().st_size
    assert (written.frames, written.flow_frames) == (51, 11)
    return path, read_recording(path)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a recording, without flow unless asked, and reads it."""

    def call(*swimmers: Swimmer, **options) -> ReadRecording:
        path = tmp_path / "x.rrd"
        write_recording(path, swimmers, **{"flow_rate": None, **options})
        return read_recording(path)

    return call


# ---- one swimmer -------------------------------------------------------------------------------


def test_rerun_verifies_it(recording, tmp_path):
    half = tmp_path / "half.rrd"
    half.write_bytes(recording[0].read_bytes()[: recording[0].stat().st_size // 2])
    for path, is_whole in ((recording[0], True), (half, False)):
        command = [rerun_command(), "rrd", "verify", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert (done.returncode == 0) is is_whole, done.stderr


def test_it_says_what_it_is(recording):
    _, read = recording
    assert read.schema == SCHEMA_VERSION == 1
    assert list(read.swimmers) == ["the_wave"]
    one = read.swimmers["the_wave"]
    assert (one.name, one.scene, one.termination_reason) == ("the wave", SCENE, "")
    assert {"commit", "machine", "versions", "date", "rerun-sdk"} <= read.about.keys()


def test_numbers_are_the_runs(recording, run):
    """Shapes in single precision, series in full, at simulated seconds."""
    one = recording[1].swimmers["the_wave"]
    frames = slice(None, None, HOLD)
    assert one.time == pytest.approx(run.time[frames], abs=1e-9)
    assert one.nodes == pytest.approx(run.nodes[frames], abs=1e-6)
    assert one.path == pytest.approx(run.path[frames], abs=1e-6)
    series = one.series
    assert (series["position"] == run.path[frames]).all()
    along = (run.path - run.path[0]) @ SCENE.episode.heading
    assert (series["progress"][:, 0] == along[frames]).all()
    # The energy has peaks between frames.
    assert one.energy_time == pytest.approx(run.time[::2], abs=1e-9)
    assert (series["energy"][:, 3] == run.energy[::2]).all()
    split = split_energy(run, np.zeros(11), np.arange(0, 201, 2))
    parts = np.column_stack([split.body, split.fluid, split.elastic])
    assert (series["energy"][:, :3] == parts).all()
    assert (series["momentum"] == run.momentum[frames]).all()
    assert np.abs(series["drift"]).max() <= momentum_drift(run.momentum, run.impulse)
    work = series["work"][-1]
    totals = [run.work.sum(), run.positive_work.sum(), run.dissipated.sum()]
    assert work[:3] == pytest.approx(totals, rel=1e-12)
    largest = np.maximum.reduceat(run.iterations, np.arange(0, 50 * HOLD, HOLD))
    assert (series["solver"][1:, 0] == largest).all()
    assert series["solver"][:, 1].max() == pytest.approx(np.log10(run.residual.max()))
    assert (series["torques"][:-1] == run.torques[frames]).all()
    assert (series["joint_angles"] == np.diff(run.angles, axis=1)[frames]).all()
    assert one.reward_time == pytest.approx(0.02 * np.arange(1, 51))
    assert (series["reward"][:, 0] == REWARDS).all()
    assert series["return"][-1, 0] == pytest.approx(REWARDS.sum())


def test_every_series_has_a_name_and_a_unit_and_held_values_are_steps(recording):
    """Torques are held from their instant on, rewards up to it; the rest are lines."""
    read = recording[1]
    one = read.swimmers["the_wave"]
    assert one.series.keys() == one.names.keys() == GROUPS.keys() | DETAILS.keys()
    modes = rr.components.InterpolationMode
    held = {"torques": modes.StepAfter, "reward": modes.StepBefore}
    for group, names in one.names.items():
        assert len(names) == one.series[group].shape[1]
        assert all(name.endswith(")") and " (" in name for name in names)
        column = read.columns[f"/scalars/the_wave/{group}", "SeriesLines:interpolation_mode"]
        assert np.ravel(column.values[0])[0] == held.get(group, modes.Linear).value


def test_flow_is_the_bodys(recording, run):
    """Pressures to the picture's 127th part, velocities in single precision, at resting points."""
    one = recording[1].swimmers["the_wave"]
    assert one.flow_time == pytest.approx(0.1 * np.arange(11), abs=1e-9)
    rows, columns = one.pressures.shape[1:]
    instant, frame = 30 * HOLD, 6
    y, x = np.mgrid[:rows, :columns]
    middles = one.grid[frame] + (np.stack([x, y], axis=-1).reshape(-1, 2) + 0.5) * one.cell
    flow, pressure = BodyFlow(SCENE).during(run, instant, middles)
    found = one.pressures[frame].ravel()
    scale = np.nanmax(np.abs(one.pressures))
    seen = ~flow.inside & (np.abs(pressure) < scale)
    assert np.abs(found - pressure)[seen].max() < 1.02 * scale / 127
    assert np.isclose(np.abs(one.grid[frame] / one.cell % 4 - 2), 2, atol=1e-3).all()
    shown = np.hypot(*one.velocities[frame].T)
    assert 0.0 < shown.max() <= np.hypot(*flow.velocity.T).max() + 1e-6


def test_pictures_of_pressure():
    """What is read is what was drawn, but for the scale's steps; deep inside there is nothing."""
    pressures = np.linspace(-3.0, 3.0, 120).reshape(10, 12).astype(np.float32)
    pressures[3:6, 3:6] = np.nan
    found = pressure_of(picture_of(pressures, 2.0), 2.0)
    outside = np.isfinite(pressures)
    clipped = np.clip(pressures, -2.0, 2.0)
    assert np.abs(found - clipped)[outside].max() <= 1.01 * 2.0 / 127
    assert np.isnan(found[4, 4]) and np.isnan(found).sum() == 1


def test_energy_without_the_starts_velocity(run, write):
    """Kinetic energy is given whole; a velocity that the run did not start with is refused."""
    one = write(Swimmer("x", run)).swimmers["x"]
    assert one.names["energy"] == list(UNSPLIT_ENERGY)
    kinetic, elastic, total = one.series["energy"].T
    assert (total == run.energy[::2]).all()
    assert kinetic == pytest.approx(total - elastic_energy(run)[::2], abs=1e-15)
    with pytest.raises(SwimError, match="not the one that the run started with"):
        write(Swimmer("x", run, start_velocity=np.ones(11)))


def test_a_scene_without_fluid_is_recorded_without_flow(write):
    scene = SCENE.replace("fluid", None)
    run = Simulator(scene).rollout(np.full((40, 8), 0.1))
    one = write(Swimmer("dry", run), flow_rate=25.0).swimmers["dry"]
    assert not one.flow_time.size
    assert one.series["energy"][:, 2] == pytest.approx(run.energy[::2])


def test_frames(run):
    """The first, every so many, and the last."""
    assert frames_of(run, 50.0).tolist() == list(range(0, 50 * HOLD + 1, HOLD))
    assert frames_of(run, 40.0)[-1] == 50 * HOLD
    assert len(frames_of(run, 1e4)) == 50 * HOLD + 1
    for rate in (0.0, -1.0, float("nan")):
        with pytest.raises(OptionError, match="frames in a second must be"):
            frames_of(run, rate)


def test_sizes_of_twenty_seconds(tmp_path):
    """Under 5 MB without flow, under 50 MB with it, at the default rates."""
    simulator = Simulator(SCENE)
    torques = np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 8)).repeat(HOLD, axis=0)
    run = simulator.rollout(torques)
    path = tmp_path / "long.rrd"
    assert write_recording(path, [Swimmer("x", run)], flow_rate=None).size < 2e6
    # The flow's size depends on its frames: a fifth of them.
    written = write_recording(path, [Swimmer("x", run)], flow_rate=5.0)
    assert written.flow_frames == 101
    assert 5 * written.size < 5e7


# ---- several swimmers, and their layout --------------------------------------------------------


def test_two_swimmers_on_one_time_line(run, write):
    """Equal names get numbers, and every swimmer keeps its own numbers."""
    shorter = Simulator(SCENE).rollout(np.zeros((20, 8)))
    swimmers = write(Swimmer("a/b", run), Swimmer("a b", shorter)).swimmers
    assert {label: one.time[-1] for label, one in swimmers.items()} == pytest.approx(
        {"a_b": 1.0, "a_b_2": 20 * SCENE.integrator.time_step}
    )
    assert swimmers["a_b"].names["progress"] == ["a_b, along the goal (BL)"]
    assert label_of("\u00e9/ ", ["swimmer"]) == "swimmer_2"


def test_lanes_share_their_scales(run, write):
    """One legend serves all: the largest torque limit, the longest beam's arrows."""
    other = SCENE.replace("actuation.torque_limit", 2.0 * SCENE.torque_limit)
    wider = Simulator(other).rollout(np.zeros((20, 8)))
    columns = write(Swimmer("a", run), Swimmer("b", wider), flow_rate=2.0).columns
    limits = columns["/__properties/swim_env", "torque_limits"].values[0]
    assert np.allclose(limits, 2.0 * SCENE.torque_limit)
    scales = [
        columns[f"/world/{name}/flow/velocity", "Transform3D:scale"].values[0] for name in "ab"
    ]
    assert np.allclose(scales[0], scales[1])


def test_files_of_equal_layout_share_it(run, tmp_path):
    """The layout is made once, and every file has it whole, with a recording of its own."""
    _fixed_parts.cache_clear()
    stores, blueprints = set(), set()
    for number in range(4):
        path = tmp_path / f"{number}.rrd"
        write_recording(path, [Swimmer("x", run)], flow_rate=None, title=f"number {number}")
        reader = rr.chunk.RrdReader(str(path))
        (store,), (blueprint,) = reader.recordings(), reader.blueprints()
        stores.add(store.recording_id)
        chunks = list(reader.stream(store=blueprint))
        blueprints.add(frozenset((chunk.entity_path, chunk.num_rows) for chunk in chunks))
    assert len(stores) == 4
    assert len(blueprints) == 1 and len(next(iter(blueprints))) > 40
    assert _fixed_parts.cache_info().misses == 1


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_every_swimmer_has_its_view(run, tmp_path, count):
    """Beside the whole course and the legend, and there is room for all of them."""
    path = tmp_path / "x.rrd"
    write_recording(path, [Swimmer(f"s{n}", run) for n in range(count)], flow_rate=None)
    reader = rr.chunk.RrdReader(str(path))
    (blueprint,) = reader.blueprints()
    found = {"ViewBlueprint:display_name": [], "ContainerBlueprint:grid_columns": []}
    for chunk in reader.stream(store=blueprint):
        batch = chunk.to_record_batch()
        for component in found.keys() & set(batch.schema.names):
            found[component] += [one[0] for one in batch.column(component).to_pylist() if one]
    names, columns = found.values()
    for n in range(count):
        assert sum([name.startswith(f"s{n} on ") for name in names]) == 1
    assert sum([name.startswith("Whole course") for name in names]) == 1
    assert names.count("Colours and arrows") == 1
    assert columns == ([2] if count > 2 else [])


# ---- other versions, other files, failures -----------------------------------------------------


def test_stored_recordings_stay_readable():
    """One of every schema so far."""
    read = read_recording(STORED)
    assert read.schema == 1
    one = read.swimmers["prescribed"]
    simulator = Simulator(one.scene)
    start = simulator.velocity()
    run = simulator.rollout(simulator.prescribed_torques(60))
    assert one.nodes == pytest.approx(run.nodes[::4], abs=1e-5)
    assert one.series["energy"][:, 3] == pytest.approx(run.energy[::4], rel=1e-6, abs=1e-12)
    split = split_energy(run, start, np.arange(0, 61, 4))
    assert one.series["energy"][:, 0] == pytest.approx(split.body, rel=1e-6, abs=1e-12)
    assert one.pressures.shape == (4, 48, 96) and one.flow_time[1] == pytest.approx(0.1)


def test_other_files_are_refused(tmp_path, recording, monkeypatch):
    """No file, no recording, that of another program, half of one, a later schema."""
    other = tmp_path / "other.rrd"
    with pytest.raises(RecordingError, match="No such file"):
        read_recording(other)
    other.write_bytes(b"not a recording")
    with pytest.raises(RecordingError, match="not a recording, or a damaged one"):
        read_recording(other)
    stream = rr.RecordingStream("else")
    stream.save(other)
    stream.log("x", rr.Scalars(1.0), static=True)
    stream.disconnect()
    with pytest.raises(RecordingError, match="says no schema"):
        read_recording(other)
    other.write_bytes(recording[0].read_bytes()[:20_000])
    with pytest.raises(RecordingError, match="the recording was cut off"):
        read_recording(other)
    monkeypatch.setattr("swim_env.recording.reader.SCHEMA_VERSION", 0)
    with pytest.raises(RecordingError, match="has schema 1, this version of swim_env reads up to"):
        read_recording(recording[0])


def test_a_file_is_written_whole_or_not_at_all(tmp_path, swimmer, monkeypatch):
    """A failure leaves what was there before and nothing half-written."""
    before = tmp_path / "before.rrd"
    before.write_bytes(b"kept")
    for swimmers, options, part in (
        ([swimmer], {"colour": "x"}, "unknown colour"),
        ([], {}, "at least one swimmer"),
        ([swimmer], {"about": {"when": object()}}, "about must be a dict in JSON's terms"),
    ):
        with pytest.raises(OptionError, match=part):
            write_recording(before, swimmers, **options)
    with pytest.raises(SwimError, match="cannot write the recording: No such file"):
        write_recording(tmp_path / "none" / "x.rrd", [swimmer], flow_rate=None)

    monkeypatch.setattr("swim_env.recording.writer.write_atomically", full_disk)
    with pytest.raises(SwimError, match="cannot write the recording: No space left on device"):
        write_recording(before, [swimmer], flow_rate=None)
    assert before.read_bytes() == b"kept"
    assert [path.name for path in tmp_path.iterdir()] == ["before.rrd"]


@pytest.mark.parametrize(
    ("module", "name"), [("rerun", "rerun"), ("PIL", "Pillow"), ("pyarrow", "pyarrow")]
)
def test_without_what_recordings_need_they_say_how_to_get_it(module, name, run, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    for use in (
        lambda: recording_file("x", "y"),
        lambda: write_recording("x.rrd", [Swimmer("x", run)]),
        lambda: read_recording(STORED),
        lambda: open_viewer(STORED),
        lambda: take_picture(STORED, "x.png", 0.1),
    ):
        with refuses(SwimError, f"recordings need {name}: install the extra 'view'"):
            use()


def test_rewards_fit_the_run(run, write):
    """One for each action, the last of which may have been cut short."""
    for rewards in (REWARDS[:-1], np.zeros(51), np.zeros((50, 1)), [*REWARDS[:-1], np.nan]):
        with pytest.raises(OptionError, match="rewards"):
            write(Swimmer("x", run, rewards))
    simulator = Simulator(SCENE)
    cut = simulator.rollout(simulator.prescribed_torques(2 * HOLD + 1))
    one = write(Swimmer("x", cut, [0.1, 0.2, 0.3])).swimmers["x"]
    assert one.reward_time == pytest.approx([0.02, 0.04, cut.duration])


@pytest.mark.parametrize(
    ("extra", "part"),
    [
        ({"goal": (1.0, 0.0, 0.0)}, "the goal of x must be 2 finite numbers"),
        ({"goal": (1.0, math.nan)}, "the goal of x must be 2 finite numbers"),
        ({"target_radius": 0.1}, "the target_radius of x needs a goal"),
        ({"start_velocity": np.zeros(5)}, "the start_velocity of x must be 11 finite numbers"),
    ],
)
def test_what_is_given_beside_a_run_fits_it(extra, part, run, write):
    with pytest.raises(OptionError, match=part):
        write(Swimmer("x", run, **extra))


def test_places_of_recordings(tmp_path, monkeypatch):
    """Files and folders; what cannot be one is refused before anything is played."""
    assert recording_file(tmp_path / "a.rrd", "n") == tmp_path / "a.rrd"
    assert recording_file(tmp_path / "v1.2", "n") == tmp_path / "v1.2" / "n.rrd"
    (tmp_path / "old.txt").mkdir()
    assert recording_file(tmp_path / "old.txt", "n") == tmp_path / "old.txt" / "n.rrd"
    (tmp_path / "file").touch()
    for name, part in (
        ("x.RRD", "ends with .rrd"),
        ("a.txt", "ends with .rrd"),
        ("file/x.rrd", "cannot make the folder"),
    ):
        with pytest.raises(SwimError, match=part):
            recording_file(tmp_path / name, "n")

    def denied(**options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", denied)
    with pytest.raises(SwimError, match="cannot write into the folder .*: Permission denied"):
        recording_file(tmp_path / "a.rrd", "n")
    assert not list(tmp_path.rglob("*.rrd"))


def test_torques_are_shown_as_a_map_of_joints_and_time(tmp_path):
    """A column a frame, a row a joint, head above, in the colours of the body."""
    simulator = Simulator("swimmer")
    run = simulator.rollout(simulator.prescribed_torques(100))
    columns = {}
    for colour in ("torque", "moment"):
        file = tmp_path / f"{colour}.rrd"
        write_recording(file, [Swimmer("one", run)], flow_rate=None, colour=colour)
        columns[colour] = read_recording(file).columns
    place = ("/maps/one/torques/picture", "EncodedImage:blob")
    with Image.open(io.BytesIO(bytes(columns["torque"][place].values[0][0]))) as picture:
        pixels = np.asarray(picture)
    frames = read_recording(tmp_path / "torque.rrd").swimmers["one"].series["torques"][:-1]
    assert pixels.shape == (8, len(frames), 3)
    assert (pixels == shades_of_torque(frames.T / run.scene.torque_limit)).all()
    assert place not in columns["moment"]
