"""The packages' seams: imports point one way, and the controller comes without the heavy libraries."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sidestep.controller

ROOT = Path(sidestep.controller.__file__).parents[1]
LAYERS = ("plant_models", "controller", "fmu", "validation")
"""Each may import from itself and those before it."""

VALIDATION = (
    "files", "interrupt", "shown", "undisturbed", "console", "given_road", "geometry", "scenarios", "loop", "judge",
    "report", "studies", "manoeuvres", "model_error", "campaigns", "can_bus", "cli",
)  # fmt: skip
"""The same of its rooms."""

ALL = {"numpy", "scipy", "numba", "llvmlite", "piqp"}
"""What the controller may load beside the standard library (llvmlite is numba's)."""


def imported_modules(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "." for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_point_one_way(layer):
    allowed = LAYERS[: LAYERS.index(layer) + 1]
    files = sorted((ROOT / layer).rglob("*.py"))
    imported = {name.split(".")[1] for file in files for name in imported_modules(file) if name.startswith("sidestep.")}
    assert layer in imported  # the files were found and understood
    assert imported <= set(allowed)


def room_of(file: Path, package: Path) -> str:
    """First name below the package: a folder, or a module at the top."""
    return file.relative_to(package).with_suffix("").parts[0]


def room_imports(layer: str) -> set[tuple[str, str]]:
    """Rooms of a package, and which other ones they import from."""
    package = ROOT / layer
    return {
        (room, other)
        for file in sorted(package.rglob("*.py"))
        for name in imported_modules(file)
        if name.startswith(f"sidestep.{layer}.")
        and (other := name.split(".")[2]) != (room := room_of(file, package))
        and room != "__init__"  # names every room for its users
    }


def test_rooms_of_validation_import_one_way():
    pairs = room_imports("validation")
    rooms = {room_of(file, ROOT / "validation") for file in (ROOT / "validation").rglob("*.py")}
    assert rooms - {"__init__", "__main__"} == set(VALIDATION)  # none is forgotten
    place = {room: i for i, room in enumerate(VALIDATION)}
    upwards = [(room, other) for room, other in pairs if room in place and place[other] > place[room]]
    assert upwards == []


@pytest.mark.parametrize("layer", LAYERS)
def test_rooms_import_in_no_circle(layer):
    left = room_imports(layer)
    while ends := {other for _, other in left} - {room for room, _ in left}:  # rooms that need none of those left
        left = {(room, other) for room, other in left if other not in ends}
    assert left == set()


@pytest.mark.parametrize("layer", LAYERS)
def test_gravity_has_one_place(layer):
    files = [file for file in (ROOT / layer).rglob("*.py") if "9.81" in file.read_text(encoding="utf-8")]
    assert files == ([ROOT / "plant_models" / "vehicle" / "checks.py"] if layer == "plant_models" else [])


@pytest.mark.parametrize("layer", ["controller", "fmu"])
def test_what_is_kept_or_sent_is_no_pickle(layer):
    files = [file for file in (ROOT / layer).rglob("*.py") if imported_modules(file) & {"pickle", "marshal", "shelve"}]
    assert files == []


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_are_absolute(layer):
    relative = [file for file in (ROOT / layer).rglob("*.py") if "." in imported_modules(file)]
    assert relative == []


def test_controller_runs_on_its_four_libraries_alone():
    """As in an environment with numpy, scipy, numba and piqp only: everything else that is installed is hidden."""
    script = f"""
import sys, sysconfig
from importlib.machinery import PathFinder

class Hidden:
    @staticmethod
    def find_spec(name, path=None, target=None):
        top = name.partition(".")[0]
        if top in {ALL!r} or top == "sidestep":
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec and "site-packages" in (spec.origin or "site-packages"):
            raise ModuleNotFoundError("hidden: " + name)

sys.meta_path.insert(0, Hidden)
from sidestep.controller import SteeringController
from sidestep.plant_models import Line, Obstacle, ReferencePath, VehicleParameters, VehicleState

road = ReferencePath.from_segments([Line(100.0)])
box = Obstacle(40.0, 0.0, 4.5, 1.8)
controller = SteeringController(VehicleParameters.preset("bmw-320i"), road, [box])
assert controller.step(VehicleState(v_x=15.0)).status.name == "TRACKING"
print(*sorted({{name.partition(".")[0] for name in sys.modules}}))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert loaded >= ALL
    assert not loaded & {"mujoco", "fmpy", "can", "cantools", "matplotlib", "msgspec"}
