"""The repository's own tools: what counts as an offence, and which tests a change asks for."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = '''
"""A module."""

def open_to_all(a, b: int, *rest: int) -> None:
    pass

class Thing:
    """Documented."""

    def method(self, x: int) -> int:
        """Documented."""

        def inside(y):
            return y

        return inside(x)

    def _own(self, x):
        return x

class _Hidden:
    def method(self, x):
        return x
'''


@pytest.fixture(scope="module")
def count():
    return runpy.run_path(str(ROOT / "tools" / "count.py"))


@pytest.fixture
def counted(count, tmp_path):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "module.py").write_text(SOURCE, encoding="utf-8")
    for function in ("functions", "offenders", "classes_without_words"):
        count[function].__globals__["ROOT"] = tmp_path
    return count


def test_functions_are_measured(counted):
    (file,) = (counted["functions"].__globals__["ROOT"] / "part").glob("*.py")
    found = {function.name: function for function in counted["functions"](file)}
    assert list(found) == ["open_to_all", "Thing.method", "Thing.method.inside", "Thing._own", "_Hidden.method"]
    assert [function.lines for function in found.values()] == [2, 7, 2, 2, 2]
    assert [function.parameters for function in found.values()] == [3, 1, 1, 1, 1]
    assert [name for name, function in found.items() if function.public] == ["open_to_all", "Thing.method"]
    assert (found["open_to_all"].documented, found["open_to_all"].typed) == (False, False)
    assert (found["Thing.method"].documented, found["Thing.method"].typed) == (True, True)


@pytest.mark.parametrize("package", [True, False])
def test_each_bound_has_its_offender(counted, tmp_path, package, monkeypatch):
    """Outside the packages only sizes are held."""
    long = "def long(a: int) -> None:\n" + '    """Words."""\n' + "    a += 1\n" * 70
    (tmp_path / "part" / "long.py").write_text(long + "\n" * 240, encoding="utf-8")
    for i in range(15):
        (tmp_path / "part" / f"m{i}.py").write_text('"""Words."""\n', encoding="utf-8")
    monkeypatch.setitem(counted["offenders"].__globals__, "PARAMETERS", {"part": 2})
    monkeypatch.setitem(counted["offenders"].__globals__, "PACKAGES", ("part",) if package else ())
    found = "\n".join(counted["offenders"]("part"))
    for words in (
        "long.py:1: long: 72 lines, at most 60", "long.py: 312 lines, at most 300", "part: 17 files, at most 14",
        "90 % of functions have up to 72 lines, at most 23",
    ):  # fmt: skip
        assert words in found
    for words in (
        "open_to_all: 3 parameters, at most 2", "open_to_all: public without docstring",
        "open_to_all: public without types", "long.py: module without docstring",
    ):  # fmt: skip
        assert (words in found) == package
    assert "_own" not in found
    assert "_Hidden" not in found


def test_a_change_asks_for_its_own_tests():
    tests_of = runpy.run_path(str(ROOT / "tools" / "check.py"))["tests_of"]
    assert tests_of(["plant_models/road/reference_path.py", "README.md"]) == []
    assert tests_of(["controller/validity.py"]) == ["tests/controller/test_validity.py"]
    assert tests_of(["tests/test_imports.py", "tests/support/stored_runs.py"]) == ["tests/test_imports.py"]
    assert "tests/controller/can_port/test_can_port.py" in tests_of(["controller/can_port/port.py"])


@pytest.fixture(scope="module")
def mutate():
    return runpy.run_path(str(ROOT / "tools" / "mutate.py"))


def test_mutants_change_one_token_of_behaviour_each(mutate):
    text = 'def f(a: int | None, *rest, b=2):\n    """a < b."""\n    return -a * b if not a <= 0.5 and rest else a\n'
    changed = {mutant.applied(text).split(":", 1)[1] for mutant in mutate["mutants_of"]("f.py", text)}
    lines = {"".join(change.splitlines(keepends=True)[-1:]).strip() for change in changed} - {text.splitlines()[-1][4:]}
    assert lines == {
        "return  a * b if not a <= 0.5 and rest else a",
        "return -a / b if not a <= 0.5 and rest else a",
        "return -a * b if   a <= 0.5 and rest else a",
        "return -a * b if not a < 0.5 and rest else a",
        "return -a * b if not a > 0.5 and rest else a",
        "return -a * b if not a <= 1.0 and rest else a",
        "return -a * b if not a <= 0.5 or rest else a",
    }
    assert len(changed) == len(lines) + 1  # and the default


def test_listed_mutants_stand_where_the_list_says_and_their_tests_are_there(mutate):
    """`tools/mutate.py list` says whether they die."""
    table = mutate["read_table"]()
    for entry in table["mutants"]:
        text = (ROOT / entry["file"]).read_text(encoding="utf-8")
        assert text.count(entry["before"]) == 1, entry["name"]
        file, _, name = entry["test"].partition("::")
        assert f"def {name}" in (ROOT / file).read_text(encoding="utf-8"), entry["name"]


def test_rooms_of_the_list_have_files_and_tests(mutate):
    for name, room in mutate["read_table"]()["rooms"].items():
        assert mutate["files_of"](room), name
        assert all((ROOT / test).exists() for test in room["tests"]), name
