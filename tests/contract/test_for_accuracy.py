"""Choosing settings for an accuracy: what is compared, references, the shipped front, refusals."""

import functools
import itertools
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.accuracy.front import front_to_json
from studies.accuracy.study import energy_error, path_error
from swim_env import Scene, SceneError, SimulationEndedError, SwimError, Trajectory, load_scene
from swim_env.accuracy import Choice, Outcome, Reference, Settings, choose, play, reference_of
from swim_env.accuracy.choice import _candidates
from swim_env.accuracy.front import Measured, load_front
from swim_env.accuracy.outcome import SAMPLES, outcome_of, relative_error
from swim_env.accuracy.reference import FINE, PILOT, Refinements, plan_for
from swim_env.accuracy.settings import PAPER_SETTINGS, duration_for
from tests.support import call_script, refuses

Array = NDArray[np.float64]

FROZEN = Settings("frozen", 9, 8, "proportional", 0.01, "composed")
STRIP = Settings("strip", 9, 4, 1, 0.01, "composed")
PANELS = Settings("panels", 9, 4, 1, 0.01, "composed")
OTHERS = Settings("frozen", 7, 8, "proportional", 0.004, "composed", "mean_angles", 1e-8)


def short(changes: Mapping[str, object] | None = None) -> Scene:
    """Return the learning scene, three seconds of it."""
    return load_scene("swimmer", {"episode.duration": 3.0, **(changes or {})})


def settings_of(scene: Scene) -> Settings:
    """Return how a scene is computed."""
    fluid, integrator = scene.fluid, scene.integrator
    of_fluid = (fluid.panels_per_element, fluid.cap_panels) if fluid else (4, 1)
    return Settings(
        *(fluid.model if fluid else "none", scene.beam.elements, *of_fluid),
        *(integrator.time_step, integrator.scheme, integrator.strain, integrator.tolerance),
    )


# ---- settings ----------------------------------------------------------------------------------

#: A body, a drive, effects, a start and an episode of its own.
MINE = load_scene(
    "swimmer",
    {
        "name": "mine",
        "description": "words",
        "beam.length": 1.3,
        "beam.bending_stiffness": {"linear": {"head": 9.0, "tail": 2.0}},
        "cross_flow_drag.coefficient": 1.5,
        "stream.velocity": (0.1, 0.0),
        "self_contact": True,
        "initial.velocity": (0.1, 0.0),
        "episode.duration": 3.0,
        "actuation.end_time": 2.0,
    },
)


def without_settings(scene: Scene) -> dict[str, Any]:
    """Return what settings do not change."""
    data = scene.to_dict()
    for block, names in {
        "beam": ("elements",),
        "fluid": ("model", "panels_per_element", "cap_panels", "variant"),
        "integrator": ("time_step", "scheme", "strain", "tolerance"),
    }.items():
        for name in names:
            data[block].pop(name, None)
    return data


@pytest.mark.parametrize(
    "settings",
    [PAPER_SETTINGS, OTHERS, replace(OTHERS, cap_panels=3)]
    + [replace(PAPER_SETTINGS, fluid_model=m) for m in ("strip", "frozen", "expansion")]
    + [replace(PAPER_SETTINGS, fluid_model="centreline")],
    ids=lambda settings: settings.label,
)
def test_settings_survive_json_and_a_scene_of_which_they_change_nothing_else(settings):
    text = json.dumps({**settings.to_dict(), "cost": 1.0, "scene": "any"})
    assert Settings.from_dict(json.loads(text)) == settings
    changed = settings.apply(MINE)
    assert settings_of(changed) == settings
    assert without_settings(changed) == without_settings(MINE)
    assert settings_of(MINE).apply(changed) == MINE


def test_what_belongs_to_another_model_is_removed():
    strip = load_scene("swimmer", {"fluid.model": "strip", "fluid.added_mass_per_length": 7.0})
    found = [replace(OTHERS, fluid_model=model).apply(strip).fluid for model in ("strip", "frozen")]
    assert [fluid and fluid.added_mass_per_length for fluid in found] == [7.0, None]


def test_settings_of_a_beam_alone_leave_it_alone():
    alone = load_scene("swimmer", {"fluid": None})
    assert OTHERS.apply(alone).fluid is None
    assert settings_of(alone).apply(alone) == alone


