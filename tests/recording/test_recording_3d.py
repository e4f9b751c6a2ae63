"""Recordings in space, read back: the body's surface, trails, series, the flow in two planes."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from swim_env import OptionError, Simulator, Trajectory, load_scene
from swim_env.analysis.body_surface import BodySurface
from swim_env.analysis.pose import orientation_of
from swim_env.analysis.spatial_energy import spatial_elastic_energy
from swim_env.analysis.spatial_flow import SpatialBodyFlow
from swim_env.physics.spatial.panels.mass import evaluate_added_mass
from swim_env.recording import COLOURS, Swimmer, read_recording, write_recording
from swim_env.recording.palette import shades_of_torque
from swim_env.recording.reader import ReadRecording
from swim_env.recording.schema import SPATIAL_DETAILS, SPATIAL_GROUPS, UNSPLIT_ENERGY
from swim_env.recording.viewer import rerun_command
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.sim.spatial.constants import surface_of
from tests.support import refuses

FISH = load_scene("fish_3d")
#: A stiff body of three unlike axes, and the same in panels with their own influence of -2 pi.
SOLID = load_scene("ellipsoid_3d", {"fluid.rows": 4})
FLAT = SOLID.replace("fluid.self_term", "flat")
PLACE = "/world/fish"


def tumbling(scene=FISH, steps: int = 200, seed: int = 0) -> Trajectory:
    """Return a run under random torques of all axes."""
    rng = np.random.default_rng(seed)
    held = rng.uniform(-4.0, 4.0, (steps // 20, scene.beam.elements - 1, 3))
    return Simulator(scene).rollout(np.repeat(held, 20, axis=0))


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return tumbling()


@pytest.fixture(scope="module")
def recording(tmp_path_factory, run) -> tuple[Path, ReadRecording]:
    path = tmp_path_factory.mktemp("recording") / "one.rrd"
    written = write_recording(path, [Swimmer("fish", run)])
    assert written.size == path.stat().st_size
    assert (written.frames, written.flow_frames) == (51, 0)
    return path, read_recording(path)


def stacked(read: ReadRecording, mark: str, component: str, place: str = PLACE) -> np.ndarray:
    return np.stack(read.columns[f"{place}/{mark}", component].values)


# ---- the body ----------------------------------------------------------------------------------


def test_numbers_are_the_runs(recording, run):
    path, read = recording
    done = subprocess.run([rerun_command(), "rrd", "verify", str(path)], capture_output=True)
    assert done.returncode == 0, done.stderr
    one = read.swimmers["fish"]
    assert (one.scene, one.termination_reason) == (FISH, "")
    frames = slice(None, None, FISH.steps_per_action)
    assert one.time == pytest.approx(run.time[frames], abs=1e-9)
    assert one.nodes == pytest.approx(run.nodes[frames], abs=1e-6)
    assert one.path == pytest.approx(run.path[frames], abs=1e-6)
    series = one.series
    paid = {"reward", "return"}
    assert series.keys() == one.names.keys() == (SPATIAL_GROUPS.keys() | SPATIAL_DETAILS) - paid
    for group, names in one.names.items():
        assert len(names) == series[group].shape[1]
        assert all(name.endswith(")") and " (" in name for name in names)
    assert (series["position"] == run.path[frames]).all()
    assert (series["progress"][:, 0] == -(run.path - run.path[0])[frames, 0]).all()
    assert (series["momentum"] == run.momentum[frames, :3]).all()
    assert (series["angular_momentum"] == run.momentum[frames, 3:]).all()
    for i, axis in enumerate(AXIS_NAMES):
        assert (series[f"{axis}_torques"][:-1] == run.torques[frames, :, i]).all()
        assert (series[f"{axis}_rotations"] == run.joint_rotations[frames, :, i]).all()
    assert one.names["energy"] == list(UNSPLIT_ENERGY)
    assert (series["energy"][:, 2] == run.energy[::2]).all()
    elastic = spatial_elastic_energy(FISH, run.joint_rotations[::2])
    assert (series["energy"][:, 1] == elastic).all() and elastic.max() > 0.1
    assert (series["energy"][1:, 0] > 0.0).all()
    assert series["orientation"] == pytest.approx(np.degrees(orientation_of(run.directors[frames])))


def test_elastic_energy_of_a_bent_body_at_rest_is_all_there_is():
    for strain in ("averaged_directors", "joint_angle"):
        bend = np.random.default_rng(1).uniform(-0.4, 0.4, (FISH.beam.elements - 1, 3))
        changes = {
            "integrator.strain": strain,
            "initial.joint_rotations": bend.tolist(),
            "beam.natural_curvature": [0.3, -0.2, 0.5],
        }
        scene = FISH.replace(changes)
        simulator = Simulator(scene)
        energy = spatial_elastic_energy(scene, simulator.joint_rotations)
        assert simulator.energy() == pytest.approx(energy, rel=1e-12)


def test_the_mesh_is_closed_and_holds_the_bodys_volume(recording, run):
    """Every edge is in two faces that run along it in opposite directions; it bends all the time.

    The polygons have the sections' area; linear between 36 of them, and cut at the joints, the
    volume is half a percent off at most.
    """
    read = recording[1]
    vertices = stacked(read, "body", "Mesh3D:vertex_positions").astype(float)
    triangles = stacked(read, "body", "Mesh3D:triangle_indices")[0]
    assert vertices.shape == (51, 626, 3) and triangles.shape == (1248, 3)
    edges = np.concatenate([triangles, np.roll(triangles, -1, axis=1)]).reshape(2, -1).T
    directed = {(a, b) for a, b in edges.tolist()}
    assert len(directed) == len(edges) and directed == {(b, a) for a, b in directed}
    assert len(np.unique(triangles)) - len(edges) // 2 + len(triangles) == 2
    a, b, c = np.moveaxis(vertices[:, triangles], 2, 0)
    volumes = np.einsum("fti,fti->f", a, np.cross(b, c)) / 6.0
    body = FISH.inertia_per_length()[:, 0].sum() * FISH.beam.element_length / FISH.fluid.density
    assert np.abs(run.joint_rotations).max() > 0.1
    assert volumes == pytest.approx(body, rel=5e-3)
    normals = stacked(read, "body", "Mesh3D:vertex_normals")
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1.0, abs=1e-5)
    faces = np.cross(b - a, c - a)
    assert (np.einsum("fti,fti->ft", faces, normals[:, triangles].mean(axis=2)) > 0.0).all()


@pytest.mark.parametrize("name", ["fish_3d", "eel_3d"])
def test_the_surface_is_that_of_the_panels(name):
    """With as many rings its corners are those of the panels, whatever the shape."""
    scene = load_scene(name, {"fluid.model": "panels"})
    run = tumbling(scene.replace("fluid.model", "strip"), 100)
    flow = SpatialBodyFlow(scene)
    still = np.zeros_like(run.centres[0])
    assert flow.at(np.zeros((1, 3)), run.path[-1], run.directors[-1], still, still) is not None
    surface = BodySurface(scene, rings=2 * scene.beam.elements, around=12, round_ends=False)
    vertices = surface.vertices(run.centres, run.directors)
    assert vertices[-1] == pytest.approx(flow._work.vertices + run.path[-1], abs=1e-14)


def test_colours_show_which_side_is_shortened(recording, run):
    """Strips shorten where the torque's sign says, and colours are those of the scale."""
    surface = BodySurface(FISH, rings=18, around=16, round_ends=False)
    for axis in (0, 1):
        bend = np.zeros((1, 8, 3))
        bend[..., axis] = 1e-3
        lengths = []
        for size in (0.0, 1.0):
            scene = FISH.replace("initial.joint_rotations", (size * bend[0]).tolist())
            body = Simulator(scene)
            rings = surface.vertices(body.centres, body.directors)[1:-1].reshape(-1, 16, 3)
            lengths.append(np.linalg.norm(np.diff(rings[1:-1:2], axis=0), axis=-1))
        change = (lengths[1] - lengths[0])[:-1]
        shown = surface.on_surface(bend)[0, 1:-1].reshape(-1, 16)[2:-3:2]
        clear = np.abs(shown) > 1e-4
        assert (np.sign(change) == -np.sign(shown))[clear].all() and clear.mean() > 0.8
    whole = BodySurface(FISH)
    packed = stacked(recording[1], "body", "Mesh3D:vertex_colors")
    found = np.stack([packed >> 24, packed >> 16 & 255, packed >> 8 & 255], axis=-1)
    shares = whole.on_surface(run.torques[:: FISH.steps_per_action]) / 8.0
    assert (found[:-1] == shades_of_torque(shares)).all()


