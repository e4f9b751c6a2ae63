"""Added mass of closed outlines against closed forms."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import gamma

from swim_env import OutlineError
from swim_env.physics import added_mass_of_polygon
from tests.analytic.conformal import mapped_mass, rectangle_mass, series_boundary
from tests.analytic.probes import fluid_constants, probe_fluid
from tests.invariants.runs import (
    largest,
    orders,
)
from tests.support import Array

UNIT_SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def ellipse(a: float, b: float, count: int) -> Array:
    t = 2.0 * np.pi * np.arange(count) / count
    return np.stack([a * np.cos(t), b * np.sin(t)], axis=1)


def ellipse_mass(a: float, b: float) -> Array:
    return np.diag([np.pi * b**2, np.pi * a**2, np.pi / 8.0 * (a**2 - b**2) ** 2])


def corners_of(z: NDArray[np.complex128]) -> Array:
    return np.stack([z.real, z.imag], axis=1)


def cut_edges(corners: NDArray[np.complex128], per_edge: list[int], graded: bool = True) -> Array:
    """Cut straight edges into panels that are equal, or by cosines shorter towards the corners."""
    edges = np.roll(corners, -1) - corners
    parts = []
    for corner, edge, count in zip(corners, edges, per_edge, strict=True):
        s = np.arange(count) / count
        parts.append(corner + edge * (0.5 * (1.0 - np.cos(np.pi * s)) if graded else s))
    return corners_of(np.concatenate(parts))


def lopsided() -> Array:
    """Return a concave outline of five corners without any symmetry, about 1 m across."""
    return np.array([[0.1, -0.2], [1.1, 0.1], [0.5, 0.3], [0.9, 0.9], [-0.2, 0.6]])


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (2.0, 1.0), (1.0, 0.5), (0.3, 1.0), (1.0, 0.2)])
def test_ellipse_converges_at_first_order(a: float, b: float) -> None:
    exact = np.diag(ellipse_mass(a, b))
    masses = np.array([added_mass_of_polygon(ellipse(a, b, count)) for count in (128, 256, 512)])
    assert largest(masses * (1.0 - np.eye(3))) < 1e-13 * exact.max()
    found = np.diagonal(masses, axis1=1, axis2=2)
    if a == b:
        assert largest(found[:, 2]) < 1e-25, "the rotary mass of a circle must vanish"
        found, exact = found[:, :2], exact[:2]
    errors = found / exact - 1.0
    observed = orders(errors)
    assert ((0.85 < observed) & (observed < 1.05)).all(), f"errors {errors}, orders {observed}"
    assert largest(errors[1]) < 0.01, f"1 % at 256 edges: {errors}"


@pytest.mark.parametrize(
    "series",
    [[0.0, 0.35], [0.1, 0.1, 0.1], [0.3 + 0.2j, 0.1 - 0.2j, 0.05j]],
    ids=["three rounded corners", "egg", "lopsided"],
)
def test_mapped_shapes_with_every_coupling(series: list[complex]) -> None:
    exact = mapped_mass(series_boundary(series, 4096))
    outlines = [corners_of(series_boundary(series, count)) for count in (256, 512, 1024)]
    errors = [largest(added_mass_of_polygon(o) - exact) / largest(exact) for o in outlines]
    text = f"errors {errors}, orders {orders(errors)}"
    assert errors[1] < 0.003, text
    # Two errors of first order nearly cancel for three corners, which are slow to settle.
    assert 0.6 < orders(errors)[1] < 1.05, text
    assert errors[2] < errors[1] < errors[0], text


@pytest.mark.parametrize("n", [3, 4, 6])
def test_regular_polygon_has_the_mass_of_its_capacity(n: int) -> None:
    # m = 2 pi R^2 - S with the capacity R in gamma functions; the square of side 2 has 4.7538.
    area = n / (4.0 * np.tan(np.pi / n))
    ratio = np.tan(np.pi / n) / (2.0 * np.pi * n) * gamma(1.0 / n) ** 4 / gamma(2.0 / n) ** 2
    exact = (ratio - 1.0) * area
    if n == 4:
        assert abs(4.0 * exact - 4.754) < 5e-4, f"tables have 4.754, this is {4.0 * exact}"
    radius = 1.0 / (2.0 * np.sin(np.pi / n))
    corners = radius * np.exp(2j * np.pi * np.arange(n) / n)
    errors = []
    for count in (8, 16, 32, 64):
        mass = added_mass_of_polygon(cut_edges(corners, [count] * n, graded=False))
        spread = abs(mass[0, 0] - mass[1, 1]) + abs(mass[0, 1])
        assert spread < 1e-12, f"x and y differ by {spread:.2e} in a body of {n}-fold symmetry"
        errors.append(float(mass[0, 0] / exact - 1.0))
    text = f"errors {errors}, orders {orders(errors)}"
    assert all(1.1 < order < 1.5 for order in orders(errors)), text
    assert abs(errors[-1]) < 1.2e-3, text


@pytest.mark.parametrize("height", [1.0, 0.3, 0.1])
def test_rectangle_along_across_and_turning(height: float) -> None:
    exact = rectangle_mass(1.0, height)
    corner = 0.5 + 0.5j * height
    corners = np.array([-corner, corner.conjugate(), corner, -corner.conjugate()])
    worst = []
    for count in (16, 32, 64):
        mass = added_mass_of_polygon(cut_edges(corners, [3 * count, count, 3 * count, count]))
        worst.append(largest(np.diag(mass) / exact - 1.0))
    text = f"errors {worst}, orders {orders(worst)}"
    assert worst[-1] < 2e-3, text
    assert all(order > 0.9 for order in orders(worst)), text


def test_thin_plate_limit() -> None:
    plate = np.array([np.pi / 4.0, np.pi / 128.0])
    excess = []
    for thickness in (0.04, 0.02, 0.01):
        per_side = int(round(4.0 / thickness))
        corner = 0.5 + 0.5j * thickness
        corners = np.array([-corner, corner.conjugate(), corner, -corner.conjugate()])
        mass = np.diag(added_mass_of_polygon(cut_edges(corners, [per_side, 8, per_side, 8])))[1:]
        assert largest(mass / rectangle_mass(1.0, thickness)[1:] - 1.0) < 2e-3
        excess.append(mass / plate - 1.0)
    # It goes as t log(1/t).
    assert (np.diff(excess, axis=0) < 0.0).all() and (0.0 < excess[-1]).all(), f"excess {excess}"
    thin = np.diag(added_mass_of_polygon(ellipse(0.5, 0.005, 1600)))
    errors = np.abs(thin[1:] / plate - 1.0)
    assert errors.max() < 1.2e-3, f"ellipse 1 % thick is off the plate by {errors.tolist()}"
    assert thin[0] < 2e-4 * plate[0], f"a plate has no mass along itself, got {thin[0]:.2e}"


@pytest.mark.filterwarnings("ignore:5 panels are too few")
@pytest.mark.parametrize("shape", ["ellipse", "lopsided"])
def test_symmetric_positive_definite_and_free_of_order(shape: str) -> None:
    corners = ellipse(1.0, 0.4, 60) if shape == "ellipse" else lopsided()
    mass = added_mass_of_polygon(corners)
    assert np.array_equal(mass, mass.T), f"asymmetric by {np.abs(mass - mass.T).max():.2e}"
    lowest = float(np.linalg.eigvalsh(mass)[0])
    assert lowest > 1e-3, f"smallest eigenvalue {lowest:.3e}"
    # Turned the other way, begun elsewhere, with its first corner repeated.
    same = corners[::-1], np.roll(corners, 2, axis=0), np.concatenate([corners, corners[:1]])
    for other in same:
        assert largest(added_mass_of_polygon(other) - mass) < 1e-14


@pytest.mark.filterwarnings("ignore:5 panels are too few")
@pytest.mark.parametrize("angle", [0.3, 2.0, -1.1])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.7, -0.4), (-30.0, 20.0)])
def test_turned_and_shifted(angle: float, shift: tuple[float, float]) -> None:
    corners = lopsided()
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    moved = added_mass_of_polygon(corners @ turn.T + shift)
    # Velocity (u, w about the new origin) as the body sees it from its own origin.
    motion = np.zeros((3, 3))
    motion[:2, :2] = turn.T
    motion[:2, 2] = turn.T @ np.array([-shift[1], shift[0]])
    motion[2, 2] = 1.0
    exact = motion.T @ added_mass_of_polygon(corners) @ motion
    assert largest(moved - exact) < 1e-12 * largest(exact)


@pytest.mark.filterwarnings("ignore:5 panels are too few")
@pytest.mark.parametrize("scale", [1e-3, 250.0])
def test_scaled_and_mirrored(scale: float) -> None:
    mass = added_mass_of_polygon(lopsided())
    assert largest(added_mass_of_polygon(lopsided(), density=998.0) / 998.0 - mass) < 1e-15
    power = scale ** np.array([[2, 2, 3], [2, 2, 3], [3, 3, 4]])
    assert largest(added_mass_of_polygon(scale * lopsided()) / power - mass) < 1e-13
    sign = np.diag([1.0, -1.0, -1.0])
    mirrored = added_mass_of_polygon(lopsided() * [1.0, -1.0])
    assert largest(mirrored - sign @ mass @ sign) < 1e-13


def swimmer_outline(joint_angles: Array, panels: int, caps: int, h: float = 0.01) -> Array:
    """Return the mitred outline (docs/theory/plane.md) of a unit beam, head at the origin."""
    n = len(joint_angles) + 1
    angles = np.concatenate([[0.0], np.cumsum(joint_angles)])
    nodes = np.concatenate([[0.0], np.cumsum(np.exp(1j * angles)) / n])
    mean = np.concatenate([angles[:1], 0.5 * (angles[1:] + angles[:-1]), angles[-1:]])
    half = np.concatenate([[0.0], 0.5 * np.asarray(joint_angles), [0.0]])
    mitre = h / np.cos(half) * 1j * np.exp(1j * mean)
    corners = np.concatenate([nodes - mitre, (nodes + mitre)[::-1]])
    per_edge = [panels // 2] * n + [caps] + [panels // 2] * n + [caps]
    return cut_edges(corners, per_edge, graded=False)


@pytest.mark.parametrize(("elements", "panels", "caps"), [(9, 4, 1), (3, 12, 2), (27, 4, 3)])
@pytest.mark.parametrize("bend", [0.0, 0.15])
def test_rigid_swimmer_is_its_polygon(elements: int, panels: int, caps: int, bend: float) -> None:
    joints = bend * np.sin(1.0 + 2.5 * np.arange(elements - 1))
    fluid = fluid_constants(elements, panels, caps, axial=True)
    angles = np.concatenate([[0.0], np.cumsum(joints)])
    d3 = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    d1 = np.stack([-d3[:, 1], d3[:, 0]], axis=1)
    centres = (np.cumsum(d3, axis=0) - 0.5 * d3) / elements
    spin = np.stack([-centres[:, 1], centres[:, 0]], axis=1)
    rates = np.zeros((2 * elements + 2, 3))
    rates[:elements, :2], rates[:elements, 2] = d1, np.sum(d1 * spin, axis=1)
    rates[elements : 2 * elements, 2] = 1.0
    ends = [0, -1]
    rates[2 * elements :, :2] = d3[ends]
    rates[2 * elements :, 2] = np.sum(d3 * spin, axis=1)[ends]
    summed = rates.T @ probe_fluid(joints, fluid).mass @ rates
    polygon = added_mass_of_polygon(swimmer_outline(joints, panels, caps), density=10.0)
    assert largest(summed - polygon) < 1e-12 * largest(polygon)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([0.0, 1.0, 2.0], r"shape \(M, 2\), got \(3,\)"),
        (np.zeros((4, 3)), r"shape \(M, 2\), got \(4, 3\)"),
        ([[0.0, 0.0], [1.0]], r"\(M, 2\) array of numbers"),
        ([["a", "b"], ["c", "d"], ["e", "f"]], r"\(M, 2\) array of numbers"),
        ([[0.0, 0.0], [1.0, 0.0]], "at least 3 corners, got 2"),
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], "at least 3 corners, got 2"),
        ([[0.0, 0.0], [1.0, np.nan], [0.0, 1.0]], "finite.* in row 1"),
        ([[0.0, 0.0], [1.0, 0.0], [np.inf, 1.0]], "finite.* in row 2"),
        ([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], "edge 1 of the outline has no length"),
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], "enclose an area"),
        ([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.5, 3.0]], "edges 0 and 2 .* cross or touch"),
        (
            [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.0], [0.0, 1.0]],
            "edges 0 and 2 .* cross or touch",
        ),
        # A bow tie: its halves cancel in the signed area, yet its corners are not on one line.
        ([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], "edges 0 and 2 .* cross or touch"),
    ],
)
def test_bad_outline_is_refused_by_name(vertices: object, message: str) -> None:
    with pytest.raises(OutlineError, match=message):
        added_mass_of_polygon(vertices)  # type: ignore[arg-type]


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, np.inf, True, None, "water", [1.0]])
def test_bad_density_is_refused(density: object) -> None:
    with pytest.raises(OutlineError, match="density must be a .*number.* in kg/m"):
        added_mass_of_polygon(UNIT_SQUARE, density=density)  # type: ignore[arg-type]


def test_a_square_by_its_corners_warns_and_has_its_mass_with_panels_on_its_edges() -> None:
    # Exact: 4.7543 per density and half side squared (from the square's conformal radius), 0.7252
    # about the centre.
    square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    with pytest.warns(UserWarning, match="4 panels are too few .* panels_per_edge"):
        added_mass_of_polygon(square)
    mass = np.diag(added_mass_of_polygon(square, panels_per_edge=200))
    np.testing.assert_allclose(mass, [4.7543, 4.7543, 0.7252], rtol=0.01)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_a_closing_corner_repeats_the_first_one_up_to_rounding(kind: type) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 201).astype(kind)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    mass = added_mass_of_polygon(circle)
    np.testing.assert_allclose(mass, added_mass_of_polygon(circle[:-1]), rtol=0.0, atol=1e-12)
    assert mass[0, 0] == pytest.approx(np.pi, rel=0.02)


@pytest.mark.parametrize(("corners", "per_edge"), [(20_000, 1), (200_000, 1), (100, 51)])
def test_too_many_panels_are_refused_before_anything_is_computed(
    corners: int, per_edge: int
) -> None:
    angles = np.arange(corners) * (2.0 * np.pi / corners)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    with pytest.raises(OutlineError, match=f"at most 5000 panels, got {corners} edges with"):
        added_mass_of_polygon(circle, panels_per_edge=per_edge)


@pytest.mark.parametrize("panels", [0, -1, 1.5, True, np.nan, np.inf, "two", None])
def test_bad_panels_per_edge_are_refused(panels: object) -> None:
    with pytest.raises(OutlineError, match="panels_per_edge must be"):
        added_mass_of_polygon(UNIT_SQUARE, panels_per_edge=panels)  # type: ignore[arg-type]
