"""A parameter with a wrong value, as text."""

from dashred.core.findings.law_schema import ParameterChange
from dashred.core.formatting import number, rounded
from dashred.core.units import with_unit


def parameter_text(change: ParameterChange) -> str:
    """Return both values with the error: ``nu is 0.0500 ± 0.0004, not 0.035``."""
    new, error = rounded(change["to"], change["std"])
    value = with_unit(f"{new} ± {error}", change.get("unit"))
    text = f"{change['parameter']} is {value}, not {number(change['from'])}"
    if not change["exact"]:
        text += " (to first order; the corrected equations contain the tangent)"
    if change["aliases"]:
        text += f"; a change of {' or '.join(change['aliases'])} has the same effect"
    return text


def short_parameter_text(change: ParameterChange) -> str:
    """Return both values: ``nu is 0.0500, not 0.035``."""
    new, _ = rounded(change["to"], change["std"])
    value = with_unit(new, change.get("unit"))
    return f"{change['parameter']} is {value}, not {number(change['from'])}"
