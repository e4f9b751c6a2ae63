"""The body in space as shaded polygons: its true surface, with a dark head and back, and eyes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.body_surface import BodySurface
from swim_env.colours import BODY, Colour, torque_colours
from swim_env.physics.spatial.invariants import centres_of, directors_of
from swim_env.scene.spatial.body import SpatialBeam
from swim_env.scene.spatial.scene import SpatialScene

Array = NDArray[np.float64]

#: Rings along the body, and vertices of each; those of its shadow.
_FINE, _COARSE = (36, 20), (18, 8)
#: The head is dark from the front to here (s/l), the back from here on (half heights).
_HEAD, _BACK = 0.14, 0.55
#: Place of the eyes (s/l), their angle above the side (rad), and sizes of white and pupil in units
#: of the smaller half axis there.
_EYE_AT, _EYE_UP, _EYE_SIZES = 0.065, 0.35, (0.36, 0.2)
_EYE_WHITE: Colour = (255, 255, 255)
_turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
_EYE_RING = np.stack([np.cos(_turn), np.sin(_turn)], axis=-1)
_EYE_QUADS = np.array([[0, k, k + 1, k + 2] for k in range(1, len(_turn) - 2, 2)])
#: How far they stand off the surface (BL).
_EYE_OFF = (0.002, 0.004)


class Polygons(NamedTuple):
    """A body in one shape.

    Attributes
    ----------
    corners : (F, 4, 3) array
        Corners of the faces, counter-clockwise seen from outside, from the mean centre (BL).
    normals : (F, 3) array
        Unit normals of the faces, outwards.
    colours : (F, 3) array
        Colours of the faces, without light: of the bending torque that shortens the body there.
    coarse : (G, 4, 3) array
        Corners of fewer and larger faces, which look upwards, for the shadow.
    """

    corners: Array
    normals: Array
    colours: Array
    coarse: Array


class BodyMesh:
    """Makes polygons of a scene's body, smaller ones the finer it is; 1 suits 640 x 360 pixels."""

    def __init__(self, scene: SpatialScene, fineness: float) -> None:
        beam = self._beam = scene.beam
        self._places, self._joints = scene.action_places, scene.joints
        fine = round(_FINE[0] * fineness), 4 * round(_FINE[1] * fineness / 4.0)
        self._surface, self._coarse = BodySurface(scene, *fine), BodySurface(scene, *_COARSE)
        # The straight body, along x, tells how far along and how far up each face is.
        turns = np.broadcast_to(np.eye(3)[[2, 0, 1]], (beam.elements, 3, 3))
        centres = centres_of(np.zeros(3), turns, beam.element_length)
        straight = self._surface.vertices(centres, turns)
        s = straight[:, 0] + 0.5 * beam.length
        height = beam.half_height_at(s.clip(0.0, beam.length))
        up = np.divide(straight[:, 2], height, out=np.zeros_like(s), where=height > 0.0)
        s, up = (one[self._surface.faces].mean(axis=1) for one in (s / beam.length, up))
        self._is_dark = (s < _HEAD) | (up > _BACK)
        self._eye_element, self._eyes = _eyes(beam)
        inks = np.repeat([_EYE_WHITE, BODY], len(_EYE_QUADS), axis=0)
        self._eye_colours = np.concatenate([inks, inks])

    def polygons(self, shape: Array, shares: Array) -> Polygons:
        """Return the polygons of a shape.

        Parameters
        ----------
        shape : (4 N,) array
            The quaternions of a state.
        shares : (n,) array
            Torques as shares of the limits of the actions.
        """
        beam, faces = self._beam, self._surface.faces
        # Elements that fold onto each other, which the physics does not allow, have no cut.
        with np.errstate(all="ignore"):
            directors, _ = directors_of(np.concatenate([np.zeros(3), shape]))
            centres = centres_of(np.zeros(3), directors, beam.element_length)
            fine, coarse = (
                np.clip(np.nan_to_num(one.vertices(centres, directors) / beam.length), -1.0, 1.0)
                for one in (self._surface, self._coarse)
            )
        eyes = centres[self._eye_element] + self._eyes @ directors[self._eye_element].T
        corners = np.concatenate([fine[faces], eyes / beam.length])
        torques = np.zeros(3 * self._joints)
        torques[self._places] = shares
        driven = self._surface.on_surface(torques.reshape(-1, 3))[faces].mean(axis=1)
        skin = np.where(self._is_dark[:, None], BODY, torque_colours(driven))
        shadow = coarse[self._coarse.faces]
        return Polygons(
            corners,
            normals_of(corners),
            np.concatenate([skin, self._eye_colours]),
            shadow[normals_of(shadow)[:, 2] > 0.0],
        )


def normals_of(corners: Array) -> Array:
    """Return the unit normals (F, 3) of faces with corners (F, 4, 3); of no area, zero."""
    across = corners[:, 2:] - corners[:, :2]
    normals = np.cross(across[:, 0], across[:, 1])
    size = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.asarray(normals / np.where(size > 0.0, size, 1.0))


def _eyes(beam: SpatialBeam) -> tuple[int, Array]:
    """Return the element with the eyes, and their faces (F, 4, 3) in its frame (m)."""
    s = _EYE_AT * beam.length
    element = min(int(s / beam.element_length), beam.elements - 1)
    width, height = float(beam.half_width_at(s)), float(beam.half_height_at(s))
    along = np.array([0.0, 0.0, 1.0])
    faces = []
    for side in (1.0, -1.0):
        cosine, sine = side * np.cos(_EYE_UP), np.sin(_EYE_UP)
        normal = np.array([cosine * height, sine * width, 0.0])
        normal /= np.linalg.norm(normal)
        ring = _EYE_RING @ np.array([along, np.cross(normal, along)])
        place = [width * cosine, height * sine, s - (element + 0.5) * beam.element_length]
        for size, off in zip(_EYE_SIZES, _EYE_OFF, strict=True):
            middle = place + off * beam.length * normal
            faces.append((middle + size * min(width, height) * ring)[_EYE_QUADS])
    return element, np.concatenate(faces)
