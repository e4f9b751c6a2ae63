"""Runs of batches as a PyTorch function: policies can be trained through the physics."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch

from swim_env.errors import OptionError
from swim_env.gradients.objectives import Slopes
from swim_env.gradients.tape import Record, Tape
from swim_env.physics.runtime.threads import usable_threads
from swim_env.scene import load_scene


class _Play(torch.autograd.Function):  # type: ignore[misc]
    """The states that follow from torques and starts, with the discrete adjoint backward."""

    @staticmethod
    def forward(
        ctx: Any,
        torques: torch.Tensor,
        coordinates: torch.Tensor,
        momenta: torch.Tensor,
        tapes: Any,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        starts = [one.detach().numpy() for one in (torques, coordinates, momenta)]

        def play(member: int) -> Record:
            held, q, p = (one[member] for one in starts)
            tapes[member].move_to(q, p)
            record: Record = tapes[member].play(np.ascontiguousarray(held), 0, len(held))
            return record

        ctx.tapes = tapes
        ctx.records = _each(play, len(tapes))
        stretches = [record.stretch for record in ctx.records]
        return (
            torch.from_numpy(np.stack([one.coordinates for one in stretches])),
            torch.from_numpy(np.stack([one.momenta for one in stretches])),
        )

    @staticmethod
    def backward(ctx: Any, *by: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        by_states = [one.detach().numpy() for one in by]

        def pull(member: int) -> tuple[Any, Any, Any]:
            tape, record = ctx.tapes[member], ctx.records[member]
            slopes = Slopes(coordinates=by_states[0][member], momenta=by_states[1][member])
            q, p = tape.rates(record.stretch, slopes)
            adjoint = np.stack([q[-1], p[-1]])
            by_torques = tape.pull(record, q, p, adjoint, np.zeros(tape.parameters))
            start = record.stretch.coordinates[0]
            return by_torques, tape.by_coordinates(adjoint[0], start), adjoint[1]

        parts = zip(*_each(pull, len(ctx.tapes)), strict=True)
        return (*(torch.from_numpy(np.stack(one)) for one in parts), None)


def _each(function: Any, members: int) -> list[Any]:
    """Call a function for every member; kernels release the interpreter's lock."""
    if members == 1:
        return [function(0)]
    with ThreadPoolExecutor(min(members, usable_threads())) as pool:
        return list(pool.map(function, range(members)))


class SwimFunction:
    """Moves a batch of bodies by torques, differentiably.

    Parameters
    ----------
    scene : Scene, str or path
        What moves; see `swim_env.gradients.value_and_gradient` for what has gradients.
    batch : int
        Number B of bodies.

    Examples
    --------
    >>> function = SwimFunction("swimmer", batch=2)
    >>> coordinates, momenta = function.start()
    >>> torques = torch.zeros(2, 5, 8, dtype=torch.float64, requires_grad=True)
    >>> after, _ = function(torques, coordinates, momenta)
    >>> after[:, -1, 0].sum().backward()
    >>> torques.grad.shape
    torch.Size([2, 5, 8])
    """

    def __init__(self, scene: Any, batch: int = 1) -> None:
        if batch < 1:
            raise OptionError(f"batch must be at least 1, got {batch}")
        self.scene = load_scene(scene)
        self._tapes = [Tape.of(self.scene) for _ in range(batch)]

    def start(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the scene's start: coordinates (B, C) and momenta (B, M), see `Stretch`."""
        bodies = self._tapes[0].simulator._bodies
        self._tapes[0].simulator.reset()
        found = (bodies.coordinates[0].copy(), bodies.momenta[0].copy())
        count = len(self._tapes)
        coordinates, momenta = (torch.from_numpy(np.stack([one] * count)) for one in found)
        return coordinates, momenta

    def __call__(
        self, torques: torch.Tensor, coordinates: torch.Tensor, momenta: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return all states of a run.

        Parameters
        ----------
        torques : (B, T, N - 1) tensor of float64
            Joint torques of every step (N m), in space (B, T, N - 1, 3).
        coordinates, momenta : (B, C), (B, M) tensors of float64
            Where every body begins, as `start` returns them, or the last states of another call.

        Returns
        -------
        coordinates, momenta : (B, T + 1, C), (B, T + 1, M) tensors
            The states before and after every step.

        Raises
        ------
        OptionError
            If a tensor is not of float64 or has the wrong shape.
        SimulationEndedError
            If a run ends early; see `swim_env.gradients.value_and_gradient`.
        """
        bodies = self._tapes[0].simulator._bodies
        batch = len(self._tapes)
        wanted = {
            "torques": (torques, (batch, *torques.shape[1:2], *bodies.joint_shape)),
            "coordinates": (coordinates, (batch, bodies.coordinates_size)),
            "momenta": (momenta, (batch, bodies.unknowns)),
        }
        for name, (tensor, shape) in wanted.items():
            if tensor.dtype != torch.float64 or tuple(tensor.shape) != shape:
                raise OptionError(
                    f"{name} must be a tensor of float64 of shape {shape}, got {tensor.dtype} of "
                    f"{tuple(tensor.shape)}"
                )
            if not bool(torch.isfinite(tensor).all()):
                raise OptionError(f"{name} must be finite")
        after: tuple[torch.Tensor, torch.Tensor] = _Play.apply(
            torques, coordinates, momenta, self._tapes
        )
        return after
