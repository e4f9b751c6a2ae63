"""Added mass of closed surfaces against closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import elliprd

from swim_env import SurfaceError
from swim_env.physics import added_mass_of_surface
from swim_env.physics.spatial.loading import load_panel_kernels
from swim_env.physics.spatial.panels.influence import (
    AREA,
    CENTROID,
    KEPT,
    NORMAL,
    POINT_ROWS,
    SOURCE_COLUMNS,
    influence,
    lay_panels,
)
from tests.support import Array, refuses

CUBE = [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def ellipsoid_mass(a: float, b: float, c: float) -> Array:
    """Return Lamb's added mass (articles 114, 115) for unit density."""
    squares = np.array([a, b, c]) ** 2
    volume = a * b * c
    alpha = np.array(
        [2.0 / 3.0 * volume * elliprd(*np.delete(squares, i), squares[i]) for i in range(3)]
    )
    mass = 4.0 / 3.0 * np.pi * volume
    moving = mass * alpha / (2.0 - alpha)
    turning = np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        less, more = squares[j] - squares[k], squares[j] + squares[k]
        difference = alpha[k] - alpha[j]
        if less != 0.0:
            turning[i] = mass / 5.0 * less**2 * difference / (2.0 * less - more * difference)
    return np.diag([*moving, *turning])


def ellipsoid(
    axes: tuple[float, float, float], rows: int, around: int, area_true: bool = False
) -> tuple[Array, list[list[int]]]:
    """Return rings at equal steps of the angle from one pole, on the first axis, to the other."""
    angle = np.pi * np.arange(1, rows) / rows
    turn = 2.0 * np.pi * np.arange(around) / around
    scale = np.sqrt(turn[1] / np.sin(turn[1])) if area_true else 1.0
    rings = [
        [[np.cos(p), scale * np.sin(p) * np.cos(t), scale * np.sin(p) * np.sin(t)] for t in turn]
        for p in np.pi - angle
    ]
    vertices = np.array([[-1.0, 0.0, 0.0], *sum(rings, []), [1.0, 0.0, 0.0]]) * axes
    faces = []
    last = len(vertices) - 1
    for j in range(around):
        after = (j + 1) % around
        faces.append([0, 1 + after, 1 + j, 1 + j])
        for first in range(1, last - around, around):
            behind = first + around
            faces.append([first + j, first + after, behind + after, behind + j])
        faces.append([last - around + j, last - around + after, last, last])
    return vertices, faces


def errors(axes: tuple[float, float, float], rows: int, around: int, **options: bool) -> Array:
    found = added_mass_of_surface(*ellipsoid(axes, rows, around, **options))
    exact = ellipsoid_mass(*axes)
    scale = np.sqrt(np.diag(exact))
    scale[scale == 0.0] = scale[3:].max() or scale.max()
    result: Array = (found - exact) / np.outer(scale, scale)
    return result


@pytest.mark.parametrize(
    "axes", [(1.0, 1.0, 1.0), (1.0, 0.6, 0.35), (0.5, 0.2, 0.9), (6.0, 1.0, 1.0)]
)
def test_inscribed_ellipsoids_converge_at_second_order_of_the_panels_size(
    axes: tuple[float, float, float],
) -> None:
    """Which is first order in their number: 26 rows of 36 lie within 2.5 % in every motion."""
    coarse, fine = errors(axes, 13, 18), errors(axes, 26, 36)
    off = np.abs(np.diag(fine))
    assert off.max() < 0.025, off
    assert np.abs(fine - np.diag(np.diag(fine))).max() < 1e-14
    moved = off > 1e-3  # in rotation about an axis of symmetry there is nothing to converge to
    order = np.log2(np.abs(np.diag(coarse))[moved] / off[moved])
    assert moved.sum() >= 3 and ((1.7 < order) & (order < 2.2)).all(), order


def test_spheroid_on_a_cosine_mesh() -> None:
    """1:6, 18 rows of 24 panels with the sections' area: measured 0.4, 0.1 and 1.7 % off."""
    off = np.abs(np.diag(errors((6.0, 1.0, 1.0), 18, 24, area_true=True)))
    assert off.max() < 0.02, off


def lopsided() -> tuple[Array, list[list[int]]]:
    """Return a surface without symmetry whose quadrilaterals are not flat."""
    vertices, faces = ellipsoid((1.0, 0.6, 0.4), 7, 9)
    bend = np.stack([np.zeros(len(vertices)), vertices[:, 0] ** 2, vertices[:, 1]], axis=1)
    return vertices + 0.3 * bend + 0.02 * np.random.default_rng(0).normal(
        size=vertices.shape
    ), faces


