"""Contests: the same episodes as one by one, figures of all seeds, ratios, groups, verdicts."""

import json
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from swim_agents import Rollout, WavePolicy, load_policy, play_episode, verify_rollout
from swim_agents.comparison.contest import (
    REFERENCES,
    Contest,
    Entry,
    _summary,
    entries_of,
    hold_contest,
)
from swim_agents.comparison.performance import measure_performance
from swim_agents.comparison.report import as_text, write_contest
from swim_agents.learning.saved import AgentError
from swim_agents.rollout import play_episodes
from swim_agents.verification import fine_scene, finer_scenes, work_of

from swim_env import (
    OptionError,
    Scene,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    SwimTargetVectorEnv,
    SwimVectorEnv,
    Task,
    load_scene,
)
from swim_env.scene import Actuation
from tests.learning.small_runs import small_config, untrained
from tests.support import assert_same, refuses

SECOND = ("episode.duration=1.0",)
#: Starts that differ enough to tell one from another.
LIVELY = (*SECOND, "episode.velocity_noise=0.05", "episode.bend_noise=0.05")
SEEDS = (4, 0, 11)


def short(*overrides: str) -> Scene:
    return load_scene("swimmer", [*SECOND, *overrides])


def plain(contest: Contest) -> dict[str, Any]:
    """Return a contest's record as it comes back from a file."""
    data: dict[str, Any] = json.loads(json.dumps(contest.record, allow_nan=False))
    return data


# ---- episodes side by side ---------------------------------------------------------------------


def side_by_side(
    batch: SwimVectorEnv,
    single: SwimEnv,
    name: str,
    seeds: Sequence[int],
    noise: float = 1.0,
    progress: Callable[[int], object] | None = None,
) -> list[Rollout]:
    """Play episodes in a batch, which must be those that are played one by one, bit for bit."""
    policy, options = load_policy(name, single.scene), {"noise": noise}
    together = play_episodes(batch, policy, seeds, options, progress=progress)
    for seed, rollout in zip(seeds, together, strict=True):
        assert_same(rollout, play_episode(single, policy, seed, options))
    return together


@pytest.mark.parametrize("name", REFERENCES)
def test_episodes_side_by_side_are_those_one_by_one_bit_for_bit(name):
    scene = load_scene("swimmer", list(LIVELY))
    calls: list[int] = []
    batch = SwimVectorEnv(len(SEEDS), scene, num_threads=2)
    together = side_by_side(batch, SwimEnv(scene), name, SEEDS, noise=1.0, progress=calls.append)
    assert calls == [1] * 50
    assert len({rollout.path.tobytes() for rollout in together}) == len(SEEDS)


@pytest.mark.parametrize("name", [*REFERENCES, "zero"])
def test_members_that_reach_their_targets_at_different_times_are_bit_for_bit(name):
    # The body glides ahead, to within 0.1 BL of targets that are not far.
    scene = short("initial.velocity=[-0.4, 0.0]")
    near: dict[str, Any] = {"target_distance": (0.105, 0.3), "target_bearing": 0.5}
    batch, single = SwimTargetVectorEnv(9, scene, **near), SwimTargetEnv(scene, **near)
    together = side_by_side(batch, single, name, range(9))
    for rollout in together:
        assert rollout.goal_is_point and rollout.terminated != rollout.truncated
        assert rollout.info["success"] == rollout.terminated
    lengths = {len(rollout.torques) for rollout in together}
    assert len(lengths) >= 3 and max(lengths) == 50
    assert len({rollout.goal.tobytes() for rollout in together}) == 9


def test_members_that_break_at_different_times_are_bit_for_bit():
    scene = load_scene("swimmer", ["episode.duration=2.0", "beam.bending_stiffness=0.05"])
    batch = SwimVectorEnv(4, scene)
    together = side_by_side(batch, SwimEnv(scene), "paper_wave", range(4), noise=20.0)
    reasons = {rollout.info["termination_reason"] for rollout in together}
    assert not reasons & {"", "target_reached"}
    assert len({rollout.steps for rollout in together}) >= 2


def test_a_batch_of_another_size_or_mode_is_refused():
    scene = short()
    policy = load_policy("zero", scene)
    with refuses(OptionError, "a batch of 3 members in mode NextStep, got 2 in"):
        play_episodes(SwimVectorEnv(2, scene), policy, SEEDS)
    batch = SwimVectorEnv(3, scene, autoreset_mode=AutoresetMode.SAME_STEP)
    with refuses(OptionError, "got 3 in mode SameStep"):
        play_episodes(batch, policy, SEEDS)


