"""What tests of motions in space share: random bodies, and the state in redundant coordinates."""

from typing import Any

import numpy as np

from swim_env import Scene, Simulator
from tests.reference.spatial import Body, exp, pose
from tests.support import Array

SCHEMES = ("paper", "composed")
STRAINS = ("averaged_directors", "joint_angle")


def coupled_matrix(elements: int, rng: np.random.Generator, size: float = 1.0) -> Array:
    """Return a positive matrix (6 N, 6 N) that couples every motion with every other one."""
    factor = rng.normal(size=(6 * elements, 6 * elements)) / np.sqrt(6 * elements)
    scale = np.tile([1.0, 1.0, 1.0, 0.1, 0.1, 0.1], elements) * np.sqrt(size)
    matrix = scale[:, None] * (factor @ factor.T) * scale
    return 0.5 * (matrix + matrix.T)


def random_scene(seed: int, scheme: str, strain: str, **changes: Any) -> Scene:
    """Return a small body that is bent, spins, is damped and curved by nature."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    stiffness = rng.uniform(0.5, 5.0, (3, n - 1))
    names = ("dorsoventral_stiffness", "lateral_stiffness", "torsional_stiffness")
    beam = {
        "length": float(rng.uniform(0.5, 2.0)),
        "elements": n,
        "density": 800.0,
        "section": {
            "profile": ("uniform", "ellipsoid")[seed % 2],
            "half_width": float(rng.uniform(0.02, 0.06)),
            "half_height": float(rng.uniform(0.02, 0.1)),
        },
        "natural_curvature": rng.uniform(-1.0, 1.0, (n - 1, 3)).tolist(),
        **{name: values.tolist() for name, values in zip(names, stiffness, strict=True)},
    }
    fluid: dict[str, object] = {"model": "strip", "density": 1000.0}
    if seed % 3:
        matrix = coupled_matrix(n, rng).tolist()
        fluid = {"model": "given", "density": 1000.0, "matrix": matrix}
    return Scene.from_dict(
        {
            "dimension": 3,
            "beam": beam,
            "fluid": fluid,
            "damping": {"retardation_time": rng.uniform(0.0, 0.02, 3).tolist()},
            "initial": {
                "velocity": rng.uniform(-0.5, 0.5, 3).tolist(),
                "spin": rng.uniform(-4.0, 4.0, 3).tolist(),
                "joint_rotations": rng.uniform(-0.4, 0.4, (n - 1, 3)).tolist(),
            },
            "integrator": {
                "time_step": 0.004,
                "tolerance": 1e-12,
                "scheme": scheme,
                "strain": strain,
            },
            **changes,
        }
    )


def pose_of(simulator: Simulator, body: Body) -> Array:
    """Return a simulator's redundant coordinates (N, 4, 3)."""
    return pose(simulator.coordinates[:3], simulator.directors, body.dl)


def momenta(simulator: Simulator) -> Array:
    """Return the carried momenta (3 N + 3,), along the free motions."""
    carried: Array = simulator._bodies.momenta[0].copy()
    return carried


def start_of(scene: Scene, body: Body) -> tuple[Array, Array]:
    """Return the redundant coordinates of a scene's start and their rate, (N, 4, 3)."""
    n, initial = scene.beam.elements, scene.initial
    directors = np.empty((n, 3, 3))
    directors[0] = np.eye(3)[:, [1, 2, 0]]  # d1 = e_y, d2 = e_z, d3 = e_x
    for j, turn in enumerate(np.broadcast_to(initial.joint_rotations, (n - 1, 3))):
        directors[j + 1] = directors[j] @ exp(np.array(turn))
    q = pose(np.zeros(3), directors, body.dl)
    rate = np.cross(initial.spin, q)
    rate[:, 0] += initial.velocity
    q[:, 0] += 0.5 * body.dl * directors[0, :, 2] - q[0, 0]
    return q, rate
