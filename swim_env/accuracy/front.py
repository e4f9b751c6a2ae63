"""The measured front of accuracy against cost that ships with the package."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from swim_env.accuracy.settings import Settings
from swim_env.errors import SwimError

__all__ = ["FRONT_FILE", "Measured", "load_front"]

#: Written by ``scripts/accuracy_cost.py --refresh-front``.
FRONT_FILE = Path(__file__).parent / "front.json"


@dataclass(frozen=True)
class Measured:
    """Settings and what was measured with them.

    ``cost`` is wall time in units of the paper's settings on scene paper_i, the median over the
    scenes; ``errors`` are relative errors of the displacement by scene.
    """

    settings: Settings
    cost: float
    errors: dict[str, float]


def load_front(path: Path = FRONT_FILE) -> list[Measured]:
    """Read a measured front, sorted by cost; SwimError if the file holds none."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return [
            Measured(Settings.from_dict(one), one["cost"], dict(one["errors"]))
            for one in data["front"]
        ]
    except OSError as error:
        raise SwimError(
            f"cannot read the measured front: {error.strerror or error} ({path})"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise SwimError(f"not a measured front: {error} ({path})") from None
