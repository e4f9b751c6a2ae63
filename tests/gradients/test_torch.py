"""Runs as a PyTorch function, checked by PyTorch's own comparison with differences."""

import pytest

torch = pytest.importorskip("torch")

from swim_env import OptionError, load_scene  # noqa: E402
from swim_env.gradients import SwimFunction  # noqa: E402
from tests.support import uniform  # noqa: E402


@pytest.mark.parametrize("name", ["swimmer", "eel_3d"])
def test_autograd_agrees_with_differences(name):
    scene = load_scene(name).replace({"beam.elements": 3, "fluid.model": "strip"})
    function = SwimFunction(scene, batch=2)
    coordinates, momenta = function.start()
    shape = (2, 3, 2) if scene.dimension == 2 else (2, 3, 2, 3)
    torques = torch.tensor(uniform(*shape, size=0.3))
    torques.requires_grad_()
    momenta = momenta + 0.01
    momenta.requires_grad_()

    def far(torques, momenta):
        after, moving = function(torques, coordinates, momenta)
        return (after[:, -1, :2] * torch.tensor([1.0, -0.5])).sum(), (moving[:, -1] ** 2).sum()

    assert torch.autograd.gradcheck(far, (torques, momenta), eps=1e-4, atol=1e-7, rtol=1e-5)


def test_one_call_after_another_is_one_run():
    function = SwimFunction("swimmer")
    torques = torch.tensor(uniform(1, 6, 8, seed=3), requires_grad=True)
    coordinates, momenta = function.start()
    whole, _ = function(torques, coordinates, momenta)
    (by_whole,) = torch.autograd.grad(whole[0, -1, 0], torques)
    after, moving = function(torques[:, :3], coordinates, momenta)
    after, _ = function(torques[:, 3:], after[:, -1], moving[:, -1])
    (by_parts,) = torch.autograd.grad(after[0, -1, 0], torques)
    torch.testing.assert_close(after[0, -1], whole[0, -1], rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(by_parts, by_whole, rtol=1e-6, atol=1e-12)


def test_tensors_that_do_not_fit_are_one_error():
    function = SwimFunction("swimmer", batch=2)
    coordinates, momenta = function.start()
    with pytest.raises(OptionError, match=r"torques must be a tensor of float64 of shape \(2, 3,"):
        function(torch.zeros(2, 3, 7, dtype=torch.float64), coordinates, momenta)
    with pytest.raises(OptionError, match="got torch.float32"):
        function(torch.zeros(2, 3, 8), coordinates, momenta)
    with pytest.raises(OptionError, match="batch must be at least 1"):
        SwimFunction("swimmer", batch=0)
