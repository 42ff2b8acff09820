"""Count what keeps the code readable, and hold it to bounds.

    python tools/count.py

A function is as long as its lines from `def` to its end, docstring included; a nested one counts for itself and in the
one around it. Public is what has no leading underscore on the way to it; kernels are typed, too. Outside the packages,
only sizes are held: functions, files, folders. Exit status 1 if a bound is broken; each offender is a line.
"""

import ast
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("plant_models", "controller", "fmu", "validation")
FOLDERS = (*PACKAGES, "tests", "benchmarks", "tools", "examples")
MEDIAN, P90, LONGEST = 8, 23, 60
"""Lines of functions, of each folder; the median of each package."""
FILE_LINES = 300
FOLDER_FILES = 14
PARAMETERS = {"controller": 8}
"""Of a function, of a package."""


class Function(NamedTuple):
    """A function or method.

    Attributes:
        place: File and line.
        name: Dotted, from its module.
        lines: From `def` to its end.
        parameters: Without self and cls.
        public: Whether others may call it.
        documented: Whether it has a docstring.
        typed: Whether all parameters and the result are annotated.
    """

    place: str
    name: str
    lines: int
    parameters: int
    public: bool
    documented: bool
    typed: bool


def functions(file: Path) -> Iterator[Function]:
    """All functions of a file, nested ones included."""
    yield from _functions(ast.parse(file.read_text(encoding="utf-8")), str(file.relative_to(ROOT)), "", True)


def _functions(node: ast.AST, place: str, prefix: str, public: bool) -> Iterator[Function]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            open_to_all = public and not (child.name.startswith("_") and not child.name.startswith("__"))
            yield _function(child, place, prefix, open_to_all)
            yield from _functions(child, place, f"{prefix}{child.name}.", False)
        elif isinstance(child, ast.ClassDef):
            inside = public and not child.name.startswith("_")
            yield from _functions(child, place, f"{prefix}{child.name}.", inside)
        else:
            yield from _functions(child, place, prefix, public)


def _function(node: ast.FunctionDef | ast.AsyncFunctionDef, place: str, prefix: str, public: bool) -> Function:
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    own = [a for i, a in enumerate(arguments) if not (i == 0 and a.arg in ("self", "cls"))]
    own += [a for a in (node.args.vararg, node.args.kwarg) if a]
    special = node.name.startswith("__")
    return Function(
        f"{place}:{node.lineno}",
        prefix + node.name,
        (node.end_lineno or node.lineno) - node.lineno + 1,
        len(own),
        public,
        special or ast.get_docstring(node) is not None or _is_overload(node),
        all(a.annotation for a in own) and (node.returns is not None or special),
    )


def _is_overload(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any(ast.unparse(decorator).rpartition(".")[2] in ("overload", "setter") for decorator in node.decorator_list)


def classes_without_words(file: Path) -> Iterator[str]:
    """Public modules, classes of a file that have no docstring."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    place = str(file.relative_to(ROOT))
    if ast.get_docstring(tree) is None:
        yield f"{place}: module without docstring"
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and ast.get_docstring(node) is None:
            yield f"{place}:{node.lineno}: class {node.name} without docstring"


def offenders(top: str) -> Iterator[str]:
    """What breaks a bound in one of `FOLDERS`, a line each."""
    files = sorted((ROOT / top).rglob("*.py"))
    every = [function for file in files for function in functions(file)]
    yield from _sizes(top, files, every)
    if top not in PACKAGES:
        return
    if (median := statistics.median(function.lines for function in every)) > MEDIAN:
        yield f"{top}: median of {median:g} lines a function, at most {MEDIAN}"
    for function in every:
        yield from _faults(function, PARAMETERS.get(top))
    for file in files:
        yield from classes_without_words(file)


def _sizes(top: str, files: list[Path], every: list[Function]) -> Iterator[str]:
    if (most := _p90([function.lines for function in every])) > P90:
        yield f"{top}: 90 % of functions have up to {most:g} lines, at most {P90}"
    for function in every:
        if function.lines > LONGEST:
            yield f"{function.place}: {function.name}: {function.lines} lines, at most {LONGEST}"
    for file in files:
        if (count := len(file.read_text(encoding="utf-8").splitlines())) > FILE_LINES:
            yield f"{file.relative_to(ROOT)}: {count} lines, at most {FILE_LINES}"
    for folder in sorted({file.parent for file in files}):
        if (count := len(list(folder.glob("*.py")))) > FOLDER_FILES:
            yield f"{folder.relative_to(ROOT)}: {count} files, at most {FOLDER_FILES}"


def _faults(function: Function, most_parameters: int | None) -> Iterator[str]:
    where = f"{function.place}: {function.name}"
    if most_parameters and function.parameters > most_parameters:
        yield f"{where}: {function.parameters} parameters, at most {most_parameters}"
    if function.public and not function.documented:
        yield f"{where}: public without docstring"
    if function.public and not function.typed:
        yield f"{where}: public without types"


def _p90(values: list[int]) -> int:
    return sorted(values)[int(0.9 * len(values))]


HEADS = ("folder", "functions", "median", "p90", "longest", "parameters", "biggest file", "fullest folder")


def figures(top: str) -> tuple[str | float, ...]:
    """The values of `HEADS` for one of `FOLDERS`."""
    files = list((ROOT / top).rglob("*.py"))
    every = [function for file in files for function in functions(file)]
    lengths = [function.lines for function in every]
    return (
        top, len(every), statistics.median(lengths), _p90(lengths), max(lengths),
        max(function.parameters for function in every),
        max(len(file.read_text(encoding="utf-8").splitlines()) for file in files),
        max(len(list(folder.glob("*.py"))) for folder in {file.parent for file in files}),
    )  # fmt: skip


def main() -> int:
    """Print the table and the offenders."""
    for row in (HEADS, *map(figures, FOLDERS)):
        print(f"{row[0]:14}" + "".join(f"{cell!s:>16}" for cell in row[1:]))
    broken = [line for top in FOLDERS for line in offenders(top)]
    print(*broken, f"{len(broken)} bounds broken", sep="\n")
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
