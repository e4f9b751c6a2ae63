"""The peers of the benchmark are the beam that they are compared with, at steps that they bear."""

from __future__ import annotations

import importlib.metadata
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.benchmark.elastica_peer import ElasticaRod, rod_workloads
from studies.benchmark.mujoco_chain import (
    CHAIN_VARIANTS,
    WAYS,
    ChainVariant,
    MuJoCoChain,
    chain_xml,
)
from studies.benchmark.mujoco_peers import chain_step, chain_workloads, swimmer_workloads
from studies.benchmark.peer_tools import PeerMissingError, largest_stable_step, load_peer
from studies.benchmark.peers import PREPARATIONS, measure_mujoco_chain, peer_workloads
from swim_env import Initial, Scene, SceneError, Simulator, load_scene
from swim_env.errors import OptionError

Array = NDArray[np.float64]

INTERVAL = 0.02
LUMPED = ChainVariant("RK4", "none", "lumped")
ROD = ChainVariant("RK4", "none", "rod")
# A beam whose numbers all differ, so that none can stand in for another.
UNEVEN = (
    load_scene("paper_i")
    .replace("beam.elements", 5)
    .replace("beam.length", 1.3)
    .replace("beam.line_density", 0.4)
    .replace("beam.bending_stiffness", [5.0, 4.0, 3.0, 2.5])
    .replace("actuation.amplitude", 0.7)
    .replace("actuation.frequency", 5.0)
    .replace("actuation.wave_number", 4.0)
    .replace("actuation.phase", 0.3)
)


@pytest.fixture
def mujoco() -> Any:
    return pytest.importorskip("mujoco")


@pytest.fixture
def elastica() -> Any:
    return pytest.importorskip("elastica")


def in_vacuum(scene: Scene, time_step: float) -> Scene:
    return scene.replace("fluid.model", "none").replace("integrator.time_step", time_step)


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
def test_the_chain_has_the_mass_length_inertia_and_stiffness_of_the_beam(
    mujoco: Any, links: str
) -> None:
    beam = UNEVEN.beam
    chain = MuJoCoChain(UNEVEN, ChainVariant("Euler", "none", links), 20)
    model, data = chain.model, chain.data
    mujoco.mj_forward(model, data)
    length = beam.length / 5
    own = 0.4 * length * (length**2 / 12 if links == "rod" else 0.0)
    assert model.body_mass.sum() == pytest.approx(0.4 * 1.3)
    assert data.xipos[1:, 0] == pytest.approx((np.arange(5) + 0.5) * length)
    assert model.body_inertia[1:, 2] == pytest.approx(7.8e-6 * length + own)
    springs = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)
    assert springs[3:, 0] == pytest.approx(np.array([5.0, 4.0, 3.0, 2.5]) / length)
    assert not springs[:3].any() and not springs[:, 1:].any()
    assert not np.any(model.dof_damping) and not np.any(model.opt.gravity)
    assert model.opt.timestep == pytest.approx(INTERVAL / 20)


def test_the_chain_has_the_kelvin_voigt_damping_of_the_scene(mujoco: Any) -> None:
    chain = MuJoCoChain(load_scene("swimmer"), ROD, 20)
    damping = np.asarray(chain.model.dof_damping).reshape(chain.model.nv, -1)
    assert damping[3:, 0] == pytest.approx(0.001 * 5.0 * 9)
    assert not damping[:3].any()


def test_the_lumped_chain_vibrates_as_the_beam_alone_does(mujoco: Any) -> None:
    # Nearly the first free-free mode, so that the unresolved modes stay small.
    fractions = np.arange(1, 9) / 9
    bent = 0.01 * np.sin(np.pi * fractions) ** 2
    step = 2e-4
    simulator = Simulator(in_vacuum(load_scene("paper_i"), step))
    simulator.reset(Initial(joint_angles=bent.tolist()))
    steps = 800
    expected = np.diff(simulator.rollout(np.zeros((steps, 8))).angles, axis=1)

    scene = load_scene("paper_i").replace("episode.control_interval", step)
    scene = scene.replace("integrator.time_step", step)
    chain = MuJoCoChain(scene, LUMPED, 4)
    chain.data.qpos[3:] = bent
    found = [bent]
    for _ in range(steps):
        mujoco.mj_step(chain.model, chain.data, 4)
        found.append(np.array(chain.data.qpos[3:]))
    amplitude = np.abs(expected).max()
    assert np.abs(np.array(found) - expected).max() < 0.02 * amplitude
    frequency = frequency_of(np.array(found)[:, 3], step)
    assert frequency == pytest.approx(frequency_of(expected[:, 3], step), rel=1e-3)
    assert frequency == pytest.approx(first_free_frequency(scene), rel=0.04)