def test_directors_and_trails(recording, run):
    """Directors start at the elements' centres and end outside; trails have a piece a frame."""
    read = recording[1]
    frames = run.directors[:: FISH.steps_per_action]
    arrows = stacked(read, "directors", "Arrows3D:vectors").reshape(51, 9, 3, 3)
    begins = stacked(read, "directors", "Arrows3D:origins").reshape(51, 9, 3, 3)
    lengths = np.linalg.norm(arrows, axis=-1)
    assert arrows / lengths[..., None] == pytest.approx(np.swapaxes(frames, -1, -2), abs=1e-5)
    assert begins[:, :, 1] == pytest.approx(run.centres[:: FISH.steps_per_action], abs=1e-6)
    s = (np.arange(9) + 0.5) / 9.0
    assert (lengths[0, :, 0] > FISH.beam.half_width_at(s)).all()
    assert (lengths[0, :, 1] > FISH.beam.half_height_at(s)).all()
    for mark, points in (("path", run.path), ("head_path", run.nodes[:, 0])):
        pieces = stacked(read, mark, "LineStrips3D:strips")[:, 0]
        shown = points[:: FISH.steps_per_action]
        assert pieces == pytest.approx(np.stack([shown[:-1], shown[1:]], axis=1), abs=1e-6)


