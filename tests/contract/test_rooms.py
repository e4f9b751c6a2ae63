"""The import rule: each room imports only rooms above it in the table of CONTRIBUTING.md."""

import ast
import re
from importlib.util import resolve_name

from tests.support import ROOT, run_python


def dotted(path: str) -> str:
    """Return the name under which a file or a folder is imported."""
    return re.sub(r"^agents/|\.py$|/$", "", path).replace("/", ".").removesuffix(".__init__")


TABLE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## Rooms\n")[1]
ROWS = re.findall(r"^\| (`.+?`) \|", TABLE, re.MULTILINE)
ROOMS = [dotted(path) for row in ROWS for path in re.findall("`(.+?)`", row)]
TOPS = ("swim_env", "agents/swim_agents", "studies", "scripts")
FILES = [file.relative_to(ROOT) for top in TOPS for file in (ROOT / top).rglob("*.py")]


def room_of(name: str) -> int:
    """Return the number of the innermost room of a module or of what is in it, -1 for none."""
    inside = [room for room in ROOMS if f"{name}.".startswith(f"{room}.")]
    return ROOMS.index(max(inside, key=len)) if inside else -1


def test_each_room_imports_only_rooms_above_it():
    for file in FILES:
        name, package = dotted(str(file)), dotted(str(file.parent))
        assert name == "swim_env" or ROOMS[room_of(name)] != "swim_env", f"{file} needs a room"
        for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
            source = ""
            if isinstance(node, ast.ImportFrom):
                source = resolve_name("." * node.level + (node.module or ""), package) + "."
            elif not isinstance(node, ast.Import):
                continue
            for found in (source + one.name for one in node.names):
                allowed = room_of(found) <= room_of(name) and not found.startswith("scripts.")
                assert allowed, f"{file}, line {node.lineno}, imports {found}"


def test_only_pictures_and_recordings_load_what_is_heavy():
    """Beyond what numba loads, which looks whether there is a SciPy, and PyTorch's own function."""
    names = [dotted(str(file)) for file in FILES]
    others = r"\.plots|\.recording|\.gradients\.torch"
    light = [name for name in names if re.match(rf"swim_env(?!{others})", name)]
    heavy = {"matplotlib", "torch", "stable_baselines3", "rerun", "scipy"}
    code = f"import numba, sys; before = set(sys.modules); import {', '.join(light)}; "
    done = run_python("-c", code + f"print({heavy} & (set(sys.modules) - before))")
    assert done.out == "set()\n", done.out + done.err