def test_turning_and_shifting_transform_the_mass_as_a_tensor() -> None:
    vertices, faces = lopsided()
    mass = added_mass_of_surface(vertices, faces)
    turn, shift = Rotation.random(random_state=1).as_matrix(), np.array([3.0, -1.0, 2.0])
    # The velocity of the old origin, in the old axes, of a motion of the turned and shifted body.
    moved = np.block([[turn.T, turn.T @ np.cross(np.eye(3), shift).T], [np.zeros((3, 3)), turn.T]])
    expected = moved.T @ mass @ moved
    found = added_mass_of_surface(vertices @ turn.T + shift, faces)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(mass - np.diag(np.diag(mass))).max() > 0.05 * mass.max(), "it has no couplings"


def test_what_must_not_matter_does_not() -> None:
    vertices, faces = lopsided()
    mass = added_mass_of_surface(vertices, faces)
    np.testing.assert_allclose(added_mass_of_surface(vertices, faces, 3.0), 3.0 * mass, rtol=1e-14)
    # Corners in another order, and all faces seen from inside.
    turned = [f[1:] + f[:1] if f[2] != f[3] else [f[1], f[2], f[0], f[0]] for f in faces]
    inside = [f[::-1] if f[2] != f[3] else [f[1], f[0], f[2], f[2]] for f in faces]
    for same in (turned, inside, np.array(inside, dtype=np.int32)[::-1]):
        off = added_mass_of_surface(vertices, same) - mass
        assert np.abs(off).max() < 1e-13 * mass.max()
    # A long way off, seen through the sum of forces.
    far = added_mass_of_surface(vertices + 1e4, faces)[:3, :3] - mass[:3, :3]
    assert np.abs(far).max() < 1e-10 * mass.max()
    triangles = [[f[0], f[1], f[2]] for f in faces] + [
        [f[0], f[2], f[3]] for f in faces if f[2] != f[3]
    ]
    cut = added_mass_of_surface(vertices, triangles)
    assert 1e-4 * mass.max() < np.abs(cut - mass).max() < 0.1 * mass.max()
    repeated = [[*f, f[-1]] for f in triangles]
    assert (added_mass_of_surface(vertices, repeated) == cut).all()


def laid(vertices: Array, faces: Any, gauss: bool) -> tuple[Array, Array, Array]:
    """Return points, normal influence and potential influence, rows by receiving panel."""
    load_panel_kernels()
    count = len(faces)
    size = (count + 7) // 8 * 8
    points, sources = np.zeros((POINT_ROWS, size)), np.zeros((size, SOURCE_COLUMNS))
    lay_panels(np.array(vertices), np.array(faces), points, sources)
    normal, potential = np.zeros((2, size, size))
    influence(points, sources, count, gauss, normal, potential, np.zeros((KEPT, count, size)))
    return points[:, :count], normal[:count, :count].T, potential[:count, :count].T


def test_a_panels_influence_is_the_integral_over_it() -> None:
    """Gauss-Legendre quadrature over a projected quadrilateral, a dart and a triangle."""
    rng = np.random.default_rng(3)
    quads = np.array(
        [
            [[0.0, 0.0, 0.05], [1.0, 0.1, -0.05], [1.1, 0.8, 0.05], [-0.1, 0.9, -0.05]],
            [[0.0, 0.0, 0.0], [1.0, -0.2, 0.0], [0.5, 0.5, 0.0], [0.3, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.3, 0.2], [0.2, 0.9, 0.1], [0.2, 0.9, 0.1]],
        ]
    )
    receivers = np.array([[0.4, 0.4, 0.6], [0.5, 0.3, -0.5], [2.0, 1.0, 0.0], [-9.0, 4.0, 3.0]])
    u, weight = np.polynomial.legendre.leggauss(60)
    u, weight = 0.5 * (u + 1.0), 0.5 * weight
    for quad in quads:
        triangles = receivers[:, None] + 0.01 * rng.normal(size=(4, 4, 3))
        triangles[:, 3] = triangles[:, 2]
        corners = np.concatenate([quad[None], triangles])
        points, normal, potential = laid(corners.reshape(-1, 3), np.arange(20).reshape(5, 4), False)
        n = points[NORMAL:AREA, 0]
        flat = quad - np.outer((quad - quad.mean(axis=0)) @ n, n)
        total = np.zeros((4, 4))
        for a, b, c in ((0, 1, 2), (0, 2, 3)):
            area = np.cross(flat[b] - flat[a], flat[c] - flat[a]) @ n
            # From the unit square: y = a + s (b - a) + s t (c - b).
            s, t = np.meshgrid(u, u, indexing="ij")
            y = flat[a] + s[..., None] * ((flat[b] - flat[a]) + t[..., None] * (flat[c] - flat[b]))
            share = np.outer(u * weight, weight) * area
            for i in range(4):
                seen = points[CENTROID:NORMAL, i + 1] - y
                r = np.sqrt((seen**2).sum(axis=-1))
                total[i, 0] += (share / r).sum()
                total[i, 1:] -= (share[..., None] * seen / r[..., None] ** 3).sum(axis=(0, 1))
        np.testing.assert_allclose(potential[1:, 0], total[:, 0], rtol=1e-12)
        along = (points[NORMAL:AREA, 1:].T * total[:, 1:]).sum(axis=1)
        np.testing.assert_allclose(normal[1:, 0], along, rtol=1e-11, atol=1e-13)
        assert normal[0, 0] == -2.0 * np.pi


