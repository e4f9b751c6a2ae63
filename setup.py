"""The packages of the distribution; all else about it is in pyproject.toml.

Scenes, agents' configurations and trained agents stay where people look for them in a checkout, and
are installed inside the packages that read them. pyproject.toml can map a folder to a package only
with a full list of packages.
"""

from setuptools import find_packages, setup

FOLDERS = {
    "swim_agents": "agents/swim_agents",
    "swim_agents.configs.agents": "configs/agents",
    "swim_agents.pretrained": "agents/pretrained",
    "swim_env.configs.scenes": "configs/scenes",
}

setup(
    packages=[
        *find_packages(include=["swim_env*"]),
        *find_packages("agents", include=["swim_agents*"]),
        *(name for name in FOLDERS if "." in name),
    ],
    package_dir=FOLDERS,
    package_data={
        "swim_agents": ["*.json", "optimal_gaits/*.json"],
        "swim_agents.configs.agents": ["*.yaml"],
        "swim_agents.pretrained": ["*/*"],
        "swim_env.accuracy": ["front.json"],
        "swim_env.configs.scenes": ["*.yaml"],
        "": ["py.typed"],
    },
)
