"""OpenSCENARIO XML (1.0 to 1.3) on one OpenDRIVE road, as far as ASAM's ALKS set uses it.

The storyboard is run beforehand with the car at its first speed in its lane: what others do when it comes near is what
they do near that car. Their ways become trajectories in the world.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.scenarios.readers.imported import Imported
from sidestep.validation.scenarios.readers.openscenario.entities import Entity
from sidestep.validation.scenarios.readers.openscenario.expressions import resolved
from sidestep.validation.scenarios.readers.openscenario.opendrive import Road, read_opendrive
from sidestep.validation.scenarios.readers.openscenario.road_table import RoadTable
from sidestep.validation.scenarios.readers.openscenario.storyboard import STEP, Scene, Storyboard
from sidestep.validation.scenarios.readers.safe_xml import number, read_xml

BEFORE, BEYOND = 30.0, 200.0
"""Of the road before the car's start and beyond where it would come to, in [m]."""
_PRESET = "bmw-320i"


def read_openscenario(root: ET.Element, file: Path, parameters: Mapping[str, str] | None = None) -> Imported:
    """The scenario of a file; of a file of variations, the first one.

    Args:
        root: Of the file.
        file: Where it stands: roads and catalogues are found from its folder.
        parameters: Values that replace those of its parameter declarations.

    Raises:
        InputError: It asks for what would change the outcome and cannot be done, or is incomplete.
    """
    if root.find("ParameterValueDistribution") is not None:
        template, values = variations(root, file)
        chosen = {**values[0], **(parameters or {})}
        result = read_openscenario(read_xml(template), template, chosen)
        words = ", ".join(f"{key} = {value}" for key, value in chosen.items())
        result.notes.insert(0, f"the first of {len(values)} variations: {words}")
        result.tables["name"] = _name(file.stem)
        return result
    _resolve(root, _declared(root, parameters or {}, str(file)), str(file))
    return _concrete(root, file)


def variations(root: ET.Element, file: Path) -> tuple[Path, list[dict[str, str]]]:
    """The scenario that a file of variations varies, and the parameters of each variation.

    Raises:
        InputError: Stochastic distributions, or none.
    """
    element = root.find("ParameterValueDistribution")
    source = None if element is None else element.find("ScenarioFile")
    if element is None or source is None or element.find("Deterministic") is None:
        raise InputError(
            str(file), "varies its parameters by chance, or names no scenario", "Deterministic, ScenarioFile"
        )
    axes: list[list[dict[str, str]]] = []
    for single in element.findall("Deterministic/DeterministicSingleParameterDistribution"):
        key = single.get("parameterName", "")
        axes.append([{key: value} for value in _values(single, str(file))])
    for multi in element.findall("Deterministic/DeterministicMultiParameterDistribution/ValueSetDistribution"):
        sets = multi.findall("ParameterValueSet")
        axes.append([
            {a.get("parameterRef", ""): a.get("value", "") for a in one.findall("ParameterAssignment")} for one in sets
        ])  # fmt: skip
    combined = [{key: value for part in parts for key, value in part.items()} for parts in product(*axes)]
    return file.parent / source.get("filepath", "").replace("\\", "/"), combined


def _values(single: ET.Element, where: str) -> list[str]:
    values = [element.get("value", "") for element in single.findall("DistributionSet/Element")]
    spread, limits = single.find("DistributionRange"), single.find("DistributionRange/Range")
    if spread is not None and limits is not None:
        low, high, step = (
            number(text, where)
            for text in (limits.get("lowerLimit"), limits.get("upperLimit"), spread.get("stepWidth"))
        )
        if not 0.0 < step <= high - low + step or (high - low) / step > 1e4:
            raise InputError(f"{where}: DistributionRange", f"{low:g} to {high:g} by {step:g}", "up to 10 000 values")
        values += [repr(low + i * step) for i in range(math.floor((high - low) / step + 1e-9) + 1)]
    if not values:
        raise InputError(f"{where}: {single.get('parameterName')}", "has no values")
    return values


