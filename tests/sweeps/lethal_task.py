"""A task that kills its process: once with a file to mark it, always without."""

import os
import signal
from pathlib import Path
from typing import Any

from swim_env import Scene
from swim_env.envs.tasks.forward import ForwardTask
from swim_env.physics.runtime.threads import usable_threads


class LethalTask(ForwardTask):
    """Swimming forward, if the process lives to see it."""

    def __init__(self, scene: Scene, mark: str = "", threads: int = 1, **options: Any) -> None:
        super().__init__(scene, **options)
        assert usable_threads() == threads
        if not mark or not Path(mark).exists():
            if mark:
                Path(mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
