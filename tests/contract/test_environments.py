"""What the single and the batched environments promise alike: seeds, snapshots, refusals, limits.

Bad actions are in tests/stability/test_bad_actions.py.
"""

import copy
import hashlib
import inspect
import math
import pickle
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
import scipy._lib.array_api_compat
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeAwareObservation
from numpy.typing import NDArray

from swim_env import (
    TERMINATION_CODES,
    TERMINATION_REASONS,
    ActionError,
    OptionError,
    SceneError,
    SimulationEndedError,
    SwimEnv,
    SwimError,
    SwimVectorEnv,
    load_scene,
)
from tests.support import (
    FORWARD,
    LIVELY,
    ROOT,
    SMALL,
    TARGET,
    TASKS,
    assert_same,
    each_task,
    make,
    make_batch,
    make_singles,
    refuses,
    run_python,
    uniform,
)

Array = NDArray[np.float64]
Build = Callable[..., Any]

KINDS: dict[str, Build] = {"single": make, "batch": make_batch}
MODES: dict[str, Build] = {
    "single": make,
    **{mode.name: partial(make_batch, autoreset_mode=mode) for mode in AutoresetMode},
}
each_kind = pytest.mark.parametrize("build", KINDS.values(), ids=KINDS)
each_mode = pytest.mark.parametrize("build", MODES.values(), ids=MODES)


def actions_for(env: SwimEnv | SwimVectorEnv, count: int, seed: int = 0) -> Array:
    return uniform(count, *env.action_space.shape, seed=seed)


def play(env: SwimEnv | SwimVectorEnv, actions: Any) -> list[Any]:
    """Step through actions; where nobody else starts what has ended anew, this does."""
    results: list[Any] = []
    for action in actions:
        step = env.step(action)
        results.append(step)
        over = step[2] | step[3]
        if isinstance(env, SwimEnv):
            if over:
                results.append(env.reset())
        elif env.autoreset_mode is AutoresetMode.DISABLED and over.any():
            results.append(env.reset(options={"reset_mask": over}))
    return results


def ends_in(results: list[Any]) -> int:
    return sum(int(np.sum(step[2] | step[3])) for step in results if len(step) == 5)


# ---- seeds, snapshots, copies ------------------------------------------------------------------


def digest(seed: int) -> str:
    """Return a hash of episodes of all environments from a seed."""
    sha = hashlib.sha256()
    for task in TASKS:
        for build in KINDS.values():
            env = build(task, overrides={"episode.duration": 0.24})
            sha.update(env.reset(seed=seed)[0].tobytes())
            with np.printoptions(precision=17):
                sha.update(repr(play(env, actions_for(env, 30))).encode())
    return sha.hexdigest()


def test_the_same_seed_gives_the_same_bits_in_a_fresh_process():
    code = "from tests.contract.test_environments import digest; print(digest(5))"
    there = run_python("-c", code, PYTHONHASHSEED="1", NUMBA_NUM_THREADS="1")
    assert there.out.strip() == digest(5), there.err
    assert digest(6) != digest(5), "the digest does not see the seed"


@each_kind
@each_task
def test_seeds_decide_and_different_ones_differ(build, task):
    env = build(task, overrides=SMALL)
    first = [env.reset(seed=1), env.reset(), env.reset()]
    assert_same([env.reset(seed=1), env.reset(), env.reset()], first)
    starts = {start[0].tobytes() for start in (*first, env.reset(seed=2), env.reset(seed=0))}
    assert len(starts) == 5
    assert env.reset(seed=2**70)[0] in env.observation_space
    assert len({build(task, overrides=SMALL).reset()[0].tobytes() for _ in range(3)}) == 3


@each_mode
@each_task
def test_a_snapshot_continues_bit_for_bit(build, task):
    """In the same environment and in others, through ends, with the random numbers to come."""
    new = partial(build, task, overrides={**LIVELY, "episode.duration": 0.7}, heading_weight=0.2)
    env, others = new(), (new(num_threads=1) if build is not make else new(), new())
    env.reset(seed=8)
    play(env, actions_for(env, 10))
    snapshot = env.snapshot()
    kept = pickle.dumps(snapshot)
    observation = env.restore(snapshot)
    actions = actions_for(env, 120, seed=77)
    following = [play(env, actions), env.reset()]
    assert ends_in(following[0]) >= 2
    for seed, other in enumerate(others):
        other.reset(seed=seed)
        play(other, actions[:4])
    for each in (env, *others):
        assert_same(each.restore(pickle.loads(kept)), observation)
        assert_same([play(each, actions), each.reset()], following)
    assert_same(env.restore(snapshot), observation)
    assert_same([play(env, actions), env.reset()], following)


