"""In space: the planar limit, mirror images, and starts that are turned."""

from typing import Any

import numpy as np
import pytest

from swim_env import Scene, Simulator, load_scene
from tests.invariants.runs import largest
from tests.invariants.spatial_runs import SCHEMES
from tests.reference import independent
from tests.reference.spatial import exp
from tests.support import Array, rollout, uniform

FLUIDS: dict[str, dict[str, object]] = {
    "none": {"fluid": None, "beam.density": 1000.0},
    "strip": {"fluid.model": "strip"},
    "frozen": {"fluid.model": "frozen", "fluid.rows": 1, "fluid.around": 8},
    "panels": {"fluid.model": "panels", "fluid.rows": 1, "fluid.around": 8},
}
each_fluid = pytest.mark.parametrize("fluid", FLUIDS)
#: Of the body length, after 40 steps of 5 ms.
BOUND = 1e-11


def _planar_twin(scene: Scene, added: Array) -> Scene:
    """Return the beam in space whose motion in the plane is a planar scene's.

    Its section is that of Table 1, 1 m high. With as little inertia about d2 as about d1, pitch and
    roll are modes that a step of 10 ms does not resolve, and grow from rounding without damping.
    """
    n, beam = scene.beam.elements, scene.beam
    matrix = np.zeros((6 * n, 6 * n))
    plane = np.concatenate([6 * np.arange(n), 6 * np.arange(n) + 4])  # v1, w2
    matrix[np.ix_(plane, plane)] = 0.5 * (added + added.T)
    return Scene.from_dict(
        {
            "dimension": 3,
            "beam": {
                "length": beam.length,
                "elements": n,
                "section": {"profile": "uniform", "half_width": 0.01, "half_height": 1.0},
                "line_density": beam.line_density,
                "rotary_inertia_1": beam.rotary_inertia,
                "lateral_stiffness": beam.stiffness_at_joints().tolist(),
                "dorsoventral_stiffness": 5.0,
                "torsional_stiffness": 5.0,
            },
            "fluid": {"model": "given", "density": 10.0, "matrix": matrix.tolist()},
            "integrator": {
                "time_step": scene.integrator.time_step,
                "tolerance": scene.integrator.tolerance,
                "scheme": scene.integrator.scheme,
                "strain": scene.integrator.strain,
            },
        }
    )


@pytest.mark.parametrize("strain", ["averaged_directors", "joint_angle"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_yaw_torques_move_a_beam_in_space_as_the_planar_one(scheme: str, strain: str) -> None:
    integrator = {"integrator.scheme": scheme, "integrator.strain": strain}
    scene = load_scene("paper_i", {"integrator.tolerance": 1e-13, **integrator})
    arguments = independent.fluid_arguments(scene)
    straight = independent.added_mass(np.zeros(8), elements=9, **arguments)
    planar = Simulator(scene.replace("fluid.model", "frozen"))
    yaw = planar.prescribed_torques(500)
    flat = planar.rollout(yaw)
    run = rollout(_planar_twin(scene, straight), yaw[..., None] * [0.0, 1.0, 0.0])
    apart = largest(run.centres[..., :2] - flat.centres)
    normal = np.stack([-np.sin(flat.angles), np.cos(flat.angles)], axis=-1)
    apart = max(apart, largest(run.directors[..., :2, 0] - normal))
    out = max(largest(run.centres[..., 2]), largest(run.joint_rotations[..., [0, 2]]))
    print(f"{scheme}, {strain}: {apart:.1e} from the planar beam, {out:.1e} out of the plane")
    assert flat.steps == 500 and largest(flat.displacement) > 0.01
    assert apart < 1e-9
    assert out < 1e-12


def _swimmer(fluid: str, **changes: Any) -> Scene:
    base = {"beam.elements": 4, "integrator.tolerance": 1e-13, **FLUIDS[fluid]}
    section = {"profile": "ellipsoid", "half_width": 0.05, "half_height": 0.08}
    return load_scene("helix_3d", {**base, "beam.section": section, **changes})


TORQUES = 3.0 * uniform(40, 3, 3, seed=5).cumsum(axis=0) / np.sqrt(np.arange(1, 41))[:, None, None]


@each_fluid
@pytest.mark.parametrize("axis", [1, 2], ids=["left and right", "up and down"])
def test_mirrored_torques_give_the_mirrored_path(fluid: str, axis: int) -> None:
    mirror = np.eye(3)
    mirror[axis, axis] = -1.0
    # d1 is e_y and d2 is e_z; moments about axes in the mirror stay, those about others turn round.
    own = np.diag(np.diag(mirror)[[1, 2, 0]])
    scene = _swimmer(fluid)
    run, image = rollout(scene, TORQUES), rollout(scene, -TORQUES @ own)
    apart = largest(image.centres - run.centres @ mirror)
    apart = max(apart, largest(image.directors - mirror @ run.directors @ own))
    size = largest(run.joint_rotations)
    print(f"{fluid}, axis {axis}: {apart:.1e} apart at joints up to {size:.2f} rad")
    assert size > 0.1
    assert apart < BOUND


@each_fluid
def test_a_turned_start_turns_the_path(fluid: str) -> None:
    start = {
        "initial.velocity": [0.3, -0.2, 0.1],
        "initial.spin": [1.0, 2.0, -1.5],
        "initial.joint_rotations": [0.1, -0.2, 0.15],
    }
    simulator = Simulator(_swimmer(fluid, **start))
    other = Simulator(simulator.scene)
    axis, shift = np.array([1.1, -0.7, 2.0]), np.array([0.3, -1.0, 2.0])
    turn, angle = exp(axis), float(np.linalg.norm(axis))
    q = simulator.coordinates
    q[:3] = turn @ q[:3] + shift
    # The quaternion of element 1, scalar first: Hamilton's product with the turn's.
    s, v = np.cos(0.5 * angle), np.sin(0.5 * angle) * axis / angle
    q[3:7] = [s * q[3] - v @ q[4:7], *(s * q[4:7] + q[3] * v + np.cross(v, q[4:7]))]
    other.reset_to(q, np.ravel(simulator.velocity().reshape(-1, 3) @ turn.T))
    run, image = simulator.rollout(TORQUES), other.rollout(TORQUES)
    apart = largest(image.centres - run.centres @ turn.T - shift)
    apart = max(apart, largest(image.directors - turn @ run.directors))
    print(f"{fluid}: {apart:.1e} apart")
    assert run.steps == 40 and largest(np.diff(run.directors, axis=0)) > 1e-2
    assert apart < BOUND
