"""The peers of the benchmark are the beam that they are compared with, at steps that they bear."""

import importlib.metadata
import json
import math
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.benchmark.elastica_peer import ElasticaRod, rod_workloads
from studies.benchmark.environments import throughput
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant, MuJoCoChain, chain_xml
from studies.benchmark.mujoco_peers import chain_step, chain_workloads, swimmer_workloads
from studies.benchmark.peer_tools import PeerMissingError, largest_stable_step, load_peer
from studies.benchmark.peers import peer_workloads
from swim_env import Initial, Scene, SceneError, Simulator, load_scene
from swim_env.errors import OptionError

Array = NDArray[np.float64]

INTERVAL = 0.02
EULER = ChainVariant("Euler")
# A beam whose numbers all differ, so that none can be mistaken for another.
UNEVEN = load_scene(
    "paper_i",
    {
        "beam.elements": 5,
        "beam.length": 1.3,
        "beam.line_density": 0.4,
        "beam.bending_stiffness": [5.0, 4.0, 3.0, 2.5],
        "actuation.amplitude": 0.7,
        "actuation.frequency": 5.0,
        "actuation.wave_number": 4.0,
        "actuation.phase": 0.3,
    },
)


@pytest.fixture
def mujoco() -> Any:
    return pytest.importorskip("mujoco")


@pytest.fixture
def elastica() -> Any:
    return pytest.importorskip("elastica")


def in_vacuum(scene: Scene, time_step: float) -> Scene:
    return scene.replace({"fluid.model": "none", "integrator.time_step": time_step})


def first_free_frequency(scene: Scene) -> float:
    """Return the first bending frequency of a uniform free-free beam (rad/s)."""
    beam = scene.beam
    stiffness = float(beam.stiffness_at_joints()[0])
    return (4.730040745 / beam.length) ** 2 * math.sqrt(stiffness / beam.line_density)


def frequency_of(angles: Array, interval: float) -> float:
    """Return the frequency of a vibration without damping (rad/s), from its zero crossings."""
    before, after = angles[:-1], angles[1:]
    index = np.flatnonzero(before * after < 0.0)
    times = (index + before[index] / (before[index] - after[index])) * interval
    return math.pi * (len(times) - 1) / float(times[-1] - times[0])


# ---- the chain in MuJoCo -----------------------------------------------------------------------


@pytest.mark.parametrize("links", ["lumped", "rod"])
def test_the_chain_has_the_mass_length_inertia_and_stiffness_of_the_beam(mujoco, links):
    chain = MuJoCoChain(UNEVEN, ChainVariant("Euler", "none", links), 20)
    model, data = chain.model, chain.data
    mujoco.mj_forward(model, data)
    length = 1.3 / 5
    own = 0.4 * length * (length**2 / 12 if links == "rod" else 0.0)
    assert model.body_mass.sum() == pytest.approx(0.4 * 1.3)
    assert data.xipos[1:, 0] == pytest.approx((np.arange(5) + 0.5) * length)
    assert model.body_inertia[1:, 2] == pytest.approx(7.8e-6 * length + own)
    springs = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)
    assert springs[3:, 0] == pytest.approx(np.array([5.0, 4.0, 3.0, 2.5]) / length)
    assert not springs[:3].any() and not springs[:, 1:].any()
    assert not np.any(model.dof_damping) and not np.any(model.opt.gravity)
    assert model.opt.timestep == pytest.approx(INTERVAL / 20)
    model = MuJoCoChain(load_scene("swimmer"), EULER, 20).model
    damping = np.asarray(model.dof_damping).reshape(model.nv, -1)
    assert damping[3:, 0] == pytest.approx(0.001 * 5.0 * 9) and not damping[:3].any()


@pytest.mark.parametrize("links", ["lumped", "rod"])
def test_the_chain_vibrates_as_the_beam_alone_does(mujoco, links):
    # Nearly the first free-free mode, so that the unresolved modes stay small.
    bent = 0.01 * np.sin(np.pi * np.arange(1, 9) / 9) ** 2
    step, steps = 2e-4, 2000
    changes = {"episode.control_interval": step, "integrator.time_step": step}
    scene = load_scene("paper_i", changes)
    chain = MuJoCoChain(scene, ChainVariant("RK4", "none", links), 4)
    chain.data.qpos[3:] = bent
    found = [bent]
    for _ in range(steps):
        mujoco.mj_step(chain.model, chain.data, 4)
        found.append(np.array(chain.data.qpos[3:]))
    frequency = frequency_of(np.array(found)[:, 3], step)
    assert frequency == pytest.approx(first_free_frequency(scene), rel=0.04)
    if links == "lumped":
        simulator = Simulator(in_vacuum(scene, step))
        simulator.reset(Initial(joint_angles=bent.tolist()))
        expected = np.diff(simulator.rollout(np.zeros((800, 8))).angles, axis=1)
        assert np.abs(found[:801] - expected).max() < 0.02 * np.abs(expected).max()
        same = frequency_of(np.array(found)[:801, 3], step)
        assert same == pytest.approx(frequency_of(expected[:, 3], step), rel=1e-3)