@each_kind
@pytest.mark.parametrize(
    ("task", "other_task", "arguments"),
    [
        (FORWARD, TARGET, {}),
        (FORWARD, FORWARD, {"overrides": {"beam.bending_stiffness": 5.1}}),
        (FORWARD, FORWARD, {"overrides": {"episode.duration": 19.0}}),
        (FORWARD, FORWARD, {"effort_weight": 0.1}),
        (FORWARD, FORWARD, {"heading_weight": 0.1}),
        (TARGET, TARGET, {"target_distance": (0.6, 1.5)}),
        (TARGET, TARGET, {"target_bearing": 1.0}),
        (TARGET, TARGET, {"target_radius": 0.2}),
    ],
    ids=str,
)
def test_a_snapshot_of_another_environment_is_refused(build, task, other_task, arguments):
    env, other = build(task), build(other_task, **arguments)
    env.reset(seed=0)
    other.reset(seed=0)
    with refuses(SwimError, "snapshot", leaving=env):
        env.restore(other.snapshot())


@each_kind
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_bit_for_bit_on_its_own(build, duplicate):
    env = build(overrides={**LIVELY, "episode.duration": 0.7})
    env.reset(seed=3)
    play(env, actions_for(env, 5))
    other = duplicate(env)
    following = play(env, actions_for(env, 120, seed=1))
    assert ends_in(following)
    assert_same(play(other, actions_for(env, 120, seed=1)), following)
    # The two share nothing.
    other.reset(seed=0)
    third = copy.deepcopy(env)
    action = actions_for(env, 1)[0]
    other.step(-action)
    assert_same(env.step(action), third.step(action))


# ---- arrays in and out -------------------------------------------------------------------------


def spoil(value: Any) -> None:
    """Overwrite all that can be written to in what an environment returned."""
    if isinstance(value, dict):
        for item in value.values():
            spoil(item)
    elif isinstance(value, tuple):
        for item in value:
            spoil(item)
    elif isinstance(value, np.ndarray):
        if not value.flags.writeable:
            assert value.dtype == object or value.all()  # masks, and no reasons
        elif value.dtype == np.bool_:
            value[:] = ~value
        elif value.dtype != object:
            value[:] = 12345


@each_mode
@each_task
def test_arrays_belong_to_the_caller(build, task):
    """Results that are kept stay as they were; what the caller overwrites spoils nothing."""
    env, twin = (build(task, overrides={**LIVELY, "episode.duration": 0.2}) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
    kept: list[tuple[Any, Any]] = []
    for action in actions_for(env, 25):
        given = action.copy()
        kept += [(result, copy.deepcopy(result)) for result in play(env, [given])]
        given[:] = np.nan
        play(twin, [action])
    for result, then in kept:
        assert_same(result, then)
        spoil(result)
    spoil(env.restore(env.snapshot()))
    assert_same(play(env, [action]), play(twin, [action]))
    spoil(env.reset(seed=1))
    twin.reset(seed=1)
    assert_same(play(env, [action]), play(twin, [action]))


def tensor(kind: str) -> Callable[[Array], Any]:
    def form(action: Array) -> Any:
        torch = pytest.importorskip("torch")
        return torch.tensor(action.copy(), dtype=getattr(torch, kind))

    return form


FORMS: dict[str, Callable[[Array], Any]] = {
    "read-only": lambda action: np.broadcast_to(action, action.shape),
    "strided": lambda action: np.repeat(action, 2, axis=-1)[..., ::2],
    "reversed": lambda action: action[::-1].copy()[::-1],
    "fortran": np.asfortranarray,
    "big-endian": lambda action: action.astype(">f8"),
    "half": lambda action: action.astype(np.float16),
    "long double": lambda action: action.astype(np.longdouble),
    "list": lambda action: action.tolist(),
    "tuple": tuple,
    "list of halves": lambda action: list(action.astype(np.float16)),
    "small integers": lambda action: np.sign(action).astype(np.int8),
    "integers": lambda action: np.sign(action).astype(np.int64),
    "large bytes": lambda action: np.full_like(action, 200, dtype=np.uint8),
    **{kind: tensor(kind) for kind in ("float16", "float32", "float64")},
}


@each_kind
@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_all_forms_of_the_same_numbers_do_the_same(build, form):
    env, twin = (build(overrides={"fluid": None}) for _ in range(2))
    shape = env.action_space.shape
    action = np.linspace(-1.0, 0.75, math.prod(shape)).reshape(shape)
    action = action.astype(np.float16).astype(np.float64)
    for each in (env, twin):
        each.reset(seed=0)
    given = form(action)
    for _ in range(2):
        assert_same(env.step(given), twin.step(np.asarray(given, dtype=np.float64)))


@each_kind
def test_a_tensor_with_a_gradient_is_refused_as_an_action_error(build):
    torch = pytest.importorskip("torch")
    env = build(overrides={"fluid": None})
    env.reset(seed=0)
    with refuses(ActionError, "action", leaving=env):
        env.step(torch.zeros(env.action_space.shape, requires_grad=True))


# ---- limits and ends ---------------------------------------------------------------------------


@each_kind
@each_task
@pytest.mark.parametrize(
    ("duration", "limit"), [(0.1, 5), (0.02, 1), (0.001, 1), (0.3, 15), (0.13, 6), (0.15, 8)]
)
def test_the_time_limit_is_met_exactly(build, task, duration, limit):
    env = build(task, overrides={**SMALL, "episode.duration": duration})
    for _ in range(2):
        env.reset()
        for count in range(1, limit + 1):
            _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
            assert not np.any(terminated)
            np.testing.assert_array_equal(truncated, np.full_like(truncated, count == limit))
        assert not np.any(np.asarray(info["termination_reason"]) != "")


# ---- what clients of Gymnasium rely on ----------------------------------------------------------

#: Five actions to an episode.
SHORT: dict[str, object] = {**SMALL, "episode.duration": 0.1}


@pytest.mark.parametrize("mode", [None, "vector_entry_point", "sync", "async"])
@pytest.mark.parametrize("task", TASKS, ids=("forward", "target"))
@pytest.mark.parametrize(("given", "limit"), [(None, 5), (3, 3), (8, 8), (-1, 10**9)])
def test_max_episode_steps_is_met_exactly_and_told(task, mode, given, limit):
    arguments: dict[str, Any] = {"overrides": SHORT}
    if given is not None:
        arguments["max_episode_steps"] = given
    if mode is None:
        env = gymnasium.make(task, **arguments)
        assert env.spec.max_episode_steps == env.unwrapped.spec.max_episode_steps == limit
        for wrapped in (env, gymnasium.make(env.spec)):
            observation, _ = TimeAwareObservation(wrapped).reset(seed=0)
            assert observation.size == env.observation_space.shape[0] + 1
    else:
        env = gymnasium.make_vec(task, 2, mode, **arguments)
        if mode != "async":
            assert [spec.max_episode_steps for spec in env.get_attr("spec")] == [limit] * 2
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape)
    ends = [bool(np.all(env.step(still)[3])) for _ in range(min(limit, 12))]
    assert ends == [step == limit for step in range(1, len(ends) + 1)]
    env.close()