# ---- the flow ----------------------------------------------------------------------------------


def rigid(flow: SpatialBodyFlow, points, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)):
    """Return the flow around the straight body in the reference pose, which moves as a whole."""
    body = Simulator(flow.scene)
    middle = body.centres.mean(axis=0)
    moving = np.asarray(velocity) + np.cross(spin, body.centres - middle)
    return flow.at(points, middle, body.directors, moving, np.tile(spin, (len(moving), 1)))


def surface_points(flow: SpatialBodyFlow, away: float = 1e-7) -> tuple[np.ndarray, np.ndarray]:
    """Return collocation points a little outside, and normals."""
    rigid(flow, np.zeros((1, 3)))
    points = flow._work.points[:, : len(flow._surface.faces)].copy()
    middle = Simulator(flow.scene).centres.mean(axis=0)
    return (points[:3] + away * points[3:6]).T + middle, points[3:6].T


MOTIONS = [((0.3, 0.2, -0.1), (0.0, 0.0, 0.0)), ((0.0, 0.0, 0.0), (1.0, 2.0, -0.5))]


@pytest.mark.parametrize("velocity, spin", MOTIONS)
def test_the_flow_follows_the_surface_of_a_straight_moving_body(velocity, spin):
    """n . u is the motion's to 1e-5 of it; by Gauss's law (the default) to 15 %, 6 % RMS."""
    for scene, largest, mean in ((FLAT, 1e-5, 1e-6), (SOLID, 0.15, 0.06)):
        flow = SpatialBodyFlow(scene)
        points, normals = surface_points(flow)
        moving = np.asarray(velocity) + np.cross(spin, points - points.mean(axis=0))
        wanted = (normals * moving).sum(axis=1)
        found = (normals * rigid(flow, points, velocity, spin)).sum(axis=1)
        scale = np.abs(wanted).max()
        assert np.abs(found - wanted).max() < largest * scale
        assert np.sqrt(np.mean((found - wanted) ** 2)) < mean * scale


def test_far_away_the_flow_is_that_of_the_bodys_dipole():
    """Its moment is V U + A U/rho, A the added mass: u = -grad(m . x/(4 pi r^3)), within 0.5 %."""
    flow = SpatialBodyFlow(SOLID)
    velocity = np.array([0.3, 0.2, -0.1])
    body = Simulator(SOLID)
    added, status = evaluate_added_mass(body.directors, surface_of(SOLID))
    assert status == 0
    ways = body.directors.transpose(0, 2, 1).reshape(-1, 3, 3)
    motions = np.concatenate([ways, np.zeros_like(ways)], axis=1).reshape(-1, 3)
    surface = BodySurface(SOLID, rings=36, around=12)
    a, b, c = np.moveaxis(surface.vertices(body.centres, body.directors)[surface.triangles], 1, 0)
    volume = np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0
    moment = volume * velocity + motions.T @ added @ motions @ velocity / SOLID.fluid.density
    away = np.random.default_rng(2).normal(size=(50, 3))
    away *= 12.0 / np.linalg.norm(away, axis=1, keepdims=True)
    found = rigid(flow, body.centres.mean(axis=0) + away, velocity)
    ahead = (away @ moment)[:, None] * away / 12.0**2
    wanted = (3.0 * ahead - moment) / (4.0 * np.pi * 12.0**3)
    scale = np.linalg.norm(wanted, axis=1).max()
    assert np.abs(found - wanted).max() < 5e-3 * scale