def test_the_chain_is_driven_by_the_simulators_wave(mujoco):
    simulator = Simulator(UNEVEN.replace("integrator.time_step", INTERVAL))
    expected = simulator.prescribed_torques(40)
    chain = MuJoCoChain(UNEVEN, ChainVariant("RK4", "none", "lumped"), 200)
    assert np.array_equal(chain.controls(40), expected)
    assert chain.swim(40) is not None
    # What acted in the last interval: a torque on every joint, and none on the free base.
    assert chain.data.qfrc_actuator[3:] == pytest.approx(expected[-1])
    assert not np.any(chain.data.qfrc_actuator[:3])


def test_mujocos_fluid_drags_but_adds_no_mass(mujoco):
    accelerations = []
    for fluid in ("none", "ellipsoid"):
        chain = MuJoCoChain(load_scene("paper_i"), ChainVariant("Euler", fluid, "rod"), 40)
        chain.data.ctrl[:] = 0.3
        mujoco.mj_forward(chain.model, chain.data)
        accelerations.append(np.array(chain.data.qacc))
    assert accelerations[1] == pytest.approx(accelerations[0], rel=1e-12)
    chain.data.qvel[:2] = [0.0, 0.1]
    mujoco.mj_forward(chain.model, chain.data)
    # Across the body, with the scene's density: 0.05 N for a flat plate with a coefficient of 1.
    assert -0.2 < float(chain.data.qfrc_passive[1]) < -0.02
    with pytest.raises(OptionError, match="ellipsoid needs a scene with a fluid density"):
        chain_xml(in_vacuum(UNEVEN, 0.01), ChainVariant("Euler", "ellipsoid"), 0.001)


