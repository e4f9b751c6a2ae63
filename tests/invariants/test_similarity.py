"""Dynamical similarity: nothing depends on how large, heavy or fast a body is."""

import numpy as np
import pytest
from swim_agents.learning.saved import AgentError
from swim_agents.policies import load_policy
from swim_agents.rollout import play_episode
from swim_agents.tuning import _grid

from swim_env import TASKS, OptionError, Scene, SwimEnv, SwimTargetEnv, load_scene, scene_names
from swim_env.accuracy import choose
from swim_env.analysis.continuous import integrate
from swim_env.plots import draw_energy
from swim_env.plots.heat_maps import tail
from swim_env.recording import Swimmer, read_recording, write_recording
from swim_env.recording.swimmer import frames_of
from swim_env.scene import SCHEME_NAMES
from tests.support import Array, refuses, rollout

#: Lengths, densities and times, from a micrometre to a kilometre, as multiples of those of a scene.
UNITS = [(1e-6, 1e-9, 1.0), (1e-6, 1e9, 1e-6), (1e3, 1e9, 1e3), (1e3, 1e-9, 1e-3), (70.0, 1.0, 1.0)]
each_unit = pytest.mark.parametrize("units", UNITS, ids=str)

#: Everything that has a unit.
BASE = load_scene(
    "swimmer",
    {
        "cross_flow_drag": {"coefficient": 0.5},
        "stream": {"velocity": (0.1, 0.05)},
        "initial": {"velocity": (0.3, 0.1), "position": (1.0, 2.0)},
        "episode.velocity_noise": None,
        "episode.duration": 1.0,
    },
)
#: Fields by what they scale with: powers of the length, the density and the time.
POWERS = {
    (1, 0, 0): ("beam.length", "beam.half_thickness", "initial.position"),
    (1, 1, 0): ("beam.line_density",),
    (3, 1, 0): ("beam.rotary_inertia",),
    (5, 1, -2): ("beam.bending_stiffness",),
    (0, 1, 0): ("fluid.density",),
    (4, 1, -2): ("actuation.amplitude", "actuation.torque_limit"),
    (1, 0, -1): ("stream.velocity", "initial.velocity"),
    (0, 0, -1): ("actuation.frequency",),
    (0, 0, 1): (
        *("integrator.time_step", "episode.control_interval", "episode.duration"),
        "damping.retardation_time",
    ),
}


def in_units(scene: Scene, units: tuple[float, float, float]) -> Scene:
    """Return a dynamically similar scene."""
    changes = {}
    for powers, paths in POWERS.items():
        factor = float(np.prod(np.power(units, powers)))
        for path in paths:
            block, name = path.split(".")
            if getattr(scene, block) is not None:
                changes[path] = (factor * np.array(getattr(getattr(scene, block), name))).tolist()
    return scene.replace(changes)


def _torques(actions: int = 50) -> Array:
    """Return random torques, held over control intervals."""
    rows = np.random.default_rng(1).uniform(-1.0, 1.0, (actions, 8))
    return np.repeat(rows, BASE.steps_per_action, axis=0)


@pytest.mark.parametrize("model", ["strip", "frozen", "panels"])
@pytest.mark.parametrize("scheme", SCHEME_NAMES)
@each_unit
def test_bodies_of_all_sizes_take_the_same_steps(units, model, scheme) -> None:
    scene = BASE.replace({"fluid.model": model, "integrator.scheme": scheme})
    length, density, time = units
    one = rollout(scene, _torques())
    other = rollout(in_units(scene, units), _torques() * length**4 * density / time**2)
    gaps = (other.centres / length - one.centres, other.angles - one.angles)
    gap = max(float(np.abs(each).max()) for each in gaps)
    assert gap < 1e-12, f"off by {gap:.2g}"
    assert np.array_equal(other.iterations, one.iterations)
    assert other.summary()["trusted"] == one.summary()["trusted"]
    assert other.energy_drift == pytest.approx(one.energy_drift, rel=1e-9)


