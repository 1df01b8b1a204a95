"""A parameter with a wrong value, as text."""

from dashred.core.findings.law_schema import ParameterChange
from dashred.core.formatting import number, rounded, with_error
from dashred.core.units import with_unit


def parameter_text(change: ParameterChange) -> str:
    """Return both values with the error: ``nu is 0.0500 ± 0.0008, not 0.035``.

    Of an offset, the text says what it is added to.
    """
    if "meaning" in change:
        text = _offset_text(change, with_error(abs(change["coefficient"]), change["std"]))
    else:
        value = with_unit(with_error(change["to"], change["std"]), change.get("unit"))
        text = f"{change['parameter']} is {value}, not {number(change['from'])}"
    if not change["exact"]:
        text += " (to first order; the corrected equations contain the tangent)"
    if change["aliases"]:
        text += f"; a change of {' or '.join(change['aliases'])} has the same effect"
    return text


def short_parameter_text(change: ParameterChange) -> str:
    """Return both values: ``nu is 0.0500, not 0.035``."""
    if "meaning" in change:
        return _offset_text(change, rounded(abs(change["coefficient"]), change["std"])[0])
    new, _ = rounded(change["to"], change["std"])
    value = with_unit(new, change.get("unit"))
    return f"{change['parameter']} is {value}, not {number(change['from'])}"


def _offset_text(change: ParameterChange, size: str) -> str:
    """Return an offset: ``the value of T at the left end is 1.3 ± 0.2 higher than stated``."""
    way = "higher" if change["coefficient"] > 0 else "lower"
    value = with_unit(size, change.get("unit"))
    return f"the {change['meaning']} is {value} {way} than stated ({change['parameter']})"
