"""Drawing with Pillow: smooth shapes on a part of a picture, fast text, colours."""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from swim_env.colours import TORQUE_STOPS
from swim_env.errors import SwimError

try:
    from PIL import Image, ImageDraw, ImageFont
except ImportError as error:
    raise SwimError(
        f"frames need Pillow: install the extra 'view' (pip install 'swim-env[view]'; {error})"
    ) from None

__all__ = [
    "Box",
    "Colour",
    "Image",
    "ImageDraw",
    "Lettering",
    "Patch",
    "Point",
    "blend",
    "coverage",
    "torque_colours",
]

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
Point = tuple[float, float]
Box = tuple[int, int, int, int]

#: Largest areas (pixels) that are drawn at four and at three times their size; others at twice.
#: It bounds the time that a frame takes, and a shape that large needs no finer edge.
_FINEST, _FINE = 70_000, 110_000

#: Most texts of one kind that are kept, and how much larger words are drawn than they come out.
_KEPT_TEXTS, _LARGER = 256, 4


def blend(first: Colour, second: Colour, share: float) -> Colour:
    """Return the colour that lies a share of the way from the first to the second."""
    r, g, b = (round(p + share * (q - p)) for p, q in zip(first, second, strict=True))
    return (r, g, b)


def torque_colours(torques: Array) -> list[Colour]:
    """Return the colours of torques.

    Parameters
    ----------
    torques : (n,) array
        Torques as a share of their limit; beyond -1 and 1 they count as -1 and 1.
    """
    at = 2.0 * (np.clip(torques, -1.0, 1.0) + 1.0)
    below = np.minimum(at.astype(np.int64), 3)
    return [
        blend(TORQUE_STOPS[i], TORQUE_STOPS[i + 1], float(share))
        for i, share in zip(below, at - below, strict=True)
    ]


def coverage(lines: Array, width: float, size: int) -> Array:
    """Return how much of every pixel of a row is covered by lines that cross it.

    Parameters
    ----------
    lines : (k,) array
        Where the middles of the lines are (pixels from the row's beginning).
    width : float
        Their width (pixels).
    size : int
        Number n of pixels.

    Returns
    -------
    (n,) array
        Shares between 0 and 1.
    """
    left = np.arange(size, dtype=np.float64)
    begin = np.maximum(left, lines[:, None] - 0.5 * width)
    end = np.minimum(left + 1.0, lines[:, None] + 0.5 * width)
    covered: Array = np.minimum(np.maximum(end - begin, 0.0).sum(axis=0), 1.0)
    return covered


class Patch:
    """A part of a picture, enlarged, so that what is drawn on it comes out smooth.

    Used in a ``with`` statement, at whose end the part goes back into the picture. Coordinates
    are those of the picture (pixels, y downwards). What lies outside of the limits is cut off.

    Parameters
    ----------
    image : PIL.Image.Image
        The picture.
    points : (n, 2) array
        What will be drawn lies around these points ...
    margin : float
        ... at most this far from one of them (pixels).
    limits : Box
        Left, top, right and bottom of what may be drawn on (pixels).
    """

    def __init__(self, image: Image.Image, points: Array, margin: float, limits: Box) -> None:
        # Cut off before rounding: far points would be too large for an int.
        low = np.clip(points.min(axis=0) - margin - 1.0, limits[:2], limits[2:])
        high = np.clip(points.max(axis=0) + margin + 1.0, limits[:2], limits[2:])
        self._image = image
        self.box = (int(low[0]), int(low[1]), math.ceil(high[0]), math.ceil(high[1]))
        width, height = self.box[2] - self.box[0], self.box[3] - self.box[1]
        self.is_empty = width == 0 or height == 0
        area = width * height
        self._scale = 4 if area <= _FINEST else 3 if area <= _FINE else 2
        # Half a pixel of the enlarged part: Pillow cuts coordinates to whole numbers.
        self._origin = np.array(self.box[:2]) - 0.5 / self._scale

    def __enter__(self) -> Patch:
        if not self.is_empty:
            width, height = self.box[2] - self.box[0], self.box[3] - self.box[1]
            part = self._image.crop(self.box)
            size = (width * self._scale, height * self._scale)
            self._large = part.resize(size, Image.Resampling.NEAREST)
            self._draw = ImageDraw.Draw(self._large)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self.is_empty and error is None:
            self._image.paste(self._large.reduce(self._scale), self.box[:2])

    def _enlarged(self, points: Array) -> Array:
        return (points - self._origin) * self._scale

    def polygons(self, corners: Array, colours: Iterable[Colour]) -> None:
        """Fill polygons of as many corners each.

        Parameters
        ----------
        corners : (n, k, 2) array
            Their corners (pixels).
        colours : iterable of Colour
            Their colours.
        """
        if self.is_empty:
            return
        flat = self._enlarged(corners).reshape(len(corners), -1).tolist()
        for polygon, colour in zip(flat, colours, strict=False):
            self._draw.polygon(polygon, fill=colour)

    def discs(self, centres: Array, radius: float, colours: Iterable[Colour]) -> None:
        """Fill discs.

        Parameters
        ----------
        centres : (n, 2) array
            Their centres (pixels).
        radius : float
            Their radius (pixels).
        colours : iterable of Colour
            Their colours.
        """
        if self.is_empty:
            return
        # An ellipse of Pillow reaches to the end of its last pixel.
        size = radius * self._scale - 0.5
        for (x, y), colour in zip(self._enlarged(centres).tolist(), colours, strict=False):
            self._draw.ellipse((x - size, y - size, x + size, y + size), fill=colour)

    def ring(self, centre: Array, radius: float, width: float, colour: Colour) -> None:
        """Draw a circle whose line lies inside of the radius; centre (2,), all in pixels."""
        if self.is_empty:
            return
        (x, y), size = self._enlarged(centre), radius * self._scale - 0.5
        box = (x - size, y - size, x + size, y + size)
        self._draw.ellipse(box, outline=colour, width=round(width * self._scale))

    def line(self, points: Array, width: float, colour: Colour) -> None:
        """Draw a line through points (n, 2) with a width (pixels)."""
        if not self.is_empty:
            corners = self._enlarged(points).ravel().tolist()
            self._draw.line(corners, fill=colour, width=round(width * self._scale))