@each_unit
def test_agents_see_and_gain_the_same(units) -> None:
    envs = [
        SwimTargetEnv(scene, render_mode="rgb_array") for scene in (BASE, in_units(BASE, units))
    ]
    random = np.random.default_rng(2)
    seen = [env.reset(seed=3)[0] for env in envs]
    for _ in range(50):
        assert seen[1] == pytest.approx(seen[0], rel=1e-5, abs=1e-6)
        action = random.uniform(-1.0, 1.0, 8)
        seen, rewards, *_, infos = zip(*(env.step(action) for env in envs), strict=True)
        assert rewards[1] == pytest.approx(rewards[0], rel=1e-9, abs=1e-14)
        assert infos[1]["distance"] == pytest.approx(infos[0]["distance"], rel=1e-12)
    # All but the words: time and torques have units.
    frames = [np.asarray(env.render(), dtype=float)[40:-60] for env in envs]
    assert np.abs(frames[0] - 255.0).max() > 100.0
    assert (np.abs(frames[1] - frames[0]) > 2.0).mean() < 1e-4
    assert envs[1].metadata["render_fps"] in (50, round(50 / units[2]))


@pytest.mark.parametrize("task", TASKS)
@each_unit
def test_tasks_reward_the_same(units, task) -> None:
    one, other = (SwimEnv(scene, task=task) for scene in (BASE, in_units(BASE, units)))
    random, total = np.random.default_rng(2), 0.0
    for env in (one, other):
        env.reset(seed=3)
    for _ in range(50):
        action = random.uniform(-1.0, 1.0, 8)
        (_, here, *_), (_, there, *_) = one.step(action), other.step(action)
        assert there == pytest.approx(here, rel=1e-7, abs=1e-12)
        total += abs(here)
    assert total > 0.01


def test_noise_and_rates_of_the_shipped_scene_are_what_agents_were_trained_with() -> None:
    scene = load_scene("swimmer")
    assert scene.episode.velocity_noise is None
    explicit, default = (
        SwimTargetEnv(scene, {"episode.velocity_noise": noise}) for noise in (1e-5, None)
    )
    assert np.array_equal(explicit.reset(seed=0)[0], default.reset(seed=0)[0])
    start = {"velocity": (-0.1, 0.0), "joint_angles": [0.0] * 8, "heading": 0.0}
    seen, _ = default.reset(seed=0, options=start)
    assert seen[18] == pytest.approx(1.0, rel=1e-6)


@each_unit
def test_settings_are_chosen_alike(units) -> None:
    scene = BASE.replace({"stream": None, "cross_flow_drag": None, "initial": {}})
    one, other = (choose(each, 0.1, keep_elements=True) for each in (scene, in_units(scene, units)))
    assert other.settings.time_step == pytest.approx(units[2] * one.settings.time_step, rel=1e-9)
    assert other.error == pytest.approx(one.error, rel=1e-6)
    assert (other.tried, other.cost) == (one.tried, one.cost)


@each_unit
def test_solvers_in_continuous_time_take_the_same_steps(units) -> None:
    scene = BASE.replace({"fluid.model": "strip"})
    one, other = (
        integrate(each, 0.1 * time)
        for each, time in ((scene, 1.0), (in_units(scene, units), units[2]))
    )
    assert other.path / units[0] == pytest.approx(one.path, rel=1e-8)
    # Rounding decides some of their steps.
    assert other.evaluations == pytest.approx(one.evaluations, rel=0.05)


