"""The inversion of the normal influence without row exchanges, and where it is not safe."""

import numpy as np
import pytest

from swim_env import load_scene
from swim_env.physics.fluid.panel_mass import SMALLEST_PIVOT
from swim_env.physics.runtime.dense import invert, invert_in_order
from swim_env.sim.constants import scene_constants
from tests.analytic.probes import probe_panels


@pytest.mark.parametrize("size", [8, 16, 24, 40, 80])
def test_it_inverts_matrices_of_padded_sizes(size: int) -> None:
    random = np.random.default_rng(size)
    matrix = random.normal(size=(size, size)) / size + 2.0 * np.eye(size)
    inverse = matrix.copy()
    assert invert_in_order(inverse, 1e-3)
    assert np.abs(inverse @ matrix - np.eye(size)).max() < 1e-13
    assert np.abs(matrix @ inverse - np.eye(size)).max() < 1e-13


@pytest.mark.parametrize("place", [0, 2, 4, 7, 15])
@pytest.mark.parametrize("pivot", [0.0, 1e-4, np.nan, np.inf])
def test_a_bad_pivot_is_refused_wherever_it_comes(place: int, pivot: float) -> None:
    matrix = np.diag(np.full(16, 2.0))
    matrix[place, place] = pivot
    assert not invert_in_order(matrix, 1e-3)


# Half thicknesses in metres, of elements of 1/9 m: the usual one, one that is just eliminated in
# order, one that is not.
@pytest.mark.parametrize("thickness", [0.01, 1e-3, 1e-5])
@pytest.mark.parametrize("bend", [0.0, 0.2, 1.0])
def test_the_added_mass_is_that_of_lapack_with_and_without_exchanges(
    thickness: float, bend: float
) -> None:
    angles = bend * np.random.default_rng(1).uniform(-1.0, 1.0, 8)
    fluid = scene_constants(load_scene("swimmer", {"beam.half_thickness": thickness}))[1]
    mass, normal, potential, motions, lengths = probe_panels(angles, fluid)
    sources = np.linalg.solve(normal, motions)
    wanted = -fluid.density * (motions * lengths[:, None]).T @ potential @ sources
    wanted = 0.5 * (wanted + wanted.T)
    condition = np.linalg.cond(normal)
    assert np.abs(mass - wanted).max() < 1e-15 * condition * np.abs(wanted).max() + 1e-13
    in_order = invert_in_order(normal.copy(), SMALLEST_PIVOT)
    assert in_order == (thickness > 1e-4)
    inverse = normal.copy()
    assert invert(inverse, np.zeros(len(inverse), dtype=np.int64))
    assert np.abs(inverse @ normal - np.eye(len(inverse))).max() < 1e-14 * condition