def test_the_flow_at_an_instant_has_the_runs_velocities():
    """A body that turns and drifts without bending: its motion is known."""
    run = Simulator(FLAT).rollout(np.zeros((20, 8, 3)))
    flow = SpatialBodyFlow(FLAT)
    # Further out than the stiff body bends.
    points, normals = surface_points(flow, 2e-4)
    body = Simulator(FLAT)
    local = (points - body.centres.mean(axis=0)) @ body.directors[0]
    for instant in (0, 7, 20):
        first, last = max(instant - 1, 0), min(instant + 1, 20)
        turn = run.directors[instant, 4]
        seen = run.path[instant] + local @ turn.T
        outwards = normals @ body.directors[0] @ turn.T
        before, after = (run.path[k] + local @ run.directors[k, 4].T for k in (first, last))
        moving = (after - before) / ((last - first) * FLAT.integrator.time_step)
        wanted = (outwards * moving).sum(axis=1)
        found = (outwards * flow.during(run, instant, seen)).sum(axis=1)
        assert np.abs(found - wanted).max() < 0.02 * np.abs(wanted).max()


def test_the_flow_moves_with_the_stream():
    """A body that drifts with a stream has the flow of one at rest, and the stream on top."""
    still = FISH.replace({"fluid.model": "panels", "fluid.rows": 1, "fluid.around": 8})
    still = still.replace("initial.velocity", [0.25, -0.5, 0.125])
    stream = [0.5, 0.25, -0.375]
    drifting = still.replace({"stream.velocity": stream, "initial.velocity": [0.75, -0.25, -0.25]})
    around = np.random.default_rng(3).uniform(0.1, 0.3, (20, 3))
    found = []
    for scene in (still, drifting):
        run = tumbling(scene, 40)
        flow = SpatialBodyFlow(scene)
        found += [flow.during(run, instant, run.path[instant] + around) for instant in (0, 30, 40)]
    rest, moved = np.split(np.array(found), 2)
    assert np.abs(rest).max() > 0.01
    assert moved - stream == pytest.approx(rest, abs=1e-12)
    with refuses(OptionError, "stream differs"):
        SpatialBodyFlow(still).during(run, 0, around)


def test_inside_and_outside(run):
    """Points a little inside and outside of the surface, of any shape."""
    flow = SpatialBodyFlow(FISH.replace("fluid.model", "panels"))
    surface = BodySurface(FISH, rings=72, around=32)
    for n in (0, 120, 200):
        shape = run.centres[n], run.directors[n]
        vertices = surface.vertices(*shape)[50:-50]
        normals = surface.normals(surface.vertices(*shape))[50:-50]
        assert flow.inside(vertices - 4e-3 * normals, *shape).mean() > 0.93
        assert not flow.inside(vertices + 4e-3 * normals, *shape).any()
        assert flow.inside(vertices + 4e-3 * normals, *shape, 0.02).all()


