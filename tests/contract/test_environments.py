"""What the single and the batched environments promise alike: seeds, snapshots, refusals, limits.

Bad actions are in tests/stability/test_bad_actions.py.
"""

import copy
import hashlib
import math
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_env import (
    ActionError,
    OptionError,
    SceneError,
    SimulationEndedError,
    SwimEnv,
    SwimError,
    SwimVectorEnv,
)
from tests.support import (
    FORWARD,
    LIVELY,
    SMALL,
    TARGET,
    TASKS,
    assert_same,
    each_task,
    make,
    make_batch,
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
BAD_SEEDS: list[Any] = ["1", 1.0, -1, True, np.True_, np.array(1), {}, []]
BAD_SEEDS_OF_ONE: list[Any] = [[1], ()]
BAD_SEEDS_OF_THREE: list[Any] = [
    *([1, 2], [1, 2, 3, 4], [1, 2.0, 3], [1, "2", 3], [1, -2, 3], [True, 2, 3]),
    *(np.array([1.0, 2.0, 3.0]), np.array([-1, 2, 3])),
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
    ("num_envs", 2.0, ("num_envs must be a whole number", "2.0")),
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
ALL_BAD_ARGUMENTS = [
    (build, task, *bad)
    for build, task, table in (
        (make, FORWARD, BAD_ARGUMENTS),
        (make, TARGET, BAD_TARGET_ARGUMENTS),
        (make_batch, FORWARD, BAD_ARGUMENTS),
        (make_batch, TARGET, BAD_TARGET_ARGUMENTS),
        (make_batch, FORWARD, BAD_BATCH_ARGUMENTS),
        (lambda _, **given: SwimEnv(**given), FORWARD, BAD_RENDER_MODES),
    )
    for bad in table
]


@pytest.mark.parametrize(("build", "task", "name", "value", "parts"), ALL_BAD_ARGUMENTS)
def test_a_bad_argument_is_refused(build, task, name, value, parts):
    error = SceneError if name in ("scene", "overrides") else OptionError
    with refuses(error, *parts) as caught:
        build(task, **{name: value})
    assert isinstance(caught.value, (SwimError, ValueError))
