"""Panels on a spatial body: added mass, shape derivative, limits."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swim_env.physics import added_mass_of_surface
from swim_env.physics.spatial.panels.surface import Surface, surface_of_sections
from swim_env.physics.status import FINE, INFLUENCE_SINGULAR, OUTLINE_DEGENERATE, UNDER_RESOLVED_GAP
from tests.analytic.spatial_probes import PanelProbe
from tests.analytic.test_surface_added_mass import ellipsoid_mass
from tests.reference import spatial_panels as reference
from tests.reference.spatial_panels import Body
from tests.support import Array, run_python

#: d1 = e_y, d2 = e_z, d3 = e_x.
STRAIGHT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def sections(profile: str, count: int) -> tuple[Array, Array]:
    """Return half widths and half heights (m) at equal steps along a body of 1 m."""
    s = np.linspace(0.0, 1.0, count + 1)
    if profile == "uniform":
        shape = np.ones_like(s)
    elif profile == "ellipsoid":
        shape = np.sqrt(1.0 - (2.0 * s - 1.0) ** 2)
    else:  # like a fish: blunt in front, narrow in front of the tail
        shape = 1.8 * s**0.5 * (1.0 - s) ** 0.7 * (1.0 - 0.6 * s)
    tall = 1.0 + (0.8 * s if profile == "fish" else 0.0)
    return 0.08 * shape, 0.11 * tall * shape


def body(profile: str, elements: int, rows: int = 2, around: int = 8, **options: str) -> Body:
    width, height = sections(profile, elements * rows)
    return Body(elements, 1.0 / elements, width, height, around, **options)


def surface(of: Body, density: float = 1.0) -> Surface:
    return surface_of_sections(
        of.element_length,
        of.half_width,
        of.half_height,
        elements=of.elements,
        around=of.around,
        density=density,
        self_term=of.self_term,
        rings=of.rings,
    )


def bent(elements: int, angle: float, seed: int = 0, turned: bool = True) -> Array:
    """Return directors of a body whose joints turn by about this angle (rad) in any direction."""
    rng = np.random.default_rng(seed)
    first = Rotation.random(random_state=seed).as_matrix() if turned else STRAIGHT
    found = [first]
    for _ in range(elements - 1):
        step = Rotation.from_rotvec(angle / np.sqrt(3.0) * rng.normal(size=3))
        found.append(found[-1] @ step.as_matrix())
    return np.array(found)


def rigid_motions(of: Body, directors: Array) -> Array:
    """Return V (6 N, 6) of rigid motions in space, rotations about the mean centre."""
    blocks = []
    for r, frame in zip(reference.centres(of, directors), directors, strict=True):
        turning = np.cross(np.eye(3), r)  # rows e_i x r
        velocity = np.concatenate([np.eye(3), turning])
        spin = np.concatenate([np.zeros((3, 3)), np.eye(3)])
        blocks += [frame.T @ velocity.T, frame.T @ spin.T]
    return np.concatenate(blocks)


def error(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


CASES: list[tuple[str, int, dict[str, Any]]] = [
    ("uniform", 2, {"rows": 1}),
    ("uniform", 3, {"rings": "inscribed"}),
    ("ellipsoid", 2, {"self_term": "flat"}),
    ("ellipsoid", 4, {"around": 12}),
    ("fish", 3, {"rows": 3}),
    ("fish", 6, {}),
    ("ellipsoid", 1, {}),
]


@pytest.mark.parametrize(("profile", "elements", "options"), CASES)
def test_bent_bodies_have_the_independent_mass_and_derivative(
    profile: str, elements: int, options: dict[str, Any]
) -> None:
    of = body(profile, elements, **options)
    probe = PanelProbe(surface(of, density=3.0))
    directors = bent(elements, 0.3, seed=elements)
    motion = np.random.default_rng(1).normal(size=6 * elements)
    exact = 3.0 * reference.added_mass(of, directors).real
    assert error(probe.mass(directors), exact) < 1e-12
    derivative = probe.derivative(directors, motion)
    if elements == 1:  # nothing but a turn of the whole
        assert np.abs(derivative).max() < 1e-12 * np.abs(exact).max()
    else:
        exact_derivative = 3.0 * reference.shape_derivative(of, directors, motion)
        assert error(derivative, exact_derivative) < 1e-10
        # Turning all elements together changes nothing.
        whole = np.einsum("kij,kj->i", directors, derivative)
        assert np.abs(whole).max() < 1e-11 * np.abs(derivative).max()


def test_derivative_is_that_of_the_compiled_mass() -> None:
    """Central differences of the kernels' own A, on the body of nine elements."""
    probe = PanelProbe(surface(body("fish", 9, around=12)))
    directors = bent(9, 0.2)
    motion = np.random.default_rng(2).normal(size=54)
    found = probe.derivative(directors, motion)
    for k, axis in ((0, 0), (3, 1), (4, 2), (8, 0), (8, 2)):
        energies = []
        for step in (1e-5, -1e-5):
            turned = directors.copy()
            turned[k] = turned[k] @ Rotation.from_rotvec(step * np.eye(3)[axis]).as_matrix()
            energies.append(motion @ probe.mass(turned) @ motion / 2.0)
        numerical = (energies[0] - energies[1]) / 2e-5
        assert abs(numerical - found[k, axis]) < 1e-7 * np.abs(found).max()


