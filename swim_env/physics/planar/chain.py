r"""Geometry and constants of the chain of rigid elements.

The minimal coordinates are q = (c, theta_1, a_2 ... a_N): the mean c of the element centres, the
angle of element 1 and the joint angles a_k = theta_k - theta_{k-1}. Joint angles are carried
rather than differenced, so the elastic moments of a stiff beam keep their digits. Momenta are
carried in the basis of the element angles, p = (p_c, p_theta_1 ... p_theta_N), where joint torques
and the angular momentum are plain sums.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import entry_kernel, kernel

Array = NDArray[np.float64]


class BeamConstants(NamedTuple):
    """Constants of the beam, per element and joint.

    Attributes
    ----------
    elements : int
        Number N of elements.
    element_length : float
        dl (m).
    element_mass : float
        dl rho_B A (kg).
    element_inertia : float
        dl rho_B I_1 (kg m^2).
    joint_stiffness : (N - 1,) array
        EI/dl (N m).
    joint_damping : (N - 1,) array
        EI t_kv/dl (N m s).
    strain_of_angles : bool
        Whether the strain of a step is that of the mean joint angles, sin(a)/dl at
        a_{n+1/2} = (a_n + a_{n+1})/2, instead of that of the averaged directors (16).
    linear_strain : bool
        Whether it is a/dl instead of sin(a)/dl, at the mean joint angles too.
    contact_radius : float
        Half the thickness (m) of the body that is watched for touching itself; 0 for no watch.
    smallest_momentum, smallest_spin : float
        Smallest scale of the residual of a momentum (kg m/s) and an angular one (kg m^2/s).
    """

    elements: int
    element_length: float
    element_mass: float
    element_inertia: float
    joint_stiffness: Array
    joint_damping: Array
    strain_of_angles: bool = False
    linear_strain: bool = False
    contact_radius: float = 0.0
    smallest_momentum: float = 0.0
    smallest_spin: float = 0.0


@kernel
def chain_weight(element: int, elements: int) -> float:
    """Return how far the mean centre moves along d3^j per length that element j (0-based) adds."""
    return (elements - element - 0.5) / elements


@entry_kernel
def centres(q: Array, element_length: float, out: Array) -> None:
    """Write the element centres (N, 2) in m of the minimal coordinates q (N + 2,).

    Neighbouring elements meet at a node, r^k - r^{k-1} = dl (d3^k + d3^{k-1})/2 (15).
    """
    elements = q.size - 2
    angle = 0.0
    x = 0.0
    y = 0.0
    mean_x = 0.0
    mean_y = 0.0
    for k in range(elements):
        angle += q[2 + k]
        step_x = 0.5 * element_length * np.cos(angle)
        step_y = 0.5 * element_length * np.sin(angle)
        out[k, 0] = x + step_x
        out[k, 1] = y + step_y
        mean_x += out[k, 0]
        mean_y += out[k, 1]
        x += 2.0 * step_x
        y += 2.0 * step_y
    for k in range(elements):
        out[k, 0] += q[0] - mean_x / elements
        out[k, 1] += q[1] - mean_y / elements


@entry_kernel
def centres_of_trajectory(q: Array, element_length: float, out: Array) -> None:
    """Write the element centres (T, N, 2) in m of a trajectory q (T, N + 2)."""
    for n in range(q.shape[0]):
        centres(q[n], element_length, out[n])


@kernel
def sum_to_centres(change: Array, shift_x: float, shift_y: float, dl: float, out: Array) -> None:
    """Apply E to changes of d3 and add a shift: out_k = shift + sum_j E_kj change_j.

    Parameters
    ----------
    change : (2, N) array
        Changes of the tangents.
    shift_x, shift_y : float
        Shift of the mean centre (m).
    dl : float
        Length of an element (m).
    out : (2, N) array
        Overwritten: changes of the centres (m).
    """
    elements = change.shape[1]
    front_x = 0.0
    front_y = 0.0
    mean_x = 0.0
    mean_y = 0.0
    for k in range(elements):
        out[0, k] = front_x + 0.5 * change[0, k]
        out[1, k] = front_y + 0.5 * change[1, k]
        mean_x += out[0, k]
        mean_y += out[1, k]
        front_x += change[0, k]
        front_y += change[1, k]
    mean_x /= elements
    mean_y /= elements
    for k in range(elements):
        out[0, k] = shift_x + dl * (out[0, k] - mean_x)
        out[1, k] = shift_y + dl * (out[1, k] - mean_y)


@kernel
def sum_from_centres(push: Array, total_x: float, total_y: float, dl: float, out: Array) -> None:
    """Apply the transpose of E: out_j = sum_k E_kj push_k; both (2, N), total the sum of push."""
    elements = push.shape[1]
    share_x = total_x / elements
    share_y = total_y / elements
    behind_x = 0.0
    behind_y = 0.0
    for back in range(elements):
        j = elements - 1 - back
        out[0, j] = dl * (behind_x + 0.5 * push[0, j] - (back + 0.5) * share_x)
        out[1, j] = dl * (behind_y + 0.5 * push[1, j] - (back + 0.5) * share_y)
        behind_x += push[0, j]
        behind_y += push[1, j]
