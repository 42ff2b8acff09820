"""Which plant a scenario drives, and how it differs from what the controller believes."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from sidestep.plant_models.mujoco.surface import FrictionPatch, HeightField, Surface
from sidestep.plant_models.ranges import Range
from sidestep.validation.scenarios.tables import built, checked, file_at

FILES = (".fmu", ".xml")
"""Endings of the files that are plants: FMUs, and MuJoCo models."""

Factor = Annotated[float, Range(0.01, 100.0)]


@dataclass(frozen=True)
class PlantSettings:
    """The table `plant` of a scenario file.

    Attributes:
        kind: linear, single-track, double-track, mujoco, an .fmu file or a MuJoCo model (.xml), found from the
            scenario file's folder, `package.module:factory`, or the name that an installed package gives its plant.
        friction: Road friction as a factor on the tyres' peak; of an .fmu file its parameter `friction`; of a MuJoCo
            model on the friction of its contacts.
        tyre: What shears the tyres of our MuJoCo car, see `MujocoPlant`.
        grade, bank: Rise of the road per metre along x and along y; of MuJoCo's cars.
        patches: Patches of other friction on its road; tables of `FrictionPatch` in the file.
        heights: Bumps on that road, None for none; in the file a table of what `HeightField.from_csv` takes.
        map: Mapping file (TOML) of an FMU or a MuJoCo model that is not ours; empty for none.
        steer_offset: Added to every commanded road-wheel angle, in [rad]: a misaligned steering, which the
            reported angle does not show.
        mass, stiffness: Of the plant's car and of its tyres, as factors on what the controller knows.
        roll_centre: By which the roll centres of the plant's car lie above those that the controller knows, in [m].
        delay: Until a command reaches the steering and the drive, in [s].
        noise: Of the state that the controller gets, in multiples of `measurement.NOISE`; the judge sees the true one.
        noise_seed: Of that noise.
        measured_offset: By which that state lies to the left of where the car is, in [m].
        accept_start: Drive a plant that does not start where it is put from where it does; refused otherwise.
        isolate: Time limit of a step of an FMU that runs in a process of its own, in [s]; 0 to run it here.
    """

    kind: str = "mujoco"
    friction: Annotated[float, Range(0.001, 10.0)] = 1.0
    tyre: Literal["magic-formula", "contact", "stock-contact"] = "magic-formula"
    grade: Annotated[float, Range(-1.0, 1.0)] = 0.0
    bank: Annotated[float, Range(-1.0, 1.0)] = 0.0
    patches: tuple[Any, ...] = ()
    heights: Any = None
    map: str = ""
    steer_offset: Annotated[float, Range(-1.0, 1.0, "rad")] = 0.0
    mass: Factor = 1.0
    stiffness: Factor = 1.0
    roll_centre: Annotated[float, Range(0.0, 1.0, "m")] = 0.0
    delay: Annotated[float, Range(0.0, 5.0, "s")] = 0.0
    noise: Annotated[float, Range(0.0, 1e3)] = 0.0
    noise_seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    measured_offset: Annotated[float, Range(-100.0, 100.0, "m")] = 0.0
    isolate: Annotated[float, Range(0.0, 3600.0, "s")] = 0.0
    accept_start: bool = False

    @property
    def name(self) -> str:
        """For tables and file names: the kind, the file's name without folder and ending, or the factory's."""
        return self.kind.rpartition(":")[2] if ":" in self.kind else Path(self.kind).stem

    @property
    def surface(self) -> Surface:
        """The road of MuJoCo's car."""
        return Surface(self.grade, self.bank, self.patches, self.heights)


@dataclass
class HeightTable:
    """The table `plant.heights` of a scenario file: bumps on the road of MuJoCo's car.

    Attributes:
        path: CSV file of heights, in [m].
        spacing: Of its grid, in [m].
        x, y: Where it begins, in [m].
    """

    path: str
    spacing: Annotated[float, Range(0.001, 1e4, "m")]
    x: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0
    y: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0


def plant_settings(table: dict[str, Any], folder: Path) -> PlantSettings:
    """The settings of a scenario file's table `plant`; files that it names are found from `folder`.

    Raises:
        InputError: Unknown key, a value that cannot be used, or a file that cannot be read.
    """
    plant = PlantSettings(**checked(PlantSettings, table, "plant"))
    kind = str(folder / plant.kind) if plant.kind.endswith(FILES) else plant.kind
    patches = tuple(built(FrictionPatch, patch, f"plant.patches[{i}]") for i, patch in enumerate(plant.patches))
    heights = None if plant.heights is None else _heights(plant.heights, folder)
    map_file = str(folder / plant.map) if plant.map else ""
    return replace(plant, kind=kind, patches=patches, heights=heights, map=map_file)


def _heights(table: Any, folder: Path) -> HeightField:
    values = checked(HeightTable, table, "plant.heights")
    return HeightField.from_csv(file_at(folder, values.pop("path"), "plant.heights.path"), **values)
