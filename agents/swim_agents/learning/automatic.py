"""Settings of a training that follow from the body: times that are counted in actions."""

from __future__ import annotations

from typing import Any

from swim_env import natural_frequencies
from swim_env.analysis.modes import driven_axis
from swim_env.errors import SettingsError
from swim_env.scene import Scene
from swim_env.scene.checks import got
from swim_env.scene.making import AUTO

#: How far a learner looks ahead, and how long exploration is held, in periods of the body's first
#: mode about its `driven_axis`. A critic that is fitted to its own guesses learns a shorter horizon
#: sooner.
_HORIZON = {"PPO": 50.0, "SAC": 20.0}
_HOLD = {"PPO": 0.4, "SAC": 0.8}
#: Periods over which PPO's advantages are estimated from rewards rather than by the critic.
_ESTIMATE = 2.0
#: Actions in a period where the body has none.
_ACTIONS = 10.0


def resolve(settings: dict[str, Any], scene: Scene, algorithm: str) -> dict[str, Any]:
    """Return the settings of a configuration with numbers for those that are ``auto``.

    Those are ``discount`` (1 - 1/n for a horizon of n actions: 50 periods for PPO, 20 for SAC),
    ``noise_hold`` (0.4 and 0.8 periods) and ``ppo.gae_lambda`` (two periods). Other text there is
    a SettingsError.
    """
    ppo = settings.get("ppo")
    given = {name: settings.get(name) for name in ("discount", "noise_hold")}
    given["ppo.gae_lambda"] = ppo.get("gae_lambda") if isinstance(ppo, dict) else None
    for name, value in given.items():
        if isinstance(value, str) and value != AUTO:
            raise SettingsError(f"{name} must be a number or {AUTO}, got {got(value)}")
    ppo = ppo if isinstance(ppo, dict) and ppo.get("gae_lambda") == AUTO else None
    if ppo is None and AUTO not in (settings.get("discount"), settings.get("noise_hold")):
        return settings
    actions = _ACTIONS
    if scene.has_period:
        (first,) = natural_frequencies(scene, 1, (driven_axis(scene),))
        actions = 1.0 / (first * scene.episode.control_interval)
    found = dict(settings)
    if found.get("discount") == AUTO:
        found["discount"] = 1.0 - 1.0 / max(2.0, _HORIZON[algorithm] * actions)
    if found.get("noise_hold") == AUTO:
        found["noise_hold"] = max(1, round(_HOLD[algorithm] * actions))
    if ppo is not None:
        found["ppo"] = {**ppo, "gae_lambda": 1.0 - 1.0 / max(2.0, _ESTIMATE * actions)}
    return found