@pytest.mark.parametrize(
    "changes",
    [
        {"beam.bending_stiffness": [5.0] * 8},
        {"initial.joint_angles": [0.1] * 8},
        {"axial_added_mass": {}},
    ],
    ids=["stiffness of each joint", "angle of each joint", "axial"],
)
def test_settings_that_do_not_fit_are_refused(changes):
    scene = load_scene("swimmer", changes)
    with pytest.raises(SceneError):
        OTHERS.apply(scene)
    fitting = replace(OTHERS, elements=9, fluid_model="panels")
    assert settings_of(fitting.apply(scene)) == fitting


def test_labels_say_what_departs_from_the_default():
    assert PAPER_SETTINGS.label == "panels 9x4/1 10 ms paper"
    assert OTHERS.label == "frozen 7x8/p 4 ms composed mean_angles tol 1e-08"


# ---- what is compared --------------------------------------------------------------------------


def trajectory_along(
    times: Array, path: Array, energy: Array | None = None, **changes: object
) -> Trajectory:
    """Return a run of straight bodies along a path."""
    steps = len(times) - 1
    every_step = ("work", "positive_work", "dissipated", "residual", "iterations", "evaluations")
    return Trajectory(
        scene=load_scene("swimmer", {"beam.elements": 3, **changes}),
        termination_reason="",
        time=times,
        centres=np.repeat(path[:, None, :], 3, axis=1),
        angles=np.zeros((steps + 1, 3)),
        torques=np.zeros((steps, 2)),
        momentum=np.zeros((steps + 1, 3)),
        energy=np.zeros(steps + 1) if energy is None else energy,
        **dict.fromkeys((*every_step, "at_round_off"), np.zeros(steps)),
        parts=np.ones(steps),
        impulse=np.zeros((steps, 3)),
    )


@pytest.mark.parametrize("period", [1.0, 0.25, 0.337, 1.0 / math.e, 0.0042])
def test_the_mean_over_the_last_period_is_exact_for_broken_lines(period):
    """Trapezoids over all corners, and over the instant at which the last period begins."""
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, 2.0, 40))
    path, energy = rng.normal(size=(40, 2)), rng.normal(size=40)
    drive = {"actuation.frequency": 2.0 * math.pi / period}
    found = outcome_of(trajectory_along(times, path, energy, **drive), 2.0, 1.0)
    corners = np.concatenate([[times[-1] - period], times[times > times[-1] - period]])

    def mean(values: Array) -> float:
        return float(np.trapezoid(np.interp(corners, times, values), corners)) / period

    # Where a body begins does not matter.
    wanted = [mean(path[:, i]) - path[0, i] for i in range(2)]
    assert found.displacement == pytest.approx(wanted, abs=1e-10)
    assert found.energy == pytest.approx(mean(energy), abs=1e-10)


@pytest.mark.parametrize(
    ("drive", "window"),
    [(-4.0 * math.pi, 0.5), (0.1, 3.0), (0.0, 3.0), (None, 0.0)],
    ids=["backwards", "slower than the run", "constant", "none"],
)
def test_what_counts_as_the_last_period(drive, window):
    times = 0.01 * np.arange(301)
    path = np.stack([times, -2.0 * times], axis=1)
    changes = {"actuation": None} if drive is None else {"actuation.frequency": drive}
    found = outcome_of(trajectory_along(times, path, **changes), 3.0, 1.0)
    middle = 3.0 - 0.5 * window
    assert found.displacement == pytest.approx([middle, -2.0 * middle], abs=1e-12)


