"""Frames as one moving picture, which web pages play by themselves."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.render.drawing import Image
from swim_env.errors import OptionError
from swim_env.files.atomic import write_atomically

Frame = NDArray[np.uint8]

#: Shortest time (ms) that viewers show a frame of each kind for; many slow shorter ones down.
_SHORTEST = {".webp": 10, ".gif": 20}


def write_clip(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    rate: float,
    *,
    shrink: int = 1,
    quality: int = 80,
) -> None:
    """Write frames as a moving picture that starts again at its end.

    Parameters
    ----------
    path : str or os.PathLike
        The file, named .webp or .gif; its folder must exist.
    frames : iterable of (height, width, 3) arrays of uint8
        All of one size, one at least.
    rate : float
        Frames in a second, at most 100, in a GIF 50.
    shrink : int
        Frames come out this many times smaller; what was drawn large has smoother edges then.
    quality : int
        0 to 100, of WebP; a GIF has 256 colours, those of the middle frame.

    Raises
    ------
    OptionError
        If the name, the rate or a size cannot be used, or there are no frames.
    OSError
        If the file cannot be written.
    """
    kind = Path(path).suffix.lower()
    if kind not in _SHORTEST:
        raise OptionError(f"a clip's name ends with {' or '.join(_SHORTEST)} ({os.fspath(path)})")
    most = 1000.0 / _SHORTEST[kind]
    if not 0.0 < rate <= most:
        raise OptionError(f"rate must be above 0 and at most {most:g} in a {kind}, got {rate}")
    if shrink < 1:
        raise OptionError(f"shrink must be at least 1, got {shrink}")
    images = [Image.fromarray(frame).reduce(shrink) for frame in frames]
    if not images:
        raise OptionError("a clip needs one frame at least, got none")
    sizes = {image.size for image in images}
    if len(sizes) > 1:
        raise OptionError(f"frames must be of one size, got {', '.join(map(str, sorted(sizes)))}")
    # Whole units of the file's time, which add up to the true one.
    unit = 10 if kind == ".gif" else 1
    ends = [math.floor(k * 1000.0 / rate / unit + 0.5) * unit for k in range(len(images) + 1)]
    durations = np.diff(ends).tolist()

    def write(file: IO[bytes]) -> None:
        settings: dict[str, Any] = {"quality": quality, "method": 4}
        shown = images
        if kind == ".gif":
            middle = images[len(images) // 2]
            # Half for the many shades of the water, half for what is small and bright.
            methods = (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE)
            inks = [middle.quantize(128, method).getpalette() or [] for method in methods]
            palette = Image.new("P", (1, 1))
            palette.putpalette(inks[0] + inks[1])
            shown = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
            settings = {"optimize": False}
        shown[0].save(
            file,
            format=kind[1:],
            save_all=True,
            append_images=shown[1:],
            duration=durations,
            loop=0,
            **settings,
        )

    write_atomically(path, write)
