"""Where the commands run."""

import signal

import pytest

from sidestep.validation.report import report as report_module


@pytest.fixture(autouse=True)
def interrupts_as_at_a_terminal():
    """A shell in the background hands down an ignored SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """In an empty folder, and without the figures, which test_report.py looks at."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report_module, "run_report", lambda run: "<!doctype html>")
