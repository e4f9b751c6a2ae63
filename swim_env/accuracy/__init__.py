"""What accuracy costs: settings compared with a converged reference, and a choice among them."""

from swim_env.accuracy.choice import Choice, choose, with_chosen_settings
from swim_env.accuracy.outcome import Outcome, play
from swim_env.accuracy.reference import Reference, reference_of
from swim_env.accuracy.settings import Settings

__all__ = [
    "Choice",
    "Outcome",
    "Reference",
    "Settings",
    "choose",
    "play",
    "reference_of",
    "with_chosen_settings",
]
