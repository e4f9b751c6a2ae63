"""The environments in three dimensions, single and batched."""

from __future__ import annotations

from typing import Any

from swim_env.envs.interface import DEFAULT_SCENES, SceneLike, SharedInterface
from swim_env.envs.single import SwimEnv, SwimTargetEnv
from swim_env.envs.vector import SwimTargetVectorEnv, SwimVectorEnv
from swim_env.errors import OptionError

_SCENE = DEFAULT_SCENES[1]


def _need_space(env: SharedInterface) -> None:
    if env.scene.dimension != 3:
        raise OptionError(
            f"{type(env).__name__} needs a scene of dimension 3, got {env.scene.name}: take "
            f"{type(env).__name__.replace('3D', '')}, or a scene such as {_SCENE}"
        )


class SwimEnv3D(SwimEnv):
    r"""An elastic beam in an ideal fluid swims in space by its joint torques.

    ``gymnasium.make("swim_env/KirchhoffSwimmer3D-v0", scene="eel_3d")``

    As `SwimEnv`, which makes the same environment of a scene of dimension 3, with these
    differences. The body's frame is that of its mean rotation: forward = -d3, left = -d1, up = d2
    of the polar factor of the elements' mean directors.

    ## Actions
    ``Box(-1, 1, (n,), float32)``: for every joint from head to tail the torques about the axes that
    are actuated, in the order of the scene's ``actuation.axes``, as shares of their limits. They
    are conjugate to the joint's rotation vector, whose components are (pitch, yaw, roll), about d1,
    d2 and d3.

    ## Observations
    ``Box((6 (N - 1) + 9,), float32)``, with J = N - 1 joints and t the control interval. Nothing
    depends on where the body is or on how it is turned.

    | index             | quantity                                             | unit of 1    |
    |-------------------|------------------------------------------------------|--------------|
    | 0 ... 3J-1        | rotation vectors of the joints (pitch, yaw, roll)    | 0.1 rad      |
    | 3J ... 6J-1       | their rates                                          | 0.1 rad / t  |
    | 6J ... 6J+2       | direction to the goal (forward, left, up)            | 1            |
    | 6J+3 ... 6J+5     | velocity of the mean centre (forward, left, up)      | 0.002 BL / t |
    | 6J+6 ... 6J+8     | turning rates of the body's frame about these axes   | 0.02 rad / t |

    ## Start
    ``reset(options=...)`` takes ``noise`` and the fields of a spatial scene's ``initial`` block,
    ``velocity``, ``spin`` and ``joint_rotations``.

    ## Info
    ``position`` has three components; ``heading_error`` is the angle between the head's direction
    and the goal's, 0 to pi.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or mapping
        As for `SwimEnv`, of dimension 3.
    **options
        The other parameters of `SwimEnv`.

    Raises
    ------
    OptionError
        If the scene is one in the plane; and all that `SwimEnv` raises.
    """

    def __init__(self, scene: SceneLike = _SCENE, **options: Any) -> None:
        super().__init__(scene, **options)
        _need_space(self)


class SwimTargetEnv3D(SwimTargetEnv):
    r"""The swimmer in space has to reach a point, for which it has to turn to any side.

    ``gymnasium.make("swim_env/KirchhoffSwimmer3DTarget-v0")``

    As `SwimEnv3D`, with the differences of `SwimTargetEnv`: the goal's direction is that to the
    point, the last observation is its distance, and ``options={"target": (x, y, z)}`` sets it.
    Targets are drawn within a cone about the scene's heading, all directions alike.

    Parameters
    ----------
    scene, **options
        As for `SwimTargetEnv`, with a scene of dimension 3.
    """

    def __init__(self, scene: SceneLike = _SCENE, **options: Any) -> None:
        super().__init__(scene, **options)
        _need_space(self)


class SwimVectorEnv3D(SwimVectorEnv):
    """Many `SwimEnv3D` in one.

    ``gymnasium.make_vec("swim_env/KirchhoffSwimmer3D-v0", num_envs=64)``

    Parameters
    ----------
    num_envs, scene, **options
        As for `SwimVectorEnv`, with a scene of dimension 3.
    """

    def __init__(self, num_envs: int = 1, scene: SceneLike = _SCENE, **options: Any) -> None:
        super().__init__(num_envs, scene, **options)
        _need_space(self)


class SwimTargetVectorEnv3D(SwimTargetVectorEnv):
    """Many `SwimTargetEnv3D` in one.

    ``gymnasium.make_vec("swim_env/KirchhoffSwimmer3DTarget-v0", num_envs=64)``

    Parameters
    ----------
    num_envs, scene, **options
        As for `SwimTargetVectorEnv`, with a scene of dimension 3.
    """

    def __init__(self, num_envs: int = 1, scene: SceneLike = _SCENE, **options: Any) -> None:
        super().__init__(num_envs, scene, **options)
        _need_space(self)
