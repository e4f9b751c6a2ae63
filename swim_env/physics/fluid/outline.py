r"""The closed outline of a bent beam, its limits, and derivatives with respect to the joint angles.

The outline is made in the frame of element 1 (its first node at the origin, its tangent along x),
so that it depends on the joint angles alone. Panels run counter-clockwise: the side below the
elements (normal -d1) from head to tail, the tail's end, the side above them (normal +d1) from tail
to head, the head's end. At a joint with angle a the side vertices lie on the mean normal at
h/cos(a/2) from the node (a mitre); in the frame of either neighbour that is a shift of
h tan(a/2) along the element, so every side segment is exactly parallel to its element.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import kernel, shared
from swim_env.physics.status import FINE, OUTLINE_DEGENERATE, UNDER_RESOLVED_GAP

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


# Rows of `OutlineArrays.panels`: vertices, collocation points, unit tangents and lengths of the
# panels; coordinate of the collocation point along its element from the element's centre (on the
# ends: height above the centre line); normal velocity of the panel per unit translation along d1,
# rotation about the centre and translation along d3 of its own element, which are the only
# non-zero entries of B.
X, Y, CX, CY, CT, ST, LENGTH, ARM, LATERAL, ROTARY, AXIAL = range(11)
PANEL_ROWS = 11
# Rows of `OutlineArrays.nodes`: nodes in the frame of element 1, tan(a/2) at every node (zero at
# both ends), element angle in that frame (of the element behind the node).
NODE_X, NODE_Y, HALF_TANGENT, ANGLE = range(4)
NODE_ROWS = 4
# Sides of an element, ends of the body.
BELOW, ABOVE = range(2)
HEAD, TAIL = range(2)


class OutlineArrays(NamedTuple):
    """An outline of M panels, padded to M', filled by `build_outline`.

    Attributes
    ----------
    panels : (PANEL_ROWS, M') array
        One row per quantity, see the row names above (m, rad or dimensionless).
    nodes : (NODE_ROWS, N + 1) array
        One row per quantity.
    element : (M',) int array
        Element that the panel belongs to.
    """

    panels: Array
    nodes: Array
    element: NDArray[np.int64]


@shared
def panel_count(geometry: FluidGeometry) -> int:
    """Return the number M of panels of the closed outline."""
    return 2 * (geometry.elements * geometry.side_panels + geometry.cap_panels)


@shared
def first_panel(geometry: FluidGeometry, element: int, side: int) -> int:
    """Return the index of the first panel of an element's side, BELOW or ABOVE (0-based)."""
    if side == ABOVE:
        return (
            geometry.elements * geometry.side_panels
            + geometry.cap_panels
            + (geometry.elements - 1 - element) * geometry.side_panels
        )
    return element * geometry.side_panels


@shared
def first_end_panel(geometry: FluidGeometry, end: int) -> int:
    """Return the index of the first panel of an end, HEAD or TAIL (0-based)."""
    if end == HEAD:
        return 2 * geometry.elements * geometry.side_panels + geometry.cap_panels
    return geometry.elements * geometry.side_panels


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
        out.panels[X, i] = start_x + ct * (v * panel)
        out.panels[Y, i] = start_y + st * (v * panel)
        out.panels[CX, i] = start_x + ct * ((v + 0.5) * panel)
        out.panels[CY, i] = start_y + st * ((v + 0.5) * panel)
        out.panels[CT, i] = ct
        out.panels[ST, i] = st
        out.panels[LENGTH, i] = panel


@kernel
def build_outline(joint_angles: Array, geometry: FluidGeometry, out: OutlineArrays) -> int:
    """Build the closed outline and check its joints.

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
    out.nodes[HALF_TANGENT, 0] = 0.0
    out.nodes[HALF_TANGENT, elements] = 0.0
    out.nodes[ANGLE, 0] = 0.0
    out.nodes[NODE_X, 0] = 0.0
    out.nodes[NODE_Y, 0] = 0.0
    for k in range(elements - 1):
        half = 0.5 * joint_angles[k]
        cosine = np.cos(half)
        # Beyond 180 degrees the cosine grows again, so the angle itself is bounded too.
        if not (cosine * LARGEST_MITRE >= 1.0 and abs(half) < 0.5 * np.pi):
            return OUTLINE_DEGENERATE
        out.nodes[HALF_TANGENT, k + 1] = np.sin(half) / cosine
        out.nodes[ANGLE, k + 1] = out.nodes[ANGLE, k] + joint_angles[k]
    for k in range(elements):
        ct = np.cos(out.nodes[ANGLE, k])
        st = np.sin(out.nodes[ANGLE, k])
        out.nodes[NODE_X, k + 1] = out.nodes[NODE_X, k] + dl * ct
        out.nodes[NODE_Y, k + 1] = out.nodes[NODE_Y, k] + dl * st
        left = h * out.nodes[HALF_TANGENT, k]
        right = h * out.nodes[HALF_TANGENT, k + 1]
        shortening = left + right
        if not dl - abs(shortening) >= SHORTEST_SIDE * dl:
            return OUTLINE_DEGENERATE
        # Below: from (-left, -h) to (dl + right, -h) in the element's frame.
        below = first_panel(geometry, k, BELOW)
        _put_segment(
            below,
            side,
            out.nodes[NODE_X, k] - left * ct + h * st,
            out.nodes[NODE_Y, k] - left * st - h * ct,
            ct,
            st,
            dl + shortening,
            out,
        )
        # Above: from (dl - right, h) back to (left, h).
        above = first_panel(geometry, k, ABOVE)
        _put_segment(
            above,
            side,
            out.nodes[NODE_X, k] + (dl - right) * ct - h * st,
            out.nodes[NODE_Y, k] + (dl - right) * st + h * ct,
            -ct,
            -st,
            dl - shortening,
            out,
        )
        panel_below = (dl + shortening) / side
        panel_above = (dl - shortening) / side
        for v in range(side):
            i = below + v
            out.panels[ARM, i] = -left + (v + 0.5) * panel_below - 0.5 * dl
            out.panels[LATERAL, i] = -1.0
            out.panels[ROTARY, i] = -out.panels[ARM, i]
            out.panels[AXIAL, i] = 0.0
            out.element[i] = k
            i = above + v
            out.panels[ARM, i] = dl - right - (v + 0.5) * panel_above - 0.5 * dl
            out.panels[LATERAL, i] = 1.0
            out.panels[ROTARY, i] = out.panels[ARM, i]
            out.panels[AXIAL, i] = 0.0
            out.element[i] = k
    last = elements - 1
    ct = np.cos(out.nodes[ANGLE, last])
    st = np.sin(out.nodes[ANGLE, last])
    tail = first_end_panel(geometry, TAIL)
    _put_segment(
        tail,
        cap,
        out.nodes[NODE_X, elements] + h * st,
        out.nodes[NODE_Y, elements] - h * ct,
        -st,
        ct,
        2.0 * h,
        out,
    )
    head = first_end_panel(geometry, HEAD)
    _put_segment(head, cap, 0.0, h, 0.0, -1.0, 2.0 * h, out)
    for v in range(cap):
        height = h * ((2.0 * v + 1.0) / cap - 1.0)
        # n = d3 at the tail, -d3 at the head; e_z x (height d1) = -height d3.
        i = tail + v
        out.panels[ARM, i] = height
        out.panels[LATERAL, i] = 0.0
        out.panels[ROTARY, i] = -height
        out.panels[AXIAL, i] = 1.0
        out.element[i] = last
        i = head + v
        out.panels[ARM, i] = -height
        out.panels[LATERAL, i] = 0.0
        out.panels[ROTARY, i] = -height
        out.panels[AXIAL, i] = -1.0
        out.element[i] = 0
    for i in range(panel_count(geometry), out.element.size):
        out.panels[:, i] = 0.0
        out.panels[X, i] = out.panels[X, 0]
        out.panels[Y, i] = out.panels[Y, 0]
        out.panels[CT, i] = 1.0
        out.element[i] = 0
    return FINE


@kernel
def _distance_to_panel(px: float, py: float, j: int, panels: Array) -> float:
    """Return the distance (m) of a point from panel j."""
    ct = panels[CT, j]
    st = panels[ST, j]
    dx = px - panels[X, j]
    dy = py - panels[Y, j]
    along = min(max(dx * ct + dy * st, 0.0), panels[LENGTH, j])
    dx -= along * ct
    dy -= along * st
    return math.sqrt(dx * dx + dy * dy)


@kernel
def _panel_gap(i: int, j: int, panels: Array) -> float:
    """Return the least distance (m) of an end of one panel from the other.

    Where panels cross it is at most half the length of the shorter one, so crossing needs no test
    of its own, which rounding would fail for panels on one line.
    """
    ax = panels[X, i]
    ay = panels[Y, i]
    bx = ax + panels[CT, i] * panels[LENGTH, i]
    by = ay + panels[ST, i] * panels[LENGTH, i]
    cx = panels[X, j]
    cy = panels[Y, j]
    dx = cx + panels[CT, j] * panels[LENGTH, j]
    dy = cy + panels[ST, j] * panels[LENGTH, j]
    return min(
        min(_distance_to_panel(ax, ay, j, panels), _distance_to_panel(bx, by, j, panels)),
        min(_distance_to_panel(cx, cy, i, panels), _distance_to_panel(dx, dy, i, panels)),
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
            limit = GAP_TO_PANEL * max(out.panels[LENGTH, i], out.panels[LENGTH, j])
            if not _panel_gap(i, j, out.panels) > limit:
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
        widest = max(widest, abs(out.nodes[HALF_TANGENT, k]))
    reach = np.sqrt((0.5 * dl + h * widest) ** 2 + h * h)
    longest = max((dl + 2.0 * h * widest) / geometry.side_panels, 2.0 * h / geometry.cap_panels)
    far = 2.0 * reach + GAP_TO_PANEL * longest
    for k in range(elements):
        centre_x = 0.5 * (out.nodes[NODE_X, k] + out.nodes[NODE_X, k + 1])
        centre_y = 0.5 * (out.nodes[NODE_Y, k] + out.nodes[NODE_Y, k + 1])
        for m in range(k + 2, elements):
            dx = 0.5 * (out.nodes[NODE_X, m] + out.nodes[NODE_X, m + 1]) - centre_x
            dy = 0.5 * (out.nodes[NODE_Y, m] + out.nodes[NODE_Y, m + 1]) - centre_y
            if not dx * dx + dy * dy >= far * far and _pair_too_close(k, m, geometry, out):
                return UNDER_RESOLVED_GAP
    return FINE


@kernel
def gradient_to_element_angles(
    geometry: FluidGeometry,
    outline: OutlineArrays,
    gradient: Array,
    joint_gradient: Array,
    out: Array,
) -> None:
    """Turn derivatives with respect to panels into derivatives with respect to element angles.

    Parameters
    ----------
    geometry, outline : FluidGeometry, OutlineArrays
        The outline that the derivatives belong to.
    gradient : (5, M or more) array
        Derivative with respect to the vertices' x and y, and to the direction, the length and
        the arm of every panel.
    joint_gradient : (N + 1,) array
        Work space.
    out : (N,) array
        Overwritten: derivative with respect to theta_k. Its sum is zero to the last bit but one,
        because the shape depends on the joint angles alone.
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
        ct = np.cos(outline.nodes[ANGLE, k])
        st = np.sin(outline.nodes[ANGLE, k])
        moment += dl * (ct * force_y - st * force_x)
        left = 0.0
        right = 0.0
        for above in range(2):
            first = first_panel(geometry, k, above)
            for v in range(side):
                i = first + v
                gx = gradient[0, i]
                gy = gradient[1, i]
                force_x += gx
                force_y += gy
                dx = outline.panels[X, i] - outline.nodes[NODE_X, k]
                dy = outline.panels[Y, i] - outline.nodes[NODE_Y, k]
                moment += dx * gy - dy * gx + gradient[2, i]
                along = gx * ct + gy * st
                # Both ends of the segment slide along the element: below by -left and +right,
                # above by +left and -right; v counts from head to tail below, back above.
                start = v / side
                middle = (v + 0.5) / side
                stretch = gradient[3, i] / side
                if above == 1:
                    right -= along * (1.0 - start) + gradient[4, i] * (1.0 - middle) + stretch
                    left += along * start + gradient[4, i] * middle - stretch
                else:
                    left -= along * (1.0 - start) + gradient[4, i] * (1.0 - middle) - stretch
                    right += along * start + gradient[4, i] * middle + stretch
        for end in range(2):
            if k != (0 if end == HEAD else elements - 1):
                continue
            first = first_end_panel(geometry, end)
            for v in range(cap):
                i = first + v
                force_x += gradient[0, i]
                force_y += gradient[1, i]
                dx = outline.panels[X, i] - outline.nodes[NODE_X, k]
                dy = outline.panels[Y, i] - outline.nodes[NODE_Y, k]
                moment += dx * gradient[1, i] - dy * gradient[0, i] + gradient[2, i]
        for end in range(2):
            node = k + end
            tangent = outline.nodes[HALF_TANGENT, node]
            slide = 0.5 * h * (1.0 + tangent * tangent)
            joint_gradient[node] += slide * (left if end == 0 else right)
        joint_gradient[k] += moment
    # The sides' shift depends on the joint angle even where the moment does not: both end nodes
    # have none, and turning the whole outline changes nothing.
    joint_gradient[0] = 0.0
    joint_gradient[elements] = 0.0
    for k in range(elements):
        out[k] = joint_gradient[k] - joint_gradient[k + 1]
