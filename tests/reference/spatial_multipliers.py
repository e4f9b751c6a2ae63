r"""The step equations (34) in space with Lagrange multipliers, a check of the null space form.

The unknowns of a step are the twelve redundant coordinates (r, d1, d2, d3) of every element at its
end and the multipliers of the 6 N orthonormality constraints (2) and the 3 (N - 1) chain
constraints (15):

.. math::
    p_n + D_1 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^- - h\, G(q_n)^T \lambda_n &= 0, \\
    g(q_{n+1}) &= 0, \\
    p_{n+1} &= D_2 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^+ .

As in `tests.reference.multipliers`, p is not projected: the next step's multipliers absorb what
does not affect the motion.
"""

from __future__ import annotations

import numpy as np

from swim_env import Scene
from tests.reference.spatial import Array, Body, Step, along_chain, momenta_of, parts_of

_PAIRS = np.triu_indices(3)
#: Newton's method ends at these: of the largest momentum or impulse, and in m or dimensionless.
BALANCE, CONSTRAINTS = 1e-13, 4e-15
_MOST_ITERATIONS = 12


def constraints(q: Array, dl: float) -> Array:
    """Evaluate g(q), (9 N - 3,): d_i . d_j - delta_ij of every element, then (15) (m)."""
    products = np.einsum("kix,kjx->kij", q[:, 1:], q[:, 1:]) - np.eye(3)
    chain = q[:, 0] - along_chain(q[:, 0].mean(axis=0), q[:, 3], dl)
    return np.concatenate([products[:, *_PAIRS].ravel(), np.diff(chain, axis=0).ravel()])


def constraint_jacobian(q: Array, dl: float) -> Array:
    """Return G(q) = dg/dq, (9 N - 3, 12 N); g is quadratic, so central differences are exact."""
    units = np.eye(q.size).reshape(-1, *q.shape)
    columns = [0.5 * (constraints(q + e, dl) - constraints(q - e, dl)) for e in units]
    return np.stack(columns, axis=1)


def solve_step(step: Step, q: Array, p: Array, guess: Array) -> tuple[Array, Array, Array]:
    """Take a step from q with momenta p (12 N,); return dq, the new momenta and the multipliers."""
    dl, size = step.body.dl, q.size
    units = np.eye(size).reshape(-1, *q.shape)
    pull = step.h * constraint_jacobian(q, dl).T
    multipliers = np.zeros(pull.shape[1])
    dq, width = guess.copy(), 1e-7
    for _ in range(_MOST_ITERATIONS):
        free = step.balance(p, q, dq, units)
        balance, broken = free - pull @ multipliers, constraints(q + dq, dl)
        scale = max(np.abs(p).max(), np.abs(free - p).max())
        if np.abs(balance).max() < BALANCE * scale and np.abs(broken).max() < CONSTRAINTS:
            return dq, step.momenta_after(q, dq, units), multipliers
        slopes = [(step.balance(p, q, dq + width * e, units) - free) / width for e in units]
        matrix = np.zeros((size + len(multipliers),) * 2)
        matrix[:size, :size] = np.transpose(slopes)
        matrix[:size, size:] = -pull
        matrix[size:, :size] = constraint_jacobian(q + dq, dl)
        change = np.linalg.solve(matrix, np.concatenate([balance, broken]))
        dq = dq - change[:size].reshape(q.shape)
        multipliers = multipliers - change[size:]
    raise RuntimeError(
        f"not solved: balance {np.abs(balance).max() / scale:.1e}, constraints "
        f"{np.abs(broken).max():.1e}"
    )


def simulate(scene: Scene, q: Array, rate: Array, torques: Array) -> tuple[Array, Array, Array]:
    """Take steps from a pose and its rate of change under torques (T, N - 1, 3).

    Returns
    -------
    tuple of arrays
        Poses (T + 1, N, 4, 3), momenta (T + 1, 12 N) and multipliers of all parts of steps.
    """
    body = Body.of(scene)
    p = momenta_of(q, rate, body, np.eye(q.size).reshape(-1, *q.shape))
    poses, momenta, multipliers = [q], [p], []
    for held in torques:
        for part in parts_of(scene, body, held):
            dq, p, pulls = solve_step(part, q, p, rate * part.h)
            q, rate = q + dq, dq / part.h
            multipliers.append(pulls)
        poses.append(q)
        momenta.append(p)
    return np.array(poses), np.array(momenta), np.array(multipliers)
