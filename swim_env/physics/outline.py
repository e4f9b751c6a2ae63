r"""The closed outline of a bent beam, its limits, and derivatives with respect to the joint angles.

The outline is made in the frame of element 1 (its first node at the origin, its tangent along x),
so that it hangs on the joint angles alone. Panels run counter-clockwise: the side below the
elements (normal -d1) from head to tail, the tail's end, the side above them (normal +d1) from tail
to head, the head's end. At a joint with angle a the side vertices lie on the mean normal at
h/cos(a/2) from the node (a mitre); in the frame of either neighbour that is a shift of
h tan(a/2) along the element, so every side segment is exactly parallel to its element.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics._compile import kernel
from swim_env.physics.status import FINE, OUTLINE_DEGENERATE, UNDER_RESOLVED_GAP

__all__ = [
    "GAP_TO_PANEL",
    "LARGEST_MITRE",
    "SHORTEST_SIDE",
    "FluidGeometry",
    "OutlineArrays",
    "build_outline",
    "gradient_to_element_angles",
    "outline_status",
    "panel_count",
]

Array = NDArray[np.float64]

#: Shortest side segment allowed, in element lengths.
SHORTEST_SIDE = 0.1
#: Longest mitre allowed, in half thicknesses.
LARGEST_MITRE = 4.0
#: Smallest gap between panels of elements that are not neighbours, in panel lengths.
GAP_TO_PANEL = 0.5


class FluidGeometry(NamedTuple):
    """How a beam is wrapped into panels.

    Attributes
    ----------
    elements : int
        Number N of elements.
    element_length : float
        dl (m).
    half_thickness : float
        h (m).
    side_panels : int
        Panels on one side of one element, half of the scene's panels per element.
    cap_panels : int
        Panels that close each end.
    """

    elements: int
    element_length: float
    half_thickness: float
    side_panels: int
    cap_panels: int


class OutlineArrays(NamedTuple):
    """Arrays that describe an outline of M panels, filled by `build_outline`.

    Attributes
    ----------
    angle, node_x, node_y : (N,), (N + 1,), (N + 1,) arrays
        Element angles (rad) and nodes (m) in the frame of element 1.
    half_tangent : (N + 1,) array
        tan(a/2) at every node, zero at both ends.
    x, y, cx, cy, ct, st, length : (M,) arrays
        Vertices, collocation points, unit tangents, panel lengths.
    arm : (M,) array
        Coordinate of the collocation point along its element from the element's centre on the
        sides (m); height above the centre line on the ends.
    lateral, rotary, axial : (M,) arrays
        Normal velocity of the panel per unit translation along d1, rotation about the centre and
        translation along d3 of its own element: the non-zero entries of B.
    element : (M,) int array
        Element that the panel belongs to.
    """

    angle: Array
    node_x: Array
    node_y: Array
    half_tangent: Array
    x: Array
    y: Array
    cx: Array
    cy: Array
    ct: Array
    st: Array
    length: Array
    arm: Array
    lateral: Array
    rotary: Array
    axial: Array
    element: NDArray[np.int64]


@kernel
def panel_count(geometry: FluidGeometry) -> int:
    """Return the number M of panels of the closed outline."""
    return 2 * (geometry.elements * geometry.side_panels + geometry.cap_panels)


@kernel
def first_panel(geometry: FluidGeometry, element: int, above: bool) -> int:
    """Return the index of the first panel of one side of an element (0-based)."""
    if above:
        return (
            geometry.elements * geometry.side_panels
            + geometry.cap_panels
            + (geometry.elements - 1 - element) * geometry.side_panels
        )
    return element * geometry.side_panels


@kernel
def _put_segment(
    first: int,
    count: int,
    start_x: float,
    start_y: float,
    ct: float,
    st: float,
    length: float,
    out: OutlineArrays,
) -> None:
    """Cut a straight segment into equal panels."""
    panel = length / count
    for v in range(count):
        i = first + v
        out.x[i] = start_x + ct * (v * panel)
        out.y[i] = start_y + st * (v * panel)
        out.cx[i] = start_x + ct * ((v + 0.5) * panel)
        out.cy[i] = start_y + st * ((v + 0.5) * panel)
        out.ct[i] = ct
        out.st[i] = st
        out.length[i] = panel


@kernel
def build_outline(joint_angles: Array, geometry: FluidGeometry, out: OutlineArrays) -> int:
    """Build the closed outline of PHYSICS.md section 2 and check its joints.

    Parameters
    ----------
    joint_angles : (N - 1,) array
        theta_{k+1} - theta_k (rad).
    geometry : FluidGeometry
        Sizes.
    out : OutlineArrays
        Overwritten.

    Returns
    -------
    int
        FINE, or OUTLINE_DEGENERATE when a mitre is longer than LARGEST_MITRE half
        thicknesses or a side segment shorter than SHORTEST_SIDE element lengths.
    """
    elements = geometry.elements
    dl = geometry.element_length
    h = geometry.half_thickness
    side = geometry.side_panels
    cap = geometry.cap_panels
    out.half_tangent[0] = 0.0
    out.half_tangent[elements] = 0.0
    out.angle[0] = 0.0
    out.node_x[0] = 0.0
    out.node_y[0] = 0.0
    for k in range(elements - 1):
        half = 0.5 * joint_angles[k]
        cosine = np.cos(half)
        # Beyond 180 degrees the cosine grows again, so the angle itself is bounded too.
        if not (cosine * LARGEST_MITRE >= 1.0 and abs(half) < 0.5 * np.pi):
            return OUTLINE_DEGENERATE
        out.half_tangent[k + 1] = np.sin(half) / cosine
        out.angle[k + 1] = out.angle[k] + joint_angles[k]
    for k in range(elements):
        ct = np.cos(out.angle[k])
        st = np.sin(out.angle[k])
        out.node_x[k + 1] = out.node_x[k] + dl * ct
        out.node_y[k + 1] = out.node_y[k] + dl * st
        left = h * out.half_tangent[k]
        right = h * out.half_tangent[k + 1]
        shortening = left + right
        if not dl - abs(shortening) >= SHORTEST_SIDE * dl:
            return OUTLINE_DEGENERATE
        # Below: from (-left, -h) to (dl + right, -h) in the element's frame.
        below = k * side
        _put_segment(
            below,
            side,
            out.node_x[k] - left * ct + h * st,
            out.node_y[k] - left * st - h * ct,
            ct,
            st,
            dl + shortening,
            out,
        )
        # Above: from (dl - right, h) back to (left, h).
        above = elements * side + cap + (elements - 1 - k) * side
        _put_segment(
            above,
            side,
            out.node_x[k] + (dl - right) * ct - h * st,
            out.node_y[k] + (dl - right) * st + h * ct,
            -ct,
            -st,
            dl - shortening,
            out,
        )
        panel_below = (dl + shortening) / side
        panel_above = (dl - shortening) / side
        for v in range(side):
            i = below + v
            out.arm[i] = -left + (v + 0.5) * panel_below - 0.5 * dl
            out.lateral[i] = -1.0
            out.rotary[i] = -out.arm[i]
            out.axial[i] = 0.0
            out.element[i] = k
            i = above + v
            out.arm[i] = dl - right - (v + 0.5) * panel_above - 0.5 * dl
            out.lateral[i] = 1.0
            out.rotary[i] = out.arm[i]
            out.axial[i] = 0.0
            out.element[i] = k
    last = elements - 1
    ct = np.cos(out.angle[last])
    st = np.sin(out.angle[last])
    tail = elements * side
    _put_segment(
        tail,
        cap,
        out.node_x[elements] + h * st,
        out.node_y[elements] - h * ct,
        -st,
        ct,
        2.0 * h,
        out,
    )
    head = 2 * elements * side + cap
    _put_segment(head, cap, 0.0, h, 0.0, -1.0, 2.0 * h, out)
    for v in range(cap):
        height = h * ((2.0 * v + 1.0) / cap - 1.0)
        # n = d3 at the tail, -d3 at the head; e_z x (height d1) = -height d3.
        i = tail + v
        out.arm[i] = height
        out.lateral[i] = 0.0
        out.rotary[i] = -height
        out.axial[i] = 1.0
        out.element[i] = last
        i = head + v
        out.arm[i] = -height
        out.lateral[i] = 0.0
        out.rotary[i] = -height
        out.axial[i] = -1.0
        out.element[i] = 0
    return FINE


@kernel
def _point_to_segment(
    px: float, py: float, ax: float, ay: float, ct: float, st: float, length: float
) -> float:
    along = min(max((px - ax) * ct + (py - ay) * st, 0.0), length)
    dx = px - ax - along * ct
    dy = py - ay - along * st
    return np.sqrt(dx * dx + dy * dy)


@kernel
def _panel_gap(i: int, j: int, o: OutlineArrays) -> float:
    """Return the distance of two panels, zero when they cross."""
    ix, iy = o.x[i] + o.ct[i] * o.length[i], o.y[i] + o.st[i] * o.length[i]
    jx, jy = o.x[j] + o.ct[j] * o.length[j], o.y[j] + o.st[j] * o.length[j]
    side_a = o.ct[i] * (o.y[j] - o.y[i]) - o.st[i] * (o.x[j] - o.x[i])
    side_b = o.ct[i] * (jy - o.y[i]) - o.st[i] * (jx - o.x[i])
    side_c = o.ct[j] * (o.y[i] - o.y[j]) - o.st[j] * (o.x[i] - o.x[j])
    side_d = o.ct[j] * (iy - o.y[j]) - o.st[j] * (ix - o.x[j])
    if side_a * side_b < 0.0 and side_c * side_d < 0.0:
        return 0.0
    return min(
        min(
            _point_to_segment(o.x[i], o.y[i], o.x[j], o.y[j], o.ct[j], o.st[j], o.length[j]),
            _point_to_segment(ix, iy, o.x[j], o.y[j], o.ct[j], o.st[j], o.length[j]),
        ),
        min(
            _point_to_segment(o.x[j], o.y[j], o.x[i], o.y[i], o.ct[i], o.st[i], o.length[i]),
            _point_to_segment(jx, jy, o.x[i], o.y[i], o.ct[i], o.st[i], o.length[i]),
        ),
    )


@kernel
def _pair_too_close(k: int, m: int, geometry: FluidGeometry, out: OutlineArrays) -> bool:
    """Compare the panels of two elements one by one."""
    panels = panel_count(geometry)
    for i in range(panels):
        if out.element[i] != k:
            continue
        for j in range(panels):
            if out.element[j] != m:
                continue
            limit = GAP_TO_PANEL * max(out.length[i], out.length[j])
            if not _panel_gap(i, j, out) >= limit:
                return True
    return False


@kernel
def outline_status(geometry: FluidGeometry, out: OutlineArrays) -> int:
    """Check that panels of elements that are not neighbours keep their distance.

    Neighbouring elements share a mitre, which `build_outline` bounds. Elements whose circumscribed
    circles are far enough apart are passed over, so an open shape costs N^2/2 comparisons.

    Returns
    -------
    int
        FINE or UNDER_RESOLVED_GAP.
    """
    elements = geometry.elements
    dl = geometry.element_length
    h = geometry.half_thickness
    widest = 0.0
    for k in range(elements + 1):
        widest = max(widest, abs(out.half_tangent[k]))
    reach = np.sqrt((0.5 * dl + h * widest) ** 2 + h * h)
    longest = max((dl + 2.0 * h * widest) / geometry.side_panels, 2.0 * h / geometry.cap_panels)
    far = 2.0 * reach + GAP_TO_PANEL * longest
    for k in range(elements):
        centre_x = 0.5 * (out.node_x[k] + out.node_x[k + 1])
        centre_y = 0.5 * (out.node_y[k] + out.node_y[k + 1])
        for m in range(k + 2, elements):
            dx = 0.5 * (out.node_x[m] + out.node_x[m + 1]) - centre_x
            dy = 0.5 * (out.node_y[m] + out.node_y[m + 1]) - centre_y
            if not dx * dx + dy * dy >= far * far and _pair_too_close(k, m, geometry, out):
                return UNDER_RESOLVED_GAP
    return FINE


@kernel
def gradient_to_element_angles(
    geometry: FluidGeometry,
    outline: OutlineArrays,
    gradient_x: Array,
    gradient_y: Array,
    gradient_turn: Array,
    gradient_length: Array,
    gradient_arm: Array,
    joint_gradient: Array,
    out: Array,
) -> None:
    """Turn derivatives with respect to panels into derivatives with respect to element angles.

    Parameters
    ----------
    geometry, outline : FluidGeometry, OutlineArrays
        The outline that the derivatives belong to.
    gradient_x, gradient_y : (M,) arrays
        Derivative with respect to the vertices.
    gradient_turn, gradient_length, gradient_arm : (M,) arrays
        Derivative with respect to the direction, length and arm of every panel.
    joint_gradient : (N + 1,) array
        Work space.
    out : (N,) array
        Overwritten: derivative with respect to theta_k. Its sum is zero to the last bit but one,
        because the shape hangs on the joint angles alone.
    """
    elements = geometry.elements
    side = geometry.side_panels
    cap = geometry.cap_panels
    dl = geometry.element_length
    h = geometry.half_thickness
    for k in range(elements + 1):
        joint_gradient[k] = 0.0
    # Walk from the tail to the head, carrying the force and the moment about the node in front of
    # the element of everything behind it: that moment is the derivative with respect to the joint.
    force_x = 0.0
    force_y = 0.0
    moment = 0.0
    for back in range(elements):
        k = elements - 1 - back
        ct = np.cos(outline.angle[k])
        st = np.sin(outline.angle[k])
        moment += dl * (ct * force_y - st * force_x)
        left = 0.0
        right = 0.0
        for above in range(2):
            first = first_panel(geometry, k, above == 1)
            sign = 1.0 if above == 1 else -1.0
            for v in range(side):
                i = first + v
                gx = gradient_x[i]
                gy = gradient_y[i]
                force_x += gx
                force_y += gy
                dx = outline.x[i] - outline.node_x[k]
                dy = outline.y[i] - outline.node_y[k]
                moment += dx * gy - dy * gx + gradient_turn[i]
                along = gx * ct + gy * st
                # Both ends of the segment slide along the element: below by -left and +right,
                # above by +left and -right; v counts from head to tail below, back above.
                start = v / side
                middle = (v + 0.5) / side
                stretch = gradient_length[i] / side
                if above == 1:
                    right -= along * (1.0 - start) + gradient_arm[i] * (1.0 - middle) + stretch
                    left += along * start + gradient_arm[i] * middle - stretch
                else:
                    left -= along * (1.0 - start) + gradient_arm[i] * (1.0 - middle) - stretch
                    right += along * start + gradient_arm[i] * middle + stretch
        for end in range(2):
            if k != (elements - 1 if end == 0 else 0):
                continue
            first = elements * side if end == 0 else 2 * elements * side + cap
            for v in range(cap):
                i = first + v
                force_x += gradient_x[i]
                force_y += gradient_y[i]
                dx = outline.x[i] - outline.node_x[k]
                dy = outline.y[i] - outline.node_y[k]
                moment += dx * gradient_y[i] - dy * gradient_x[i] + gradient_turn[i]
        for end in range(2):
            node = k + end
            tangent = outline.half_tangent[node]
            slide = 0.5 * h * (1.0 + tangent * tangent)
            joint_gradient[node] += slide * (left if end == 0 else right)
        joint_gradient[k] += moment
    # The sides' shift hangs on the joint angle even where the moment does not: both end nodes
    # have none, and turning the whole outline changes nothing.
    joint_gradient[0] = 0.0
    joint_gradient[elements] = 0.0
    for k in range(elements):
        out[k] = joint_gradient[k] - joint_gradient[k + 1]
