"""modelDescription.xml for FMI 2.0 and FMI 3.0, build description and variable table of an FMU that we make."""

import html
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from sidestep.fmu.description.variables import ATTRIBUTES, UNITS, Kind, Model, Variable

TOOL = "sidestep"
STEP_SIZE = 0.02
STOP_TIME = 8.0
LOG_CATEGORIES = {
    "logStatusWarning": "A value that was set is not used",
    "logStatusError": "A call that failed, and why",
}


def model_description(model: Model, fmi: int, token: str, sources: list[str]) -> bytes:
    """The XML file of one standard.

    Args:
        model: Variables and texts.
        fmi: 2 or 3.
        token: GUID (FMI 2.0) or instantiation token (FMI 3.0).
        sources: C files in sources/, listed in the FMI 2.0 file.

    Returns:
        UTF-8 text.
    """
    return _text(_fmi2(model, token, sources) if fmi == 2 else _fmi3(model, token))


def build_description(model: Model, sources: list[str]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = SubElement(build, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    return _text(root)


def variable_rows(model: Model) -> str:
    """The variables as rows of an HTML table: name, causality, unit, start, description."""
    cells = (
        (f"{row.array}, {span} elements" if row.array else row.name, ATTRIBUTES[row.kind][0], row.unit,
         "" if row.start is None or row.array else f"{row.start:g}", row.description)
        for row, span in zip(model.variables, model.spans, strict=True)
        if span
    )  # fmt: skip
    return "\n".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in cells)


def _fmi2(model: Model, token: str, sources: list[str]) -> Element:
    root = Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=model.name, guid=token, description=model.description,
        generationTool=TOOL, variableNamingConvention="structured", numberOfEventIndicators="0",
    )  # fmt: skip
    interface = SubElement(
        root, "CoSimulation", modelIdentifier=model.identifier,
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true", canGetAndSetFMUstate="true", canSerializeFMUstate="true",
        providesDirectionalDerivative=_differentiable(model),
    )  # fmt: skip
    if sources:
        files = SubElement(interface, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)
    _common(root, model)
    variables = SubElement(root, "ModelVariables")
    for reference, row in enumerate(model.variables):
        scalar = SubElement(variables, "ScalarVariable", _attributes(row, reference))
        of_state = {"derivative": str(_state_of(model, reference) + 1)} if row.kind == "derivative" else {}
        SubElement(scalar, "Real", _value(row) | of_state)
    structure = SubElement(root, "ModelStructure")
    for name, references in _structure(model).items():
        if references:
            unknowns = SubElement(structure, name)
            for reference in references:
                depends = {} if name == "InitialUnknowns" else _dependencies(model, reference, first=1)
                SubElement(unknowns, "Unknown", {"index": str(reference + 1)} | depends)
    return root


def _fmi3(model: Model, token: str) -> Element:
    root = Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=model.name, instantiationToken=token,
        description=model.description, generationTool=TOOL, variableNamingConvention="structured",
    )  # fmt: skip
    SubElement(
        root, "CoSimulation", modelIdentifier=model.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true", canSerializeFMUState="true",
        providesDirectionalDerivatives=_differentiable(model),
    )  # fmt: skip
    _common(root, model)
    variables = SubElement(root, "ModelVariables")
    for reference, (row, span) in enumerate(zip(model.variables, model.spans, strict=True)):
        if not span:
            continue
        of_state = {"derivative": str(_state_of(model, reference))} if row.kind == "derivative" else {}
        values = _values(model.variables[reference : reference + span])
        variable = SubElement(variables, "Float64", _attributes(row, reference) | values | of_state)
        if row.array:
            variable.set("name", row.array)
            SubElement(variable, "Dimension", start=str(span))
    structure = SubElement(root, "ModelStructure")
    names = {"Outputs": "Output", "Derivatives": "ContinuousStateDerivative", "InitialUnknowns": "InitialUnknown"}
    for name, references in _structure(model).items():
        for reference in references:
            if not model.spans[reference]:
                continue
            depends = {} if name == "InitialUnknowns" else _dependencies(model, reference, first=0)
            SubElement(structure, names[name], {"valueReference": str(reference)} | depends)
    return root


def _differentiable(model: Model) -> str:
    return "true" if model.of_kind("derivative") else "false"


def _common(root: Element, model: Model) -> None:
    """What both standards write alike: units, log categories, default experiment."""
    units = SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(row.unit for row in model.variables if row.unit):
        exponents = {base: str(exponent) for base, exponent in UNITS[name].items()}
        SubElement(SubElement(units, "Unit", name=name), "BaseUnit", exponents)
    categories = SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=description)
    step = next((row.start for row in model.variables if row.name == "period"), STEP_SIZE)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime=str(STOP_TIME), stepSize=str(step))


def _attributes(row: Variable, reference: int) -> dict[str, str]:
    causality, variability, initial = ATTRIBUTES[row.kind]
    attributes = {"name": row.name, "valueReference": str(reference), "description": row.description}
    attributes |= {"causality": causality, "variability": variability}
    return attributes | ({"initial": initial} if initial else {})


def _value(row: Variable) -> dict[str, str]:
    values = {"unit": row.unit, "start": row.start, "min": row.minimum, "max": row.maximum}
    return {name: str(value) for name, value in values.items() if value not in (None, "")}


def _values(rows: Sequence[Variable]) -> dict[str, str]:
    """Of an array, whose starts are a list; of a scalar as it is."""
    starts = [str(row.start) for row in rows if row.start is not None]
    return _value(rows[0]) | ({"start": " ".join(starts)} if starts else {})


def _state_of(model: Model, derivative: int) -> int:
    """Value reference of the state that belongs to a derivative."""
    return model.of_kind("state", "hidden state")[0][0] + derivative - model.of_kind("derivative")[0][0]


def _structure(model: Model) -> dict[str, list[int]]:
    """Value references in each part of the model structure."""
    parts: dict[str, tuple[Kind, ...]] = {
        "Outputs": ("state", "output", "sampled"),
        "Derivatives": ("derivative",),
        "InitialUnknowns": ("state", "hidden state", "derivative", "output", "sampled"),
    }
    return {name: [reference for reference, _ in model.of_kind(*kinds)] for name, kinds in parts.items()}


def _dependencies(model: Model, reference: int, first: int) -> dict[str, str]:
    """States depend on themselves alone, sampled outputs on nothing: masters see that no input acts on them at once."""
    kind = model.variables[reference].kind
    if kind == "sampled":
        return {"dependencies": ""}
    return {"dependencies": str(reference + first), "dependenciesKind": "dependent"} if kind == "state" else {}


def _text(root: Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
