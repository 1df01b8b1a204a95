"""The texts in the findings, generated from the other keys."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

from dashred.core.findings.law_schema import AlternativeTerm, MissingTerm, ParameterChange
from dashred.core.findings.schema import Findings
from dashred.physics.system import System
from dashred.reporting.text.causes import cause_text
from dashred.reporting.text.hidden_state import hidden_state_text
from dashred.reporting.text.parameters import parameter_text
from dashred.reporting.text.regions import region_text, states_text
from dashred.reporting.wording.sized_term import Description
from dashred.reporting.wording.term_description import describe_term


def add_text(findings: Findings, system: System) -> Findings:
    """Add the texts to the findings, in place, and return them.

    Args:
        findings: the findings without texts.
        system: the simulator; it defines the meanings and units of fields.
    """
    for cause in findings["causes"] or []:
        if text := cause_text(cause, system.units):
            cause["says"] = text
    for term in findings["terms"] or []:
        add_term_text(term, system)
    if "hidden_state" in findings:
        findings["hidden_state"]["says"] = hidden_state_text(findings["hidden_state"])
    listed = [
        law["terms"] for law in (*(findings["alternatives"] or []), *(findings["smaller"] or []))
    ]
    for other in chain(*listed, findings["also_supported"]):
        window = other["window"]
        other["region"] = None if window is None else region_text(window, system.units)
    where = findings["where"]
    if where is not None:
        states, in_space = where["states"], bool(system.axes)
        where["regime"] = (
            None if states is None else states_text(states, system.units, in_space=in_space)
        )
    return findings


def add_term_text(term: MissingTerm | ParameterChange, system: System) -> None:
    """Add the effect and the text of a term, or the text of a parameter."""
    if term["equation"] is None:
        term["says"] = parameter_text(term)
        return
    description = describe(term, system, term["std"])
    term["effect"] = description.effect
    region = term["region"]
    where = f", {region_text(region[0], system.units)}" if region else ""
    term["says"] = f"{description.text}{where}"


def describe(term: MissingTerm | AlternativeTerm, system: System, std: float = 0.0) -> Description:
    """Describe a term of a law; `std` is that of its coefficient, 0 if unknown."""
    equation = term["equation"]
    assert equation is not None
    expr = system.parse(term["term"], f"library.{equation}", equation=equation)
    return describe_term(system, equation, expr, term["coefficient"], std)


def law_text(terms: Sequence[MissingTerm | ParameterChange], system: System) -> str:
    """Return a law in one sentence for the missing terms and one for the wrong parameters."""
    for term in terms:
        add_term_text(term, system)
    missing = [term["says"] for term in terms if term["equation"] is not None]
    changed = [term["says"] for term in terms if term["equation"] is None]
    sentences = []
    if missing:
        sentences.append(f"The simulation leaves out {'; and '.join(missing)}.")
    if changed:
        noun = "A parameter has a wrong value" if len(changed) == 1 else "Parameters are wrong"
        sentences.append(f"{noun}: {'; and '.join(changed)}.")
    return " ".join(sentences) or "The recording shows no missing term and no wrong parameter."