def test_the_path_is_sampled_at_equal_times_of_any_step():
    """Straight lines are met whatever the step; a run that ended early stays where it was."""
    wanted = np.linspace(0.0, 3.0, SAMPLES + 1)
    for step in (0.01, 0.013, 0.3):
        times = step * np.arange(round(3.0 / step) + 2)
        path = np.stack([0.2 * times + 1.0, -times], axis=1)
        found = outcome_of(trajectory_along(times, path), 3.0, 1.0)
        assert found.path == pytest.approx(np.stack([0.2 * wanted, -wanted], axis=1), abs=1e-12)
        # Drifting with a stream does not count.
        stream = {"stream.velocity": (0.2, -1.0)}
        found = outcome_of(trajectory_along(times, path, **stream), 3.0, 1.0)
        assert max(np.abs(found.displacement).max(), np.abs(found.path).max()) < 1e-12
    times = 0.01 * np.arange(151)
    early = outcome_of(trajectory_along(times, np.stack([times, times], axis=1)), 3.0, 1.0)
    assert early.path[[SAMPLES // 2, -1]] == pytest.approx(np.full((2, 2), 1.5))


def test_the_largest_bend_and_the_work_are_counted():
    run = trajectory_along(0.01 * np.arange(4), np.zeros((4, 2)))
    run.angles[2] = [0.1, -0.3, 0.2]
    run.parts[1:] = [2.0, 4.0]
    run.evaluations[:2] = [3.0, 2.0]
    run = replace(run, iterations=np.array([4.0, 0.0, 2.0]))
    found = outcome_of(run, 0.03, 7.0)
    assert found.largest_bend == pytest.approx(0.5)
    assert (found.steps, found.cut_steps, found.seconds) == (3, 2, 7.0)
    assert (found.evaluations, found.corrections) == (5, 6)


def test_the_scale_of_errors():
    for found, wanted, length, error in (
        ([1.0, 0.0], [1.0, 0.0], 1.0, 0.0),
        ([0.0, 1.0], [1.0, 0.0], 1.0, math.sqrt(2.0)),
        ([3.3, 4.4], [3.0, 4.0], 1.0, 0.1),
        # Below a hundredth of the length it is an error in hundredths of the length.
        ([0.001, 0.0], [0.0, 0.0], 1.0, 0.1),
        ([0.002, 0.0], [0.001, 0.0], 2.0, 0.05),
        ([math.nan, 0.0], [1.0, 0.0], 1.0, math.inf),
        ([math.inf, 0.0], [1.0, 0.0], 1.0, math.inf),
    ):
        measured = relative_error(np.array(found), np.array(wanted), length)
        assert measured == pytest.approx(error, abs=1e-15)


def made_outcome(values: Array, reason: str = "") -> Outcome:
    """Return a run with these displacement, energy and path."""
    path = values[3:].reshape(SAMPLES + 1, 2)
    return Outcome(values[:2], path, float(values[2]), 0.1, 10, 0.1, 0, reason)


def test_errors_of_path_and_energy():
    along = np.linspace(0.0, 2.0, SAMPLES + 1)
    path = np.stack([along, 0.0 * along], axis=1)
    reference = Reference(path[-1], path, 4.0, 1.0, 0.0, 0.0, 0.0, {})
    off = path.copy()
    off[7] += [0.3, -0.4]
    run = made_outcome(np.concatenate([path[-1] + [0.0, 0.2], [3.0], off.ravel()]))
    # The largest distance of 0.5 on a path of extent 2, and a quarter of the energy.
    assert path_error(reference, run) == pytest.approx(0.25)
    assert energy_error(reference, run) == pytest.approx(0.25)
    assert reference.error(run) == pytest.approx(0.1)
    early = replace(run, termination_reason="turn_too_large")
    for error in (Reference.error, path_error, energy_error):
        assert error(reference, early) == math.inf
    # Of a body that stays put they are finite.
    still = Reference(np.zeros(2), np.zeros((SAMPLES + 1, 2)), 0.0, 2.0, 0.0, 0.0, 0.0, {})
    values = np.zeros(2 * SAMPLES + 5)
    for error in (Reference.error, path_error, energy_error):
        assert error(still, made_outcome(values)) == 0.0
    values[2:4] = [0.5, 0.01]
    assert energy_error(still, made_outcome(values)) == 0.5
    assert path_error(still, made_outcome(values)) == pytest.approx(0.5)


# ---- references --------------------------------------------------------------------------------


class Laws:
    """A run that is a sum of laws, in place of `play`.

    Parameters
    ----------
    higher : float
        Size of what the extrapolations leave out, relative to what they take off.
    model : float
        Relative size of what freezing the added mass takes off.
    """

    def __init__(self, higher: float = 0.0, model: float = 0.02, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        n = 3 + 2 * (SAMPLES + 1)
        self.limit = rng.normal(size=n) + np.sign(rng.normal(size=n))
        size = np.hypot(*self.limit[:2])
        self.elements, self.panels, self.step = (size * rng.uniform(-1, 1, n) for _ in range(3))
        self.model = model * size * rng.uniform(0.5, 1.0, n) / math.sqrt(2.0)
        self.higher = higher
        self.played: list[Settings] = []
        self.reason = ""

    def of(self, settings: Settings) -> Array:
        """Return displacement, energy and path."""
        n, p = settings.elements, settings.elements * settings.panels_per_element
        chain = 2.0 * self.elements / n**2
        chain[2] *= n  # the energy's order is 1
        values = self.limit + chain * (1.0 + 10.0 * self.higher / n**2)
        values = values + 3e3 * self.step * settings.time_step**2 * (
            1.0 + 1e4 * self.higher * settings.time_step**2
        )
        if settings.fluid_model != "none":
            values = values + self.panels * self.of_panels(p) * (1.0 + 20.0 * self.higher / p)
        if settings.fluid_model == "panels":
            values = values + self.model * (1.0 + 0.5 * self.higher / settings.panels_per_element)
        return values

    @staticmethod
    def of_panels(along: float) -> float:
        """Return the share that is left with so many panels; corners spoil the order."""
        return 0.1 * along**-0.6

    def __call__(self, scene: Scene, duration: float) -> Outcome:
        assert duration == 3.0
        settings = settings_of(scene)
        self.played.append(settings)
        return made_outcome(self.of(settings), self.reason)


@pytest.fixture
def laws(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Laws:
    found = Laws(**getattr(request, "param", {}))
    monkeypatch.setattr("swim_env.accuracy.reference.play", found)
    return found


def values_of(reference: Reference) -> Array:
    return np.concatenate([reference.displacement, [reference.energy], reference.path.ravel()])


def test_a_reference_takes_off_all_known_laws(laws):
    # As many panels along the body at every N, to the last one.
    plan = Refinements((5, 9, 15), 90, 9, 0.01, (6, 12))
    reference = reference_of(load_scene("swimmer"), 3.0, plan)
    assert values_of(reference) == pytest.approx(laws.limit + laws.model, abs=1e-11)
    scale = np.hypot(*reference.displacement)

    def share(values: Array) -> float:
        return float(np.hypot(*values[:2]) / scale)

    # Half of what refining the step twice would change, half of what the panels have left, and a
    # sixth of the model's; two extrapolations of one law do not differ.
    parts = {
        "elements": 0.0,
        "time_step": 0.5 * share(3e3 * laws.step * plan.time_step**2),
        "panels": 0.5 * share(laws.panels * laws.of_panels(4 * plan.panels)),
        "model": 0.15 * share(laws.model),
    }
    assert reference.parts == pytest.approx(parts, abs=1e-11)
    assert reference.uncertainty == pytest.approx(math.hypot(*parts.values()), abs=1e-11)
    assert reference.length == 1.0


@pytest.mark.parametrize(
    "laws", [{"higher": 1.0, "seed": seed} for seed in range(5)], indirect=True
)
@pytest.mark.parametrize("plan", [FINE, PILOT])
def test_the_error_bar_covers_what_is_left(plan, laws):
    """With laws that hold in the limit alone, the error is within the bar, which is not much more
    than what was taken off.
    """
    reference = reference_of(load_scene("swimmer"), 3.0, plan)
    limit = laws.limit + laws.model
    error = relative_error(reference.displacement, limit[:2], 1.0)
    assert 0.0 < error < reference.uncertainty
    steps = Settings("panels", 36, 12, "proportional", plan.time_step, "composed")
    direct = relative_error(laws.of(steps)[:2], limit[:2], 1.0)
    assert reference.uncertainty < 2.0 * direct


def test_the_runs_of_a_reference(laws):
    """None is made twice, all are counted, and nothing of the scene's own settings is in them."""
    counted: list[int] = []
    scene = load_scene("swimmer", {"integrator.tolerance": 1e-6, "fluid.cap_panels": 7})
    reference_of(scene, 3.0, FINE, progress=counted.append)
    assert len(laws.played) == len(set(laws.played)) == sum(counted) == 11
    usual = ("composed", "proportional", 1e-10)
    assert {(one.scheme, one.cap_panels, one.tolerance) for one in laws.played} == {usual}
    # Panels are solved at every step on few elements only, at twice the step.
    dear = [one for one in laws.played if one.fluid_model == "panels"]
    assert {(one.elements, one.time_step) for one in dear} == {(9, 0.005)}


@pytest.mark.parametrize("elements", [9, 7, 4])
def test_elements_that_are_kept_belong_to_the_scene(elements, laws):
    scene = load_scene("swimmer", {"beam.elements": elements})
    reference = reference_of(scene, 3.0, PILOT, keep_elements=True)
    assert {one.elements for one in laws.played} == {elements}
    assert reference.parts.keys() == {"time_step", "panels", "model"}
    wanted = laws.limit + laws.model + 2.0 * laws.elements / elements**2
    error = relative_error(reference.displacement, wanted[:2], 1.0)
    # 216 panels can be shared out to 9 and to 4 elements, to 7 nearly.
    assert error < (0.3 * reference.parts["panels"] if elements == 7 else 1e-12)


@pytest.mark.parametrize("changes", [{"fluid": None}, {"fluid.model": "none"}])
def test_without_a_fluid_two_laws_are_left(changes, laws):
    reference = reference_of(load_scene("swimmer", changes), 3.0, PILOT)
    assert reference.parts.keys() == {"elements", "time_step"}
    assert values_of(reference) == pytest.approx(laws.limit, abs=1e-11)


def test_what_cannot_be_frozen_is_refined_as_it_is(laws):
    """Such runs take long: they are coarser than those of any plan, and the same for all plans."""
    axial, plain = load_scene("swimmer", {"axial_added_mass": True}), load_scene("swimmer")
    reference = reference_of(axial, 3.0, FINE)
    assert reference.parts.keys() == {"elements", "time_step", "panels"}
    assert {one.fluid_model for one in laws.played} == {"panels"}
    assert max(one.elements * one.panels_per_element for one in laws.played) <= 144
    assert values_of(reference) == pytest.approx(laws.limit + laws.model, abs=1e-11)
    assert plan_for(axial, FINE) == plan_for(axial, PILOT) != PILOT
    for plan, scene in itertools.product((FINE, PILOT), (plain, plain.replace("fluid", None))):
        assert plan_for(scene, plan) is plan


def test_a_body_that_bends_too_far_or_ends_early_has_no_reference(laws):
    laws.model *= 50.0
    with pytest.raises(SwimError, match=r"scene swimmer bends too far .* is \d\d% off"):
        reference_of(load_scene("swimmer"), 3.0)
    laws.played.clear()
    laws.reason = "turn_too_large"
    with pytest.raises(SwimError, match="no converged reference: .* ended with turn_too_large"):
        reference_of(load_scene("swimmer"), 3.0)
    assert len(laws.played) == 1


# ---- choosing ----------------------------------------------------------------------------------

#: Scenes unlike each other: the second loses momentum and bends more.
SCENES: dict[str, dict[str, object]] = {
    "swimmer": {},
    "dragged": {"cross_flow_drag.coefficient": 2.0, "actuation.amplitude": 2.0},
}


@functools.cache
def fine_displacement(name: str) -> Array:
    """Return what panels, twice the elements and the better scheme give."""
    fine = Settings("panels", 18, 4, "proportional", 0.01, "composed")
    outcome = play(fine.apply(short(SCENES[name])), 3.0)
    assert not outcome.termination_reason
    return outcome.displacement


@pytest.mark.parametrize("tolerance", [0.1, 0.03])
@pytest.mark.parametrize("name", SCENES)
def test_the_chosen_settings_are_good_enough(name, tolerance):
    scene = short({**SCENES[name], "description": "Mine."})
    found = scene.for_accuracy(tolerance)
    outcome = play(found, 3.0)
    assert not outcome.termination_reason
    assert relative_error(outcome.displacement, fine_displacement(name), 1.0) <= tolerance
    assert without_settings(found.replace("description", "Mine.")) == without_settings(scene)
    # It says what was chosen, for what, and on which grounds.
    chosen = settings_of(found)
    assert found.description.startswith(f"Mine. Settings chosen for {tolerance:g} of the displ")
    for part in (
        f"fluid model {chosen.fluid_model}",
        f"{chosen.elements} elements,",
        f"steps of {1e3 * chosen.time_step:g} ms of the {chosen.scheme} scheme",
        "off by",
        "times the cost",
        "cheaper ones tried were further off",
    ):
        assert part in found.description
    assert "\n" not in found.description


def test_a_choice_is_the_cheapest_that_is_good_enough():
    """Those before it on the front are tried and found wanting, those behind it are not tried."""
    scene = short()
    counted: list[int] = []
    choice = choose(scene, 0.02, progress=counted.append)
    assert isinstance(choice, Choice)
    assert choice.tolerance == 0.02
    assert choice.reason in scene.for_accuracy(0.02).description
    assert choice.scene == choice.settings.apply(scene)
    assert choice.error <= 0.02
    assert choice.uncertainty < 0.01
    assert sum(counted) >= choice.tried + 4
    reference = reference_of(scene, 3.0, PILOT)
    front = load_front()
    place = next(i for i, one in enumerate(front) if one.settings == choice.settings)
    assert choice.cost == front[place].cost
    assert choice.tried <= place + 1
    for one in front[:place]:
        assert reference.error(play(one.settings.apply(scene), 3.0)) > 0.7 * 0.02


def test_a_choice_does_not_depend_on_how_the_scene_was_computed_before():
    scene = short()
    one = scene.for_accuracy(0.03)
    settings = Settings("expansion", 5, 8, 2, 0.02, "composed", "mean_angles", 1e-6)
    other = settings.apply(scene).for_accuracy(0.03)
    assert other.replace("integrator", one.to_dict()["integrator"]) == one
    assert settings_of(one.for_accuracy(0.03)) == settings_of(one)


@pytest.mark.parametrize("elements", [9, 6])
def test_elements_can_be_kept(elements):
    """For an agent with so many joints: the error is that of this body."""
    scene = short({"beam.elements": elements})
    found = scene.for_accuracy(0.03, keep_elements=True)
    assert found.beam == scene.beam
    assert f"{elements} elements (kept)" in found.description
    fine = Settings("panels", elements, 12, "proportional", 0.005, "composed")
    wanted = play(fine.apply(scene), 3.0).displacement
    assert relative_error(play(found, 3.0).displacement, wanted, 1.0) <= 0.03
    # What is listed for every element can be kept only.
    scene = short({"beam.bending_stiffness": [5.0] * 8})
    with refuses(SwimError, "lists values for every joint or element"):
        scene.for_accuracy(0.1)
    assert scene.for_accuracy(0.1, keep_elements=True).beam == scene.beam


def test_replay_chooses_and_says_so(capsys):
    options = ("--scene", "swimmer", "--duration", "2", "--accuracy", "0.1", "--json")
    done = call_script(capsys, "replay", *options)
    figures = done.figures()
    assert figures["scene"] == "swimmer"
    assert figures["duration"] == pytest.approx(2.0)
    assert len(done.out.splitlines()) == 1
    (said,) = [line for line in done.err.splitlines() if "chosen for 0.1 of the displ" in line]
    # What it said is what it did.
    step = float(said.partition("steps of ")[2].split()[0]) / 1e3
    assert figures["steps"] == round(2.0 / step)


# ---- fronts ------------------------------------------------------------------------------------


UseFront = Callable[..., Path]


@pytest.fixture
def use_front(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> UseFront:
    """Return a function that lets choices be made from settings, the first the cheapest."""
    path = tmp_path / "front.json"

    def use(*settings: Settings, text: str | None = None) -> Path:
        front = [Measured(one, 0.1 * (i + 1), {"swimmer": 0.1}) for i, one in enumerate(settings)]
        path.write_bytes((text or front_to_json(front, {})).encode("utf-8", "surrogateescape"))
        load = functools.partial(load_front, path)
        monkeypatch.setattr("swim_env.accuracy.choice.load_front", load)
        return path

    return use


@pytest.mark.parametrize(
    ("front", "changes", "tolerance", "chosen", "tried"),
    [
        ([FROZEN, replace(FROZEN, time_step=0.005)], {}, 0.1, FROZEN, 1),
        (
            [FROZEN, replace(FROZEN, time_step=0.005)],
            {"episode.control_interval": 0.015},
            *(0.1, replace(FROZEN, time_step=0.0075), 1),
        ),
        # Strips miss what a swimmer pushes off from by more than its displacement.
        ([STRIP, FROZEN], {}, 0.1, FROZEN, 2),
        # No scheme of a scene.
        ([replace(FROZEN, scheme="LSODA", tolerance=1e-4), FROZEN], {}, 0.1, FROZEN, 1),
        (
            [STRIP, FROZEN, PANELS],
            {"episode.duration": 1.0, "axial_added_mass": True},
            *(0.1, PANELS, 1),
        ),
        # At rest without a drive nothing is off.
        ([STRIP, FROZEN], {"actuation": None}, 1e-3, STRIP, 1),
        # Drifting, it moves in a straight line as far as its added mass lets it, in all ways.
        ([STRIP], {"actuation": None, "initial.velocity": (0.1, 0.0)}, 1e-3, STRIP, 1),
    ],
    ids=["first", "control interval", "coarse", "solver", "effect", "at rest", "drifting"],
)
def test_the_first_that_fits_and_is_good_enough_is_chosen(
    front, changes, tolerance, chosen, tried, use_front
):
    use_front(*front)
    choice = choose(short(changes), tolerance)
    assert (choice.settings, choice.tried) == (chosen, tried)
    assert choice.scene.effects == short(changes).effects
    assert f"the {tried - 1} cheaper ones tried were further off" in choice.reason
    if "actuation" in changes:
        assert choice.error < 1e-9 and choice.uncertainty < 1e-9


def test_a_fast_drive_may_have_the_steps_of_a_slow_one_where_they_are_good_enough(use_front):
    """What took 10 ms at 1 Hz, where the front is measured, takes 2 at 5 Hz, or 10 if they do."""
    use_front(FROZEN)
    fast = {"actuation.frequency": 5.0 * math.tau, "episode.control_interval": 0.02}
    steps = [settings.time_step for settings, _ in _candidates(short(fast), False)[0]]
    assert steps == pytest.approx([0.01, 0.002])
    costs = [cost for _, cost in _candidates(short(fast), False)[0]]
    assert costs == pytest.approx([0.02, 0.1])
    assert [one.time_step for one, _ in _candidates(short(), False)[0]] == [0.01]
    # All of them divide the time on which they are compared: at 3 Hz 333 intervals, not 1000 steps.
    thrice = short({**fast, "actuation.frequency": 3.0 * math.tau})
    assert duration_for(thrice, 20.0) == pytest.approx(6.66, abs=1e-12)


def test_settings_that_end_early_are_passed_over(use_front, monkeypatch):
    """On the way or at the start, whatever the displacement was until then."""
    at_once, soon = (replace(FROZEN, time_step=step) for step in (0.02, 0.0125))
    use_front(at_once, soon, FROZEN)

    def breaking(scene: Scene, duration: float) -> Outcome:
        if settings_of(scene).time_step >= at_once.time_step:
            raise SimulationEndedError("mass_not_positive", 0.0, "made up")
        reason = "turn_too_large" if settings_of(scene) == soon else ""
        return replace(play(scene, duration), termination_reason=reason)

    monkeypatch.setattr("swim_env.accuracy.choice.play", breaking)
    assert choose(short({"episode.control_interval": 0.1}), 0.3).settings == FROZEN


def test_without_a_fluid_settings_that_differ_in_it_alone_are_one(use_front, monkeypatch):
    # Four settings, of nine elements and of twelve.
    use_front(STRIP, FROZEN, PANELS, replace(STRIP, elements=12))
    scene = short({"fluid": None, "beam.rotary_inertia": 1e-3, "initial.velocity": (0.1, 0.0)})
    choice = choose(scene, 0.03)
    # It drifts as it started, whatever it is computed with.
    assert choice.tried == 1
    assert choice.scene.fluid is None
    assert choice.settings.fluid_model == "none"
    assert play(choice.scene, 3.0).displacement == pytest.approx([0.25, 0.0], rel=1e-9)
    assert "fluid model none, 9 elements" in choice.reason

    monkeypatch.setattr(
        "swim_env.accuracy.choice.play",
        lambda *given: replace(play(*given), termination_reason="turn_too_large"),
    )
    with refuses(SwimError, "the best of 2 is off by inf"):
        choose(scene, 0.03)


# ---- refusals ----------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.0, -0.01, 5e-4, 0.31, math.nan, math.inf, True, "0.1"])
def test_a_tolerance_beyond_reach_or_sense_is_refused(tolerance):
    with refuses(SwimError, f"the tolerance must be 0.001 to 0.3, got {tolerance!r}"):
        short().for_accuracy(tolerance)


#: Half a wave of ten times what this body can take rolls it up; only panels see that.
ROLLED: dict[str, object] = {
    "beam.bending_stiffness": 0.2,
    "damping.retardation_time": 0.05,
    "actuation.wave_number": math.pi,
    "actuation.amplitude": 3.0,
}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (ROLLED, "scene swimmer has no converged reference: "),
        # Nine elements that turn by 2 rad each lie on one another.
        ({"initial.joint_angles": 2.0, "axial_added_mass": True}, ""),
    ],
    ids=["on the way", "at the start"],
)
def test_a_scene_that_cannot_be_simulated_is_refused(changes, why):
    with refuses(SwimError, why, "under_resolved_gap"):
        short(changes).for_accuracy(0.1, duration=1.0)


@pytest.mark.parametrize(
    ("tolerance", "changes", "plans"),
    [
        (0.3, {}, [PILOT]),
        (0.1, {}, [PILOT, FINE]),
        (0.07, {}, [PILOT, FINE]),
        # Both plans would be the same.
        (0.07, {"axial_added_mass": True}, [PILOT]),
    ],
    ids=["plainly", "barely", "not", "not, at once"],
)
def test_a_reference_has_to_be_good_enough(tolerance, changes, plans, monkeypatch):
    """Known to 4 %: past 0.3 of the tolerance a finer one is made, past half of it none is used."""
    made: list[Refinements] = []
    known = replace(reference_of(short(), 3.0, PILOT), uncertainty=0.04)

    def vague(scene: Scene, duration: float, plan: Refinements, *others: Any) -> Reference:
        made.append(plan)
        return known

    monkeypatch.setattr("swim_env.accuracy.choice.reference_of", vague)
    if tolerance > 0.08:
        assert choose(short(changes), tolerance).uncertainty == 0.04
    else:
        with refuses(SwimError, "good enough for 0.07", "known to 4.0e-02 only"):
            choose(short(changes), tolerance)
    assert made == plans


@pytest.mark.parametrize(
    "text",
    [
        *("{", "[]", "3", '{"front": 3}', '{"front": [{}]}', '{"front": [{"cost": 1}]}', "\udcff"),
        '{"front": [{"cost": 1.0, "errors": {}}]}',
    ],
)
def test_a_broken_front_is_refused(text, use_front):
    use_front(text=text)
    with refuses(SwimError, "not a measured front: ", "front.json"):
        short().for_accuracy(0.1)


def test_a_missing_empty_or_coarse_front_is_refused(use_front):
    use_front(STRIP, replace(STRIP, elements=5))
    with refuses(SwimError, "swimmer to within 0.1: the best of 2 is off by "):
        short().for_accuracy(0.1)
    path = use_front()
    with refuses(SwimError, "no settings of the measured front fit scene swimmer: it has none"):
        short().for_accuracy(0.1)
    path.unlink()
    with refuses(SwimError, "cannot read the measured front: No such file", "front.json)"):
        short().for_accuracy(0.1)


def test_a_scene_that_no_settings_fit_is_told_why():
    seconds = {"episode.control_interval": 2e4, "episode.duration": 2e4}
    seldom = load_scene("swimmer", {**seconds, "integrator.time_step": 0.02})
    why = "episode.control_interval must be at most 100,000 steps of integrator.time_step"
    with refuses(SwimError, "no settings of the measured front fit scene swimmer: ", why):
        seldom.for_accuracy(0.1)