class Lettering:
    """Text of one size, in the font that comes with Pillow.

    Laying out a text takes Pillow longer than drawing a fish, so texts are kept. What changes
    from frame to frame is put together from kept letters; the font's digits have one width.

    Parameters
    ----------
    size : float
        Size of the font (pixels).
    """

    def __init__(self, size: float) -> None:
        self._font = ImageFont.load_default(size)
        self._large_font = ImageFont.load_default(_LARGER * size)
        _, top, _, bottom = self._font.getbbox("Ag0(", anchor="ls")
        self._ascent, self._height = 1 - math.floor(top), math.ceil(bottom) - math.floor(top) + 2
        self._letters: dict[str, Image.Image] = {}
        self._figures: dict[str, Image.Image] = {}
        self._words: dict[str, Image.Image] = {}

    def words(
        self, image: Image.Image, at: Point, text: str, colour: Colour, shift: float = 0.0
    ) -> float:
        """Draw a text that stays, evenly spaced.

        Parameters
        ----------
        image : PIL.Image.Image
            The picture.
        at : Point
            A point on the base line (pixels) ...
        text : str
            The text.
        colour : Colour
            Its colour.
        shift : float
            ... which the text begins at (0), has in its middle (0.5) or ends at (1).

        Returns
        -------
        float
            The text's width (pixels).
        """
        mask = self._words.get(text)
        if mask is None:
            # Drawn larger, and so without the font's rounding of letters to whole pixels.
            size = (_LARGER * math.ceil(self.words_width(text)), _LARGER * self._height)
            large = Image.new("L", size)
            start = (0.0, float(_LARGER * self._ascent))
            draw = ImageDraw.Draw(large)
            draw.text(start, text, fill=255, font=self._large_font, anchor="ls")
            mask = _keep(self._words, text, large.reduce(_LARGER))
        self._paste(image, at, mask, colour, shift)
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

    def _line(self, text: str) -> Image.Image:
        """Return a text put together from letters, white on black."""
        line = self._figures.get(text)
        if line is None:
            letters = [self._letters.get(letter) or self._letter(letter) for letter in text]
            line = Image.new("L", (sum(letter.width for letter in letters), self._height))
            x = 0
            for letter in letters:
                line.paste(letter, (x, 0))
                x += letter.width
            _keep(self._figures, text, line)
        return line

    def _letter(self, letter: str) -> Image.Image:
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
        return _keep(self._letters, letter, mask)


def _keep(store: dict[str, Image.Image], text: str, mask: Image.Image) -> Image.Image:
    """Keep a mask; a store that is full starts anew."""
    if len(store) >= _KEPT_TEXTS:
        store.clear()
    store[text] = mask
    return mask