def _declared(element: ET.Element, given: Mapping[str, str], where: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for declaration in element.findall("ParameterDeclarations/ParameterDeclaration"):
        name = declaration.get("name", "")
        values[name] = given.get(name, resolved(declaration.get("value", ""), values, where))
    for name in given:
        if name not in values:
            raise InputError(f"{where}: parameters.{name}", "is not declared", ", ".join(values) or "none is")
    return values


def _resolve(element: ET.Element, parameters: Mapping[str, str], where: str) -> None:
    """Put the parameters in, everywhere but in the declarations themselves."""
    for child in element:
        if child.tag in ("ParameterDeclarations", "FileHeader"):
            continue
        for key, value in child.items():
            if "$" in value:
                child.set(key, resolved(value, parameters, f"{where}: {child.tag} {key}"))
        _resolve(child, parameters, where)


def _concrete(root: ET.Element, file: Path) -> Imported:
    result, where = Imported(), str(file)
    entities, ego = _entities(root, file, result)
    roads, board = _roads(root, file), root.find("Storyboard")
    if board is None:
        raise InputError(where, "has no storyboard")
    road = _ego_road(board, ego, roads, where)
    for note in road.notes:
        result.note(note)
    scene = Scene(entities, ego, RoadTable(road), result, where)
    storyboard = Storyboard(board, scene)
    car = entities[ego]
    if not car.placed:
        raise InputError(f"{where}: {ego}", "is nowhere at the beginning", "a TeleportAction")
    start = car.s, car.offset, car.turn, car.speed
    duration = storyboard.run()
    if any(entity.placed for name, entity in entities.items() if name != ego):
        result.note("the others' triggers see the car at its first speed in its lane, whatever it does on the way")
    result.tables = {
        "name": _name(file.stem),
        "description": _description(root),
        "speed": round(max(start[3], 1.0), 6),
        "duration": round(duration, 3),
        **_road_and_start(road, car, start, duration, where),
        "obstacles": [_obstacle(entity) for name, entity in entities.items() if name != ego and entity.placed],
        "vehicle": _vehicle(car, result),
    }
    return result


def _name(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "_.-" else "_" for letter in text) or "openscenario"


def _description(root: ET.Element) -> str:
    header = root.find("FileHeader")
    return " ".join(("" if header is None else header.get("description", "")).split()) or "OpenSCENARIO"


def _entities(root: ET.Element, file: Path, result: Imported) -> tuple[dict[str, Entity], str]:
    entities, driven = {}, []
    for element in root.findall("Entities/ScenarioObject"):
        name = element.get("name", "")
        model = next((child for child in element if child.tag in ("Vehicle", "Pedestrian", "MiscObject")), None)
        if (reference := element.find("CatalogReference")) is not None:
            model = _from_catalogue(reference, root, file)
        if model is None:
            raise InputError(f"{file}: {name}", "is no vehicle, pedestrian or object")
        entities[name] = _entity(name, model, f"{file}: {name}")
        if element.find("ObjectController") is not None:
            driven.append(name)
    ego = next((name for name in entities if name.lower() == "ego"), driven[0] if driven else None)
    if ego is None:
        raise InputError(
            f"{file}: Entities", "none is called Ego and none has a controller", "a ScenarioObject named Ego"
        )
    result.note(f"{ego} is driven here, by sidestep's controller from the beginning on")
    return entities, ego


def _entity(name: str, model: ET.Element, where: str) -> Entity:
    size, centre = model.find("BoundingBox/Dimensions"), model.find("BoundingBox/Center")
    if size is None:
        raise InputError(where, "has no bounding box")
    if centre is not None and abs(number(centre.get("y") or "0", where)) > 1e-6:
        raise InputError(f"{where}: BoundingBox", "its middle is beside its axis", "y = 0")
    ahead = 0.0 if centre is None else number(centre.get("x") or "0", where)
    return Entity(name, model.tag, number(size.get("length"), where), number(size.get("width"), where), ahead)


def _from_catalogue(reference: ET.Element, root: ET.Element, file: Path) -> ET.Element:
    catalogue, entry = reference.get("catalogName", ""), reference.get("entryName", "")
    for directory in root.findall("CatalogLocations/*/Directory"):
        folder = file.parent / directory.get("path", "").replace("\\", "/")
        for candidate in sorted(folder.glob("*.xosc")):
            found = read_xml(candidate).find("Catalog")
            if found is None or found.get("name") != catalogue:
                continue
            for model in found:
                if model.get("name") == entry:
                    given = {
                        a.get("parameterRef", ""): a.get("value", "") for a in reference.iter("ParameterAssignment")
                    }
                    _resolve(model, _declared(model, given, str(candidate)), str(candidate))
                    return model
    raise InputError(
        f"{file}: CatalogReference", f"no entry {entry!r} in a catalogue {catalogue!r}", "an entry that exists"
    )


def _roads(root: ET.Element, file: Path) -> dict[str, Road]:
    logic = root.find("RoadNetwork/LogicFile")
    if logic is None:
        raise InputError(f"{file}: RoadNetwork", "has no LogicFile", "an OpenDRIVE file")
    return read_opendrive(file.parent / logic.get("filepath", "").replace("\\", "/"))


def _ego_road(board: ET.Element, ego: str, roads: dict[str, Road], where: str) -> Road:
    for private in board.findall("Init/Actions/Private"):
        if private.get("entityRef") != ego:
            continue
        for position in private.findall("PrivateAction/TeleportAction/Position/*"):
            key = position.get("roadId")
            if key in roads:
                return roads[key]
            if key is not None:
                raise InputError(f"{where}: roadId", f"{key!r} is not in the road network", ", ".join(roads))
    if len(roads) == 1:
        return next(iter(roads.values()))
    raise InputError(f"{where}: {ego}", "starts on no road by its name", "a LanePosition or RoadPosition")


def _road_and_start(
    road: Road, car: Entity, start: tuple[float, float, float, float], duration: float, where: str
) -> dict[str, Any]:
    """The tables `road` and `start`: the middle of the car's lane, and the edges of the lanes beside it."""
    s, offset, turn, speed = start
    lane, way = car.lane, road.direction(car.lane)
    reach = max(speed, 1.0) * duration + BEYOND
    low, high = (max(s - BEFORE, 0.0), s + reach) if way > 0 else (s - reach, min(s + BEFORE, road.length))
    low, high = max(low, 0.0), min(high, road.length)
    if not low <= s <= high:
        raise InputError(f"{where}: {car.name}", f"starts at {s:g} m", f"0 to {road.length:g}")
    grid = _grid(road, low, high)
    centre = road.centre(lane, grid)
    edges = np.array([_edges(road, lane, at) for at in grid.tolist()]) - centre[:, None]
    x, y, _ = road.world(grid, centre)
    left, right = (edges[:, 1], -edges[:, 0]) if way > 0 else (-edges[:, 0], edges[:, 1])
    points = np.round(np.column_stack([x, y, left, right])[::way], 6)
    stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))])
    axle = float(np.interp(s, grid[::way] if way > 0 else grid, stations if way > 0 else stations[::-1]))
    centre_of_gravity = VehicleParameters.preset(_PRESET).l_r
    return {
        "road": {"points": points.tolist(), "closed": False},
        "start": {
            "s": round(axle + centre_of_gravity * math.cos(turn), 6),
            "l": round(way * offset + centre_of_gravity * math.sin(turn), 6),
            "heading": round(turn, 6), "speed": round(speed, 6),
        },
    }  # fmt: skip


