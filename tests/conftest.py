"""Hypothesis profiles (`fast` by default; HYPOTHESIS_PROFILE names another), and what several tests need."""

import os

import pytest
from hypothesis import HealthCheck, settings

common = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("fast", max_examples=40, **common)
settings.register_profile("ci", max_examples=40, derandomize=True, **common)
settings.register_profile("deep", max_examples=2000, **common)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fast"))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item, call):
    """The failure of a test in real time has what its programs printed, so that it names their faults.

    The Makefile flies a test again only if its failure names a fault that a stall of the machine causes.
    """
    failure = call.excinfo and call.excinfo.value
    if call.when == "call" and item.get_closest_marker("real_time") and isinstance(failure, AssertionError):
        printed = "".join(text for when, _, text in item._report_sections if when == "call")
        failure.args = (f"{failure}\n{printed}",)


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """The log of a flight of some seconds: the bytes of its file. It is flown in real time."""
    from test_programs import run

    path = tmp_path_factory.mktemp("logs") / "flight.mcap"
    result = run("--sim", "--take-off", "--duration", "3", "--log", path)
    assert result.returncode == 0, result.stderr
    return path.read_bytes()


@pytest.fixture(scope="module")
def path(tmp_path_factory, flight):
    """A file with the same log, in a folder of the test's module."""
    path = tmp_path_factory.mktemp("flown") / "flight.mcap"
    path.write_bytes(flight)
    return path


@pytest.fixture
def served(request):
    """A server of pages at any port; its parameter is the token that it asks for."""
    from tilthex.view import gate

    server = gate.serve(gate.Gate("127.0.0.1", 0, getattr(request, "param", None)))
    yield server
    server.stop()