@pytest.mark.parametrize("as_text", [False, True])
def test_a_spec_that_is_made_again_for_another_scene_has_that_ones_limit(as_text):
    def kept(spec: EnvSpec) -> EnvSpec:
        return EnvSpec.from_json(spec.to_json()) if as_text else spec

    longer = {**SHORT, "episode.duration": 0.2}
    env = gymnasium.make(FORWARD, overrides=SHORT)
    assert env.spec.max_episode_steps == 5
    for spec in (env.spec, gymnasium.make_vec(FORWARD, 2, overrides=SHORT).spec):
        again = gymnasium.make_vec(kept(spec), 2, "vector_entry_point", overrides=longer)
        assert again.episodes.limit == again.spec.max_episode_steps == 10
    # Gymnasium puts a wrapper with the spec's own number around a single environment.
    for duration, limit in ((0.2, 10), (0.06, 3)):
        changed = {**SHORT, "episode.duration": duration}
        with refuses(OptionError, "the spec has 5 actions", f"max_episode_steps={limit}"):
            gymnasium.make(kept(env.spec), overrides=changed)
        again = gymnasium.make(kept(env.spec), overrides=changed, max_episode_steps=limit)
        assert again.unwrapped.episodes.limit == again.spec.max_episode_steps == limit
    same = gymnasium.make(kept(env.spec), overrides={**SHORT, "beam.length": 2.0})
    assert same.spec.max_episode_steps == 5
    # A number of the user's own stays.
    mine = gymnasium.make(FORWARD, overrides=SHORT, max_episode_steps=7).spec
    assert gymnasium.make(kept(mine), overrides=longer).unwrapped.episodes.limit == 7
    assert gymnasium.make_vec(kept(mine), 2, overrides=longer).episodes.limit == 7


@each_kind
def test_an_episode_of_a_snapshot_ends_when_the_original_does(build):
    original, other = build(overrides=SHORT), build(overrides=SHORT, max_episode_steps=50)
    for env in (original, other):
        env.reset(seed=0)
    action = actions_for(original, 1)[0]
    original.step(action)
    other.restore(pickle.loads(pickle.dumps(original.snapshot())))
    ends = [[bool(np.all(env.step(action)[3])) for _ in range(4)] for env in (original, other)]
    assert ends == [[False, False, False, True]] * 2
    # In later episodes too.
    for env in (original, other):
        env.reset(seed=1)
    ends = [[bool(np.all(env.step(action)[3])) for _ in range(5)] for env in (original, other)]
    assert ends == [[False, False, False, False, True]] * 2
    assert other.unwrapped.episodes.limit == other.unwrapped.spec.max_episode_steps == 5
    batch = make_batch(overrides=SHORT, max_episode_steps=50)
    batch.reset(seed=0)
    single = gymnasium.make_vec(FORWARD, 1, overrides=SHORT)
    single.reset()
    single.restore(batch.snapshot().member(1))
    assert single.episodes.limit == single.spec.max_episode_steps == 50
    longer = gymnasium.make_vec(single.spec, overrides={**SHORT, "episode.duration": 0.2})
    assert longer.episodes.limit == 50


