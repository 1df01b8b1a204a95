"""Parameters that were fitted because the configuration states them with a spread, as text.

They are no part of the law: a parameter that the recording shows to be wrong is a change of the law
(:mod:`dashred.reporting.text.parameters`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.findings.law_schema import FittedParameter
from dashred.core.formatting import number, with_error
from dashred.core.units import with_unit
from dashred.reporting.text.laws import FEW

TITLE = "Fitted parameters"
# The recording determines a value if its standard deviation is at most this share of the spread,
# or if its distance from the stated value is more than so many spreads and standard deviations.
NARROW, FAR = 0.9, 3.0


def fitted_parameter_lines(findings: Mapping[str, Any]) -> list[str]:
    """Return one line for each fitted parameter; none in findings of before there were any."""
    return [
        " ".join([f"{fitted_parameter_text(each)}.", *_remarks(each)])
        for each in findings.get("fitted_parameters", ())
    ]


def fitted_parameter_text(fitted: FittedParameter) -> str:
    """Return the value and what was stated: ``R = 3.41 ± 0.10 ohm (stated 2.7, spread 1)``."""
    order = "" if fitted["exact"] else "; to first order"
    stated, spread = number(fitted["stated"]), number(fitted["spread"])
    return f"{value_text(fitted)} (stated {stated}, spread {spread}{order})"


def value_text(fitted: FittedParameter) -> str:
    """Return the value with its error: ``R = 3.41 ± 0.10 ohm``."""
    value = with_error(fitted["value"], fitted["std"])
    return f"{fitted['parameter']} = {with_unit(value, fitted.get('unit'))}"


def values_in_a_row(every: Sequence[FittedParameter]) -> str:
    """Return the values in a sentence: ``the fitted parameter R = 3.41 ± 0.05 ohm``."""
    if len(every) > FEW:
        return f"the {len(every)} fitted parameters"
    noun = "parameter" if len(every) == 1 else "parameters"
    return f"the fitted {noun} {' and '.join(map(value_text, every))}"


def _remarks(fitted: FittedParameter) -> list[str]:
    """Return what a reader should know about a value, one sentence each."""
    distance = abs(fitted["value"] - fitted["stated"]) / fitted["spread"]
    determines = "determines" if _is_determined(fitted) else "does not determine"
    remarks = [
        f"It is {distance:.1f} spreads from the stated value, and the recording {determines} it."
    ]
    if "episode" in fitted:
        remarks.append(f"This is the value in episode {fitted['episode']}.")
    if "input" in fitted:
        remarks.append(f"This is the delay of the input {fitted['input']}.")
    if "sensor" in fitted:
        remarks.append(f"This calibrates the sensor {fitted['sensor']}.")
    if fitted["aliases"]:
        remarks.append(f"A change of {' or '.join(fitted['aliases'])} has the same effect.")
    return remarks


def _is_determined(fitted: FittedParameter) -> bool:
    """Return whether the fit narrows the stated spread, or leaves it far behind."""
    std, spread = fitted["std"], fitted["spread"]
    moved = abs(fitted["value"] - fitted["stated"])
    return std <= NARROW * spread or moved > FAR * max(std, spread)
