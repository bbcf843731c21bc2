"""All tests: where nothing may be skipped, a skip is a failure; Ctrl-C is heeded by what the tests start."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from astropy.utils import iers

# no test asks the network: from 30 days after the tables of the lock file astropy would, and fail where there is none
iers.conf.auto_download = False

NOTHING_SKIPPED = "NEBOSVOD_NOTHING_SKIPPED"
SHARED = Path(__file__).resolve().parent.parent.parent / "shared"

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # handed on by a shell to what it runs in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)


def unexcused(reports: list[pytest.TestReport]) -> Iterator[str]:
    """Reasons of the skipped tests, but for the reference data that a clone does not bring."""
    for report in reports:
        where = report.longrepr[-1] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if SHARED.is_dir() or "reference data" not in where:
            yield f"{report.nodeid}: {where}"


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """With NEBOSVOD_NOTHING_SKIPPED=1 (CI): an oracle, a package or a browser that is missing fails the run."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not os.environ.get(NOTHING_SKIPPED) or reporter is None:
        return
    missed = sorted(set(unexcused(reporter.stats.get("skipped", []))))
    if missed and session.exitstatus == pytest.ExitCode.OK:
        reporter.write_line(f"\n{NOTHING_SKIPPED} is set, and {len(missed)} tests were skipped:", red=True)
        for line in missed:
            reporter.write_line(f"  {line}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