def test_a_limit_of_its_own_and_of_its_spec_count_for_an_environment_without_wrappers():
    env = SwimEnv(overrides=SHORT, max_episode_steps=7)
    assert env.episodes.limit == 7 and env.spec is None
    env.spec = gymnasium.envs.registration.EnvSpec(FORWARD, max_episode_steps=2)
    env.reset(seed=0)
    assert [env.step(np.zeros(2))[3] for _ in range(2)] == [False, True]


GIVEN_SCENES: dict[str, Callable[[], dict[str, Any]]] = {
    "a scene": lambda: {"scene": load_scene("paper_ii", SHORT)},
    "a mapping": lambda: {"scene": load_scene("paper_ii", SHORT).to_dict()},
    "a name": lambda: {"scene": "paper_ii", "overrides": SHORT},
    "texts": lambda: {"overrides": ("beam.elements=3", "episode.duration=0.1")},
    "an iterator": lambda: {"overrides": iter(["beam.elements=3", "episode.duration=0.1"])},
    "a path": lambda: {"scene": ROOT / "configs" / "scenes" / "paper_ii.yaml"},
    "numbers of NumPy": lambda: {
        "effort_weight": np.float32(0.5),
        "overrides": {"beam.elements": np.int8(3)},
    },
}


@pytest.mark.parametrize("arguments", GIVEN_SCENES.values(), ids=GIVEN_SCENES)
def test_a_spec_becomes_text_and_the_same_environment_again(arguments):
    env = gymnasium.make(FORWARD, max_episode_steps=9, **arguments())
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec == env.spec
    assert again.unwrapped.task.identity == env.unwrapped.task.identity
    assert again.unwrapped.episodes.limit == 9


def test_a_spec_of_a_batch_becomes_text_and_the_same_batch_again():
    scene = load_scene("paper_ii", SHORT)
    given = {"target_distance": (0.5, 0.75), "autoreset_mode": AutoresetMode.SAME_STEP}
    envs = make_batch(TARGET, 3, scene=scene, max_episode_steps=9, num_threads=1, **given)
    again = gymnasium.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert again.spec == envs.spec
    assert again.task.identity == envs.task.identity
    assert (again.num_envs, again.autoreset_mode) == (3, AutoresetMode.SAME_STEP)
    assert again.episodes.limit == 9


def test_reasons_have_numbers_which_libraries_without_text_get(monkeypatch):
    torch = pytest.importorskip("torch")
    # SciPy's copy of what gymnasium's extra array-api installs.
    monkeypatch.setitem(sys.modules, "array_api_compat", scipy._lib.array_api_compat)
    from gymnasium.wrappers.vector import NumpyToTorch

    assert TERMINATION_CODES[0] == "" and set(TERMINATION_CODES.values()) - {""} == set(
        TERMINATION_REASONS
    )
    plain, envs = (make_batch(FORWARD, 3, overrides=LIVELY) for _ in range(2))
    converted = NumpyToTorch(envs)
    mask = {"reset_mask": np.array([False, True, False])}
    reasons = set()
    for action in [None, *actions_for(plain, 150), mask]:
        if action is None or action is mask:
            infos, tensors = (one.reset(seed=0, options=action)[1] for one in (plain, converted))
        else:
            infos, tensors = plain.step(action)[4], converted.step(torch.as_tensor(action))[4]
        codes = infos["termination_code"]
        assert codes.dtype == np.int64
        texts = [text or "" for text in infos["termination_reason"]]
        assert texts == [TERMINATION_CODES[code] for code in codes]
        assert tensors.keys() == infos.keys()
        for name in ("termination_code", "termination_reason"):
            assert tensors[name].tolist() == codes.tolist()
        reasons |= set(texts)
    assert len(reasons) > 1