def test_mass_depends_on_the_joints_alone() -> None:
    probe = PanelProbe(surface(body("fish", 5)))
    turned = bent(5, 0.3)
    straight = np.einsum("ij,kjl->kil", turned[0].T, turned)
    assert error(probe.mass(turned), probe.mass(straight)) < 1e-13
    # It is positive on what the body can do and has the symmetry of a matrix to the last bit.
    found = probe.mass(turned)
    assert (found == found.T).all()
    assert np.linalg.eigvalsh(found).min() > -1e-3 * np.abs(found).max()


@pytest.mark.parametrize("profile", ["uniform", "ellipsoid", "fish"])
def test_rigid_motions_have_the_mass_of_the_polyhedron(profile: str) -> None:
    """Whatever the shape; this is the public function on the reference's mesh."""
    of = body(profile, 4)
    probe = PanelProbe(surface(of, density=2.0))
    for directors in (bent(4, 0.0), bent(4, 0.25)):
        vertices, faces, _ = reference.mesh(of, directors)
        motions = rigid_motions(of, directors)
        found = motions.T @ probe.mass(directors) @ motions
        assert error(found, added_mass_of_surface(vertices, faces, density=2.0)) < 1e-12


@pytest.mark.parametrize(
    ("options", "least", "most"),
    [
        ({}, 0.009, 0.043),  # 4.2, 1.0 and 2.5 % along, across and turning
        ({"self_term": "flat"}, 0.08, 0.121),
        ({"rings": "inscribed"}, 0.03, 0.061),
        ({"self_term": "flat", "rings": "inscribed"}, 0.03, 0.072),
    ],
)
@pytest.mark.parametrize("elements", [9, 18])
def test_spheroid_on_a_bodys_own_mesh(
    options: dict[str, Any], least: float, most: float, elements: int
) -> None:
    """1:6 with 18 rows of 12 panels: the default is within 5 % in every motion."""
    s = np.linspace(0.0, 1.0, 19)
    radius = np.sqrt(1.0 - (2.0 * s - 1.0) ** 2) / 12.0
    of = Body(elements, 1.0 / elements, radius, radius, 12, **options)
    directors = np.array([STRAIGHT] * elements)
    motions = rigid_motions(of, directors)
    found = motions.T @ PanelProbe(surface(of)).mass(directors) @ motions
    exact = ellipsoid_mass(0.5, 1.0 / 12.0, 1.0 / 12.0)
    off = np.abs(np.diag(found)[[0, 1, 2, 4, 5]] / np.diag(exact)[[0, 1, 2, 4, 5]] - 1.0)
    assert least < off.min() and off.max() < most, off
    assert np.abs(found - np.diag(np.diag(found))).max() < 1e-12 * found.max()


