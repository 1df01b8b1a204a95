"""The findings in one sentence, for a reader who knows the system and no statistics."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.formatting import number
from dashred.reporting.text.verdict import FEW, sentence

# Where the words of a term end and its size begins.
SIZE = re.compile(r"[,:]?\s+(?:by |with velocity |coefficient )?\(?[−-]?\d")
PLACES = {
    "test_sensors": "at sensors that no fit has seen",
    "heldout_episode": "in an episode that no fit has seen",
    "heldout_time": "in the time that no fit has seen",
    "heldout_restarted": "in the time that no fit has seen, from a state fitted just before it",
}
# Ratios nearer to 1 than this are no difference.
SAME = 1.05


def headline(findings: Mapping[str, Any], mostly: Sequence[str] = ()) -> str:
    """One sentence on what is wrong with the simulation, and one on what mending it is worth.

    Args:
        findings: of ``findings.json``.
        mostly: of more terms than a few, the words of the few that explain nearly all.
    """
    told = _told(findings, mostly)
    worth = _worth(findings["fit"]) if findings["terms"] else None
    return " ".join(sentence(text) for text in (told, worth) if text)


def gain(fit: Mapping[str, Any]) -> tuple[str, float] | None:
    """The first proof there is, and how many times smaller the error is with the law.

    Held against the uncorrected simulation from its own best start.
    """
    for key in PLACES:
        errors = fit.get(key) or {}
        before, after = errors.get("simulation_refit"), errors.get("corrected")
        if before is not None and after is not None and before > 0 and after > 0:
            return key, before / after
    return None


def _told(findings: Mapping[str, Any], mostly: Sequence[str]) -> str:
    terms = findings["terms"] or []
    all_missing = [_what(term["says"]) for term in terms if term["equation"] is not None]
    missing = _listed(all_missing, mostly)
    changed = [_changed(term) for term in terms if term["equation"] is None]
    match findings["verdict"]:
        case "nothing-missing":
            return "the simulation agrees with the recording: these sensors show nothing missing"
        case "initial-condition":
            return "the simulation is right as far as can be seen, but it starts from a wrong state"
        case "sensor-fault":
            fault = next((c["says"] for c in findings["causes"] or [] if "says" in c), "")
            return f"the simulation is right as far as can be seen, but a sensor is not: {fault}"
        case "unresolved-numerics":
            return "nothing can be said yet: the simulation's own grid or time step is too coarse"
        case "not-converged":
            return "no answer: the simulation could not be fitted to the recording, with any law"
        case "mismatch":
            return (
                "the recording does what no snapshot of the simulation shows; what is missing "
                "cannot be told without a simulator that runs"
            )
        case "no-mismatch-seen":
            return "the recording looks like the simulation's snapshots, as far as these show"
        case "outside-library" if missing and "terms" in (findings["causes"] or [{}])[0]:
            return f"the simulation leaves out {missing}, of a form that its library of terms lacks"
        case "outside-library":
            best = f"; what comes nearest is {missing}" if missing else ""
            return f"the simulation lacks something that no term of the library expresses{best}"
        case "ambiguous":
            best = f"; the best guess is {_listed(all_missing + changed, mostly)}" if terms else ""
            return f"several explanations fit this recording about equally well{best}"
        case "parameter":
            return f"the simulation has a wrong number in it: {_listed(changed)}"
        case "missing-term":
            also = f", and a number in it is wrong: {_listed(changed)}" if changed else ""
            return f"the simulation leaves out {missing}{also}"
    return "nothing was looked for"


def _what(says: str) -> str:
    """The words of a term without its size: ``viscous damping of angular velocity``."""
    words = SIZE.split(says, maxsplit=1)[0]
    return words.replace("a change of", "a further change of", 1)


def _changed(term: Mapping[str, Any]) -> str:
    return str(term["says"]).split(" (±")[0]


def _listed(parts: Sequence[str], mostly: Sequence[str] = ()) -> str:
    """Return the effects in a row; two terms may have the same words without their sizes."""
    if len(parts) <= FEW:
        return " and ".join(dict.fromkeys(parts))
    if not mostly:
        return f"{len(parts)} effects at once"
    return f"mostly {' and '.join(dict.fromkeys(map(_what, mostly)))} ({len(parts)} terms in all)"


def _worth(fit: Mapping[str, Any]) -> str | None:
    found = gain(fit)
    if found is None:
        return None
    key, ratio = found
    if ratio >= SAME:
        return f"with that put in, the error {PLACES[key]} is {_times(ratio)} smaller"
    if ratio > 1 / SAME:
        return f"with that put in, the error {PLACES[key]} is the same as before"
    return f"with that put in, the error {PLACES[key]} is {_times(1 / ratio)} larger: beware"


def _times(ratio: float) -> str:
    return f"{number(float(f'{ratio:.2g}'))} times"
