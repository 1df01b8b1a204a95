"""Parameters that were fitted because the configuration states them with a spread, as text.

They are no part of the law: a parameter that the recording shows to be wrong is a change of the law
(:mod:`dashred.reporting.text.parameters`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.findings.law_schema import FittedParameter
from dashred.core.formatting import number, rounded
from dashred.core.units import with_unit
from dashred.reporting.text.verdict import FEW

TITLE = "Fitted parameters"
# A value that is farther from the stated one, in spreads, is pointed out.
FAR = 3.0
# If the fit leaves more than this share of the spread, it has determined nothing.
UNDETERMINED = 0.9


def fitted_parameter_lines(findings: Mapping[str, Any]) -> list[str]:
    """Return one line for each fitted parameter; none in findings of before there were any."""
    return [
        " ".join([f"{fitted_parameter_text(each)}.", *_remarks(each)])
        for each in findings.get("fitted_parameters", ())
    ]


def fitted_parameter_text(fitted: FittedParameter) -> str:
    """Return the value and what was stated: ``R = 3.41 ± 0.05 ohm (stated 2.7 ± 1.0)``."""
    order = "" if fitted["exact"] else "; to first order"
    return f"{value_text(fitted)} (stated {_stated(fitted)}{order})"


def value_text(fitted: FittedParameter) -> str:
    """Return the value with its error: ``R = 3.41 ± 0.05 ohm``."""
    value = " ± ".join(rounded(fitted["value"], fitted["std"]))
    return f"{fitted['parameter']} = {with_unit(value, fitted.get('unit'))}"


def values_in_a_row(every: Sequence[FittedParameter]) -> str:
    """Return the values in a sentence: ``the fitted parameter R = 3.41 ± 0.05 ohm``."""
    if len(every) > FEW:
        return f"the {len(every)} fitted parameters"
    noun = "parameter" if len(every) == 1 else "parameters"
    return f"the fitted {noun} {' and '.join(map(value_text, every))}"


def _stated(fitted: FittedParameter) -> str:
    """Return the stated value and its spread: ``2.7 ± 1.0``."""
    value, spread = number(fitted["stated"]), number(fitted["spread"])
    if "." in value and spread.isdigit():
        spread += ".0"
    return f"{value} ± {spread}"


def _remarks(fitted: FittedParameter) -> list[str]:
    """Return what a reader should know about a value, one sentence each."""
    name, spread = fitted["parameter"], fitted["spread"]
    distance = abs(fitted["value"] - fitted["stated"]) / spread
    remarks = []
    if "episode" in fitted:
        remarks.append(f"This is the value in episode {fitted['episode']}.")
    if "input" in fitted:
        remarks.append(f"This is the delay of the input {fitted['input']}.")
    if "sensor" in fitted:
        remarks.append(f"This calibrates the sensor {fitted['sensor']}.")
    if distance > FAR:
        size = number(float(f"{distance:.2g}"))
        remarks.append(f"This is {size} spreads from the stated value.")
    if fitted["std"] > UNDETERMINED * spread:
        remarks.append(f"The recording does not determine {name}.")
    if fitted["aliases"]:
        remarks.append(f"A change of {' or '.join(fitted['aliases'])} has the same effect.")
    return remarks
