"""What environments have of their own in the plane and in space: shapes, starts and figures."""

from swim_env.envs.geometry.base import Geometry, StartPlan, geometry_of

__all__ = ["Geometry", "StartPlan", "geometry_of"]
