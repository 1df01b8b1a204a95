"""A hidden state as text."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import MINUS, parenthesize_sum, pretty, with_error
from dashred.core.units import with_unit


def hidden_state_text(found: Mapping[str, Any]) -> str:
    """Return what a hidden state follows, its time constant and its gain, in one sentence.

    Args:
        found: ``findings["hidden_state"]``.
    """
    z, u, f = found["state"], found["follows"], found["equation"]
    time = with_error(found["time_constant"], found["time_constant_std"])
    gain = with_error(found["gain"], found["gain_std"])
    term = parenthesize_sum(pretty(found["term"]).replace("-", MINUS))
    return (
        f"a hidden state {z} relaxes toward {u} with a time constant τ of "
        f"{with_unit(time, found.get('time_unit'))}, and acts on {f} with a gain of "
        f"{with_unit(gain, found.get('gain_unit'))}: d{z}/dt = ({u} {MINUS} {z})/τ, and d{f}/dt "
        f"also contains gain·{term}"
    )