def test_starts_of_another_number_task_or_body_are_refused():
    scene = short()
    policy, batch = load_policy("zero", scene), SwimVectorEnv(2, scene)
    start = play_episode(SwimEnv(scene), policy, 0)
    with refuses(OptionError, "starts must be 2 episodes, one for each seed, got 1"):
        play_episodes(batch, policy, [0, 1], starts=[start])
    aimed = play_episode(SwimTargetEnv(scene), policy, 1)
    with refuses(OptionError, "starts[1] must be", "is a direction, got one whose goal is a point"):
        play_episodes(batch, policy, [0, 1], starts=[start, aimed])
    longer = scene.replace("beam.length", 1.5)
    other = play_episode(SwimEnv(longer), load_policy("zero", longer), 0)
    with refuses(OptionError, "starts[0], an episode of scene swimmer,", "beam differs"):
        play_episodes(batch, policy, [0, 1], starts=[other, start])


# ---- figures of a contest ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def contest() -> Contest:
    scene = load_scene("swimmer", list(LIVELY))
    return hold_contest(scene, entries_of(["random", "zero"], scene), SEEDS, threads=2, keep=2)


def test_the_references_take_part_in_front_of_the_others(contest):
    scene = short()
    assert [entry.name for entry in entries_of([], scene)] == list(REFERENCES)
    names = ["zero", "tuned_wave", "zero", "random"]
    found = [entry.name for entry in entries_of(names, scene)]
    assert found == ["paper_wave", "tuned_wave", "zero", "random"]
    assert list(contest.record["policies"]) == ["paper_wave", "tuned_wave", "random", "zero"]


def test_the_lists_hold_the_figures_of_the_episodes_one_by_one(contest):
    record = plain(contest)
    assert record["seeds"] == list(SEEDS) == list(contest.seeds)
    about = {"scene": "swimmer", "task": "forward", "duration": 1.0, "tolerance": 0.1}
    assert {**about, "source_tolerance": 0.05}.items() <= record.items()
    env, fine = SwimEnv(contest.scene), SwimEnv(fine_scene(contest.scene))
    for name, one in contest.record["policies"].items():
        assert {len(value) for value in one.values() if isinstance(value, list)} == {len(SEEDS)}
        assert record["net_displacement"][name] == one["net_displacement"]
        if name not in REFERENCES:
            continue
        for i, seed in enumerate(SEEDS):
            policy = load_policy(name, contest.scene)
            rollout, closed_loop = (play_episode(one, policy, seed) for one in (env, fine))
            checked = verify_rollout(rollout, closed_loop)
            expected = measure_performance(rollout, rollout.simulate(), checked).to_dict()
            assert {figure: one[figure][i] for figure in expected} == expected
            # Waves have no feedback.
            assert one["closed_displacement"][i] == one["fine_displacement"][i]
            assert one["closed_loop_change"][i] == one["together_change"][i] != 0.0
        for change, largest in one["largest_change"].items():
            changes = one[f"{change}_change"]
            if change == "model":  # in space alone there is another one
                assert largest is None and set(changes) == {None}
                continue
            assert largest in changes and abs(largest) == np.abs(changes).max() > 0.0


def test_ratios_are_quotients_of_the_medians(contest):
    policies = contest.record["policies"]
    prefixes = {"net": "", "fine": "fine_", "closed": "closed_"}
    for kind, prefix in ((f"{kind}_displacement", one) for kind, one in prefixes.items()):
        middle = {name: float(np.median(one[kind])) for name, one in policies.items()}
        for name, one in policies.items():
            assert one["median"][kind] == pytest.approx(middle[name], rel=1e-12)
            for reference in REFERENCES:
                # Being so many times as far as what swims backwards means nothing.
                base = middle[reference]
                expected = pytest.approx(middle[name] / base, rel=1e-12) if base > 0.0 else None
                assert one[f"{prefix}ratio_to_{reference}"] == expected
    for name, ratios in contest.record["ratios"].items():
        assert ratios == {other: policies[name][f"ratio_to_{other}"] for other in REFERENCES}


