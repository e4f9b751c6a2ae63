"""The wheel: complete for a user who has no checkout."""

import configparser
import os
import shutil
import zipfile
from pathlib import Path

import pytest

from tests.support import ROOT, files_of, run_python

#: What a build needs of the checkout.
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "swim_env", "agents", "configs")


def copy_sources(folder: Path) -> None:
    """Copy what a build needs, since it leaves folders in its source."""
    folder.mkdir()
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, folder / name)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Build the wheel."""
    pytest.importorskip("setuptools")
    folder = tmp_path_factory.mktemp("wheel")
    copy_sources(folder / "source")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "-w", str(folder)]
    done = run_python("-m", "pip", "wheel", *options, "./source", cwd=folder)
    assert done.code == 0, done.err
    (file,) = folder.glob("*.whl")
    return zipfile.ZipFile(file)


def test_the_wheel_holds_both_packages_and_nothing_else_at_the_top(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    (about,) = (name for name in tops if name.endswith(".dist-info"))
    assert tops == {"swim_env", "swim_agents", about}
    inside = {name for name in wheel.namelist() if name.endswith(".py")}
    for package, folder in (("swim_env", ROOT), ("swim_agents", ROOT / "agents")):
        modules = (folder / package).rglob("*.py")
        assert {path.relative_to(folder).as_posix() for path in modules} <= inside
        assert f"{package}/py.typed" in wheel.namelist()
    entries = configparser.ConfigParser()
    entries.read_string(wheel.read(f"{about}/entry_points.txt").decode())
    assert dict(entries["console_scripts"]) == {"swim-env": "swim_agents.commands.main:main"}


def test_scenes_configurations_and_agents_are_inside(wheel):
    places = {
        "configs/scenes": "swim_env/configs/scenes",
        "configs/agents": "swim_agents/configs/agents",
        "agents/pretrained": "swim_agents/pretrained",
    }
    for folder, place in places.items():
        files = files_of(ROOT / folder)
        assert files
        for name, content in files.items():
            assert wheel.read(f"{place}/{name}") == content


def test_an_unpacked_wheel_finds_what_ships_with_it(wheel, tmp_path):
    wheel.extractall(tmp_path / "site")
    (tmp_path / "empty").mkdir()
    code = (
        "import swim_env, swim_agents\n"
        "from swim_agents.learning.config import config_names\n"
        "from swim_agents.policies import pretrained_names\n"
        "from swim_agents.tuned_wave import load_tuned_wave\n"
        "from swim_env.accuracy.front import load_front\n"
        "assert load_front() and load_tuned_wave()\n"
        "print(swim_env.__file__, len(swim_env.scene_names()))\n"
        "print(*config_names(), *pretrained_names())"
    )
    done = run_python("-c", code, cwd=tmp_path / "empty", PYTHONPATH=os.fspath(tmp_path / "site"))
    assert done.code == 0, done.err
    place, count, *names = done.out.split()
    assert Path(place).is_relative_to(tmp_path / "site")
    assert int(count) == len(list((ROOT / "configs" / "scenes").glob("*.yaml")))
    shipped = [path.stem for path in sorted((ROOT / "configs" / "agents").glob("*.yaml"))]
    shipped += [path.parent.name for path in sorted((ROOT / "agents").glob("*/*/agent.json"))]
    assert names == shipped


def test_messages_name_no_scripts():
    """Whoever has only the wheel has no folder of scripts."""
    for folder in (ROOT / "swim_env", ROOT / "agents" / "swim_agents"):
        for path in folder.rglob("*.py"):
            assert "scripts/" not in path.read_text(encoding="utf-8"), path
