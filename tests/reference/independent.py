"""Independent reference for a planar elastic beam in ideal fluid, written for clarity.

Everything follows docs/theory/plane.md literally, and no gradient is derived by hand: every
derivative is a complex step, d f(x)/dx = Im f(x + i h)/h with h = 1e-30, which has no subtractive
error. All functions that carry a derivative therefore accept complex arguments and avoid ``abs``,
``norm`` and ``conj``. The only finite difference is in Newton's Jacobian, which affects the number
of iterations but not the solution.

Minimal coordinates are u = (x0, y0, th_1, ..., th_N), with (x0, y0) the head node.  The redundant
ones are centres r, normals d1 and tangents d3.  All quantities are SI, per metre of depth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env import Scene

STEP = 1e-30  # complex step
JACOBIAN_STEP = 1e-7  # finite difference of Newton's Jacobian, rad or m
TOLERANCE = 1e-13  # accepted residual, relative to the scale that simulate() sets
MAX_ITERATIONS = 50
MAX_TURN = 0.5  # rad; a larger turn of an element or joint in one step is a wrong root


class ReferenceFailureError(RuntimeError):
    """A step has no acceptable solution; the reference never halves its step."""


def _atan2(y: NDArray, x: NDArray) -> NDArray:
    """Angle of (x, y), continued to first order in the imaginary parts; any shape, rad."""
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return np.arctan2(y, x)
    real = np.arctan2(y.real, x.real)
    return real + 1j * (y.imag * x.real - y.real * x.imag) / (x.real**2 + y.real**2)


def _dot(a: NDArray, b: NDArray) -> NDArray:
    """Unconjugated scalar product over the last axis (size 2)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _length(a: NDArray) -> NDArray:
    """Length of vectors on the last axis, analytic in the components."""
    return np.sqrt(_dot(a, a))


def _tangent(th: NDArray) -> NDArray:
    """Return d3 = (cos th, sin th), shape (..., 2)."""
    return np.stack([np.cos(th), np.sin(th)], axis=-1)


def _normal(th: NDArray) -> NDArray:
    """Return d1 = (-sin th, cos th), shape (..., 2)."""
    return np.stack([-np.sin(th), np.cos(th)], axis=-1)


@dataclass(frozen=True)
class _Panels:
    """Panels of a closed outline, counterclockwise; leading axes are a batch of shapes."""

    start: NDArray  # (..., M, 2), m
    tangent: NDArray  # (..., M, 2)
    normal: NDArray  # (..., M, 2), into the fluid
    size: NDArray  # (..., M), m
    middle: NDArray  # (..., M, 2), collocation points, m
    element: NDArray  # (M,), the element each panel belongs to


def _outline(th: NDArray, dl: float, h: float, per_element: int, caps: int) -> _Panels:
    """Cut the mitred outline into panels.

    th (..., N) in rad, head node at the origin; element length dl and half thickness h in m.
    """
    n = th.shape[-1]
    per_side = per_element // 2
    nodes = np.zeros((*th.shape[:-1], n + 1, 2), dtype=th.dtype)
    nodes[..., 1:, :] = np.cumsum(dl * _tangent(th), axis=-2)
    offset = np.zeros_like(nodes)
    offset[..., 0, :] = h * _normal(th[..., 0])
    offset[..., n, :] = h * _normal(th[..., n - 1])
    half = (th[..., 1:] - th[..., :-1]) / 2
    mean = (th[..., 1:] + th[..., :-1]) / 2
    offset[..., 1:n, :] = (h / np.cos(half))[..., None] * _normal(mean)
    left, right = nodes + offset, nodes - offset

    # Corners counterclockwise: along the right side to the tail, tail cap, back, head cap.
    # Each edge: first corner, last corner, number of panels, element.
    edges = [(right[..., k, :], right[..., k + 1, :], per_side, k) for k in range(n)]
    edges.append((right[..., n, :], left[..., n, :], caps, n - 1))
    edges += [(left[..., k + 1, :], left[..., k, :], per_side, k) for k in reversed(range(n))]
    edges.append((left[..., 0, :], right[..., 0, :], caps, 0))
    cuts = [(a, b - a, i, m, k) for a, b, m, k in edges for i in range(m)]
    start = np.stack([a + ab * (i / m) for a, ab, i, m, _ in cuts], axis=-2)
    end = np.stack([a + ab * ((i + 1) / m) for a, ab, i, m, _ in cuts], axis=-2)
    size = _length(end - start)
    tangent = (end - start) / size[..., None]
    normal = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    return _Panels(start, tangent, normal, size, (start + end) / 2, np.array([k for *_, k in cuts]))


