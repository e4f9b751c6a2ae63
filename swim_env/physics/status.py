"""Why a simulation can end: the closed list of reasons, and the kernels' codes for them."""

from __future__ import annotations

#: Reason by kernel code. Code 0 means that all is well.
TERMINATION_REASONS: dict[int, str] = {
    0: "",
    1: "outline_degenerate",
    2: "under_resolved_gap",
    3: "influence_singular",
    4: "mass_not_positive",
    5: "step_not_solved",
    6: "turn_too_large",
    7: "state_not_finite",
    8: "self_contact",
    # 9 is the task's own: target_reached.
    10: "energy_unexplained",
}

FINE = 0
OUTLINE_DEGENERATE = 1
UNDER_RESOLVED_GAP = 2
INFLUENCE_SINGULAR = 3
MASS_NOT_POSITIVE = 4
STEP_NOT_SOLVED = 5
TURN_TOO_LARGE = 6
STATE_NOT_FINITE = 7
SELF_CONTACT = 8
ENERGY_UNEXPLAINED = 10

#: What happened, and what would help.
_MEANING = {
    "outline_degenerate": (
        "the beam bends so far at a joint that the inner side of its outline is shorter than 0.1 "
        "element lengths or the mitre longer than 4 half thicknesses (in space: a strip of panels "
        "is shorter than 0.1 of its length, or a joint turns by 0.9 pi); more stiffness or less "
        "torque bends it less far, a thinner body may bend further"
    ),
    "under_resolved_gap": (
        "parts of the beam that are not neighbours are closer to each other than half the length "
        "of their panels, which these cannot resolve; more panels (fluid.panels_per_element, "
        "fluid.cap_panels; in space fluid.rows, fluid.around) or less bending would help"
    ),
    "influence_singular": (
        "the normal influence matrix of the panels has no inverse that could be trusted, its "
        "condition is beyond 1e10: the body is too thin for panels on both of its sides; fluid "
        "model strip takes any thickness"
    ),
    "mass_not_positive": (
        "the discrete total mass is not positive definite: the outline is too coarse for the bend "
        "(more fluid.panels_per_element, in space fluid.rows, would help), or the inertia too "
        "small for the numbers (beam.rotary_inertia above 0 would help)"
    ),
    "step_not_solved": (
        "the step equations could not be solved, however short a part of the step was tried, or "
        "not within the effort of half a second that a step may take; a smaller "
        "integrator.time_step, less torque or, for a very fine body, fewer elements or panels "
        "would help"
    ),
    "turn_too_large": (
        "an element or a joint turns by more than 0.5 rad in however short a part of a step; a "
        "smaller integrator.time_step, less torque or a slower start would help"
    ),
    "state_not_finite": (
        "the state holds a number that is not finite: what started or drove the body was too large"
    ),
    "energy_unexplained": (
        "more energy than integrator.energy_tolerance is not explained by start, work and losses; "
        "a smaller integrator.time_step would help"
    ),
    "self_contact": "the body, as thick as it is, touches itself (watched for by self_contact)",
}


def describe(reason: str) -> str:
    """Return one sentence on a reason of TERMINATION_REASONS."""
    return _MEANING[reason]
