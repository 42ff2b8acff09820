import pytest
from support.stored_runs import drive

from sidestep.validation.report.report import run_report


@pytest.fixture(scope="module")
def collided():
    return drive()


@pytest.fixture(scope="module")
def html(collided):
    return run_report(collided)