def test_the_chain_of_rods_has_nearly_the_beams_first_frequency(mujoco: Any) -> None:
    scene = load_scene("paper_i").replace("integrator.time_step", 0.0005)
    scene = scene.replace("episode.control_interval", 0.0005)
    chain = MuJoCoChain(scene, ROD, 1)
    chain.data.qpos[3:] = 0.01 * np.sin(np.pi * np.arange(1, 9) / 9) ** 2
    angles = []
    for _ in range(800):
        mujoco.mj_step(chain.model, chain.data)
        angles.append(float(chain.data.qpos[6]))
    found = frequency_of(np.array(angles), 0.0005)
    assert found == pytest.approx(first_free_frequency(scene), rel=0.04)


def test_the_chain_is_driven_by_the_simulators_wave(mujoco: Any) -> None:
    simulator = Simulator(UNEVEN.replace("integrator.time_step", INTERVAL))
    expected = simulator.prescribed_torques(40)
    chain = MuJoCoChain(UNEVEN, LUMPED, 200)
    assert np.array_equal(chain.controls(40), expected)
    assert chain.swim(40) is not None
    # What acted in the last interval: a torque on every joint, and none on the free base.
    assert chain.data.qfrc_actuator[3:] == pytest.approx(expected[-1])
    assert not np.any(chain.data.qfrc_actuator[:3])


def test_the_driven_chain_moves_as_the_beam_alone_does(mujoco: Any) -> None:
    # With damping: what the sudden start of the torques does to the fastest modes is soon over.
    scene = load_scene("swimmer")
    found = MuJoCoChain(scene, ChainVariant("Euler", "none", "lumped"), 400).swim(15)
    simulator = Simulator(in_vacuum(scene, INTERVAL / 400))
    torques = np.repeat(
        simulator.scene.actuation.torques(INTERVAL * np.arange(15), scene.beam), 400, 0
    )
    expected = np.diff(simulator.rollout(torques).angles, axis=1)[400::400]
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()


@pytest.mark.parametrize("fluid", ["box", "ellipsoid"])
def test_mujocos_fluids_drag_but_add_no_mass(mujoco: Any, fluid: str) -> None:
    scene = load_scene("paper_i")
    accelerations = []
    for name in ("none", fluid):
        chain = MuJoCoChain(scene, ChainVariant("Euler", name, "rod"), 40)
        chain.data.ctrl[:] = 0.3
        mujoco.mj_forward(chain.model, chain.data)
        accelerations.append(np.array(chain.data.qacc))
    assert accelerations[1] == pytest.approx(accelerations[0], rel=1e-12)
    chain.data.qvel[:2] = [0.0, 0.1]
    mujoco.mj_forward(chain.model, chain.data)
    drag = float(chain.data.qfrc_passive[1])
    # Across the body, with the scene's density: 0.05 N for a flat plate with a coefficient of 1.
    assert -0.2 < drag < -0.02


def test_every_variant_of_the_benchmark_can_be_built(mujoco: Any) -> None:
    scene = load_scene("paper_i")
    known = mujoco.mjtIntegrator.__members__
    for variant in CHAIN_VARIANTS:
        if f"mjINT_{variant.integrator.upper()}" in known:
            assert MuJoCoChain(scene, variant, 200).swim(2) is not None, variant
    assert len({variant.name for variant in CHAIN_VARIANTS}) == len(CHAIN_VARIANTS)


