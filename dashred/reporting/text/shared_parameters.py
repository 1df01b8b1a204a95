"""Advice on parameters that several episodes share, where no law explains the recording."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import joined

# Verdicts without a law that explains the recording.
UNEXPLAINED = ("outside-library", "not-converged", "unconfirmed")
# So many parameters are named.
MOST_NAMED = 6


def shared_parameters(findings: Mapping[str, Any]) -> list[str]:
    """Return a sentence that parameters may differ between the episodes; empty if none may.

    Subjects or specimens differ. A law that all episodes share cannot express this.
    """
    source = findings["input"]
    episodes = (source["splits"] or {}).get("episodes") or ()
    system = source["config"]["system"]
    names = list(system.get("parameters") or ())
    is_told = bool(system.get("parameter_per"))
    if findings["verdict"] not in UNEXPLAINED or len(episodes) < 2 or not names or is_told:
        return []
    listed = joined(names) if len(names) <= MOST_NAMED else f"{len(names)} parameters"
    return [
        f"All {len(episodes)} episodes share {listed}. If one of them may differ between episodes, "
        "its declaration has to say so: {value: VALUE, spread: SPREAD, per: episode}."
    ]
