"""The packages of the distribution; all else about it stands in pyproject.toml.

configs/scenes and configs/agents stay at the top of the checkout, where people look for them, and
are installed inside swim_env. pyproject.toml can map a folder so only with a full list of packages.
"""

from setuptools import find_packages, setup

CONFIGS = {f"swim_env.configs.{name}": f"configs/{name}" for name in ("scenes", "agents")}

setup(
    packages=[*find_packages(include=["swim_env*", "agents*"]), *CONFIGS],
    package_dir=CONFIGS,
    package_data={
        **{package: ["*.yaml"] for package in CONFIGS},
        "agents": ["*.json", "pretrained/*/*"],
        "swim_env.accuracy": ["front.json"],
        "": ["py.typed"],
    },
)
