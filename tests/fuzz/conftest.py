"""How long to look for inputs that break something: for a few seconds at the same ones, or for long and anew.

``PFSLAM_FUZZ=2000 python -m pytest tests/fuzz`` tries 2,000 inputs a test, other ones in every run; without it, a few
that are always the same. A failure prints the smallest input found and a line that repeats it.
"""

import os

import pytest
from hypothesis import HealthCheck, settings

EXAMPLES = int(os.environ.get("PFSLAM_FUZZ", "0"))
_CHECKS = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture)

settings.register_profile(
    "short", max_examples=30, derandomize=True, database=None, deadline=None, suppress_health_check=_CHECKS
)
settings.register_profile("long", deadline=None, suppress_health_check=_CHECKS, print_blob=True)
settings.load_profile("long" if EXAMPLES else "short")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """In a long run every test tries as many inputs as were asked for."""
    if EXAMPLES:
        for item in items:
            inner = getattr(getattr(item, "function", None), "hypothesis", None)
            if inner is not None:
                function = item.function  # type: ignore[attr-defined]
                function._hypothesis_internal_use_settings = settings(
                    function._hypothesis_internal_use_settings, max_examples=EXAMPLES
                )