def test_in_the_target_task_there_are_no_ratios_and_the_closed_loop_must_reach_it():
    scene = load_scene("swimmer", ["episode.duration=2.0", "initial.velocity=[-0.3, 0.0]"])
    near = {"target_distance": (0.3, 0.3), "target_bearing": 0.05}
    entries = entries_of(["zero"], scene, "target")
    contest = hold_contest(scene, entries, [1, 2], "target", environment=near)
    record = plain(contest)
    assert record["environment"] == {"target_distance": [0.3, 0.3], "target_bearing": 0.05}
    assert record["target_radius"] == 0.1
    zero = record["policies"]["zero"]
    rates = ("success_rate", "verified_success_rate", "replayed_success_rate")
    assert [zero[rate] for rate in rates] == [1.0, 1.0, 1.0]
    assert zero["closed_success"] == zero["verified"] == [True, True]
    assert zero["closed_termination_reason"] == ["target_reached"] * 2
    assert all(0.09 < distance <= 0.11 for distance in zero["fine_distance"])
    assert all(0.09 < distance <= 0.10 for distance in zero["closed_distance"])
    assert record["ratios"]["zero"] == {"paper_wave": None, "tuned_wave": None}
    # What the torques miss is told, what the policy misses in the finer scene does not count.
    far = [replace(one, fine_distance=0.12) for one in contest.performances["zero"]]
    assert [_summary(far, 0.1)[rate] for rate in rates] == [1.0, 1.0, 0.0]
    missed = replace(far[0], closed_success=False, verified=False)
    assert [_summary([missed, far[1]], 0.1)[rate] for rate in rates] == [1.0, 0.5, 0.0]


class Chase(Task):
    """Its target moves, so that torques played again cannot be judged by where it was."""

    goal_is_point = ends_at_goal = True

    def draw_goal(self, random):
        return np.array([-1.0, 0.0])

    def update_goal(self, now):
        return now.goal if now.start else now.goal + [[-0.01, 0.0]]


def test_a_target_that_moves_is_judged_by_the_return():
    scene = load_scene("swimmer", ["episode.duration=0.2"])
    task = f"{__name__}:Chase"
    record = hold_contest(scene, entries_of(["zero"], scene, task), [1], task, threads=1).record
    assert record["score"] == "return (BL)" and "target_radius" not in record
    zero = record["policies"]["zero"]
    assert (zero["success_rate"], zero["replayed_success_rate"]) == (0.0, None)
    assert zero["fine_distance"] == [None]


def test_a_cost_that_is_infinite_counts_in_the_median():
    # A start that happens to drift forward must not make a cost of those that drift backwards.
    scene = short()
    record = hold_contest(scene, entries_of(["zero"], scene), [0, 1], threads=1).record
    mixed = record["policies"]["zero"]
    assert mixed["cost_of_transport"] == [None, 0.0]
    assert min(mixed["net_displacement"]) < 0.0 < max(mixed["net_displacement"])
    for one in record["policies"].values():
        costs = [np.inf if cost is None else cost for cost in one["cost_of_transport"]]
        middle = float(np.median(costs))
        assert one["median"]["cost_of_transport"] == (middle if np.isfinite(middle) else None)


def test_the_wave_in_the_table_is_that_of_the_median_episode(contest):
    for one in contest.record["policies"].values():
        order = np.argsort(one["net_displacement"])
        assert one["median"]["wave"] == one["gait"][order[1]]["wave"]
        frequencies = [gait["frequency"] for gait in one["gait"]]
        assert one["median"]["gait"]["frequency"] == pytest.approx(np.median(frequencies))


def test_episodes_are_kept_as_asked_for(contest):
    for name in contest.record["policies"]:
        assert [rollout.seed for rollout in contest.rollouts[name]] == [4, 0]
        assert len(contest.trajectories[name]) == 2
        for rollout, run in zip(contest.rollouts[name], contest.trajectories[name], strict=True):
            assert np.abs(run.path[-1] - rollout.path[-1]).max() < 1e-12
        assert len(contest.performances[name]) == 3


def test_one_thread_and_several_give_the_same_record(contest):
    entries = entries_of(["random", "zero"], contest.scene)
    alone = hold_contest(contest.scene, entries, SEEDS, threads=1, keep=2)
    one, other = plain(alone), plain(contest)
    for name in ("commit", "date", "machine"):
        del one[name], other[name]
    assert one == other
    assert_same(alone.rollouts, contest.rollouts)


