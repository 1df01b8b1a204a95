"""The text of a hidden state."""

from __future__ import annotations

from typing import Any

from dashred.reporting.text.hidden_state import hidden_state_text

FOUND: dict[str, Any] = {
    "state": "z",
    "follows": "T",
    "equation": "T",
    "term": "z - T",
    "constant": "tau_z",
    "time_constant": 199.87,
    "time_constant_std": 0.93,
    "gain": 0.0033356,
    "gain_std": 0.0000113,
}


def test_a_hidden_state_is_told_in_words_and_symbols() -> None:
    assert hidden_state_text(FOUND) == (
        "a hidden state z relaxes toward T with a time constant τ of 199.9 ± 1.8, and acts on T "
        "with a gain of 0.00334 ± 0.00002: dz/dt = (T − z)/τ, and dT/dt also contains "
        "gain·(z − T)"
    )


def test_its_units_are_told() -> None:
    text = hidden_state_text(FOUND | {"time_unit": "s", "gain_unit": "1/s"})
    assert ("199.9 ± 1.8 s," in text and "(0.00334 ± 0.00002) 1/s" in text) or "per s" in text
