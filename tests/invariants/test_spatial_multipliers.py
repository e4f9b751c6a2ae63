"""In space, the constrained form (34) with multipliers moves as the package's null space form."""

import numpy as np
import pytest

from swim_env import Scene, Simulator
from tests.invariants.spatial_runs import SCHEMES, coupled_matrix, momenta, start_of
from tests.reference.spatial import Body, directors_of, free_motions
from tests.reference.spatial_multipliers import constraints, simulate

TOLERANCE = 1e-12
#: Bound on differences of the two forms in m, rad, kg m/s and kg m^2/s.
AGREEMENT = 10.0 * TOLERANCE
ROUND_OFF = 16.0 * float(np.finfo(np.float64).eps)
STEPS = 12

BEAM = {
    "elements": 3,
    "density": 500.0,
    "section": {"profile": "ellipsoid", "half_width": 0.03, "half_height": 0.05},
    "lateral_stiffness": 1.0,
    "dorsoventral_stiffness": 3.0,
    "torsional_stiffness": 0.5,
}
SOFT = {"lateral_stiffness": 0.2, "dorsoventral_stiffness": 0.3}
BENT = {"joint_rotations": [[0.3, -0.4, 0.2], [-0.2, 0.5, 0.3]], "velocity": [0.3, -0.2, 0.1]}
SPIN = {"spin": [3.0, -2.0, 5.0]}
STRIP = {"fluid": {"model": "strip", "density": 1000.0}}
GIVEN = coupled_matrix(3, np.random.default_rng(3), 3.0).tolist()
CASES: dict[str, tuple[dict[str, object], float]] = {
    "bent, spinning": ({**STRIP, "initial": {**BENT, **SPIN}}, 0.0),
    "no fluid, torques": (
        {"initial": {**BENT, **SPIN}, "beam": {**BEAM, "torsional_stiffness": 0.1, **SOFT}},
        0.1,
    ),
    "damped, torques": ({**STRIP, "damping": {"retardation_time": [0.01, 0.03, 0.02]}}, 2.0),
    "curved by nature": (
        {
            **STRIP,
            "beam": {**BEAM, "natural_curvature": [[1.0, -0.5, 0.3], [0.2, 0.4, -1.0]]},
            "initial": SPIN,
        },
        0.5,
    ),
    "coupled matrix, all": (
        {
            "fluid": {"model": "given", "density": 1000.0, "matrix": GIVEN},
            "damping": {"retardation_time": 0.02},
            "initial": {**BENT, **SPIN},
            "beam": {**BEAM, "natural_curvature": [0.3, -0.2, 0.5]},
        },
        1.0,
    ),
}


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("case", CASES)
def test_both_forms_move_alike(case: str, scheme: str) -> None:
    changes, size = CASES[case]
    integrator = {
        "time_step": 0.002,
        "tolerance": TOLERANCE,
        "scheme": scheme,
        "strain": "joint_angle" if case.startswith("damped") else "averaged_directors",
    }
    scene = Scene.from_dict({"dimension": 3, "beam": BEAM, "integrator": integrator, **changes})
    body = Body.of(scene)
    torques = np.random.default_rng(7).uniform(-size, size, (STEPS, 2, 3))
    poses, redundant, multipliers = simulate(scene, *start_of(scene, body), torques)
    simulator = Simulator(scene)
    run = simulator.rollout(torques)
    assert run.steps == STEPS, run.termination_reason
    # The form with multipliers does not cut steps.
    assert (run.parts == 1.0).all()
    assert np.abs(np.diff(poses[:, :, 1:], axis=0)).max() > 1e6 * AGREEMENT
    # Momenta along the motions that the constraints leave free are the package's.
    free = free_motions(poses[-1], body.dl).reshape(-1, redundant.shape[1])
    differences = [
        poses[:, :, 0] - run.centres,
        directors_of(poses) - run.directors,
        free @ redundant[-1] - momenta(simulator),
    ]
    worst = max(float(np.abs(each).max()) for each in differences)
    broken = max(np.abs(constraints(q, body.dl)).max() for q in poses)
    print(f"{case}, {scheme}: differences {worst:.1e}, constraints {broken:.1e}")
    assert worst <= AGREEMENT
    assert broken <= ROUND_OFF
    assert np.abs(multipliers).max() > 1e-3