def test_progress_adds_up_to_what_is_announced():
    scene = short()
    shares: list[float] = []
    hold_contest(scene, entries_of(["zero"], scene), [0, 1], threads=2, progress=shares.append)
    assert min(shares) > 0.0
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)
    # Without panels there is but the step.
    shares.clear()
    scene = short("fluid.model=strip")
    entries = entries_of(["zero"], scene)  # it is not what the wave was tuned on
    record = hold_contest(scene, entries, [0], threads=2, progress=shares.append)
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)
    one = record.record["policies"]["paper_wave"]
    assert one["panels_change"] == one["ends_change"] == [None]
    assert one["time_step_change"] == one["together_change"] == [one["largest_change"]["together"]]
    assert one["largest_change"]["panels"] is None


def test_progress_comes_to_its_end_where_episodes_end_early():
    shares: list[float] = []
    scene, entries = thin(), entries_of([], thin())  # finer panels refuse the second start
    hold_contest(scene, entries, [1, 13], threads=1, progress=shares.append)
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)
    shares.clear()
    scene = short("episode.velocity_noise=1.0")
    entries = entries_of([], scene, "target")
    record = hold_contest(scene, entries, [6], "target", threads=1, progress=shares.append).record
    assert record["policies"]["paper_wave"]["duration"][0] < 1.0
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("coarse", "fine", "longer"),
    [
        ("swimmer", {"integrator.time_step": 0.00125}, 4.0),
        ("swimmer", {"fluid.panels_per_element": 12}, 7.0),
        ("swimmer", {"fluid.model": "frozen"}, 0.2),
        ("eel_3d", {"fluid.model": "panels"}, 100.0),
    ],
)
def test_the_work_of_scenes_is_compared_by_steps_and_panels(coarse, fine, longer):
    """The ratios were measured; a bar serves while it is right within a factor of two."""
    scene = load_scene(coarse)
    assert longer / 2.0 < work_of(scene.replace(fine)) / work_of(scene) < 2.0 * longer


def test_without_noise_all_starts_are_the_same():
    scene = short()
    record = hold_contest(scene, entries_of(["zero"], scene), [1, 2], noise=0.0, threads=1).record
    for name in REFERENCES:
        first, second = record["net_displacement"][name]
        assert first == second != 0.0
    zero = record["policies"]["zero"]
    assert zero["net_displacement"] == [0.0, 0.0]
    assert zero["gait"] == [None, None]
    assert zero["median"]["wave"] is None and zero["median"]["cost_of_transport"] is None
    assert zero["ratio_to_paper_wave"] == 0.0
    assert zero["verified"] == [True, True]
    json.dumps(record, allow_nan=False)
    # Nothing is divided by a reference that stays where it is.
    scene = short("actuation.amplitude=0")
    record = hold_contest(scene, entries_of([], scene), [0], noise=0.0, threads=1).record
    assert record["net_displacement"]["paper_wave"] == [0.0]
    assert [record["ratios"][name]["paper_wave"] for name in record["policies"]] == [None, None]


def test_targets_are_the_same_for_all_and_the_share_of_those_reached_is_counted():
    # Pushed in any direction, one of these comes within 0.1 BL of its target.
    scene = short("episode.velocity_noise=1.0")
    entries = entries_of([], scene, "target")
    contest = hold_contest(scene, entries, [5, 6, 7], task="target", threads=2, keep=3)
    for name, one in contest.record["policies"].items():
        assert one["success"] == [False, True, False]
        assert one["termination_reason"] == ["", "target_reached", ""]
        assert one["success_rate"] == pytest.approx(1.0 / 3.0)
        assert one["duration"][1] < 1.0 == one["duration"][0]
        assert one["net_displacement"][1] > 0.3, name
    first, second = ([one.goal.tolist() for one in kept] for kept in contest.rollouts.values())
    assert first == second
    assert first[0] != first[2]


