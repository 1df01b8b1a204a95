"""The model description of a corrected FMU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from dashred.physics.external.adapters.fmu.description import Description

# What the original may be able to do, but the corrected FMU is not.
LOST = (
    "providesDirectionalDerivative",
    "providesDirectionalDerivatives",
    "providesAdjointDerivatives",
    "canGetAndSetFMUstate",
    "canSerializeFMUstate",
    "canGetAndSetFMUState",
    "canSerializeFMUState",
    "canInterpolateInputs",
    "maxOutputDerivativeOrder",
    "canRunAsynchronuously",
)
DEPENDENCIES = ("dependencies", "dependenciesKind")
INTERFACES = ("ModelExchange", "CoSimulation", "ScheduledExecution")


def corrected_description(
    xml: bytes,
    description: Description,
    identifier: str,
    token: str,
    told: str,
    starts: Sequence[tuple[Any, float]],
) -> bytes:
    """Return the model description with another identity and other start values.

    Variables, states and events are those of the original. The interface that was analysed is the
    only one. A derivative may depend on everything.

    Args:
        xml: of the original.
        description: the same, as FMPy has read it.
        identifier: name of the new library, without suffix.
        token: the new GUID or instantiation token.
        told: what is said of the law.
        starts: variables and their start values.
    """
    root = ElementTree.fromstring(xml)
    root.set("guid" if description.is_second else "instantiationToken", token)
    root.set("modelName", f"{root.get('modelName')} corrected")
    before = root.get("description")
    root.set("description", f"{before.rstrip('. ')}. {told}" if before else told)
    root.set("generationTool", "dashred")
    root.attrib.pop("generationDateAndTime", None)
    for kind in INTERFACES:
        for interface in root.findall(kind):
            if kind != description.kind:
                root.remove(interface)
                continue
            interface.set("modelIdentifier", identifier)
            for name in LOST:
                interface.attrib.pop(name, None)
            for sources in interface.findall("SourceFiles"):
                interface.remove(sources)
    structure = root.find("ModelStructure")
    for unknown in () if structure is None else _slopes(structure, description):
        for name in DEPENDENCIES:
            unknown.attrib.pop(name, None)
    variables = root.find("ModelVariables")
    for variable, value in starts:
        assert variables is not None
        for element in variables:
            if element.get("name") == variable.name:
                of_start = element[0] if description.is_second else element
                of_start.set("start", _text(variable, value))
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written


def _slopes(structure: Any, description: Description) -> list[Any]:
    """Return the elements of the model structure that are derivatives of states."""
    variables = description.description.modelVariables
    slopes = {each.variable.valueReference for each in description.description.derivatives}
    found = []
    for element in structure.iter():
        index, reference = element.get("index"), element.get("valueReference")
        if index is not None:
            reference = variables[int(index) - 1].valueReference
        if reference is not None and int(reference) in slopes:
            found.append(element)
    return found


def _text(variable: Any, value: float) -> str:
    if variable.type == "Boolean":
        return "true" if value else "false"
    is_real = variable.type in ("Real", "Float64", "Float32")
    return repr(float(value)) if is_real else str(int(value))