def _grid(road: Road, low: float, high: float) -> Any:
    """Stations every 2 m in bends, every 20 m where it is straight, and at joints."""
    fine = np.arange(low, high, 2.0)
    heading = np.unwrap(road.reference(np.append(fine, high))[2])
    bends = np.abs(np.diff(heading, prepend=heading[0])) > 1e-9
    keep = bends | np.append(bends[1:], True) | (np.arange(len(bends)) % 10 == 0)
    return np.unique(np.append(np.append(fine, high)[keep], high))


def _edges(road: Road, lane: int, s: float) -> tuple[float, float]:
    inner, outer = road.drivable_beside(lane, s)
    ends = (road.borders(inner, s)[0][0], road.borders(outer, s)[1][0])
    return float(min(ends)), float(max(ends))


def _obstacle(entity: Entity) -> dict[str, Any]:
    rows = np.array(entity.track)
    rows[:, 3] = np.unwrap(rows[:, 3])
    if np.ptp(rows[:, 1:3], axis=0).max() < 1e-6:
        rows = rows[:1]
    else:
        every = max(1, round(0.1 / STEP))
        rows = rows[np.unique(np.append(np.arange(0, len(rows), every), len(rows) - 1))]
    rows = np.round(rows, 6)
    motion = {"frame": "world", **{key: rows[:, i].tolist() for i, key in enumerate(("t", "x", "y", "heading"))}}
    return {
        "length": entity.length,
        "width": entity.width,
        "trajectory": motion,
        "note": f"{entity.kind} {entity.name}",
    }


def _vehicle(car: Entity, result: Imported) -> dict[str, Any]:
    """Our car with the outline of the file's around the rear axle."""
    ours = VehicleParameters.preset(_PRESET)
    front = round(car.centre + 0.5 * car.length - ours.wheelbase, 6)
    if front < 0.001 or car.length - front - ours.wheelbase < 0.0:
        result.note(f"{car.name}'s outline does not fit around {_PRESET}'s axles: it keeps its own")
        return {"preset": _PRESET}
    result.note(f"{car.name} is {_PRESET} with an outline of {car.length:g} x {car.width:g} m")
    return {"preset": _PRESET, "length": car.length, "width": car.width, "front_overhang": front}