def test_a_score_that_depends_on_the_time_step_is_reported_as_unverified():
    # Without damping, at a large step and near the second resonance, the motion is not resolved.
    scene = load_scene(
        "swimmer", ["damping=null", "integrator.time_step=0.01", "episode.duration=3.0"]
    )
    wave = Actuation(amplitude=1.0, frequency=2.0 * np.pi * 14.0, wave_number=-6.0)
    entry = Entry("too fast", "too fast", WavePolicy(scene, wave), {})
    entries = [*entries_of([], scene), entry]
    policies = hold_contest(scene, entries, [0], noise=0.0, threads=1).record["policies"]
    one, paper = policies["too fast"], policies["paper_wave"]
    assert (one["verified"], one["verified_share"]) == ([False], 0.0)
    assert (paper["verified"], paper["verified_share"]) == ([True], 1.0)
    gap = abs(one["fine_displacement"][0] - one["net_displacement"][0])
    assert gap > 0.1 * abs(one["net_displacement"][0]) or one["termination_reason"] != [""]


class _Steered:
    """Torques that follow the bending and the way to the goal."""

    def predict(self, observation: Any, *_: Any, **__: Any) -> tuple[Any, None]:
        seen = np.asarray(observation)
        bending = 0.2 * np.roll(seen[..., :8], 1, axis=-1)
        return np.clip(bending + 0.3 * seen[..., 16:17], -1.0, 1.0), None


@pytest.mark.parametrize("task", ["forward", "target"])
def test_a_policy_with_feedback_plays_in_the_finer_scene_itself(task):
    scene = load_scene("swimmer", list(LIVELY))
    entries = [*entries_of([], scene, task), Entry("steered", "steered", _Steered(), {})]
    record = plain(hold_contest(scene, entries, SEEDS, task, noise=0.5, threads=2))
    one = record["policies"]["steered"]
    made = SwimTargetEnv if task == "target" else SwimEnv
    fine = made(fine_scene(scene))
    for i, seed in enumerate(SEEDS):
        alone = play_episode(fine, _Steered(), seed, {"noise": 0.5})
        assert one["closed_displacement"][i] == alone.net_displacement
        assert one["closed_displacement"][i] != one["fine_displacement"][i]
        assert one["closed_energy_drift"][i] == alone.info["energy_drift"]
        assert one["closed_success"][i] == alone.info.get("success")
    assert one["median"]["closed_displacement"] == np.median(one["closed_displacement"])