def test_planes_hold_the_flow(tmp_path):
    """Speed and velocity at the points that the file says, at half the frames."""
    scene = FISH.replace({"fluid.model": "panels", "fluid.rows": 1, "fluid.around": 8})
    simulator = Simulator(scene)
    run = simulator.rollout(simulator.prescribed_torques(60))
    written = write_recording(tmp_path / "x.rrd", [Swimmer("fish", run)], flow_rate=10.0)
    assert (written.frames, written.flow_frames) == (16, 4)
    read = read_recording(tmp_path / "x.rrd")
    instants = np.arange(0, 61, 20)
    assert read.swimmers["fish"].flow_time == pytest.approx(run.time[instants])
    flow = SpatialBodyFlow(scene)
    for plane, normal in (("horizontal", 2), ("vertical", 1)):
        place = f"{PLACE}/flow/{plane}"
        moved = read.columns[place, "Transform3D:translation"].values
        grid = stacked(read, f"flow/{plane}/speed", "Mesh3D:vertex_positions")[0]
        colours = stacked(read, f"flow/{plane}/speed", "Mesh3D:vertex_colors")
        assert colours.shape == (4, len(grid)) and len(np.unique(colours)) > 50
        seconds = np.ravel(read.columns[f"{place}/velocity", "Transform3D:scale"].values[0])[0]
        origins = seconds * stacked(read, f"flow/{plane}/velocity", "Arrows3D:origins")[0]
        arrows = stacked(read, f"flow/{plane}/velocity", "Arrows3D:vectors")
        assert arrows.shape == (4, len(origins), 3)
        assert (grid[:, normal] == 0.0).all() and np.ptp(grid, axis=0).max() == pytest.approx(2.4)
        for frame, n in enumerate(instants.tolist()):
            at = np.ravel(moved[frame]) + origins
            assert at[:, normal] == pytest.approx(run.path[n, normal], abs=1e-6)
            within = np.delete(at, normal, axis=1) / 0.1
            assert within == pytest.approx(np.rint(within), abs=1e-3)
            shape = run.centres[n], run.directors[n]
            wanted = flow.during(run, n, at.astype(float))
            wanted[flow.inside(at, *shape, 0.02)] = 0.0
            assert arrows[frame] == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())
            assert (arrows[frame] == 0.0).all(axis=1).sum() < 0.2 * len(at)


# ---- several, other colours, bad input ---------------------------------------------------------


def test_swimmers_have_lanes_and_rewards_and_either_colour(run, tmp_path):
    goal = {"goal": (2.0, 0.5, 0.3), "target_radius": 0.1}
    two = [Swimmer("a", run, 0.01 * np.arange(50), **goal), Swimmer("b", run)]
    for colour in COLOURS:
        write_recording(tmp_path / "x.rrd", two, colour=colour)
        read = read_recording(tmp_path / "x.rrd")
        moved = read.columns["/world/b", "Transform3D:translation"].values[0]
        assert np.ravel(moved) == pytest.approx([0.0, -0.5, 0.0])
        assert len(np.unique(stacked(read, "body", "Mesh3D:vertex_colors", "/world/a"))) > 100
    series = read.swimmers["a"].series
    assert series["return"][-1, 0] == pytest.approx(0.01 * np.arange(50).sum())
    far = np.linalg.norm(run.path[[0, -1]] - (2.0, 0.5, 0.3), axis=1)
    assert series["progress"][-1, 0] == pytest.approx(far[0] - far[1])
    assert ("/world/a/target", "Ellipsoids3D:half_sizes") in read.columns


def test_bad_input_is_one_clear_error(run, tmp_path):
    planar = Simulator("swimmer").rollout(np.zeros((4, 8)))
    file = tmp_path / "x.rrd"
    for swimmers, text in (
        ([Swimmer("a", run), Swimmer("b", planar)], "one dimension, got a of dimension 3, b of"),
        ([Swimmer("a", run, start_velocity=np.zeros(30))], "leave start_velocity out"),
        ([Swimmer("a", run, goal=(1.0, 0.0))], "goal of a must be 3 finite numbers"),
        ([Swimmer("a", Simulator(FISH).rollout(np.zeros((0, 8, 3))))], "at least one step"),
    ):
        with refuses(OptionError, text):
            write_recording(file, swimmers)
        assert not file.exists()
    with refuses(OptionError, "fluid.model panels or frozen, scene fish_3d has fluid.model strip"):
        SpatialBodyFlow(FISH)
    flow, points = SpatialBodyFlow(SOLID), np.zeros((1, 3))
    with refuses(OptionError, "cannot show a trajectory of scene fish_3d: beam differs"):
        flow.during(run, 0, points)
    solid = Simulator(SOLID).rollout(np.zeros((2, 8, 3)))
    with refuses(OptionError, "instant must be 0 to 2 for this trajectory, got 3"):
        flow.during(solid, 3, points)
    with refuses(OptionError, "at least one step"):
        flow.during(Simulator(SOLID).rollout(np.zeros((0, 8, 3))), 0, points)
