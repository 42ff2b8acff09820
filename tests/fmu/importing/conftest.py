"""What the tests of imported FMUs share."""

import pytest
from support.fmus.fmu_files import CAR

from sidestep.fmu.native.plant import native_plant


@pytest.fixture(params=[2, 3], ids=["FMI2", "FMI3"])
def fmi(request):
    return request.param


@pytest.fixture
def plant(fmi):
    with native_plant(CAR, fmi=fmi) as plant:
        yield plant
