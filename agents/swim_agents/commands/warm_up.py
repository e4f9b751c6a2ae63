"""Compile the kernels into their cache folder, so that later starts find them there.

For images and clusters: processes that start together would wait for the first one. The folder is
printed; NUMBA_CACHE_DIR names another one, for this and for later starts.
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options: it has none."""


def main(options: argparse.Namespace) -> int:
    """Compile, and print where the kernels are."""
    from swim_env.envs.assessment import load_assessment
    from swim_env.errors import SwimError
    from swim_env.physics.loading import OF_MODELS, load_model
    from swim_env.physics.runtime.cache import cache_folder, why_temporary
    from swim_env.physics.spatial.loading import load_spatial_kernels

    load_assessment()
    for model in OF_MODELS:
        load_model(model)
    load_spatial_kernels(panels=True)
    if why_temporary():
        raise SwimError(f"the kernels cannot be kept, as {why_temporary()}")
    print(cache_folder())
    return 0
