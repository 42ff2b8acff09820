"""Controller and plant as one system (SSP 1.0): an .ssp file for masters that open such."""

import io
import zipfile
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from sidestep.fmu.exporting.controller_variables import STATE
from sidestep.fmu.native.build import write_to

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_COMMANDS = ("steer_angle_command", "target_speed", "acceleration")


def write_ssp(out: Path, name: str, controller: Path, plant: Path, duration: float, period: float) -> Path:
    """Write the system: the plant's state goes to the controller, its commands go back.

    The system has no connectors of its own and every start value stands in the FMUs, since importers differ in both.

    Args:
        out: The .ssp file.
        name: Of the system.
        controller, plant: The two FMUs.
        duration: Of the default experiment, in [s].
        period: Communication step, in [s].

    Raises:
        InputError: `out` cannot be written.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SystemStructure.ssd", _structure(name, duration, period))
        archive.write(controller, "resources/controller.fmu")
        archive.write(plant, "resources/plant.fmu")
    return write_to(out, buffer.getvalue())


def _structure(name: str, duration: float, period: float) -> bytes:
    ElementTree.register_namespace("ssd", _SSD)
    ElementTree.register_namespace("ssc", _SSC)
    root = Element(f"{{{_SSD}}}SystemStructureDescription", name=name, version="1.0")
    system = SubElement(root, f"{{{_SSD}}}System", name="drive")
    elements, states = SubElement(system, f"{{{_SSD}}}Elements"), [state for state, *_ in STATE]
    _component(elements, "controller", inputs=states, outputs=_COMMANDS)
    _component(elements, "plant", inputs=_COMMANDS, outputs=states)
    connections = SubElement(system, f"{{{_SSD}}}Connections")
    for start, end, signals in (("plant", "controller", states), ("controller", "plant", _COMMANDS)):
        for signal in signals:
            SubElement(connections, f"{{{_SSD}}}Connection", startElement=start, startConnector=signal,
                       endElement=end, endConnector=signal)  # fmt: skip
    notes = SubElement(SubElement(system, f"{{{_SSD}}}Annotations"), f"{{{_SSC}}}Annotation", type="org.openmodelica")
    master = SubElement(SubElement(notes, "oms:Annotations", {"xmlns:oms": "https://raw.githubusercontent.com/"
                        "OpenModelica/OMSimulator/master/schema/oms.xsd"}), "oms:SimulationInformation")  # fmt: skip
    SubElement(master, "oms:FixedStepMaster", description="oms-ma", stepSize=str(period),
               absoluteTolerance="1e-4", relativeTolerance="1e-4")  # fmt: skip
    SubElement(root, f"{{{_SSD}}}DefaultExperiment", startTime="0", stopTime=str(duration))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _component(elements: Element, name: str, inputs: "tuple[str, ...] | list[str]",
               outputs: "tuple[str, ...] | list[str]") -> None:  # fmt: skip
    component = SubElement(elements, f"{{{_SSD}}}Component", name=name, type="application/x-fmu-sharedlibrary",
                           source=f"resources/{name}.fmu")  # fmt: skip
    connectors = SubElement(component, f"{{{_SSD}}}Connectors")
    for kind, signals in (("input", inputs), ("output", outputs)):
        for signal in signals:
            connector = SubElement(connectors, f"{{{_SSD}}}Connector", name=signal, kind=kind)
            SubElement(connector, f"{{{_SSC}}}Real")
