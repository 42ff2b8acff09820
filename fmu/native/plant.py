"""One of our own FMUs as a plant."""

from sidestep.fmu.description.plants import find_model, model_values
from sidestep.fmu.importing.mapping import Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.build import build_fmu
from sidestep.plant_models.vehicle.parameters import VehicleParameters


def native_plant(
    vehicle: VehicleParameters,
    friction: float = 1.0,
    fmi: int = 3,
    model: str = "single-track",
    **parameters: float,
) -> FmuPlant:
    """One of our own FMUs, built on first use.

    Args:
        vehicle: The car.
        friction: Of the road, as a factor on the tyres' peak.
        fmi: 2 or 3.
        model: One of `plants.MODELS`.
        parameters: Further parameters of the FMU by name, in SI units: steer_offset, internal_step.

    Raises:
        InputError: No such model, FMI version or parameter, or the car lacks what the model needs.
        CompilerError: The FMU is not built yet and there is no C compiler.
    """
    values = model_values(find_model(model), vehicle, friction) | parameters
    return FmuPlant(build_fmu(model, fmi), Mapping(parameters={**values}))
