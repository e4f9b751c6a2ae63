"""The import rule: an ordered list of rooms, each of which imports only the ones before it."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.support import ROOT, run_python

#: Lower ones first; a module belongs to the innermost room that holds it.
ROOMS = [
    *("swim_env.errors", "swim_env.colours", "swim_env.files", "swim_env.scene"),
    *(f"swim_env.physics.{name}" for name in ("status", "runtime", "fluid", "planar", "solve")),
    *("swim_env.physics", "swim_env.sim", "swim_env.analysis", "swim_env.accuracy"),
    *("swim_env.envs", "swim_env", "swim_env.plots", "swim_env.recording"),
    *("swim_agents", "studies", "scripts", "tests"),
]
HEAVY = {"matplotlib", "torch", "stable_baselines3", "rerun"}


def room_of(module: str) -> int:
    """Return the number of the room that a module is in, -1 for those of other packages."""
    inside = [room for room in ROOMS if f"{module}.".startswith(f"{room}.")]
    return ROOMS.index(max(inside, key=len)) if inside else -1


def imports() -> Iterator[tuple[str, str, bool]]:
    """Yield modules, what each imports, and whether it does so when it is itself imported."""
    for package in ("swim_env", "agents/swim_agents", "studies"):
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
            module = name.removeprefix("agents.").removesuffix(".__init__")
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    inside = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
                    for found in node.names:
                        yield module, inside + found.name, node in tree.body


def test_each_room_imports_only_rooms_before_it() -> None:
    broken = [
        f"{one} imports {other}" for one, other, _ in imports() if room_of(other) > room_of(one)
    ]
    assert not broken, "\n".join(broken)


def test_only_pictures_and_recordings_need_what_is_heavy() -> None:
    pictures = [ROOMS.index(f"swim_env.{name}") for name in ("plots", "recording")]
    broken = [
        f"{module} imports {found}"
        for module, found, at_once in imports()
        if at_once and found.split(".")[0] in HEAVY
        if module.startswith("swim_env") and room_of(module) not in pictures
    ]
    assert not broken, "\n".join(broken)


def test_importing_the_library_loads_nothing_heavy() -> None:
    """Beyond what numba loads, which looks whether there is a SciPy."""
    code = "import numba, sys; before = set(sys.modules); import swim_env; "
    done = run_python("-c", code + "print(*set(sys.modules) - before)")
    assert "swim_env" in done.out, done.err
    assert not {name.split(".")[0] for name in done.out.split()} & {*HEAVY, "scipy"}
