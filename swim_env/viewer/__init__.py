"""Looking at runs: still pictures for people who read."""

from swim_env.viewer.stills import draw_path, require_matplotlib, save_figure

__all__ = ["draw_path", "require_matplotlib", "save_figure"]
