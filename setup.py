"""The packages of the distribution; all else about it stands in pyproject.toml.

configs/scenes stays at the top of the checkout, where people look for it, and is installed as
swim_env/configs/scenes. pyproject.toml can map a folder so only with a full list of packages.
"""

from setuptools import find_packages, setup

SCENES = "swim_env.configs.scenes"

setup(
    packages=[*find_packages(include=["swim_env*", "agents*"]), SCENES],
    package_dir={SCENES: "configs/scenes"},
    package_data={SCENES: ["*.yaml"], "agents": ["*.json"], "": ["py.typed"]},
)