def _influence(p: _Panels, length: float) -> tuple[NDArray, NDArray]:
    """Return G (normal velocity) and P (potential) of unit sources; (..., M, M).

    Row i is the collocation point, column j the panel that carries the source.
    """
    arm = p.middle[..., :, None, :] - p.start[..., None, :, :]
    t, n = p.tangent[..., None, :, :], p.normal[..., None, :, :]
    size = p.size[..., None, :]
    xi, eta = _dot(arm, t), _dot(arm, n)
    log1 = np.log((xi**2 + eta**2) / length**2) / 2
    log2 = np.log(((xi - size) ** 2 + eta**2) / length**2) / 2
    angle = _atan2(eta * size, xi * (xi - size) + eta**2)
    along, across = (log1 - log2) / (2 * np.pi), angle / (2 * np.pi)
    own = p.normal[..., :, None, :]
    g = along * _dot(own, t) + across * _dot(own, n)
    phi = (xi * log1 - (xi - size) * log2 - size + eta * angle) / (2 * np.pi)
    i = np.arange(p.size.shape[-1])
    g[..., i, i] = 0.5
    phi[..., i, i] = p.size * (np.log(p.size / (2 * length)) - 1) / (2 * np.pi)
    return g, phi


def _boundary(p: _Panels, th: NDArray, dl: float, axial: bool) -> NDArray:
    """Return B, the panels' normal velocity under the unit motions; (..., M, 2N or 3N)."""
    n = th.shape[-1]
    centres = np.cumsum(dl * _tangent(th), axis=-2) - dl / 2 * _tangent(th)
    arm = p.middle - centres[..., p.element, :]
    spin = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)  # e_z x arm
    motions = [_normal(th)[..., p.element, :], spin]
    if axial:
        motions.append(_tangent(th)[..., p.element, :])
    own = p.element[:, None] == np.arange(n)  # zero on the other elements' panels
    return np.concatenate([_dot(p.normal, m)[..., None] * own for m in motions], axis=-1)


def added_mass(
    joint_angles: ArrayLike,
    *,
    length: float,
    elements: int,
    half_thickness: float,
    density: float,
    panels_per_element: int,
    cap_panels: int,
    axial: bool = False,
) -> NDArray:
    """Return the added mass of a bent beam, A = -rho sym(B^T diag(L) P G^-1 B).

    Parameters
    ----------
    joint_angles : (..., N-1) array
        th_{k+1} - th_k, rad; real or complex, leading axes are a batch.
    length, half_thickness, density : float
        Of the body, m; of the fluid, kg/m^3 (unit depth).
    panels_per_element, cap_panels : int
        Panels on both sides of an element together (even), and on each end.
    axial : bool
        Whether translation along d3 is among the unit motions.

    Returns
    -------
    (..., 2N, 2N) or (..., 3N, 3N) array
        Symmetric part, in the order all v, all w, all axial; kg/m, kg, kg m.
    """
    joints = np.asarray(joint_angles)
    joints = joints.astype(np.result_type(joints.dtype, np.float64))
    first = np.zeros((*joints.shape[:-1], 1), dtype=joints.dtype)
    th = np.concatenate([first, np.cumsum(joints, axis=-1)], axis=-1)
    dl = length / elements
    panels = _outline(th, dl, half_thickness, panels_per_element, cap_panels)
    g, phi = _influence(panels, length)
    b = _boundary(panels, th, dl, axial)
    potential = phi @ np.linalg.solve(g, b)
    a = -density * np.swapaxes(panels.size[..., None] * b, -1, -2) @ potential
    return (a + np.swapaxes(a, -1, -2)) / 2


def fluid_arguments(scene: Scene) -> dict[str, Any] | None:
    """Return what `added_mass` needs to know of a scene with the panel model, besides its beam."""
    fluid, beam = scene.fluid, scene.beam
    if fluid is None:
        return None
    return {
        "length": beam.length,
        "half_thickness": beam.half_thickness,
        "density": fluid.density,
        "panels_per_element": fluid.panels_per_element,
        "cap_panels": fluid.cap_panels,
        "axial": scene.axial_added_mass is not None,
    }


def _added_mass_and_tensor(th: NDArray, **fluid: Any) -> tuple[NDArray, NDArray]:
    """Return A and dA/dth_k, shapes (m, m) and (N, m, m), at real angles th (N,)."""
    n = len(th)
    probes = th + 1j * STEP * np.eye(n)
    a = added_mass(np.diff(th), elements=n, **fluid)
    return a, added_mass(np.diff(probes, axis=-1), elements=n, **fluid).imag / STEP


@dataclass(frozen=True)
class _Beam:
    """Constants of the discrete Lagrangian; SI units."""

    dl: float
    line_density: float  # rho_B A, kg/m
    rotary_inertia: float  # rho_B I_1, kg m
    stiffness: NDArray  # EI at the joints, (N-1,), N m^2
    dt: float
    axial: bool