@pytest.mark.parametrize(
    ("variant", "message"),
    [
        (ChainVariant("Verlet"), "integrator must be one of"),
        (ChainVariant("Euler", "water"), "fluid must be none, box or ellipsoid, got 'water'"),
        (ChainVariant("Euler", "none", "sphere"), "links must be lumped or rod, got 'sphere'"),
        (ChainVariant("Euler", "box", "lumped"), "fluid box needs links rod"),
    ],
)
def test_unknown_variants_are_refused(variant: ChainVariant, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        chain_xml(load_scene("paper_i"), variant, 0.001)


def test_unknown_ways_are_refused() -> None:
    with pytest.raises(OptionError, match=r"ways must be of .*, got \['twice'\]"):
        chain_workloads(load_scene("paper_i"), ways=("held", "twice"))


def test_a_chain_in_a_fluid_needs_a_fluid() -> None:
    with pytest.raises(OptionError, match="fluid box needs a scene with a fluid density"):
        chain_xml(in_vacuum(load_scene("paper_i"), 0.01), ChainVariant("Euler", "box"), 0.001)


def test_the_chains_step_is_stable_and_the_next_is_not(
    mujoco: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene, variant = load_scene("paper_i"), ChainVariant("Euler")
    found = chain_step(scene, variant, 4.0)
    assert found.time_step == pytest.approx(INTERVAL / found.substeps)
    # Without damping Euler's method is stable up to 2/omega, omega being the fastest mode.
    chain = MuJoCoChain(scene, variant, 1)
    mujoco.mj_forward(chain.model, chain.data)
    size = chain.model.nv
    mass = np.empty((size, size))
    for column in range(size):
        unit = np.zeros(size)
        unit[column] = 1.0
        mujoco.mj_mulM(chain.model, chain.data, mass[column], unit)
    stiffness = np.diag([0.0] * 3 + [5.0 * 9] * 8)
    limit = 2.0 / math.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.max())
    assert 0.9 * limit < found.time_step <= 1.01 * limit
    assert found.unstable_time_step > 0.98 * limit
    assert MuJoCoChain(scene, variant, found.substeps // 2).swim(200) is None
    assert not list(tmp_path.iterdir()), "the search must not leave MuJoCo's log behind"


def test_the_chains_calls_do_the_work_that_they_are_credited_with(mujoco: Any) -> None:
    scene = load_scene("paper_i")
    steps: list[int] = []
    workloads = chain_workloads(
        scene,
        (ChainVariant("Euler"),),
        ways=WAYS,
        seconds=0.4,
        duration=1.0,
        progress=steps.append,
    )
    assert steps == [1]
    assert list(workloads) == [f"mujoco_chain/Euler/none/rod/{way}" for way in WAYS]
    chain = MuJoCoChain(scene, ChainVariant("Euler"), 25)
    ends = []
    for call in chain.calls(20).values():
        for _ in range(2):  # every call starts anew
            call()
            assert chain.data.time == pytest.approx(0.4)
            ends.append(np.array(chain.data.qpos))
    assert len(ends) == 2 * len(WAYS)
    assert all(np.array_equal(end, ends[0]) for end in ends[1:])
    for workload in workloads.values():
        assert workload.steps == 20 and workload.seconds == pytest.approx(0.4)
        assert workload.physics_steps == 20 * workload.facts["substeps"]


def test_integrators_that_are_not_there_are_left_out(mujoco: Any) -> None:
    variants = (ChainVariant("Leapfrog"),)
    assert chain_workloads(load_scene("paper_i"), variants) == {}


# ---- the rod in PyElastica ---------------------------------------------------------------------


def test_the_rod_has_the_stiffness_and_mass_of_the_beam(elastica: Any) -> None:
    rod = ElasticaRod(UNEVEN).rod
    assert rod.mass.sum() == pytest.approx(0.4 * 1.3)
    assert rod.rest_lengths == pytest.approx(1.3 / 5)
    for axis in (0, 1):
        assert rod.bend_matrix[axis, axis] == pytest.approx(np.array([5.0, 4.0, 3.0, 2.5]))
    # Rotary inertia per length about the axis out of the plane.
    own = rod.mass_second_moment_of_inertia[0, 0] / rod.rest_lengths
    assert own == pytest.approx(7.8e-6)
    assert ElasticaRod(load_scene("paper_i")).rod.radius == pytest.approx(0.01, rel=0.01)


def test_softening_divides_shear_and_stretching_stiffness_alone(elastica: Any) -> None:
    hard, soft = (ElasticaRod(UNEVEN, softening=factor).rod for factor in (1.0, 10.0))
    assert soft.shear_matrix == pytest.approx(hard.shear_matrix / 10.0)
    assert soft.bend_matrix == pytest.approx(hard.bend_matrix)


def test_the_rods_muscles_are_the_simulators_wave(elastica: Any) -> None:
    peer = ElasticaRod(UNEVEN, viscosity=0.0)
    rod = peer.rod
    simulator = Simulator(UNEVEN.replace("integrator.time_step", INTERVAL))
    for index, torques in enumerate(simulator.prescribed_torques(30)):
        rod.external_torques[:] = 0.0
        peer._system.synchronize(index * INTERVAL + (1e-9 if index == 0 else 0.0))
        # Material frame; the first director points out of the plane.
        found = rod.external_torques
        expected = np.zeros(5)
        expected[1:] += torques
        expected[:-1] -= torques
        assert found[0] == pytest.approx(expected, abs=1e-7)
        assert not found[1:].any()


def test_the_rod_vibrates_at_the_beams_first_frequency(elastica: Any) -> None:
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


def test_the_rod_starts_anew_and_its_drag_slows_it(elastica: Any) -> None:
    scene = load_scene("paper_i")
    free, slow = ElasticaRod(scene, viscosity=0.0), ElasticaRod(scene, viscosity=10.0)
    first, again = (slow.swim(INTERVAL, 1000, 3) for _ in range(2))
    assert np.array_equal(first, again)
    assert slow.time == pytest.approx(3 * INTERVAL)
    free.swim(INTERVAL, 1000, 3)
    speeds = [float(np.abs(peer.rod.velocity_collection).max()) for peer in (free, slow)]
    assert speeds[1] < 0.5 * speeds[0]
    # Steps beyond the stable ones are noticed, without a warning of numpy's.
    assert free.swim(INTERVAL, 20, 50) is None or np.abs(free.swim(INTERVAL, 20, 50)).max() > 1.0


def test_the_rods_calls_do_the_work_that_they_are_credited_with(elastica: Any) -> None:
    workloads = rod_workloads(load_scene("paper_i"), (100.0,), seconds=0.04, duration=0.1)
    ((name, workload),) = workloads.items()
    assert name == "elastica_rod/100"
    workload.call()
    assert workload.steps == 2 and workload.seconds == pytest.approx(0.04)
    assert workload.physics_steps == 2 * workload.facts["substeps"]
    assert workload.facts["version"] == importlib.metadata.version("pyelastica")
    assert workload.facts["time_step"] < workload.facts["unstable_time_step"]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("actuation.end_time", 1.0, "actuation.end_time and actuation.active_until must be left"),
        ("actuation.active_until", 0.5, "actuation.end_time and actuation.active_until must be"),
        ("actuation", None, "actuation is missing"),
    ],
)
def test_scenes_without_the_rods_wave_are_refused(
    elastica: Any, field: str, value: object, message: str
) -> None:
    with pytest.raises(SceneError, match=message):
        ElasticaRod(load_scene("paper_i").replace(field, value))


