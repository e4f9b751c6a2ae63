"""What all tests share."""

from __future__ import annotations

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before parallel workers start, so that they do not all do it."""
    if not hasattr(config, "workerinput") and not config.option.collectonly:
        from swim_env.assessment import load_assessment

        load_assessment()