def test_the_chains_step_is_stable_and_the_next_is_not(mujoco, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = load_scene("paper_i")
    found = chain_step(scene, EULER, 4.0)
    assert found.time_step == pytest.approx(INTERVAL / found.substeps)
    # Without damping Euler's method is stable up to 2/omega, omega being the fastest mode.
    chain = MuJoCoChain(scene, EULER, 1)
    mujoco.mj_forward(chain.model, chain.data)
    mass = np.empty((chain.model.nv, chain.model.nv))
    for column, unit in zip(mass, np.eye(len(mass)), strict=True):
        mujoco.mj_mulM(chain.model, chain.data, column, unit)
    stiffness = np.diag([0.0] * 3 + [5.0 * 9] * 8)
    limit = 2.0 / math.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.max())
    assert 0.9 * limit < found.time_step <= 1.01 * limit
    assert found.unstable_time_step > 0.98 * limit
    assert MuJoCoChain(scene, EULER, found.substeps // 2).swim(200) is None
    assert not list(tmp_path.iterdir()), "the search must not leave MuJoCo's log behind"


def test_the_chains_calls_do_the_work_that_they_are_credited_with(mujoco):
    scene = load_scene("paper_i")
    known = mujoco.mjtIntegrator.__members__
    for variant in CHAIN_VARIANTS:
        if f"mjINT_{variant.integrator.upper()}" in known:
            assert MuJoCoChain(scene, variant, 200).swim(2) is not None, variant
    workloads = chain_workloads(
        scene,
        (EULER, ChainVariant("Leapfrog")),  # which MuJoCo does not have
        ways=("held", "single"),
        seconds=0.4,
        duration=1.0,
    )
    assert list(workloads) == [f"mujoco_chain/Euler/none/rod/{way}" for way in ("held", "single")]
    chain = MuJoCoChain(scene, EULER, 25)
    ends = []
    for call in chain.calls(20).values():
        for _ in range(2):  # every call starts anew
            call()
            assert chain.data.time == pytest.approx(0.4)
            ends.append(np.array(chain.data.qpos))
    assert len(ends) == 4 and all(np.array_equal(end, ends[0]) for end in ends[1:])
    for workload in workloads.values():
        assert workload.steps == 20 and workload.seconds == pytest.approx(0.4)
        assert workload.physics_steps == 20 * workload.facts["substeps"]
        speed = throughput(workload, np.ones(3))
        assert json.loads(json.dumps(speed, allow_nan=False)) == speed
        assert speed["physics_steps_per_step"] == speed["substeps"]
        assert speed["time_step"] < speed["unstable_time_step"] < INTERVAL


# ---- the rod in PyElastica ---------------------------------------------------------------------


@pytest.mark.slow
def test_the_rod_has_the_stiffness_and_mass_of_the_beam(elastica):
    rod, soft = (ElasticaRod(UNEVEN, softening=factor).rod for factor in (1.0, 10.0))
    assert rod.mass.sum() == pytest.approx(0.4 * 1.3)
    assert rod.rest_lengths == pytest.approx(1.3 / 5)
    for axis in (0, 1):
        assert rod.bend_matrix[axis, axis] == pytest.approx(np.array([5.0, 4.0, 3.0, 2.5]))
    # Rotary inertia per length about the axis out of the plane.
    own = rod.mass_second_moment_of_inertia[0, 0] / rod.rest_lengths
    assert own == pytest.approx(7.8e-6)
    assert ElasticaRod(load_scene("paper_i")).rod.radius == pytest.approx(0.01, rel=0.01)
    # Softening divides shear and stretching stiffness alone.
    assert soft.shear_matrix == pytest.approx(rod.shear_matrix / 10.0)
    assert soft.bend_matrix == pytest.approx(rod.bend_matrix)


def test_the_rods_muscles_are_the_simulators_wave(elastica):
    peer = ElasticaRod(UNEVEN, viscosity=0.0)
    simulator = Simulator(UNEVEN.replace("integrator.time_step", INTERVAL))
    for index, torques in enumerate(simulator.prescribed_torques(30)):
        found = peer.rod.external_torques
        found[:] = 0.0
        peer._system.synchronize(index * INTERVAL + (1e-9 if index == 0 else 0.0))
        # Material frame; the first director points out of the plane.
        expected = np.append(0.0, torques) - np.append(torques, 0.0)
        assert found[0] == pytest.approx(expected, abs=1e-7)
        assert not found[1:].any()


@pytest.mark.slow
def test_the_rod_vibrates_at_the_beams_first_frequency(elastica):
    scene = load_scene("paper_i").replace("actuation.amplitude", 0.0)
    peer = ElasticaRod(scene, viscosity=0.0)
    # The first free-free mode of a beam, as velocities across it.
    nodes = np.linspace(0.0, 1.0, 10)
    root = 4.730040745
    ratio = (math.cosh(root) - math.cos(root)) / (math.sinh(root) - math.sin(root))
    mode = np.cosh(root * nodes) + np.cos(root * nodes)
    mode -= ratio * (np.sinh(root * nodes) + np.sin(root * nodes))
    peer.rod.velocity_collection[1] = 0.01 * mode
    angles = []
    for _ in range(300):
        peer.advance(2e-5, 25)
        angles.append(float(peer.joint_angles()[3]))
    found = frequency_of(np.array(angles), 25 * 2e-5)
    assert found == pytest.approx(first_free_frequency(scene), rel=0.06)


def test_the_rod_starts_anew_and_its_drag_slows_it(elastica):
    scene = load_scene("paper_i")
    free, slow = ElasticaRod(scene, viscosity=0.0), ElasticaRod(scene, viscosity=10.0)
    first, again = (slow.swim(INTERVAL, 3, 1000) for _ in range(2))
    assert np.array_equal(first, again)
    assert slow.time == pytest.approx(3 * INTERVAL)
    free.swim(INTERVAL, 3, 1000)
    speeds = [float(np.abs(peer.rod.velocity_collection).max()) for peer in (free, slow)]
    assert speeds[1] < 0.5 * speeds[0]
    # Steps beyond the stable ones are noticed, without a warning of numpy's.
    wild = free.swim(INTERVAL, 50, 20)
    assert wild is None or np.abs(wild).max() > 1.0


def test_the_rods_calls_do_the_work_that_they_are_credited_with(elastica):
    workloads = rod_workloads(load_scene("paper_i"), (100.0,), seconds=0.04, duration=0.1)
    ((name, workload),) = workloads.items()
    assert name == "elastica_rod/100"
    workload.call()
    assert workload.steps == 2 and workload.seconds == pytest.approx(0.04)
    assert workload.physics_steps == 2 * workload.facts["substeps"]
    assert workload.facts["version"] == importlib.metadata.version("pyelastica")
    assert workload.facts["time_step"] < workload.facts["unstable_time_step"]


def test_scenes_without_the_rods_wave_are_refused(elastica):
    left = "actuation.end_time and actuation.active_until must be left"
    for field, value, message in (
        ("actuation.end_time", 1.0, left),
        ("actuation.active_until", 0.5, left),
        ("actuation", None, "actuation is missing"),
    ):
        with pytest.raises(SceneError, match=message):
            ElasticaRod(load_scene("paper_i").replace(field, value))


# ---- Swimmer-v5 --------------------------------------------------------------------------------


def test_swimmer_v5_is_the_stock_environment(mujoco):
    workloads = swimmer_workloads(3, single_steps=7, batch_steps=2)
    single, batch = workloads["swimmer_v5"], workloads["swimmer_v5_sync_vector"]
    for workload in (single, batch):
        workload.call()
        assert workload.seconds == pytest.approx(0.04 * workload.steps)
        assert workload.physics_steps == 4 * workload.steps
        assert workload.facts["integrator"] == "RK4"
        assert workload.facts["time_step"] == pytest.approx(0.01)
    assert (single.steps, batch.steps) == (7, 6)
    assert (single.facts["members"], batch.facts["members"]) == (1, 3)


# ---- the search for the largest stable step ----------------------------------------------------


@pytest.mark.parametrize("resolution", [0.0, 0.2])
@pytest.mark.parametrize("omega", [90.0, 130.0, 733.0, 2750.0])
def test_the_search_finds_a_known_limit(omega, resolution):
    """Semi-implicit Euler steps of a vibration are stable up to 2/omega."""
    tried = []

    def run(substeps: int) -> Array | None:
        tried.append(substeps)
        step, place, rate, angles = INTERVAL / substeps, 1e-4, 0.0, []
        for _ in range(200):
            for _ in range(substeps):
                rate -= step * omega**2 * place
                place += step * rate
            angles.append([place + 0.05])
        return np.array(angles) if abs(place) < 1e9 else None

    found = largest_stable_step(run, INTERVAL, resolution=resolution)
    exact = math.ceil(INTERVAL * omega / 2.0)
    assert exact <= found.substeps <= exact * (1.0 + 1.25 * resolution)
    assert found.time_step == INTERVAL / found.substeps
    assert (found.unstable_time_step is None) is (exact == 1)
    if resolution == 0.0 and exact > 1:
        assert found.unstable_time_step == INTERVAL / (found.substeps - 1)
    assert len(tried) == len(set(tried)) <= (10 if resolution else 16)


@pytest.mark.parametrize(
    ("run", "substeps"),
    [
        # In a longer run it would blow up. 1 + 8.1/n exceeds 1.5 (1 + 8.1/4n) for n up to 10.
        (lambda n: 0.1 * (1.0 + 8.1 / n) * np.sin(np.arange(50.0))[:, None], 11),
        (lambda n: None if n < 3 else np.full((5, 1), np.nan if n < 6 else 0.1), 6),
        (lambda n: None, None),
    ],
    ids=["slow growth", "complaints and NaN", "never stable"],
)
def test_what_counts_as_unstable(run, substeps):
    found = largest_stable_step(run, INTERVAL, most=50, resolution=0.0)
    assert (found and found.substeps) == substeps


def test_a_whole_interval_may_be_stable_and_the_deviation_is_from_the_finer_run():
    found = largest_stable_step(lambda n: np.full((4, 2), 0.1 if n >= 4 else 0.13), INTERVAL)
    assert (found.substeps, found.time_step, found.unstable_time_step) == (1, INTERVAL, None)
    assert found.deviation == pytest.approx(0.3)


# ---- packages that are not installed -----------------------------------------------------------


def test_a_package_that_is_there_but_broken_says_so_itself(tmp_path, monkeypatch):
    (tmp_path / "broken_peer.py").write_text("import something_it_needs_in_vain\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="something_it_needs_in_vain") as caught:
        load_peer("broken_peer", "A peer")
    assert not isinstance(caught.value, PeerMissingError)


def test_without_the_packages_all_peers_are_skipped_with_a_reason(monkeypatch):
    for name in ("mujoco", "elastica"):
        for module in [key for key in sys.modules if key.split(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
        monkeypatch.setitem(sys.modules, name, None)
    steps: list[int] = []
    workloads, skipped = peer_workloads(progress=steps.append)
    assert workloads == {}
    why = "is not measured: it is not installed (pip install 'swim-env[bench]')"
    assert skipped == {
        "swimmer_v5": f"MuJoCo {why}",
        "mujoco_chain": f"MuJoCo {why}",
        "elastica_rod": f"PyElastica {why}",
    }
    assert sum(steps) == 1 + len(CHAIN_VARIANTS) + 3