# ---- Swimmer-v5 --------------------------------------------------------------------------------


def test_swimmer_v5_is_the_stock_environment(mujoco: Any) -> None:
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


def vibrations(omega: float, count: int = 200) -> Callable[[int], Array | None]:
    """Return runs of a slow and a small fast vibration by the semi-implicit Euler method.

    It is stable up to a step of 2/omega, omega being the frequency of the fast one.
    """
    squares = np.array([5.0, omega]) ** 2

    def run(substeps: int) -> Array | None:
        step = INTERVAL / substeps
        place, rate = np.array([0.05, 1e-4]), np.zeros(2)
        angles = np.empty((count, 1))
        for index in range(count):
            for _ in range(substeps):
                rate -= step * squares * place
                place += step * rate
            if not np.abs(place).max() < 1e9:
                return None
            angles[index] = place.sum()
        return angles

    return run


@pytest.mark.parametrize("omega", [130.0, 733.0, 2750.0])
def test_the_search_finds_a_known_limit(omega: float) -> None:
    found = largest_stable_step(vibrations(omega), INTERVAL, resolution=0.0)
    assert found.substeps == math.ceil(INTERVAL * omega / 2.0)
    assert found.time_step == INTERVAL / found.substeps
    assert found.unstable_time_step == INTERVAL / (found.substeps - 1)


