"""Where does the controller's model stop predicting your FMU? A few cells; `sidestep validate` drives them all."""

import sys

from sidestep.fmu.native.build import build_fmu
from sidestep.validation.model_error.envelope import envelope
from sidestep.validation.model_error.prediction_models import MODELS


def main() -> None:
    fmu = sys.argv[1] if len(sys.argv) > 1 else build_fmu("single-track", 3)  # yours goes here
    found = envelope([f'plant.kind="{fmu}"'], speeds=(10.0, 20.0, 30.0), shares=(0.2, 0.4, 0.6, 0.8))
    for friction, limits in zip(found.frictions, found.largest()[0, MODELS.index("affine")], strict=True):
        cells = (f"{limit:.1f} m/s² at {v:g} m/s" for v, limit in zip(found.speeds, limits, strict=True))
        print(f"friction {friction:g}: valid up to {', '.join(cells)}")


if __name__ == "__main__":  # the cells are driven by processes of their own
    main()
