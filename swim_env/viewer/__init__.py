"""Looking at runs: still pictures for people who read."""

from swim_env.viewer.gaits import draw_gaits, draw_paths, draw_scores
from swim_env.viewer.stills import draw_path, draw_wave_search, require_matplotlib, save_figure
from swim_env.viewer.training import draw_training

__all__ = [
    "draw_gaits",
    "draw_path",
    "draw_paths",
    "draw_scores",
    "draw_training",
    "draw_wave_search",
    "require_matplotlib",
    "save_figure",
]