def test_the_search_stops_at_the_resolution() -> None:
    tried = []
    run = vibrations(2750.0)
    found = largest_stable_step(
        lambda substeps: (tried.append(substeps), run(substeps))[1], INTERVAL, resolution=0.2
    )
    exact = INTERVAL * 2750.0 / 2.0
    assert exact <= found.substeps < 1.25 * exact + 1.0
    assert len(tried) == len(set(tried)) <= 10


def test_a_whole_interval_may_be_stable() -> None:
    found = largest_stable_step(vibrations(90.0), INTERVAL)
    assert (found.substeps, found.time_step, found.unstable_time_step) == (1, INTERVAL, None)
    assert 0.0 < found.peak <= 0.08 and 0.0 < found.deviation < 1.0


def test_slow_growth_within_bounds_counts_as_unstable() -> None:
    # In a longer run it would blow up. 1 + 8.1/n exceeds 1.5 (1 + 8.1/4n) for n up to 10.
    def run(substeps: int) -> Array:
        return 0.1 * (1.0 + 8.1 / substeps) * np.sin(np.arange(50.0))[:, None]

    assert largest_stable_step(run, INTERVAL, resolution=0.0).substeps == 11


def test_complaints_and_numbers_that_are_not_finite_are_unstable() -> None:
    def run(substeps: int) -> Array | None:
        if substeps < 3:
            return None
        return np.full((5, 1), np.nan if substeps < 6 else 0.1)

    assert largest_stable_step(run, INTERVAL).substeps == 6


def test_there_may_be_no_stable_step() -> None:
    tried = []
    assert largest_stable_step(lambda n: tried.append(n), INTERVAL, most=50) is None
    assert max(tried) <= 50


def test_the_deviation_is_relative_to_the_finer_run() -> None:
    def run(substeps: int) -> Array:
        return np.full((4, 2), 0.1 if substeps >= 4 else 0.13)

    assert largest_stable_step(run, INTERVAL).deviation == pytest.approx(0.3)


# ---- packages that are not installed -----------------------------------------------------------


def test_a_missing_package_is_named_with_what_brings_it() -> None:
    with pytest.raises(
        PeerMissingError,
        match=r"A peer is not measured: it is not installed \(pip install 'swim-env\[bench\]'\)",
    ):
        load_peer("no_such_package_anywhere", "A peer")


def test_a_package_that_is_there_but_broken_says_so_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_peer.py").write_text("import something_it_needs_in_vain\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="something_it_needs_in_vain") as caught:
        load_peer("broken_peer", "A peer")
    assert not isinstance(caught.value, PeerMissingError)


@pytest.fixture
def without_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mujoco", "elastica"):
        for module in [key for key in sys.modules if key.split(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
        monkeypatch.setitem(sys.modules, name, None)


def test_without_the_packages_all_peers_are_skipped_with_a_reason(without_peers: None) -> None:
    steps: list[int] = []
    workloads, skipped = peer_workloads(progress=steps.append)
    assert workloads == {}
    assert set(skipped) == {"swimmer_v5", "mujoco_chain", "elastica_rod"}
    for name, reason in skipped.items():
        package = "PyElastica" if name == "elastica_rod" else "MuJoCo"
        assert reason == (
            f"{package} is not measured: it is not installed (pip install 'swim-env[bench]')"
        )
    assert sum(steps) == PREPARATIONS
    assert measure_mujoco_chain() == {"speeds": {}, "skipped": skipped["mujoco_chain"]}


def test_what_is_measured_is_plain_and_said_per_second(mujoco: Any) -> None:
    record = measure_mujoco_chain(
        rounds=2, variants=(ChainVariant("Euler"),), seconds=0.2, duration=0.5
    )
    assert record["skipped"] is None
    ((name, speed),) = record["speeds"].items()
    assert name == "mujoco_chain/Euler/none/rod/held"
    assert json.loads(json.dumps(speed, allow_nan=False)) == speed
    rate = speed["simulated_seconds_per_second"]["median"]
    assert rate == pytest.approx(INTERVAL * speed["steps_per_second"]["median"])
    assert speed["physics_steps_per_step"] == speed["substeps"]
    assert speed["time_step"] < speed["unstable_time_step"] < INTERVAL
