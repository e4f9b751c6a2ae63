"""What a recording holds and where: entity paths, series with their units, and the version."""

from __future__ import annotations

from collections.abc import Collection

from swim_env.files.names import plain_name

#: Version of the layout below. A reader takes recordings of this version and older ones. A change
#: of a path, a series, its unit or its place in a row adds one, and a branch to the reader.
SCHEMA_VERSION = 1

APPLICATION = "swim_env"
#: The recording's own property, which holds the version.
PROPERTY = "swim_env"
#: Simulated time (s).
TIMELINE = "time"
#: Everything in the plane is below this entity, which turns the plane's y upwards (m).
WORLD = "world"
#: What colours and arrows mean.
LEGEND = "legend"

#: Series of every swimmer, with what a name says and its unit. Each group is one entity with one
#: row of numbers per instant.
GROUPS: dict[str, tuple[str, ...]] = {
    "progress": ("along the goal (BL)",),
    "position": ("x (BL)", "y (BL)"),
    "reward": ("reward of the action (BL)",),
    "return": ("sum of rewards (BL)",),
    "energy": ("kinetic, body (J)", "kinetic, fluid (J)", "elastic (J)", "total (J)"),
    "work": ("by torques (J)", "positive part (J)", "to damping (J)", "unexplained (J)"),
    "momentum": ("x (kg m/s)", "y (kg m/s)", "angular (kg m\u00b2/s)"),
    "drift": ("linear (kg m/s)", "angular (kg m\u00b2/s)"),
    "solver": ("Newton corrections in a step (1)", "log10 of the residual (1)"),
}

#: The group energy of a run whose velocity at the start is not known.
UNSPLIT_ENERGY = ("kinetic, body and fluid (J)", "elastic (J)", "total (J)")

#: The same of bodies in space.
SPATIAL_GROUPS: dict[str, tuple[str, ...]] = {
    **GROUPS,
    "position": ("x (BL)", "y (BL)", "z (BL)"),
    "orientation": ("roll (\u00b0)", "pitch (\u00b0)", "yaw (\u00b0)"),
    "momentum": ("x (kg m/s)", "y (kg m/s)", "z (kg m/s)"),
    "angular_momentum": ("x (kg m\u00b2/s)", "y (kg m\u00b2/s)", "z (kg m\u00b2/s)"),
}

#: Groups at the ends of an episode's actions, absent without rewards.
REWARDS = ("reward", "return")

#: Groups whose values are held, and how rerun draws them: from their instant on, or up to it.
HELD = {
    "torques": "StepAfter",
    **dict.fromkeys(("yaw_torques", "pitch_torques", "roll_torques"), "StepAfter"),
    "reward": "StepBefore",
}

#: Groups with a series for each joint, from head to tail.
DETAILS: dict[str, str] = {"torques": "N m", "joint_angles": "rad"}

#: The same in space, about d1 (pitch), d2 (yaw) and d3 (roll).
SPATIAL_DETAILS: dict[str, str] = {
    f"{axis}_{what}": unit
    for what, unit in (("torques", "N m"), ("rotations", "rad"))
    for axis in ("yaw", "pitch", "roll")
}


def groups_of(dimension: int) -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    """Return the groups of series of swimmers in the plane or in space, and those by joints."""
    return (GROUPS, DETAILS) if dimension == 2 else (SPATIAL_GROUPS, SPATIAL_DETAILS)


def place_of(label: str) -> str:
    """Return the entity of a swimmer in the plane."""
    return f"{WORLD}/{label}"


def group_path(label: str, group: str) -> str:
    """Return the entity of a group of series of a swimmer."""
    return f"scalars/{label}/{group}"


def map_path(label: str, group: str) -> str:
    """Return the entity of the map of a swimmer's group of torques."""
    return f"maps/{label}/{group}"


def names_of(group: str, joints: int, split: bool, dimension: int = 2) -> tuple[str, ...]:
    """Return the names of a group's series, with their units.

    The group is a key of what `groups_of` returns; `split` says whether the kinetic energy is
    split.
    """
    groups, details = groups_of(dimension)
    if group in details:
        return tuple([f"joint {joint} ({details[group]})" for joint in range(1, joints + 1)])
    return UNSPLIT_ENERGY if group == "energy" and not split else groups[group]


def label_of(name: str, taken: Collection[str] = ()) -> str:
    """Return what a swimmer is called in entity paths: one plain part, unlike those taken."""
    label = plain_name(name) or "swimmer"
    found, number = label, 2
    while found in taken:
        found, number = f"{label}_{number}", number + 1
    return found
