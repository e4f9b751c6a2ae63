r"""Geometry, strain energy and body inertia of the chain of rigid elements.

The minimal coordinates are q = (c, theta_1, a_2 ... a_N): the mean c of the element centres, the
angle of element 1 and the joint angles a_k = theta_k - theta_{k-1}. Joint angles are carried
rather than differenced, so the elastic moments of a stiff beam keep their digits. Momenta are
carried in the basis of the element angles, p = (p_c, p_theta_1 ... p_theta_N), where joint torques
and the angular momentum are plain sums.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import entry_kernel, kernel

__all__ = [
    "BeamConstants",
    "centres",
    "centres_of_trajectory",
    "chain_levers",
    "touches_itself",
]

Array = NDArray[np.float64]


class BeamConstants(NamedTuple):
    """What a scene says of the beam, per element and joint.

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
    elastic : bool
        Whether any joint has a stiffness.
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
    elastic: bool = True
    strain_of_angles: bool = False
    linear_strain: bool = False
    contact_radius: float = 0.0
    smallest_momentum: float = 1e-3
    smallest_spin: float = 1e-3


@kernel
def chain_weight(element: int, elements: int) -> float:
    """Return how far the mean centre moves along d3^j per length that element j (0-based) adds."""
    return (elements - element - 0.5) / elements


def chain_levers(elements: int, element_length: float) -> Array:
    """Return E, (N, N): centre k moves by E_kj (m) times the change of d3 of element j."""
    k, j = np.indices((elements, elements))
    weight = (elements - j - 0.5) / elements
    levers: Array = element_length * (np.where(j < k, 1.0, 0.0) + 0.5 * (j == k) - weight)
    return levers


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
def _distance_from_segment(
    x: float, y: float, start_x: float, start_y: float, along_x: float, along_y: float, dl: float
) -> float:
    """Return the distance (m) of a point from a segment of length dl with the given direction."""
    dx = x - start_x
    dy = y - start_y
    along = min(max(dx * along_x + dy * along_y, 0.0), dl)
    dx -= along * along_x
    dy -= along * along_y
    distance: float = np.sqrt(dx * dx + dy * dy)
    return distance


@kernel
def touches_itself(
    d3x: Array, d3y: Array, radius: float, dl: float, node_x: Array, node_y: Array
) -> bool:
    """Tell whether the body touches itself.

    Every element counts as a stadium, all points within the radius of its centre line. Two of them
    touch where they overlap, and are further apart along the body than half a turn around the
    radius: what is nearer is bent, not touching. Neighbours, which overlap at their node whatever
    they do, touch where the joint folds so far that their other ends do. Exact; elements that are
    far apart cost one comparison.

    Parameters
    ----------
    d3x, d3y : (N,) arrays
        Tangents of the elements.
    radius : float
        Half the thickness (m).
    dl : float
        Length of an element (m).
    node_x, node_y : (N,) arrays
        Scratch: the node in front of every element.
    """
    elements = d3x.size
    width = 2.0 * radius
    x = 0.0
    y = 0.0
    for k in range(elements):
        node_x[k] = x
        node_y[k] = y
        x += dl * d3x[k]
        y += dl * d3y[k]
    far = dl + width
    half_turn = math.pi * radius
    for k in range(elements):
        ax = d3x[k]
        ay = d3y[k]
        for m in range(k + 1, elements):
            if max(m - k - 1, 1) * dl < half_turn:
                continue
            bx = d3x[m]
            by = d3y[m]
            # From centre to centre.
            dx = node_x[m] - node_x[k] + 0.5 * dl * (bx - ax)
            dy = node_y[m] - node_y[k] + 0.5 * dl * (by - ay)
            if dx * dx + dy * dy > far * far:
                continue
            end_x = node_x[m] + dl * bx
            end_y = node_y[m] + dl * by
            if m == k + 1:
                gap = min(
                    _distance_from_segment(end_x, end_y, node_x[k], node_y[k], ax, ay, dl),
                    _distance_from_segment(node_x[k], node_y[k], node_x[m], node_y[m], bx, by, dl),
                )
                if gap < width:
                    return True
                continue
            # Sides of one segment's ends from the other's line, for segments that cross.
            first = ax * (node_y[m] - node_y[k]) - ay * (node_x[m] - node_x[k])
            second = ax * (end_y - node_y[k]) - ay * (end_x - node_x[k])
            third = bx * (node_y[k] - node_y[m]) - by * (node_x[k] - node_x[m])
            tip_x = node_x[k] + dl * ax
            tip_y = node_y[k] + dl * ay
            fourth = bx * (tip_y - node_y[m]) - by * (tip_x - node_x[m])
            if first * second < 0.0 and third * fourth < 0.0:
                return True
            gap = min(
                min(
                    _distance_from_segment(node_x[m], node_y[m], node_x[k], node_y[k], ax, ay, dl),
                    _distance_from_segment(end_x, end_y, node_x[k], node_y[k], ax, ay, dl),
                ),
                min(
                    _distance_from_segment(node_x[k], node_y[k], node_x[m], node_y[m], bx, by, dl),
                    _distance_from_segment(tip_x, tip_y, node_x[m], node_y[m], bx, by, dl),
                ),
            )
            if gap < width:
                return True
    return False
