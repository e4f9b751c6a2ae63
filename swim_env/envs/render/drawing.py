"""Drawing with Pillow: smooth shapes on a part of a picture, and fast text."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.colours import Colour
from swim_env.errors import SwimError

try:
    from PIL import Image, ImageDraw, ImageFilter, ImageFont
except ImportError as error:
    raise SwimError(
        f"frames need Pillow: install the extra 'view' (pip install 'swim-env[view]'; {error})"
    ) from None

__all__ = ["Box", "Image", "ImageDraw", "ImageFilter", "Lettering", "Patch", "Point"]

Array = NDArray[np.float64]
Point = tuple[float, float]
Box = tuple[int, int, int, int]

#: Largest areas (pixels) that are drawn at four and at three times their size; others at twice.
#: It bounds the time that a frame takes, and a shape that large needs no finer edge.
_FINEST, _FINE = 70_000, 110_000

#: Most texts of one kind that are kept, and how much larger words are drawn than they come out.
_KEPT_TEXTS, _LARGER = 256, 4


class Patch:
    """A part of a picture, enlarged, so that what is drawn on it comes out smooth.

    Used in a ``with`` statement, at whose end the part goes back into the picture. Coordinates
    and sizes are pixels of the picture, y downwards; colours are one Colour or an (n, 3) array.

    Parameters
    ----------
    image : PIL.Image.Image
        The picture.
    points : (n, 2) array
        What will be drawn lies around these points ...
    margin : float
        ... at most this far from one of them.
    limits : Box
        Left, top, right and bottom of what may be drawn on; the rest is cut off.
    """

    def __init__(self, image: Image.Image, points: Array, margin: float, limits: Box) -> None:
        # Cut off before rounding: far points would be too large for an int.
        low = np.clip(points.min(axis=0) - margin - 1.0, limits[:2], limits[2:])
        high = np.clip(points.max(axis=0) + margin + 1.0, limits[:2], limits[2:])
        self._image = image
        self._box = (int(low[0]), int(low[1]), math.ceil(high[0]), math.ceil(high[1]))
        width, height = self._box[2] - self._box[0], self._box[3] - self._box[1]
        area = width * height
        self._is_empty = area == 0
        scale = self._scale = 4 if area <= _FINEST else 3 if area <= _FINE else 2
        # Half a pixel of the enlarged part: Pillow cuts coordinates to whole numbers.
        self._origin = np.array(self._box[:2]) - 0.5 / scale
        if not self._is_empty:
            size = (width * scale, height * scale)
            self._large = image.crop(self._box).resize(size, Image.Resampling.NEAREST)
            self._draw = ImageDraw.Draw(self._large)

    def __enter__(self) -> Patch:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if not self._is_empty and error is None:
            self._image.paste(self._large.reduce(self._scale), self._box[:2])

    def _enlarged(self, points: Array) -> Array:
        return (points - self._origin) * self._scale

    def polygons(self, corners: Array, colours: ArrayLike) -> None:
        """Fill polygons with corners (n, k, 2)."""
        if self._is_empty:
            return
        flat = self._enlarged(corners).reshape(len(corners), -1).tolist()
        for polygon, colour in zip(flat, _inks(colours, len(flat)), strict=True):
            self._draw.polygon(polygon, fill=colour)

    def discs(self, centres: Array, radius: float, colours: ArrayLike) -> None:
        """Fill discs with centres (n, 2)."""
        if self._is_empty:
            return
        # An ellipse of Pillow reaches to the end of its last pixel.
        size = radius * self._scale - 0.5
        places = self._enlarged(centres).tolist()
        for (x, y), colour in zip(places, _inks(colours, len(places)), strict=True):
            self._draw.ellipse((x - size, y - size, x + size, y + size), fill=colour)

    def ring(self, centre: Array, radius: float, width: float, colour: Colour) -> None:
        """Draw a circle around a centre (2,), whose line lies inside of the radius."""
        if self._is_empty:
            return
        (x, y), size = self._enlarged(centre), radius * self._scale - 0.5
        box = (x - size, y - size, x + size, y + size)
        self._draw.ellipse(box, outline=colour, width=round(width * self._scale))

    def line(self, points: Array, width: float, colour: Colour) -> None:
        """Draw a line through points (n, 2)."""
        if not self._is_empty:
            corners = self._enlarged(points).ravel().tolist()
            self._draw.line(corners, fill=colour, width=round(width * self._scale))


def _inks(colours: ArrayLike, count: int) -> list[Colour]:
    """Return a colour for each of a number of shapes, as Pillow takes them."""
    return [tuple(colour) for colour in np.broadcast_to(colours, (count, 3)).tolist()]


class Lettering:
    """Text of one size (pixels), in the font that comes with Pillow.

    Laying out a text takes Pillow longer than drawing a fish, so texts are kept. What changes
    from frame to frame is put together from kept letters; the font's digits have one width.
    """

    def __init__(self, size: float) -> None:
        self._font = ImageFont.load_default(size)
        self._large_font = ImageFont.load_default(_LARGER * size)
        _, top, _, bottom = self._font.getbbox("Ag0(", anchor="ls")
        self._ascent, self._height = 1 - math.floor(top), math.ceil(bottom) - math.floor(top) + 2
        kept = functools.lru_cache(_KEPT_TEXTS)
        self._word = kept(self._drawn_word)
        self._line = kept(self._drawn_line)
        self._letter = kept(self._drawn_letter)

    def words(
        self, image: Image.Image, at: Point, text: str, colour: Colour, shift: float = 0.0
    ) -> float:
        """Draw a text that stays, evenly spaced, and return its width (pixels).

        It begins (shift 0), has its middle (0.5) or ends (1) at a point on the base line.
        """
        self._paste(image, at, self._word(text), colour, shift)
        return self.words_width(text)

    def words_width(self, text: str) -> float:
        """Return how wide a text of `words` is (pixels)."""
        return self._large_font.getlength(text) / _LARGER

    def figures(
        self, image: Image.Image, at: Point, text: str, colour: Colour, shift: float = 0.0
    ) -> int:
        """Draw a number, whose hyphen becomes a minus; see `words`."""
        mask = self._line(text)
        self._paste(image, at, mask, colour, shift)
        return mask.width

    def figures_upwards(self, image: Image.Image, at: Point, text: str, colour: Colour) -> None:
        """Draw a number that runs upwards; its base line's middle is at a point (pixels)."""
        mask = self._line(text).transpose(Image.Transpose.ROTATE_90)
        corner = (round(at[0]) - self._ascent, round(at[1]) - mask.height // 2)
        image.paste(colour, corner, mask)

    def figures_width(self, text: str) -> int:
        """Return how wide a text of `figures` is (pixels)."""
        return self._line(text).width

    def _paste(
        self, image: Image.Image, at: Point, mask: Image.Image, colour: Colour, shift: float
    ) -> None:
        corner = (round(at[0] - shift * mask.width), round(at[1]) - self._ascent)
        image.paste(colour, corner, mask)

    def _drawn_word(self, text: str) -> Image.Image:
        """Return a text, white on black, drawn larger and so without rounding its letters."""
        size = (_LARGER * math.ceil(self.words_width(text)), _LARGER * self._height)
        large = Image.new("L", size)
        start = (0.0, float(_LARGER * self._ascent))
        ImageDraw.Draw(large).text(start, text, fill=255, font=self._large_font, anchor="ls")
        return large.reduce(_LARGER)

    def _drawn_line(self, text: str) -> Image.Image:
        """Return a text put together from letters, white on black."""
        letters = [self._letter(letter) for letter in text]
        line = Image.new("L", (sum(letter.width for letter in letters), self._height))
        x = 0
        for letter in letters:
            line.paste(letter, (x, 0))
            x += letter.width
        return line

    def _drawn_letter(self, letter: str) -> Image.Image:
        """Return a letter, white on black, as wide as the way to the next one."""
        shape = "+" if letter == "-" else letter
        mask = Image.new("L", (round(self._font.getlength(shape)), self._height))
        at = (0.0, float(self._ascent))
        ImageDraw.Draw(mask).text(at, shape, fill=255, font=self._font, anchor="ls")
        if letter == "-":
            # The font's hyphen is too short for a minus: leave the bar of its plus.
            pixels = np.array(mask)
            columns = np.flatnonzero(pixels.any(axis=0))
            pixels[:, columns] = pixels[:, columns[1], None]
            mask = Image.fromarray(pixels)
        return mask
