"""Derivatives of steps: the discrete adjoint of the step equations, and their tangent."""
