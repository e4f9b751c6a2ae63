"""Added mass of every fluid model: gradient, order in the bend, centre line, refusals."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from swim_env import FLUID_MODELS, SceneError, SimulationEndedError, Simulator, load_scene
from swim_env.physics.fluid.layout import FluidConstants
from swim_env.sim.constants import scene_constants
from tests.analytic.probes import probe_fluid
from tests.analytic.test_derivatives import differentiate
from tests.invariants.runs import MODELS, VARIANTS, each_model, each_size, largest, orders
from tests.support import Array, refuses, uniform

each_variant = pytest.mark.parametrize("variant", VARIANTS)


def fluid_of(fluid: Mapping[str, object], elements: int, **beam: float) -> FluidConstants:
    """Return what the kernels get from a scene with this fluid block and this beam."""
    changes = {f"beam.{key}": value for key, value in beam.items()}
    scene = load_scene(
        "paper_i", {"fluid": {"density": 10.0, **fluid}, "beam.elements": elements, **changes}
    )
    constants = scene_constants(scene)[1]
    # Terms that are shared are read-only, another type for the probe, which would compile again.
    return constants._replace(terms=constants.terms.copy())


def random_bend(elements: int, size: float = 0.5) -> Array:
    """Return joint angles (N - 1,) of up to `size` (rad)."""
    return uniform(elements - 1, seed=elements, size=size)


# ---- the shape force ---------------------------------------------------------------------------


@each_size
@each_model
def test_shape_force_is_the_derivative_of_the_kinetic_energy(name: str, elements: int) -> None:
    fluid = fluid_of(MODELS[name], elements)
    joints = random_bend(elements)
    motion = np.random.default_rng(3).normal(size=2 * elements)
    probe = probe_fluid(joints, fluid, motion)

    def energy(joints: Array) -> Array:
        return np.array([0.5 * motion @ probe_fluid(joints, fluid).mass @ motion])

    # A joint turns the elements behind it against those in front.
    exact = -np.diff(differentiate(energy, joints)[0], prepend=0.0, append=0.0)
    # A constant added mass has no derivative: then rounding has to be small beside the energy.
    scale = max(float(np.abs(exact).max()), 1e-3 * float(motion @ probe.mass @ motion))
    error = float(np.abs(probe.gradient - exact).max()) / scale
    # A's rounding over steps of 0.02 rad.
    assert error < 1e-9, f"derivative off by {error:.1e} of {scale:.2e}"
    # Turning the whole body leaves A alone: a sum of up to 9 rounded terms, 4e-16 seen.
    whole = abs(float(probe.gradient.sum())) / scale
    assert whole < 1e-14, f"turning the whole body changes A by {whole:.1e}"
    assert np.array_equal(probe.mass, probe.mass.T), "A is not symmetric"
    least = float(np.linalg.eigvalsh(probe.mass)[0])
    assert least > 0.0, f"an eigenvalue of A is {least:.2e}"


@each_model
def test_units_do_not_matter(name: str) -> None:
    # All lengths times a and the density times c: v-v goes as c a^2, every w brings one more a.
    a, c, n = 2.5, 3.0, 5
    one = probe_fluid(random_bend(n), fluid_of(MODELS[name], n)).mass
    scaled = fluid_of({**MODELS[name], "density": c * 10.0}, n, length=a, half_thickness=a * 0.01)
    other = probe_fluid(random_bend(n), scaled).mass
    power = np.repeat([1.0, a], n)
    wanted = c * a**2 * power[:, None] * power * one
    # Rounding, 5e-15 seen; that of the expansion's second derivatives is divided by a bend of
    # 0.01 squared, 7e-12 seen.
    assert largest(other - wanted) < (1e-9 if name == "expansion" else 1e-13) * largest(wanted)


# ---- strip, frozen, expansion ------------------------------------------------------------------


@each_size
@pytest.mark.parametrize("given", [None, 3.7, 1e-3])
def test_strips_have_the_mass_of_their_own_length(given: float | None, elements: int) -> None:
    fluid = fluid_of({"model": "strip", "added_mass_per_length": given}, elements, length=2.0)
    # By default a plate's mean value, rho pi l/4 = 5 pi.
    per_length = 5.0 * np.pi if given is None else given
    dl = 2.0 / elements
    wanted = np.repeat([per_length * dl, per_length * dl**3 / 12.0], elements)
    for bend in (0.0, 1.5):
        found = probe_fluid(np.full(elements - 1, bend), fluid).mass
        error = np.abs(found - np.diag(wanted)).max()
        # One rounding in each of a handful of products.
        assert error <= 1e-15 * wanted.max(), f"bent by {bend} rad: off by {error:.1e}"


@each_size
def test_frozen_is_the_straight_bodys_mass_at_every_shape(elements: int) -> None:
    for fluid in ({}, {"panels_per_element": 8, "cap_panels": "proportional"}):
        panels = fluid_of({"model": "panels", **fluid}, elements)
        straight = probe_fluid(np.zeros(elements - 1), panels).mass
        for model in ("frozen", "expansion"):
            cheap = fluid_of({"model": model, **fluid}, elements)
            found = probe_fluid(np.zeros(elements - 1), cheap).mass
            assert np.array_equal(found, straight), f"{model}: {np.abs(found - straight).max():.1e}"
        frozen = fluid_of({"model": "frozen", **fluid}, elements)
        bent = probe_fluid(np.full(elements - 1, 1.2), frozen).mass
        assert np.array_equal(bent, straight), f"bent: {np.abs(bent - straight).max():.1e}"


@each_size
@pytest.mark.parametrize("caps", [1, "proportional"])
def test_errors_in_the_bend_are_of_second_and_of_fourth_order(
    caps: int | str, elements: int
) -> None:
    block: dict[str, object] = {"panels_per_element": 8, "cap_panels": caps}
    direction = random_bend(elements, 1.0)
    direction /= np.abs(direction).max()
    fluids = {
        m: fluid_of({"model": m, **block}, elements) for m in ("panels", "frozen", "expansion")
    }
    errors: dict[str, list[float]] = {"frozen": [], "expansion": []}
    # Below 0.04 rad the tensor's own error, some 1e-8, would begin to show in the fourth order.
    for size in (0.16, 0.08, 0.04):
        masses = {m: probe_fluid(size * direction, fluid).mass for m, fluid in fluids.items()}
        for model, found in errors.items():
            found.append(largest(masses[model] - masses["panels"]) / largest(masses["panels"]))
    for model, order in (("frozen", 2.0), ("expansion", 4.0)):
        observed = orders(errors[model])
        # A is even in the bend, so what is left is off by bend^2 in the order: 0.011 seen.
        assert np.abs(observed - order).max() < 0.05, f"{model}: orders {observed}, {errors}"


def test_caps_in_proportion_are_refined_with_the_sides() -> None:
    found = {}
    for panels in (4, 8, 12):
        block = {"model": "panels", "panels_per_element": panels, "cap_panels": "proportional"}
        fluid = fluid_of(block, 9)
        found[panels] = fluid.geometry.cap_panels
        same = fluid_of({**block, "cap_panels": found[panels]}, 9)
        one, other = (probe_fluid(random_bend(9), caps).mass for caps in (fluid, same))
        assert np.array_equal(one, other), f"{panels} panels: not those of {found[panels]} caps"
    assert found == {4: 1, 8: 2, 12: 3}


# ---- centre line -------------------------------------------------------------------------------
# Symmetries of all models: see tests.invariants.test_symmetry.


def sheet_mass(joints: Array, variant: str, panels: int, length: float = 1.0) -> Array:
    """Return the centre line's A from the formulas, density 10, the fluid on d1's side.

    Complex positions: a unit source on the segment from 0 to h has the potential
    z log z - (z - h) log(z - h) - h over 2 pi, lengths in units of the body's.
    """
    factor, origin = VARIANTS[variant]
    n = len(joints) + 1
    dl, h = length / n, length / n / panels
    turn = np.exp(1j * np.concatenate([[0.0], np.cumsum(joints)]))
    nodes = np.concatenate([[0.0], np.cumsum(dl * turn)])
    element = np.repeat(np.arange(n), panels)
    along = np.tile(np.arange(panels) * h, n)
    tangent = turn[element]
    start = nodes[element] + along * tangent
    z = (start + 0.5 * h * tangent)[:, None]
    seen = (z - start) / tangent
    ahead, behind = np.log(seen / length), np.log((seen - h) / length)
    potential = (seen * ahead - (seen - h) * behind - h).real / (2.0 * np.pi)
    velocity = (ahead - behind) / tangent / (2.0 * np.pi)  # u_x - i u_y
    normal = 1j * tangent
    influence = (velocity * normal[:, None]).real
    np.fill_diagonal(influence, 0.5)
    arm = along + 0.5 * h - 0.5 * dl - origin * dl
    own = np.eye(n)[element]
    boundary = np.hstack([own, factor * arm[:, None] * own])
    mass: Array = -10.0 * h * boundary.T @ potential @ np.linalg.solve(influence, boundary)
    return 0.5 * (mass + mass.T)


@each_size
@each_variant
@pytest.mark.parametrize("panels", [2, 4, 10])
def test_centre_line_is_the_independent_one(panels: int, variant: str, elements: int) -> None:
    block = {"model": "centreline", "variant": variant, "panels_per_element": panels}
    for length, size in ((1.0, 0.0), (1.0, 0.5), (2.7, 0.8)):
        joints = random_bend(elements, size)
        found = probe_fluid(joints, fluid_of(block, elements, length=length)).mass
        exact = sheet_mass(joints, variant, panels, length=length)
        # Two ways to round the same matrices of up to 90 panels: 1e-14 seen.
        assert largest(found - exact) < 1e-12 * largest(exact)


def test_the_variant_is_the_consistent_one_unless_named() -> None:
    masses = [
        probe_fluid(random_bend(5), fluid_of({"model": "centreline", **block}, 5)).mass
        for block in ({}, {"variant": "consistent"}, {"variant": "printed_factor"})
    ]
    assert np.array_equal(masses[0], masses[1])
    assert not np.array_equal(masses[0], masses[2])


# ---- refusals ----------------------------------------------------------------------------------

REFUSED: list[tuple[dict[str, object], str]] = [
    (
        {"axial_added_mass": {}, "fluid": None},
        "axial_added_mass has no meaning without fluid.model panels",
    ),
    (
        {"fluid.model": "expansion", "beam.elements": 28},
        "fluid.model expansion takes at most 27 elements",
    ),
    (
        {"fluid.model": "strip", "fluid.added_mass_per_length": 0.0},
        "fluid.added_mass_per_length must be above 0 kg/m, got 0.0",
    ),
    (
        {"fluid.model": "centreline", "fluid.variant": "printed_facto"},
        "got 'printed_facto' (nearest: printed_factor)",
    ),
    ({"fluid.model": "centerline"}, "got 'centerline' (nearest: centreline)"),
    ({"fluid.cap_panels": "propotional"}, "got 'propotional' (nearest: proportional)"),
    ({"fluid.cap_panels": 0}, "fluid.cap_panels must be at least 1, got 0"),
    (
        {"fluid": {"model": "none", "density": 10.0}},
        "fluid.density has no meaning with fluid.model none",
    ),
]
for _model in FLUID_MODELS:
    _meaningless = f"has no meaning with fluid.model {_model}, only with"
    if _model != "panels":
        _why = "without fluid.model panels, as it is that of the end panels; leave it out or change"
        _words = f"axial_added_mass has no meaning {_why} the model, got {_model}"
        REFUSED.append(({"axial_added_mass": {}, "fluid.model": _model}, _words))
    if _model != "strip":
        _changes = {"fluid.model": _model, "fluid.added_mass_per_length": 1.0}
        REFUSED.append((_changes, f"fluid.added_mass_per_length {_meaningless} strip"))
    if _model != "centreline":
        _changes = {"fluid.model": _model, "fluid.variant": "consistent"}
        REFUSED.append((_changes, f"fluid.variant {_meaningless} centreline"))
    if _model != "none":
        _words = f"{_model} needs fluid.density, a number above 0 in kg/m^3, got null"
        REFUSED.append(({"fluid": {"model": _model}}, f"fluid.model {_words}"))


@pytest.mark.parametrize(("changes", "words"), REFUSED, ids=str)
def test_a_scene_that_makes_no_sense_is_refused(changes: dict[str, object], words: str) -> None:
    with refuses(SceneError, words):
        load_scene("paper_i", changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"axial_added_mass": {}},
        {"fluid.model": "expansion", "beam.elements": 27},
        {"fluid.model": "strip", "fluid.added_mass_per_length": 1.0},
        {"fluid.model": "centreline", "fluid.variant": "printed_factor"},
        {"fluid.cap_panels": "proportional"},
        {"fluid": {"model": "strip", "density": 1.0}},
        {"fluid": {"model": "none"}},
    ],
    ids=str,
)
def test_what_was_just_refused_is_accepted_one_step_away(
    changes: dict[str, object], tmp_path: Path
) -> None:
    # So that the refusals above are of what they name and of nothing else.
    scene = load_scene("paper_i", changes)
    scene.save(tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == scene


def test_an_expansion_beyond_its_bends_has_no_positive_mass() -> None:
    # A coil of one and a half turns: the parabola in the bend takes the mass of some motions below
    # zero. Close by, at one turn and a quarter, body and fluid together are still positive.
    fluid = fluid_of({"model": "expansion"}, 9)
    least = [
        float(np.linalg.eigvalsh(probe_fluid(np.full(8, a), fluid).mass)[0]) for a in (0.3, 1.2)
    ]
    assert least[0] > 0.0 > least[1], f"least eigenvalues {least}"
    base = {"fluid.model": "expansion"}
    assert Simulator(load_scene("paper_i", {**base, "initial.joint_angles": 1.0})).energy() > 0.0
    with refuses(SimulationEndedError) as caught:
        Simulator(load_scene("paper_i", {**base, "initial.joint_angles": 1.2}))
    assert caught.value.reason == "mass_not_positive"