@pytest.fixture
def hears_interrupts() -> Iterator[None]:
    """Undo that a shell's background jobs ignore interrupts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_interrupts")
def test_what_is_interrupted_while_it_is_checked_ends_at_once():
    scene, shares = load_scene("swimmer", ["episode.duration=8.0"]), list[float]()
    finer = [work_of(one) for one in finer_scenes(scene).values()]
    twice = work_of(scene) + finer[-1]
    checks = 0.5 / (twice + sum(finer))  # of the first of two entries
    played = twice * checks + 1e-9

    def interrupt(share: float) -> None:
        before = sum(shares)
        shares.append(share)
        if before <= played < sum(shares):
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)  # Ctrl-C

    with pytest.raises(KeyboardInterrupt):
        hold_contest(scene, entries_of([], scene), [0, 1], threads=2, progress=interrupt)
    assert sum(shares) < played + finer[0] * checks, "not even the finer steps are done"


def thin(*overrides: str) -> Scene:
    """Return a scene in which some noise is refused by three times the panels only."""
    brief = ("episode.duration=0.1", "beam.half_thickness=0.0005", "episode.bend_noise=1.5")
    return load_scene("swimmer", [*brief, *overrides])


@pytest.mark.parametrize("task", ["forward", "target"])
def test_a_start_that_finer_panels_refuse_is_not_verified_and_the_others_keep_theirs(task):
    scene, refused = thin(), 13
    entries = entries_of(["zero"], scene, task)
    contest = hold_contest(scene, entries, [1, refused, 3], task, threads=1, keep=3)
    record = plain(contest)
    others = plain(hold_contest(scene, entries, [1, 3], task, threads=1))
    for name, one in record["policies"].items():
        assert one["closed_termination_reason"] == ["", "mass_not_positive", ""]
        assert one["verified"][1] is False
        assert one["closed_displacement"][1] == one["fine_displacement"][1] == 0.0
        assert one["closed_success"][1] is (False if task == "target" else None)
        # The episode itself was played.
        assert one["duration"][0] == one["duration"][2] == 0.1
        assert abs(one["net_displacement"][1]) > 1e-5
        assert (
            one["closed_loop_change"][1]
            == one["together_change"][1]
            == pytest.approx(-np.sign(one["net_displacement"][1]))
        )
        for figure, values in others["policies"][name].items():
            if isinstance(values, list):
                assert [one[figure][0], one[figure][2]] == values, figure
    assert as_text(record) and contest.rollouts["zero"][1].seed == refused
    # The finer scene would draw the same start with less noise.
    env, fine = SwimEnv(scene), SwimEnv(fine_scene(scene))
    rollout, drawn = (play_episode(one, load_policy("zero", scene), refused) for one in (env, fine))
    assert np.abs(rollout.coordinates - drawn.coordinates).max() > 0.01
    checked = verify_rollout(rollout)
    assert (checked.verified, checked.termination_reason) == (False, "mass_not_positive")


def test_a_scene_whose_own_start_finer_panels_refuse_verifies_nothing():
    env = SwimEnv(thin())
    env.reset(seed=13)
    scene = thin(f"initial.joint_angles={env.coordinates[3:].tolist()}", "episode.bend_noise=0.0")
    with refuses(SwimError, "mass_not_positive"):
        SwimEnv(fine_scene(scene))
    record = plain(hold_contest(scene, entries_of(["zero"], scene), [0, 1], threads=1))
    zero = record["policies"]["zero"]
    assert zero["verified"] == [False, False]
    assert zero["closed_termination_reason"] == ["mass_not_positive"] * 2
    assert zero["together_change"] == zero["closed_loop_change"]


# ---- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"seeds": []}, "seeds must be different whole numbers"),
        ({"seeds": [1, 2, 1]}, "seeds must be different whole numbers"),
        ({"seeds": [3, -2]}, "seeds must be different whole numbers"),
        ({"entries": []}, "paper_wave"),
        ({"task": "tagret"}, "tagret"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_played(arguments, problem):
    scene, calls = short(), list[float]()
    given = {"entries": entries_of([], scene), "seeds": [0], **arguments}
    with refuses(SwimError, problem):
        hold_contest(scene, **given, threads=1, progress=calls.append)
    assert calls == []


# ---- agents ------------------------------------------------------------------------------------


def save_run(folder: Path, seed: int, **changes: Any) -> None:
    """Save an untrained agent as a training run does."""
    pytest.importorskip("stable_baselines3")
    from swim_agents.learning.saved import save_agent

    config = small_config(
        name="tiny", scene=short(), overrides={}, state_dependent_noise=False, **changes
    )
    save_agent(folder / "agent", untrained(config, seed), config, {"seed": seed, "steps": 0})


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of one configuration."""
    folder = tmp_path_factory.mktemp("runs") / "tiny_runs"
    for seed in (0, 1):
        save_run(folder / f"seed_{seed}", seed)
    return folder


def test_a_folder_of_runs_is_a_group_with_its_spread(runs):
    scene = short()
    entries = entries_of([str(runs)], scene)
    names = ["tiny/seed_0", "tiny/seed_1"]
    assert [entry.name for entry in entries] == [*REFERENCES, *names]
    assert [entry.group for entry in entries] == [*REFERENCES, "tiny", "tiny"]
    assert [entry.about.get("seed") for entry in entries[2:]] == [0, 1]
    record = plain(hold_contest(scene, entries, [0, 1, 2], threads=2))
    assert list(record["groups"]) == ["tiny"]
    group = record["groups"]["tiny"]
    assert group["members"] == names
    for key in ("net_displacement", "fine_displacement", "closed_displacement"):
        low, high = sorted(record["policies"][name]["median"][key] for name in names)
        middle = pytest.approx(0.5 * (low + high), rel=1e-12)
        assert group[key] == {"median": middle, "min": low, "max": high}
        assert low < high
    for key in ("ratio_to_paper_wave", "fine_ratio_to_tuned_wave", "verified_share"):
        if record["policies"][names[0]][key] is None:
            assert key not in group
            continue
        low, high = sorted(record["policies"][name][key] for name in names)
        assert (group[key]["min"], group[key]["max"]) == (low, high)
        assert low <= group[key]["median"] <= high
    assert "success_rate" not in group
    assert record["policies"][names[0]]["training"] == {"seed": 0, "steps": 0}