@each_unit
def test_frames_and_the_search_for_waves_follow_the_bodys_own_time(units, tmp_path) -> None:
    # With three steps in an action.
    base = BASE.replace("integrator.time_step", BASE.episode.control_interval / 3)
    scenes = base, in_units(base, units)
    time = units[2]
    assert scenes[1].frame_interval == pytest.approx(scenes[0].frame_interval * time, rel=1e-12)
    torques = np.repeat(_torques()[:: BASE.steps_per_action], 3, axis=0)
    runs = [rollout(scene, torques * scene.torque_limit) for scene in scenes]
    chosen = [frames_of(run, None).tolist() for run in runs]
    assert chosen[0] == chosen[1] == list(range(0, 151, 3))
    # Twice as many frames would be one in one and a half steps, and rounding must not decide.
    chosen = [frames_of(run, None, 2.0).tolist() for run in runs]
    assert chosen[0] == chosen[1] == list(range(151))
    assert [len(tail(run.torques, run, None)) for run in runs] == [150, 150]
    first, _ = draw_energy({"a": runs[0]}).axes[:2], draw_energy({"a": runs[1]})
    assert "last 1 s" in first[0].get_title(loc="left")
    files = []
    for number, run in enumerate(runs):
        files.append(write_recording(tmp_path / f"{number}.rrd", [Swimmer("x", run)]))
    assert [(one.frames, one.flow_frames) for one in files] == [(51, 26)] * 2
    read = read_recording(tmp_path / "1.rrd").swimmers["x"]
    assert read.time == pytest.approx(runs[1].time[::3], rel=1e-6, abs=1e-9)
    here, there = (np.array(_grid(scene, None, None)[0]) for scene in scenes)
    assert there * time == pytest.approx(here, rel=1e-12)


def test_shipped_scenes_have_fifty_frames_a_second() -> None:
    for name in scene_names():
        assert load_scene(name).frame_interval == 0.02


@pytest.mark.parametrize("units", [(2.0, 1.0, 1.0), (2.0, 3.0, 0.5), (1e-3, 100.0, 7.0)], ids=str)
def test_an_agent_plays_on_a_similar_body_as_on_its_own(units) -> None:
    scene = load_scene("swimmer", {"episode.duration": 4.0})
    policy = load_policy("ppo_forward")
    own, other = (
        play_episode(SwimEnv(one), policy, seed=5) for one in (scene, in_units(scene, units))
    )
    assert own.net_displacement > 0.3
    # Observations have single precision.
    assert other.net_displacement == pytest.approx(own.net_displacement, rel=1e-4)
    for field in ("beam.bending_stiffness", "actuation.torque_limit", "fluid.density"):
        unlike = in_units(scene, units)
        block, name = field.split(".")
        unlike = unlike.replace(field, 1.01 * getattr(getattr(unlike, block), name))
        with pytest.raises(AgentError, match="was trained on scene swimmer"):
            play_episode(SwimEnv(unlike), policy, seed=5)


@each_unit
def test_what_a_body_sets_for_itself_is_similar(units) -> None:
    automatic = dict.fromkeys(
        (
            *("integrator.time_step", "episode.control_interval", "episode.duration"),
            *("damping.retardation_time", "actuation.torque_limit", "actuation.frequency"),
        ),
        "auto",
    )
    here = load_scene("swimmer", automatic)
    there = in_units(load_scene("swimmer"), units).replace(automatic)
    expected = in_units(here, units)
    for path in automatic:
        block, name = path.split(".")
        values = (getattr(getattr(scene, block), name) for scene in (there, expected))
        assert next(values) == pytest.approx(next(values), rel=1e-9), path


def test_fast_drives_have_as_many_frames_in_a_period_whatever_the_control_interval() -> None:
    fast = load_scene("swimmer", {"actuation.frequency": 2000.0 * np.pi})
    assert fast.frame_interval == pytest.approx(1e-3 / 10, rel=1e-12)
    assert load_scene("swimmer", {"actuation.frequency": 30.0}).frame_interval == 0.02
    brief = rollout(load_scene("swimmer", {"integrator.time_step": 1e-10}), np.zeros((2, 8)))
    with refuses(OptionError, "recordings count nanoseconds", "at most 1e9 frames in a second"):
        frames_of(brief, 1e10)