class NumbersOnly(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The wrapper that docs/environments/interface.md shows."""

    def reset(self, **arguments):
        observation, info = self.env.reset(**arguments)
        info.pop("termination_reason")
        return observation, info

    def step(self, action):
        *result, info = self.env.step(action)
        info.pop("termination_reason")
        return *result, info


@pytest.mark.parametrize("kind", ["ours", "sync"])
def test_episodes_end_and_begin_behind_a_conversion_to_tensors(monkeypatch, kind):
    torch = pytest.importorskip("torch")
    monkeypatch.setitem(sys.modules, "array_api_compat", scipy._lib.array_api_compat)
    from gymnasium.wrappers.vector import NumpyToTorch

    text = (ROOT / "docs" / "environments" / "interface.md").read_text(encoding="utf-8")
    assert inspect.getsource(NumbersOnly).split('"""')[2].strip() in text
    if kind == "ours":
        modes = list(AutoresetMode)[:2]
        batches = [make_batch(FORWARD, 3, overrides=SHORT, autoreset_mode=mode) for mode in modes]
    else:
        wrapped = {"vectorization_mode": "sync", "wrappers": [NumbersOnly]}
        batches = [gymnasium.make_vec(FORWARD, 3, **wrapped, overrides=SHORT)]
    for envs in batches:
        converted = NumpyToTorch(envs)
        first, _ = converted.reset(seed=0)
        seen: set[str] = set()
        for _ in range(12):
            observations, _, _, truncated, infos = converted.step(torch.zeros(3, 2))
            assert observations.shape == first.shape and torch.is_tensor(truncated)
            seen |= infos.keys()
            if "final_obs" in infos:
                assert infos["final_obs"].shape == first.shape
                assert infos["_final_obs"].all() and infos["final_obs"].any()
        same_step = envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        assert ("final_obs" in seen) == same_step and "termination_code" in seen
        converted.close()


def test_last_observations_of_members_that_play_on_are_zeros_for_other_libraries():
    batch = make_batch(overrides=LIVELY, autoreset_mode=AutoresetMode.SAME_STEP)
    batch.reset(seed=0)
    for action in actions_for(batch, 150):
        *_, infos = batch.step(action)
        last = infos.get("final_obs")
        if last is not None and not infos["_final_obs"].all():
            break
    assert last.dtype == object
    numbers = np.from_dlpack(last)
    assert numbers.dtype == np.float32
    for found, one in zip(numbers, last, strict=True):
        assert_same(found, np.zeros_like(found) if one is None else one)


def test_integral_floats_are_integers_wherever_one_is_taken():
    for four in (4, 4.0, np.float64(4), np.float32(4), np.int8(4), np.array(4)):
        scene = load_scene("swimmer", {"beam.elements": four, "fluid.panels_per_element": four})
        assert type(scene.beam.elements) is int and scene.beam.elements == 4
        assert scene.fluid.panels_per_element == 4
        envs = make_batch(FORWARD, four, scene=scene, num_threads=four, max_episode_steps=four)
        assert (envs.num_envs, envs.episodes.limit, envs.num_threads) == (4, 4, 4)
        env = SwimEnv(scene, num_threads=four, max_episode_steps=four)
        assert_same(envs.reset(seed=four)[0][0], env.reset(seed=4)[0])
        assert_same(envs.reset(seed=[4, 1.0, four, None])[0][2], env.reset(seed=four)[0])
    for seeds in (range(4), (0, 1, 2, 3), np.arange(4)):
        assert_same(envs.reset(seed=seeds)[0], envs.reset(seed=0)[0])
    for number in (0.25, np.float32(0.25), np.array(0.25)):
        assert load_scene("swimmer", {"beam.length": number}).beam.length == 0.25
        assert load_scene("swimmer", {"beam.bending_stiffness": number}).beam.bending_stiffness
        assert SwimEnv(overrides=SHORT, effort_weight=number).task.effort_weight == 0.25
        env.reset(seed=0, options={"noise": number, "heading": number})


@pytest.mark.parametrize("task", TASKS, ids=("forward", "target"))
def test_attributes_of_members_are_those_of_gymnasiums_own_batch(task):
    ours, theirs = make_batch(task, 3, overrides=SHORT), make_singles(task, 3, overrides=SHORT)
    for envs in (ours, theirs):
        envs.reset(seed=0)
        envs.step(actions_for(ours, 1)[0])
    own = ("coordinates", "velocity", "torques", "goal", "steps", "snapshot")
    for name in (*own, "render_mode", "metadata", "action_space", "observation_space", "scene"):
        for call in ("call", "get_attr"):
            found, expected = (getattr(envs, call)(name) for envs in (ours, theirs))
            assert type(found) is tuple
            assert_same(found, expected, name) if name in own else None
            assert name in own or found == expected
    assert_same(
        [one.bit_generator.state for one in ours.get_attr("np_random")],
        [one.bit_generator.state for one in theirs.get_attr("np_random")],
    )
    ours.set_attr("render_mode", "rgb_array")
    assert ours.get_attr("render_mode") == ("rgb_array",) * 3
    assert_same(ours.call("render"), ours.render())
    ours.set_attr("render_mode", [None] * 3)
    assert ours.render_mode is None
    for name, value in (("render_mode", ["human", None, None]), ("render_mode", [None] * 2)):
        with refuses(OptionError, "all members share render_mode"):
            ours.set_attr(name, value)
    ours.set_attr("render_mode", np.array(["rgb_array"] * 3))
    assert ours.render_mode == "rgb_array"
    for value in (np.zeros(3), np.zeros((3, 2)), 5, np.array(5.0), ["human", 5, None]):
        with refuses(OptionError, "unknown render_mode"):
            ours.set_attr("render_mode", value)
    for value in (5, "x", np.zeros(3), [None, 5, None]):
        with refuses(OptionError, "spec must be an EnvSpec of Gymnasium or None"):
            ours.set_attr("spec", value)
        with refuses(OptionError, "spec must be an EnvSpec of Gymnasium or None"):
            SwimEnv(overrides=SHORT).spec = value
    with refuses(SwimError, "random numbers need an episode: call reset first"):
        make_batch(task, 3, overrides=SHORT).get_attr("np_random")
    for name in ("scene", "goal", "episodes", "step"):
        with refuses(AttributeError, f"{name} of a batch cannot be set"):
            ours.set_attr(name, None)
    for name in ("step", "reset", "episodes", "no_such_name"):
        with refuses(AttributeError, f"no attribute {name!r}; it has", "coordinates"):
            ours.call(name)


@each_kind
def test_resetting_twice_and_closing_twice_do_no_harm(build):
    env, twin = build(overrides=SMALL), build(overrides=SMALL)
    env.reset(seed=0)
    for each in (env, twin):
        each.reset(seed=0)
    action = actions_for(env, 1)[0]
    assert_same(env.step(action), twin.step(action))
    env.close()
    env.close()
    assert getattr(env, "closed", True)


# ---- bad starts --------------------------------------------------------------------------------

#: Options of a reset, whatever the task and the kind of environment, and what a refusal says.
BAD_OPTIONS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "a list": ([], ("options must be a mapping", "list")),
    "text": ("noise", ("options must be a mapping", "noise")),
    "a number": (3, ("options must be a mapping", "3")),
    "a typing error": ({"nois": 1.0}, ("unknown option 'nois'", "nearest: noise")),
    "a capital": ({"Heading": 1.0}, ("unknown option 'Heading'", "heading")),
    "a key that is no text": ({1: 1.0}, ("unknown option 1", "noise")),
    "another task's": ({"target": (1, 1)}, ("unknown option 'target'",)),
    "negative noise": ({"noise": -0.1}, ("noise must be at least 0", "-0.1")),
    "noise as text": ({"noise": "1"}, ("noise must be a number", "'1'")),
    "noise as bool": ({"noise": True}, ("noise must be a number", "true")),
    "noise as nothing": ({"noise": None}, ("noise must be a number",)),
    "noise not finite": ({"noise": math.inf}, ("noise must be a finite number", "inf")),
    "heading as text": ({"heading": "north"}, ("heading must be a number in rad", "north")),
    "heading as nan": ({"heading": math.nan}, ("heading must be a finite number", "nan")),
    "position as number": ({"position": 3.0}, ("position must be two numbers", "3.0")),
    "position of three": ({"position": (1, 2, 3)}, ("position must be two numbers", "3")),
    "few joint angles": ({"joint_angles": (0.1,)}, ("joint_angles", "8", "got 1")),
    "joint angle as text": ({"joint_angles": ["a"] * 8}, ("joint_angles[0]", "'a'")),
    "velocity as text": ({"velocity": "fast"}, ("velocity must be two numbers", "fast")),
    "a spin that tears": ({"turning_rate": 1.0}, ("turning_rate", "inextensibility")),
    "good and bad": ({"heading": 0.5, "noise": "x"}, ("noise must be a number",)),
}
BAD_TARGETS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "one number": (1.0, ("target must be two numbers", "1.0")),
    "three numbers": ((1, 2, 3), ("target must be two numbers", "3")),
    "letters": ("ab", ("target must be two numbers", "ab")),
    "nan": ((math.nan, 0.0), ("target[0] must be a finite number in m", "nan")),
    "nothing": (None, ("target must be two numbers",)),
    "bools": ((True, False), ("target[0] must be a number", "true")),
}
MASK = np.array([True, False, True])
#: What only a batch of three takes.
BAD_MASKS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "with an error": ({"reset_mask": MASK, "nois": 1}, ("unknown option 'nois'",)),
    "a list": ({"reset_mask": [True] * 3}, ("reset_mask", "3 bools")),
    "numbers": ({"reset_mask": np.ones(3)}, ("reset_mask", "3 bools")),
    "many numbers": ({"reset_mask": np.ones(64)}, ("reset_mask", "3 bools")),
    "many bools": ({"reset_mask": [True] * 64}, ("reset_mask", "3 bools")),
    "long": ({"reset_mask": np.ones(4, dtype=bool)}, ("reset_mask", "3 bools")),
    "deep": ({"reset_mask": np.ones((3, 1), dtype=bool)}, ("reset_mask", "3 bools")),
    "empty": ({"reset_mask": np.zeros(3, dtype=bool)}, ("reset_mask", "one of them")),
    "nothing": ({"reset_mask": None}, ("reset_mask", "None")),
}
BAD_SEEDS: list[Any] = ["1", 1.5, math.nan, -1, True, np.True_, np.array(1.5), {}, []]
BAD_SEEDS_OF_ONE: list[Any] = [[1], ()]
BAD_SEEDS_OF_THREE: list[Any] = [
    *([1, 2], [1, 2, 3, 4], [1, 2.5, 3], [1, "2", 3], [1, -2, 3], [True, 2, 3]),
    *(np.array([1.0, 2.5, 3.0]), np.array([-1, 2, 3])),
]
BAD_SEED = (gymnasium.error.Error, OptionError)
FOLDED: list[dict[str, Any]] = [{"joint_angles": 2.9}, {"velocity": (1e200, 0.0)}]


