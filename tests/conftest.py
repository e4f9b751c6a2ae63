"""Pytest configuration shared by all tests."""

import pytest

pytest.register_assert_rewrite("tests.support")


def pytest_configure(config: pytest.Config) -> None:
    """Load the kernels before any test calls one; the first process compiles them for all workers.

    Their bits depend on the order in which they are loaded: a test that loaded one by itself, and
    happened to be its worker's first, would change those of all later ones.
    """
    if not config.option.collectonly:
        from swim_env.envs.assessment import load_assessment

        load_assessment()
