"""A very stiff ellipsoid tumbles as a rigid body does: Kirchhoff's equations, Euler's top."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swim_env import Simulator, load_scene
from swim_env.scene.spatial.scene import SpatialScene
from tests.reference.spatial import hat, log
from tests.support import Array, rollout

DURATION = 4.0
#: d1, d2 and d3 of the reference pose.
START = np.eye(3)[:, [1, 2, 0]]
FLUIDS = {"none": None, "strip": {"model": "strip"}, "frozen": {"model": "frozen"}}
ORDER = {"paper": 1, "composed": 2}


def _ellipsoid(fluid: str, **changes: object) -> SpatialScene:
    block = FLUIDS[fluid] and {"density": 1000.0, **FLUIDS[fluid]}
    stiffness = dict.fromkeys(("dorsoventral_stiffness", "lateral_stiffness"), 3e4)
    others = {f"beam.{name}": value for name, value in stiffness.items()}
    scene = load_scene(
        "ellipsoid_3d",
        {
            "beam.density": 1000.0,
            "fluid": block,
            "integrator.tolerance": 1e-12,
            **others,
            **{name.replace("__", "."): value for name, value in changes.items()},
        },
    )
    assert isinstance(scene, SpatialScene)
    return scene


def _mass(scene: SpatialScene) -> Array:
    """Return the straight body's mass (6, 6) about its mean centre, on its own axes."""
    columns = []
    for unit in np.eye(6):
        simulator = Simulator(scene.replace({"initial": {"velocity": unit[:3], "spin": unit[3:]}}))
        momentum = simulator.momentum()
        momentum[3:] -= np.cross(simulator.coordinates[:3], momentum[:3])
        columns.append(momentum)
    axes = np.kron(np.eye(2), START)
    return np.asarray(axes.T @ np.transpose(columns) @ axes)


def _kirchhoff(scene: SpatialScene, mass: Array) -> tuple[Array, Array]:
    """Return centre (m) and rotation of the rigid body at the end."""

    def rates(_: float, state: Array) -> Array:
        rotation, linear, angular = state[3:12].reshape(3, 3), state[12:15], state[15:]
        motion = np.linalg.solve(mass, state[12:])
        speed, spin = motion[:3], motion[3:]
        turned = np.cross(angular, spin) + np.cross(linear, speed)
        moves = (rotation @ speed, np.ravel(rotation @ hat(spin)), np.cross(linear, spin), turned)
        return np.concatenate(moves)

    motion = np.concatenate([START.T @ scene.initial.velocity, START.T @ scene.initial.spin])
    centre = [0.5 * scene.beam.length, 0.0, 0.0]
    begin = np.concatenate([centre, START.ravel(), mass @ motion])
    path = solve_ivp(rates, (0.0, DURATION), begin, method="DOP853", rtol=1e-12, atol=1e-13)
    rotations = path.y[3:12].T.reshape(-1, 3, 3)
    assert np.linalg.norm(log(START.T @ rotations), axis=-1).max() > 2.0, "it does not tumble"
    return path.y[:3, -1], rotations[-1]


def _misses(scene: SpatialScene, centre: Array, rotation: Array) -> Array:
    """Return by how much a run's centre (m) and rotation vector (rad) miss, (6,)."""
    steps = round(DURATION / scene.integrator.time_step)
    run = rollout(scene, np.zeros((steps, scene.beam.elements - 1, 3)))
    left, _, right = np.linalg.svd(run.directors[-1].mean(axis=0))
    return np.concatenate([run.centres[-1].mean(axis=0) - centre, log(rotation.T @ left @ right)])


@pytest.mark.parametrize("elements", [3, 9])
@pytest.mark.parametrize("scheme", ORDER)
@pytest.mark.parametrize("fluid", FLUIDS)
def test_a_stiff_ellipsoid_tumbles_as_a_rigid_body(fluid: str, scheme: str, elements: int) -> None:
    scene = _ellipsoid(fluid, beam__elements=elements, integrator__scheme=scheme)
    centre, rotation = _kirchhoff(scene, _mass(scene))
    steps = (0.01, 0.005, 0.0025)
    misses = [
        _misses(scene.replace("integrator.time_step", step), centre, rotation) for step in steps
    ]
    first = 2.0 ** ORDER[scheme]
    once = [(first * fine - coarse) / (first - 1.0) for coarse, fine in pairwise(misses)]
    # The paper's errors have all powers of dt, those of a symmetric scheme even ones alone.
    second = (4.0 if scheme == "composed" else 2.0) * first
    twice = (second * once[1] - once[0]) / (second - 1.0)
    sizes = [np.abs(each).max() for each in (*misses, twice)]
    print(f"{fluid}, {scheme}, N = {elements}: misses", *(f"{size:.1e}" for size in sizes))
    assert sizes[-1] < 2e-4
    falls = [np.abs(coarse - fine).max() for coarse, fine in pairwise(misses)]
    assert falls[0] / falls[1] > 0.8 * first