def _bad_starts() -> dict[str, tuple[Build, str, Any, dict[str, Any], tuple[str, ...]]]:
    cases: dict[str, Any] = {}
    single_only = {"a mask": ({"reset_mask": np.array([True])}, ("unknown option 'reset_mask'",))}
    for kind, build, own_options, own_seeds in (
        ("single", make, single_only, BAD_SEEDS_OF_ONE),
        ("batch", make_batch, BAD_MASKS, BAD_SEEDS_OF_THREE),
    ):
        for name, (options, parts) in {**BAD_OPTIONS, **own_options}.items():
            given = {"seed": 5, "options": options}
            cases[f"{kind}: {name}"] = (build, FORWARD, OptionError, given, parts)
        for name, (target, parts) in BAD_TARGETS.items():
            given = {"options": {"target": target}}
            cases[f"{kind}: target {name}"] = (build, TARGET, OptionError, given, parts)
        for seed in (*BAD_SEEDS, *own_seeds):
            given = {"seed": seed}
            cases[f"{kind}: seed {seed!r}"] = (build, FORWARD, BAD_SEED, given, ("eed must be",))
        for options in FOLDED:
            for start in (None, 5):
                given = {"seed": start, "options": options}
                name = f"{kind}: {options} from {start}"
                cases[name] = (build, FORWARD, SimulationEndedError, given, ("t = 0 s",))
    return cases