@pytest.mark.parametrize("flatness", [1e-2, 1e-4])
def test_flat_bodies(flatness: float) -> None:
    """Their influence is eliminated with exchanges of rows, and worse conditioned."""
    of = body("uniform", 3)
    thin = Body(3, of.element_length, flatness * of.half_width, of.half_height, 8)
    directors = bent(3, 0.2)
    exact = reference.added_mass(thin, directors).real
    assert error(PanelProbe(surface(thin)).mass(directors), exact) < 1e-12 / flatness


def test_bodies_without_thickness_are_refused() -> None:
    of = body("uniform", 3)
    thin = Body(3, of.element_length, 1e-13 * of.half_width, of.half_height, 8)
    assert PanelProbe(surface(thin)).status(bent(3, 0.2)) == INFLUENCE_SINGULAR


def test_folded_surfaces_are_refused() -> None:
    probe = PanelProbe(surface(body("uniform", 3)))
    for axis in range(3):
        for angle, status in ((2.82, FINE), (2.84, OUTLINE_DEGENERATE)):
            directors = np.array([STRAIGHT] * 3)
            turn = np.zeros(3)
            turn[axis] = angle
            directors[1:] = STRAIGHT @ Rotation.from_rotvec(turn).as_matrix()
            # A twist leaves all strips as long as they are; a bend of that size does not.
            expected = status if axis == 2 else OUTLINE_DEGENERATE
            assert probe.status(directors) == expected, (axis, angle)


def test_strips_end_at_a_tenth_of_their_length() -> None:
    """In plane, a bend a shortens the inner strip of an element by h tan(a/2) at its node."""
    of = body("uniform", 3, rows=1, rings="inscribed")
    probe = PanelProbe(surface(of))
    for axis, half in ((1, of.half_width[0]), (0, of.half_height[0])):
        limit = 2.0 * np.arctan(0.9 * of.element_length / half)
        for share, status in ((0.999, FINE), (1.001, OUTLINE_DEGENERATE)):
            directors = np.array([STRAIGHT] * 3)
            turn = np.zeros(3)
            turn[axis] = share * limit
            directors[2] = STRAIGHT @ Rotation.from_rotvec(turn).as_matrix()
            assert probe.status(directors) == status, (axis, share)


def closed_ring(elements: int, angle: float) -> Array:
    turns = angle * np.arange(elements)
    return np.array([STRAIGHT @ Rotation.from_rotvec([0.0, t, 0.0]).as_matrix() for t in turns])


def test_gaps_end_at_half_an_edge() -> None:
    """A body bent to a ring, until its ends come close."""
    of = body("uniform", 8, rows=1, around=4)
    probe = PanelProbe(surface(of))
    statuses = []
    for angle in np.linspace(0.5, 0.9, 41):
        directors = closed_ring(8, angle)
        statuses.append(probe.status(directors))
        vertices, faces, element = reference.mesh(of, directors)
        panels = [reference.panel(vertices[face]) for face in faces]
        points = [[*vertices[f], p.centroid] for f, p in zip(faces, panels, strict=True)]
        edge = [
            max(
                float(np.linalg.norm(vertices[a] - vertices[b]))
                for a, b in zip(f, f[1:] + f[:1], strict=True)
            )
            for f in faces
        ]
        close = any(
            min(np.linalg.norm(a - b) for a in points[i] for b in points[j])
            < 0.5 * max(edge[i], edge[j])
            for i in range(len(faces))
            for j in range(i)
            if abs(element[i] - element[j]) >= 3
        )
        assert statuses[-1] == (UNDER_RESOLVED_GAP if close else FINE), angle
    assert {statuses[0], statuses[-1]} == {FINE, UNDER_RESOLVED_GAP}


def test_neither_physics_compiles_the_other() -> None:
    code = (
        "from swim_env.physics.loading import load_kernels as planar; "
        "from swim_env.physics.spatial.loading import load_panel_kernels as spatial; "
        "from swim_env.physics.spatial.panels.mass import panel_added_mass as mine; "
        "from swim_env.physics.planar.equations import evaluate_step as theirs; "
        "{}(); print(len(mine.linked.compiled.overloads), len(theirs.linked.compiled.overloads))"
    )
    assert run_python("-c", code.format("spatial")).out == "1 0\n"
    assert run_python("-c", code.format("planar")).out == "0 1\n"
