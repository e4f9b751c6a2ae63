"""What a run keeps and spends: momentum, energy, and the forces and moments along the beam."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from swim_env.sim.trajectory import Trajectory

Array = NDArray[np.float64]

#: What rounding adds to the momentum in a step, as a share of its terms.
ROUND_OFF = 1e-15
#: Up to this frequency (Hz) the paper's steps of 10 ms resolve a motion: 2 pi f dt = 0.5.
RESOLVED = 8.0


def momentum_figures(trajectory: Trajectory) -> dict[str, Any]:
    """Return how well the discrete momentum map is kept.

    ``drift`` is max |J_n - J_0| (kg m/s and kg m^2/s, as one norm), ``bound`` that of the step
    where the drift comes closest to it, and ``share`` the drift's share of it there. The bound is
    10 tolerances plus 1e-15 n times the size of the map's terms, n the step: Newton's method leaves
    an error of its tolerance that the carried momenta pass on, and sums round.
    """
    momentum = trajectory.momentum
    drift = np.linalg.norm(momentum - momentum[0], axis=1)
    arms = np.linalg.norm(trajectory.path, axis=1)
    linear = float(np.hypot(*momentum[0, :2]))
    terms = np.maximum(np.linalg.norm(momentum[0]), arms * linear)
    bound = 10.0 * trajectory.scene.integrator.tolerance
    bounds = bound + ROUND_OFF * np.arange(len(drift)) * terms
    worst = int(np.argmax(drift / bounds))
    return {
        "drift": float(drift.max()),
        "bound": float(bounds[worst]),
        "share": float(drift[worst] / bounds[worst]),
    }


def energy_figures(trajectory: Trajectory) -> dict[str, Any]:
    """Return what the energy does.

    ``largest`` is H (J); ``unexplained`` max |H_n - H_0 - work + dissipated| as a share of it;
    ``first`` and ``last`` the mean unexplained energy of the first and the last quarter of the run,
    as shares: a trend would show there. ``work``, ``positive_work`` (J) of the torques and
    ``power``, the mean of the positive part (W); ``trusted`` by the scene's energy tolerance.
    """
    balance = trajectory.unexplained_energy
    largest = float(trajectory.energy.max())
    scale = largest if largest > 0.0 else 1.0
    quarter = max(1, len(balance) // 4)
    positive = float(trajectory.positive_work.sum())
    return {
        "largest": largest,
        "unexplained": float(np.abs(balance).max()) / scale,
        "first": float(balance[:quarter].mean()) / scale,
        "last": float(balance[-quarter:].mean()) / scale,
        "work": float(trajectory.work.sum()),
        "positive_work": positive,
        "power": positive / trajectory.duration if trajectory.duration else 0.0,
        "trusted": not trajectory.warnings(),
    }


def joint_moments(trajectory: Trajectory) -> dict[str, Array]:
    """Return the moments that the two sides of each joint exert on each other, part by part.

    In a step a joint carries its torque, the spring's moment (33) at the mean directors,
    EI/dl K cos(...) with K of (16), and the damper's. All turn the element behind it; the sum is
    what the body's material and muscle have to bear there. These are ``torque``, ``elastic``,
    ``damping`` and ``total`` (N m), (T, N - 1) arrays of every step.
    """
    beam, scene = trajectory.scene.beam, trajectory.scene
    spring = beam.stiffness_at_joints() / beam.element_length
    joint = np.diff(trajectory.angles, axis=1)
    mean = 0.5 * (joint[:-1] + joint[1:])
    turn = 0.5 * np.diff(trajectory.angles, axis=0)
    soften = np.ones_like(mean)
    if scene.integrator.strain == "averaged_directors":
        soften = (np.cos(turn[:, :-1]) * np.cos(turn[:, 1:])) ** 2
    elastic = -spring * soften * np.sin(mean) * np.cos(mean)
    if scene.integrator.strain == "joint_angle":
        elastic = -spring * mean
    damping = np.zeros_like(elastic)
    if scene.damping is not None:
        rate = np.diff(joint, axis=0) / scene.integrator.time_step
        damping = -spring * scene.damping.retardation_time * rate
    torque = trajectory.torques
    parts = {"torque": torque, "elastic": elastic, "damping": damping}
    return {**parts, "total": torque + elastic + damping}


def internal_forces(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the axial and the shear forces of the joints (N), (T - 1, N - 1) arrays.

    They are along the mean tangent and the mean normal of the joint's two elements, at the
    beginning of the second step and of every one after it; the axial one is a pull where it is
    positive.
    """
    forces = trajectory.internal_forces
    assert forces is not None
    # At the beginning of a run there is no step before, whose momenta the balance needs.
    forces, angles = forces[1:], trajectory.angles[1:-1]
    mean = 0.5 * (angles[:, :-1] + angles[:, 1:])
    cos, sin = np.cos(mean), np.sin(mean)
    axial: Array = forces[..., 0] * cos + forces[..., 1] * sin
    shear: Array = forces[..., 1] * cos - forces[..., 0] * sin
    return axial, shear


def has_forces(trajectory: Trajectory) -> bool:
    """Tell whether a run has forces across its joints, and two seconds of them."""
    return trajectory.internal_forces is not None and trajectory.duration >= 2.0


def resolved(values: Array, step: float) -> Array:
    """Return the part of series (T, ...), steps (s) apart, below `RESOLVED`, in phase."""
    sections = butter(4, RESOLVED, fs=1.0 / step, output="sos")
    slow: Array = sosfiltfilt(sections, values, axis=0)
    return slow


def internal_figures(trajectory: Trajectory) -> dict[str, Any]:
    """Return forces and moments along the beam, the largest strain, and what is not resolved.

    An undamped beam rings in modes that steps of 10 ms do not resolve, and more so with smaller
    steps: instantaneous forces have no limit that these runs come near to. Root mean squares below
    `RESOLVED` do: of ``axial``, ``shear`` (N), ``torque``, ``elastic``, ``total`` (N m) over the
    run, lists over the joints. ``above`` is, by ``axial``, ``shear`` and ``total``, the share of
    the variance above `RESOLVED` in all joints together; ``peak_shear`` the largest of all instants
    and joints as it is (N); ``strain`` the largest bending strain at the skin over the joints, h
    times the curvature; and ``power`` the mean positive power (W) of the torques on the resolved
    part of the motion.
    """
    axial, shear = internal_forces(trajectory)
    moments = joint_moments(trajectory)
    beam, step = trajectory.scene.beam, trajectory.scene.integrator.time_step
    found = {"axial": axial, "shear": shear}
    found |= {name: moments[name] for name in ("torque", "elastic", "total")}
    slow = {name: resolved(values, step) for name, values in found.items()}
    figures: dict[str, Any] = {
        name: np.sqrt(np.mean(values**2, axis=0)).tolist() for name, values in slow.items()
    }
    figures["above"] = {
        name: _share(np.mean((found[name] - slow[name]) ** 2), np.mean(found[name] ** 2))
        for name in ("axial", "shear", "total")
    }
    figures["peak_shear"] = float(np.abs(shear).max())
    curvature = np.sin(np.abs(np.diff(trajectory.angles, axis=1))) / beam.element_length
    rate = np.diff(resolved(np.diff(trajectory.angles, axis=1), step), axis=0) / step
    figures["power"] = float(np.maximum(trajectory.torques * rate, 0.0).sum(axis=1).mean())
    figures["strain"] = (beam.half_thickness * curvature.max(axis=0)).tolist()
    return figures


def _share(part: Any, whole: Any) -> float:
    return float(part / whole) if whole > 0.0 else 0.0
