import json

import pytest

from sidestep.validation.cli.main import main
from sidestep.validation.scenarios.library import built_in_scenarios, read_scenario
from sidestep.validation.scenarios.scenario import ScenarioTables, parse_scenario
from sidestep.validation.scenarios.schema import documented, schema, tables


def test_every_key_is_explained():
    assert all(key.text for table in tables() for key in table.keys)
    summary, texts = documented(ScenarioTables)
    assert summary == "A scenario file: one drive."
    assert texts["speed"] == "To be held, in [m/s]."


def test_the_examples_are_a_scenario():
    examples = {table.name: table.example for table in tables()}
    names = ("", "road", "start", "obstacles[]", "obstacles[].trajectory", "vehicle", "controller", "plant", "goal")
    scenario = parse_scenario("\n".join(examples[name] for name in names), "examples")
    assert len(scenario.obstacles) == 2
    assert scenario.goal is not None


def violations(rules, value, where=""):
    """Enough of JSON schema for our own: types, bounds, unknown and missing keys."""
    if "oneOf" in rules:
        return [] if any(not violations(rule, value, where) for rule in rules["oneOf"]) else [where]
    kinds = {"number": (int, float), "integer": int, "string": str, "boolean": bool, "array": list, "object": dict}
    if "type" in rules and not isinstance(value, kinds[rules["type"]]):
        return [where]
    found = [where] if "enum" in rules and value not in rules["enum"] else []
    found += [where] if "const" in rules and value != rules["const"] else []
    if isinstance(value, int | float) and not rules.get("minimum", value) <= value <= rules.get("maximum", value):
        found.append(where)
    if isinstance(value, list):
        return found + [
            bad for i, one in enumerate(value) for bad in violations(rules.get("items", {}), one, f"{where}[{i}]")
        ]
    if isinstance(value, dict) and "properties" in rules:
        found += [f"{where}.{key}" for key in rules.get("required", []) if key not in value]
        for key, one in value.items():
            known = rules["properties"].get(key)
            found += [f"{where}.{key}"] if known is None else violations(known, one, f"{where}.{key}")
    return found


@pytest.mark.parametrize("name", built_in_scenarios())
def test_the_schema_takes_every_built_in_scenario(name):
    import tomllib

    assert violations(schema(), tomllib.loads(read_scenario(name)[1])) == []


def test_the_schema_refuses_what_the_reader_refuses():
    rules = schema()
    assert violations(rules, {"speed": 1.0, "duration": 1.0}) == [".road"]
    assert violations(rules, {"speed": 0.0, "duration": 1.0, "road": {}, "sped": 1}) == [".speed", ".sped"]
    road = {"segments": [{"type": "line", "length": 1.0}, {"type": "lin", "length": 1.0}]}
    assert violations(rules, {"speed": 1.0, "duration": 1.0, "road": road}) == [".road.segments[1]"]


def test_the_command_prints_it(capsys):
    assert main(["scenarios", "--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()