BAD_STARTS = _bad_starts()


@pytest.mark.parametrize("name", BAD_STARTS)
def test_a_bad_start_is_refused_and_changes_nothing(name):
    """Neither in the middle of an episode nor in the very first call."""
    build, task, error, arguments, parts = BAD_STARTS[name]
    env, twin = build(task), build(task)
    with refuses(error):
        env.reset(**arguments)
    action = np.linspace(-1.0, 1.0, math.prod(env.action_space.shape))
    action = action.reshape(env.action_space.shape)
    with refuses(gymnasium.error.ResetNeeded, "reset"):
        env.step(action)
    for each in (env, twin):
        each.reset(seed=0)
        each.step(action)
    with refuses(error, *parts, leaving=env):
        env.reset(**arguments)
    assert_same(env.step(-action), twin.step(-action))
    assert_same(env.reset(), twin.reset())


# ---- bad arguments -----------------------------------------------------------------------------

#: Arguments, values that they cannot have, and what is said of them.
Arguments = list[tuple[str, Any, tuple[str, ...]]]
BAD_ARGUMENTS: Arguments = [
    ("scene", "swimer", ("unknown scene 'swimer'", "nearest: swimmer")),
    ("scene", "no/such/scene.yaml", ("no such scene file", "no/such/scene.yaml")),
    ("scene", None, ("scene", "NoneType")),
    ("overrides", ["beam.element=9"], ("beam.element", "beam.elements")),
    *(
        (
            "overrides",
            {"episode.control_interval": value},
            ("episode.control_interval", "0.005", str(value)),
        )
        for value in (0.012, 0.001)
    ),
    ("overrides", {"episode.heading": (2.0, 0.0)}, ("episode.heading", "unit vector")),
    ("effort_weight", -0.1, ("effort_weight must be at least 0", "-0.1")),
    ("effort_weight", math.nan, ("effort_weight must be a finite number", "nan")),
    ("effort_weight", "1", ("effort_weight must be a number", "'1'")),
    ("effort_weight", True, ("effort_weight must be a number", "true")),
    ("heading_weight", -1, ("heading_weight must be at least 0", "-1")),
    ("heading_weight", None, ("heading_weight must be a number",)),
    ("heading_weight", math.inf, ("heading_weight must be a finite number", "inf")),
]
BAD_TARGET_ARGUMENTS: Arguments = [
    ("target_distance", 1.0, ("target_distance", "1.0")),
    ("target_distance", (1.0,), ("target_distance must be two numbers", "[1.0]")),
    ("target_distance", (1.0, 2.0, 3.0), ("target_distance must be two numbers",)),
    ("target_distance", (2.0, 1.0), ("target_distance", "[2.0, 1.0]")),
    ("target_distance", (0.1, 1.0), ("target_distance", "target_radius")),
    ("target_distance", (-1.0, 1.0), ("target_distance", "[-1.0, 1.0]")),
    ("target_distance", (math.nan, 1.0), ("target_distance[0]", "finite", "nan")),
    ("target_distance", (0.5, math.inf), ("target_distance[1]", "finite", "inf")),
    ("target_distance", "ab", ("target_distance", "ab")),
    ("target_distance", None, ("target_distance",)),
    ("target_bearing", -0.1, ("target_bearing must be at least 0", "-0.1")),
    ("target_bearing", 3.2, ("target_bearing must be at most", "3.2")),
    ("target_bearing", "wide", ("target_bearing must be a number", "wide")),
    ("target_bearing", math.nan, ("target_bearing", "finite")),
    ("target_radius", 0.0, ("target_radius must be above 0", "0")),
    ("target_radius", -1.0, ("target_radius must be above 0", "-1")),
    ("target_radius", 0.5, ("target_distance", "target_radius (0.5)")),
    ("target_radius", None, ("target_radius must be a number",)),
]
BAD_BATCH_ARGUMENTS: Arguments = [
    ("num_envs", 0, ("num_envs must be at least 1", "0")),
    ("num_envs", -3, ("num_envs must be at least 1", "-3")),
    ("num_envs", 2.5, ("num_envs must be a whole number", "2.5")),
    ("num_envs", math.nan, ("num_envs must be a whole number", "nan")),
    ("num_envs", "2", ("num_envs must be a whole number", "'2'")),
    ("num_envs", None, ("num_envs must be a whole number", "None")),
    ("num_envs", True, ("num_envs must be a whole number", "True")),
    ("num_envs", 10**15, ("num_envs",)),
    ("num_envs", 10**30, ("num_envs",)),
    ("num_threads", 0, ("num_threads must be at least 1", "0")),
    ("num_threads", 1.5, ("num_threads must be a whole number", "1.5")),
    ("num_threads", "two", ("num_threads must be a whole number", "'two'")),
    ("num_threads", False, ("num_threads must be a whole number", "False")),
    ("max_episode_steps", 0, ("max_episode_steps must be at least 1",)),
    ("max_episode_steps", 2.5, ("max_episode_steps must be a whole", "2.5")),
    ("max_episode_steps", "5", ("max_episode_steps must be a whole", "'5'")),
    ("autoreset_mode", "nextstep", ("autoreset_mode 'nextstep'", "NextStep")),
    ("autoreset_mode", None, ("autoreset_mode None", "SameStep")),
    ("autoreset_mode", 1, ("autoreset_mode 1", "Disabled")),
    ("render_mode", "rgb", ("render_mode 'rgb'", "rgb_array")),
]
#: Gymnasium's own way of making single environments looks at render modes before we do.
BAD_RENDER_MODES: Arguments = [
    ("render_mode", value, ("render_mode", repr(value), "rgb_array"))
    for value in ("rgb", "RGB_ARRAY", "", 3, [])
]
BAD_LIMITS = [bad for bad in BAD_BATCH_ARGUMENTS if bad[0] in ("max_episode_steps", "num_threads")]
ALL_BAD_ARGUMENTS = [
    (build, task, *bad)
    for build, task, table in (
        (make, FORWARD, BAD_ARGUMENTS),
        (make, TARGET, BAD_TARGET_ARGUMENTS),
        (make_batch, FORWARD, BAD_ARGUMENTS),
        (make_batch, TARGET, BAD_TARGET_ARGUMENTS),
        (make_batch, FORWARD, BAD_BATCH_ARGUMENTS),
        (lambda _, **given: SwimEnv(**given), FORWARD, [*BAD_RENDER_MODES, *BAD_LIMITS]),
    )
    for bad in table
]


@pytest.mark.parametrize(("build", "task", "name", "value", "parts"), ALL_BAD_ARGUMENTS)
def test_a_bad_argument_is_refused(build, task, name, value, parts):
    error = SceneError if name in ("scene", "overrides") else OptionError
    with refuses(error, *parts) as caught:
        build(task, **{name: value})
    assert isinstance(caught.value, (SwimError, ValueError))


def test_the_number_that_make_vec_is_given_counts_more_than_that_of_a_spec():
    spec = gymnasium.make(FORWARD, overrides={"episode.duration": 0.1, **SMALL}).spec
    assert spec.max_episode_steps == 5
    batch = gymnasium.make_vec(spec, num_envs=2, max_episode_steps=3)
    assert batch.spec.max_episode_steps == 3 and batch.unwrapped.episodes.limit == 3


def test_last_infos_of_members_that_ended_have_numbers_for_their_reasons():
    batch = make_batch(
        overrides={"episode.duration": 0.02, **SMALL}, autoreset_mode=AutoresetMode.SAME_STEP
    )
    batch.reset(seed=0)
    *_, infos = batch.step(np.zeros((3, 2)))
    assert np.from_dlpack(infos["final_info"]["termination_reason"]).tolist() == [0, 0, 0]
