"""Hypothesis profiles: `fast` by default; HYPOTHESIS_PROFILE names another."""

import os

from hypothesis import HealthCheck, settings

common = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("fast", max_examples=40, **common)
settings.register_profile("ci", max_examples=40, derandomize=True, **common)
settings.register_profile("deep", max_examples=2000, **common)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fast"))
