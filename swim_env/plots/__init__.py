"""Still pictures of runs.

Everywhere `trajectories` are runs by the names of their policies, and `seconds` is the time that is
shown, the last of each run (s): 50 of its scene's `frame_interval` unless given. Where nothing can
be drawn, that is a SwimError.
"""

from swim_env.plots.energy import draw_energy
from swim_env.plots.gaits import draw_gaits, draw_paths, draw_scores
from swim_env.plots.heat_maps import draw_kymographs, draw_torques, draw_wave_search
from swim_env.plots.spatial_gaits import draw_bending
from swim_env.plots.stills import draw_path
from swim_env.plots.style import require_matplotlib, save_figure
from swim_env.plots.sweeps import draw_sweep
from swim_env.plots.training import draw_training

__all__ = [
    "draw_bending",
    "draw_energy",
    "draw_gaits",
    "draw_kymographs",
    "draw_path",
    "draw_paths",
    "draw_scores",
    "draw_sweep",
    "draw_torques",
    "draw_training",
    "draw_wave_search",
    "require_matplotlib",
    "save_figure",
]
