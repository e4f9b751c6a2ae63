"""Connects a running environment to its frames and its window."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.episodes import Episodes
from swim_env.envs.render.camera import Camera
from swim_env.envs.render.window import Window
from swim_env.scene import Scene

if TYPE_CHECKING:
    from swim_env.envs.render.painter import Painter

Frame = NDArray[np.uint8]


class EpisodesViewer:
    """Draws the members of `Episodes` as they are, or shows member 0 in a window.

    Nothing of the episodes is changed. The viewer in a copy of an environment continues the trail,
    and has a window of its own. A window shows so many frames in a second of real time. `frames`
    raises a SwimError where Pillow is not installed.
    """

    def __init__(self, episodes: Episodes, rate: float) -> None:
        self._episodes = episodes
        self._painters: list[Painter[Any]] = []
        #: Of a copy, until it paints itself.
        self._cameras: list[Camera | None] = []
        self._rate = rate
        self._window: Window | None = None

    def frames(self) -> tuple[Frame, ...]:
        """Return a frame of every member, (height, width, 3) uint8 each."""
        return tuple(self._frame(member) for member in range(len(self._episodes.all_members)))

    def show(self) -> None:
        """Show member 0 in the window, if there is one."""
        if self._window is None:
            self._window = Window(f"swim_env: {self._episodes.task.scene.name}", self._rate)
        if self._window.is_open:
            self._window.show(self._frame(0))

    def forget(self, member: int | None = None) -> None:
        """Say that the episode of one member, or of all, does not continue what was shown."""
        chosen = slice(None) if member is None else slice(member, member + 1)
        for painter in self._painters[chosen]:
            painter.forget()
        self._cameras[chosen] = [None] * len(self._cameras[chosen])

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def _frame(self, member: int) -> Frame:
        scene = self._episodes.task.scene
        if not self._painters:
            task = self._episodes.task
            radius = task.radius if task.goal_is_point else None
            painter = _painter_of(scene)(scene, target_radius=radius)
            # Copies share what all their frames have in common.
            self._painters = [copy.copy(painter) for _ in self._episodes.all_members]
            for one, camera in zip(self._painters, self._cameras, strict=False):
                one.camera = camera
            self._cameras = []
        info = self._episodes.info(member)
        return self._painters[member].draw(
            self._episodes.bodies.coordinates[member],
            scene.actions_of(self._episodes.torques[member, 0]),
            info["time"],
            info["progress"],
            self._episodes.goals[member],
        )

    def __getstate__(self) -> dict[str, Any]:
        # Neither fonts nor windows can be copied.
        cameras = [painter.camera for painter in self._painters] or self._cameras
        return {**vars(self), "_painters": [], "_cameras": cameras, "_window": None}


def _painter_of(scene: Scene) -> type[Painter[Any]]:
    """Return what draws a scene's frames, which needs Pillow: not every environment has it."""
    if scene.dimension == 3:
        from swim_env.envs.render.spatial_frames import SpatialFramePainter

        return SpatialFramePainter
    from swim_env.envs.render.frames import FramePainter

    return FramePainter