def _redundant(u: NDArray, dl: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return (r, d1, d3), each (..., N, 2), of minimal coordinates u (..., N+2); eq. (15)."""
    th = u[..., 2:]
    d3 = _tangent(th)
    r = u[..., None, :2] + np.cumsum(dl * d3, axis=-2) - dl / 2 * d3
    return r, _normal(th), d3


def _motions(
    d1: NDArray, d3: NDArray, dr: NDArray, dd1: NDArray, dd3: NDArray, axial: bool
) -> NDArray:
    """Return V = (v, w[, axial]) of changes dr, dd1, dd3 as seen at d1, d3."""
    v, w = _dot(d1, dr), (_dot(dd3, d1) - _dot(dd1, d3)) / 2
    return np.concatenate([v, w, _dot(d3, dr)] if axial else [v, w], axis=-1)


def _elastic(d3: NDArray, beam: _Beam) -> NDArray:
    """Elastic energy W (...,), J, of (possibly averaged) tangents; eqs. (16), (33)."""
    a, b = d3[..., :-1, :], d3[..., 1:, :]
    strain = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]) / beam.dl
    return beam.dl / 2 * np.sum(beam.stiffness * strain**2, axis=-1)


def _step_motions(u0: NDArray, u1: NDArray, beam: _Beam) -> NDArray:
    """Return V of the step from u0 to u1, shape (..., 2N or 3N)."""
    (r0, d10, d30), (r1, d11, d31) = _redundant(u0, beam.dl), _redundant(u1, beam.dl)
    return _motions(d10, d30, r1 - r0, d11 - d10, d31 - d30, beam.axial)


def _discrete_lagrangian(u0: NDArray, u1: NDArray, a: NDArray | None, beam: _Beam) -> NDArray:
    """L_d(u0, u1) of (34) with the added mass held at a; (..., N+2) -> (...,), J s."""
    (r0, d10, d30), (r1, d11, d31) = _redundant(u0, beam.dl), _redundant(u1, beam.dl)
    dr, dd1 = r1 - r0, d11 - d10
    quadratic = beam.dl * np.sum(
        beam.line_density * _dot(dr, dr) + beam.rotary_inertia * _dot(dd1, dd1), axis=-1
    )
    if a is not None:
        v = _motions(d10, d30, dr, dd1, d31 - d30, beam.axial)
        quadratic = quadratic + np.sum(v * (v @ a), axis=-1)
    return quadratic / (2 * beam.dt) - beam.dt * _elastic((d30 + d31) / 2, beam)


def _d1(u0: NDArray, u1: NDArray, a: NDArray | None, da: NDArray | None, beam: _Beam) -> NDArray:
    """D1 L_d at u0 (N+2,) for a batch u1 (..., N+2), with the shape derivative of A."""
    probes = u0 + 1j * STEP * np.eye(len(u0))
    out = _discrete_lagrangian(probes, u1[..., None, :], a, beam).imag / STEP
    if da is not None:
        v = _step_motions(u0, u1, beam)
        shape = np.einsum("...i,kij,...j->...k", v, da, v, optimize=True)
        out[..., 2:] += shape / (2 * beam.dt)
    return out


def _d2(u0: NDArray, u1: NDArray, a: NDArray | None, beam: _Beam) -> NDArray:
    """D2 L_d at (u0, u1), shape (N+2,)."""
    probes = u1 + 1j * STEP * np.eye(len(u1))
    return _discrete_lagrangian(u0, probes, a, beam).imag / STEP


def _mass(u: NDArray, a: NDArray | None, beam: _Beam) -> NDArray:
    """Total mass matrix (N+2, N+2) on du/dt at u; eqs. (18), (32)."""
    # Row c of the complex step is the velocity that the unit rate of coordinate c produces.
    dr, dd1, dd3 = (q.imag / STEP for q in _redundant(u + 1j * STEP * np.eye(len(u)), beam.dl))
    mass = beam.line_density * np.einsum("aki,bki->ab", dr, dr)
    mass += beam.rotary_inertia * np.einsum("aki,bki->ab", dd1, dd1)
    mass *= beam.dl
    if a is not None:
        _, d1, d3 = _redundant(u, beam.dl)
        v = _motions(d1, d3, dr, dd1, dd3, beam.axial)
        mass += v @ a @ v.T
    return mass


def _force(torque: NDArray, damping: NDArray, u0: NDArray, u1: NDArray, dt: float) -> NDArray:
    """Generalised force F_n (..., N+2) of the torques and Kelvin-Voigt moments.

    damping is (EI/dl) t_kv at the joints, N m s.
    """
    moment = torque - damping * np.diff(u1[..., 2:] - u0[2:], axis=-1) / dt
    force = np.zeros_like(u1)
    force[..., 3:] += moment
    force[..., 2:-1] -= moment
    return force


def _solve(residual: Callable[[NDArray], NDArray], guess: NDArray, scale: float) -> NDArray:
    """Newton with a finite-difference Jacobian and backtracking, run down to round-off."""
    u, r = guess, residual(guess)
    for _ in range(MAX_ITERATIONS):
        rows = (residual(u + JACOBIAN_STEP * np.eye(len(u))) - r) / JACOBIAN_STEP
        change = np.linalg.solve(rows.T, -r)
        size = np.max(np.abs(r))
        for halvings in range(12):
            trial = u + change / 2**halvings
            r_trial = residual(trial)
            if np.max(np.abs(r_trial)) < size:
                break
        else:  # nothing decreases any more: round-off, or failure
            break
        u, r = trial, r_trial
        if np.max(np.abs(r)) > 0.5 * size and size <= TOLERANCE * scale:
            break
    if not np.max(np.abs(r)) <= TOLERANCE * scale:
        raise ReferenceFailureError(f"residual {np.max(np.abs(r)):.1e} of scale {scale:.1e}")
    return u


def simulate(scene: Scene, torques: NDArray) -> dict[str, NDArray]:
    """Run the variational integrator (34) from the straight pose with its head at the origin.

    Parameters
    ----------
    scene : Scene
        Beam, damping, fluid (panels or none), axial added mass, time step, and the start's uniform
        velocity and slope; the rest is ignored.
    torques : (T, N-1) array
        Joint torques held over each step, N m.

    Returns
    -------
    dict
        centres (T+1, N, 2) in m; angles (T+1, N) in rad; momentum (T+1, 3), the discrete momentum
        map (px, py, angular about the origin); energy (T+1,) in J, p M^-1 p/2 + W; work (T,) in J,
        that of the torques.
    """
    n, dl, length = scene.beam.elements, scene.beam.element_length, scene.beam.length
    dt = scene.integrator.time_step
    stiffness = scene.beam.stiffness_at_joints()
    axial = scene.axial_added_mass is not None
    beam = _Beam(dl, scene.beam.line_density, scene.beam.rotary_inertia, stiffness, dt, axial)
    fluid = fluid_arguments(scene)
    damping = stiffness / dl * (scene.damping.retardation_time if scene.damping else 0.0)
    rate = np.full(n + 2, scene.initial.velocity_slope)
    rate[:2] = scene.initial.velocity

    steps = len(torques)
    path = np.zeros((steps + 1, n + 2))
    momenta = np.zeros_like(path)
    energy, work = np.zeros(steps + 1), np.zeros(steps)
    guess = path[0] + dt * rate
    for i in range(steps + 1):
        u0 = path[i]
        a, da = _added_mass_and_tensor(u0[2:], **fluid) if fluid else (None, None)
        mass = _mass(u0, a, beam)
        np.linalg.cholesky(mass)  # refuses a mass that has lost positivity
        if i == 0:
            momenta[0] = mass @ rate
        p = momenta[i]
        energy[i] = p @ np.linalg.solve(mass, p) / 2 + _elastic(_tangent(u0[2:]), beam)
        if i == steps:
            break

        def residual(u1: NDArray, i=i, u0=u0, p=p, a=a, da=da) -> NDArray:
            force = _force(torques[i], damping, u0, u1, dt)
            return p + _d1(u0, u1, a, da, beam) + dt / 2 * force

        # Subtracting positions costs eps (l + |x|) M/dt of momentum; the residual can't go below.
        reach = length + np.max(np.abs(u0[:2]))
        scale = max(np.max(np.abs(p)), np.max(np.abs(mass)) * reach / dt * 1e-3)
        u1 = _solve(residual, guess, scale)
        turn = u1[2:] - u0[2:]
        if np.max(np.abs(np.concatenate([turn, np.diff(turn)]))) > MAX_TURN:
            raise ReferenceFailureError(f"step {i} turns an element or joint by over {MAX_TURN}")
        path[i + 1] = u1
        momenta[i + 1] = _d2(u0, u1, a, beam) + dt / 2 * _force(torques[i], damping, u0, u1, dt)
        work[i] = torques[i] @ np.diff(turn)
        guess = 2 * u1 - u0

    spin = path[:, 0] * momenta[:, 1] - path[:, 1] * momenta[:, 0] + momenta[:, 2:].sum(axis=1)
    return {
        "centres": _redundant(path, dl)[0],
        "angles": path[:, 2:],
        "momentum": np.column_stack([momenta[:, :2], spin]),
        "energy": energy,
        "work": work,
    }