def test_agents_side_by_side_do_what_they_do_one_by_one(runs):
    # Not to the bit: a product of matrices may round otherwise for a batch.
    scene = short()
    policy = load_policy(runs / "seed_1", scene)
    together = play_episodes(SwimVectorEnv(3, scene), policy, SEEDS)
    for seed, rollout in zip(SEEDS, together, strict=True):
        alone = play_episode(SwimEnv(scene), policy, seed)
        assert np.abs(rollout.torques).max() > 1e-4
        assert np.abs(rollout.torques - alone.torques).max() < 1e-5
        assert np.abs(rollout.path - alone.path).max() < 1e-6


def test_runs_are_counted_in_the_order_of_their_seeds(runs, tmp_path):
    many = tmp_path / "many"
    for seed in (10, 9, 2):
        shutil.copytree(runs / "seed_0", many / f"seed_{seed}")
    (many / "seed_3").mkdir()  # begun, and no agent yet
    names = [entry.name for entry in entries_of([str(many)], short())[2:]]
    assert names == ["tiny/seed_2", "tiny/seed_9", "tiny/seed_10"]


def test_one_run_and_its_agents_folder_are_named_after_the_run(runs):
    for place in (runs / "seed_1", runs / "seed_1" / "agent"):
        one = entries_of([str(place)], short())[2]
        assert (one.name, one.group, one.about["seed"]) == ("tiny/seed_1", "tiny/seed_1", 1)


def test_folders_of_the_same_name_are_kept_apart(runs, tmp_path):
    other = tmp_path / "elsewhere" / runs.name
    shutil.copytree(runs, other)
    entries = entries_of([str(runs), str(other)], short())[2:]
    assert len({entry.name for entry in entries}) == 4
    groups = [entry.group for entry in entries]
    assert groups[0] == groups[1] != groups[2] == groups[3]


def test_agents_for_a_target_play_for_a_target_alone(tmp_path):
    save_run(tmp_path / "seed_5", 5, task="target")
    scene = short()
    entries = entries_of([str(tmp_path / "seed_5")], scene, "target")
    record = hold_contest(scene, entries, [0], task="target", threads=1).record
    assert record["policies"][entries[2].name]["success_rate"] == 0.0
    with refuses(SwimError, "was trained for task target, not for forward"):
        entries_of([str(tmp_path / "seed_5")], scene)


def test_a_policy_of_another_scene_is_refused_before_any_is_played():
    scene = short()
    other = load_policy("tuned_wave", scene.replace("actuation.torque_limit", 2.0))
    played: list[float] = []
    entries = [*entries_of(["zero"], scene), Entry("other", "other", other, {})]
    with refuses(OptionError, "cannot play scene swimmer: torque_limit is 1.0, it was 2.0"):
        hold_contest(scene, entries, SEEDS, threads=1, progress=played.append)
    assert not played
    target = Entry("agent", "agent", load_policy("ppo_target", scene), {})
    with refuses(AgentError, "agent ppo_target was trained for task target, not for forward"):
        hold_contest(scene, [*entries, target][:3] + [target], SEEDS, threads=1)


def test_a_scene_without_a_wave_is_compared_without_one(tmp_path):
    scene = short("actuation=null").replace("beam.bending_stiffness", 2.0)
    entries = entries_of(["zero", "random"], scene)
    assert [entry.name for entry in entries] == ["zero", "random"]
    contest = hold_contest(scene, entries, [0], threads=1)
    write_contest(contest, tmp_path / "out")
    assert plain(contest)["ratios"]["random"] == {"paper_wave": None, "tuned_wave": None}


def test_on_another_body_the_tuned_wave_is_no_reference(tmp_path):
    scene = short().replace("beam.bending_stiffness", 2.0)
    entries = entries_of(["zero"], scene)
    assert [entry.name for entry in entries] == ["paper_wave", "zero"]
    contest = hold_contest(scene, entries, [0], threads=1)
    record = plain(contest)
    assert record["tuned_on"] is None and "tuned" not in as_text(record).partition("\n")[0]
    assert all(one["tuned_wave"] is None for one in record["ratios"].values())
    assert record["policies"]["paper_wave"]["fine_ratio_to_tuned_wave"] is None
    write_contest(contest, tmp_path / "out")
    with refuses(OptionError, "the wave was tuned on scene swimmer"):
        entries_of(["tuned_wave"], scene)
    with refuses(OptionError, "every contest needs paper_wave, paper_wave is missing"):
        hold_contest(scene, entries[1:], [0])