def test_gauss_self_terms_send_every_share_out() -> None:
    points, normal, _ = laid(*lopsided(), True)
    area = points[AREA]
    np.testing.assert_allclose(area @ normal, -4.0 * np.pi * area, rtol=1e-12)
    flat = laid(*lopsided(), False)[1]
    assert (np.diag(flat) == -2.0 * np.pi).all()
    assert (flat[~np.eye(len(flat), dtype=bool)] == normal[~np.eye(len(flat), dtype=bool)]).all()


def test_two_bodies_far_apart_add_up() -> None:
    vertices, faces = ellipsoid((1.0, 0.6, 0.35), 8, 8)
    one = added_mass_of_surface(vertices, faces)
    both = np.concatenate([vertices + [0.0, 200.0, 0.0], vertices - [0.0, 200.0, 0.0]])
    apart = np.array(faces) + len(vertices)
    found = added_mass_of_surface(both, [*faces, *apart.tolist()])[:3, :3]
    np.testing.assert_allclose(found, 2.0 * one[:3, :3], atol=1e-6)
    with refuses(SurfaceError, "all parts", "oriented alike"):
        added_mass_of_surface(both, [*faces, *apart[:, [1, 0, 3, 2]].tolist()])


@pytest.mark.parametrize(
    ("vertices", "faces", "parts"),
    [
        ([[0.0, 0.0]], SIDES, ("vertices", "shape (V, 3)", "(1, 2)")),
        ("cube", SIDES, ("vertices", "numbers")),
        ([*CUBE[:7], [0.0, np.nan, 1.0]], SIDES, ("finite", "row 7")),
        (CUBE, [[0, 1]], ("faces", "(F, 4) or (F, 3)", "(1, 2)")),
        (CUBE, [[0, 1, 2, 3], [0, 1]], ("faces", "(F, 4)")),
        (CUBE, np.array(SIDES, dtype=float), ("integers", "float64")),
        (CUBE, SIDES[:3], ("at least 4 faces", "3")),
        (CUBE, [*SIDES[:5], [1, 5, 8, 3]], ("face 5", "0 to 7", "[1, 5, 8, 3]")),
        (CUBE, [*SIDES[:5], [-1, 5, 7, 3]], ("face 5", "0 to 7")),
        (CUBE, [*SIDES[:5], [1, 1, 7, 3]], ("face 5", "some length")),
        (CUBE, [*SIDES[:5], [1, 3, 1, 3]], ("face 5", "area")),
        (CUBE, SIDES[:5], ("closed", "vertices 1 and 3", "in 1")),
        (CUBE, [*SIDES, SIDES[0]], ("closed", "in 3")),
        (CUBE, [*SIDES[:5], SIDES[5][::-1]], ("opposite directions", "vertices")),
        (CUBE, SIDES * 900, ("at most 5000", "5400")),
        ([[*c[:2], 0.0] for c in CUBE], SIDES, ("face", "length")),
    ],
)
def test_bad_surfaces_are_refused(vertices: Any, faces: Any, parts: tuple[str, ...]) -> None:
    with refuses(SurfaceError, *parts):
        added_mass_of_surface(vertices, faces)


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, np.inf, "water", True])
def test_bad_densities_are_refused(density: Any) -> None:
    with refuses(SurfaceError, "density", "kg/m^3"):
        added_mass_of_surface(CUBE, SIDES, density)


def test_a_cube_of_six_panels_is_symmetric() -> None:
    mass = added_mass_of_surface(CUBE, SIDES)
    np.testing.assert_allclose(np.diag(mass)[:3], mass[0, 0], rtol=1e-13)
    assert 0.3 < mass[0, 0] < 0.8
