"""The findings in a few plain sentences: what is left out, how sure, where, and its worth."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import number, percent, pretty, probability, rounded
from dashred.core.units import NO_UNITS, with_unit
from dashred.reporting.text.improvement import UNTESTED, reconstructed, unresolved, worth

VERDICTS = {
    "missing-term": "a term is missing from the simulation",
    "nothing-missing": "nothing is missing from the simulation",
    "parameter": "a parameter of the simulation has another value",
    "initial-condition": "the simulation starts from the wrong state",
    "sensor-fault": "a sensor is at fault, not the simulation",
    "unresolved-numerics": "the simulation is not resolved, so nothing can be said of its physics",
    "outside-library": "something is missing that the library of terms cannot express",
    "ambiguous": "several explanations fit about equally well",
    "not-converged": "the search did not converge",
    "mismatch": "the recording is unlike the simulation, and snapshots alone cannot tell why",
    "no-mismatch-seen": "the recording looks like the simulation's snapshots",
}
# A p below this is no chance event, whatever its size.
CERTAIN = 1e-12
PARTS = {
    "H": "H, the energy itself",
    "J": "J, how energy moves about",
    "R": "R, what takes energy away",
    "G": "G, what lets inputs in",
    None: "no part of the structure by itself",
}
# Of more terms than a few, the smallest law that explains nearly all is told of, too.
FEW, NEARLY = 3, 0.95
# A cause below this probability is not told of.
LIKELY = 0.05


def verdict_lines(findings: Mapping[str, Any]) -> list[str]:
    """The verdict and what follows from it, a sentence or two a line; empty without a verdict."""
    verdict = findings["verdict"]
    if verdict is None:
        return []
    head = f"Verdict: {verdict}: {VERDICTS.get(verdict, 'see findings.json')}."
    body = [
        *causes(findings),
        *law(findings),
        *certainty(findings),
        *unresolved(findings["fit"]),
        *places(findings["where"] if findings["terms"] else None, findings.get("units", NO_UNITS)),
        *consequences(findings),
        *worth(findings["fit"]),
        *reconstructed(findings),
        *unknowable(findings),
    ]
    return [head, *(f"  {line}" for line in body)]


def causes(findings: Mapping[str, Any]) -> list[str]:
    """What the causes worth a sentence say."""
    return [sentence(cause["says"]) for cause in _told(findings) if "says" in cause]


def _told(findings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes worth a sentence: the leading one, and where it is open, those that may be it."""
    known = findings["causes"] or []
    if findings["verdict"] != "ambiguous":
        return list(known[:1])
    return [cause for cause in known if cause["probability"] >= LIKELY]


def alternative_in_words(alternative: Mapping[str, Any]) -> str:
    """``u: 0.0249·u, −0.0251·u³``; ``nu +0.015``; ``nothing``."""
    return ", ".join(_tried(term) for term in alternative["terms"]) or "nothing"


def sentence(text: str) -> str:
    """The text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def law(findings: Mapping[str, Any]) -> list[str]:
    """What is left out and what is mis-stated, with sizes."""
    terms = findings["terms"] or []
    rivals = any(other["rival"] for other in findings["alternatives"] or [])
    undecided = findings["verdict"] == "ambiguous" or rivals
    guess = "As the best guess, " if undecided and terms else ""
    added = [term for term in terms if term["equation"] is not None]
    missing = [term["says"] for term in added]
    if len(added) > FEW:
        # Nobody reads a paragraph of so many.
        units = findings.get("units", NO_UNITS)
        told = ", ".join(_in_symbols(term, units) for term in added)
        missing = [f"{len(added)} terms: {told}"]
    changed = [term["says"] for term in terms if term["equation"] is None]
    lines = []
    if missing:
        lines.append(f"the simulation leaves out {'; and '.join(missing)}")
    if changed:
        noun = "a parameter is" if len(changed) == 1 else "parameters are"
        lines.append(f"{noun} mis-stated: {'; and '.join(changed)}")
    lines = [f"{guess if not index else ''}{line}" for index, line in enumerate(lines)]
    return [sentence(line) for line in [*lines, *_gist(findings)]]


def nearly_all(findings: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Of more terms than a few, the smallest law that explains nearly all that they do."""
    if len(findings["terms"] or []) <= FEW:
        return None
    nearly = (law for law in findings["smaller"] or [] if law["explained"] >= NEARLY)
    return min(nearly, key=lambda law: len(law["terms"]), default=None)


def _gist(findings: Mapping[str, Any]) -> list[str]:
    """What the first few of many terms explain: the smallest law that says nearly all."""
    few = nearly_all(findings)
    if few is None:
        return []
    left = f"{100 * (1 - few['explained']):.2g} %"
    return [f"most of it is {alternative_in_words(few)}: alone it explains all but {left} of that"]


def certainty(findings: Mapping[str, Any]) -> list[str]:
    """How sure: the chance that noise alone would do it, and what else fits."""
    lines = []
    p = (findings["where"] or {}).get("significance")
    if findings["terms"] and p is not None:
        lines.append(f"The chance that noise alone looks like this: p {_p(p)}.")
    others = findings["alternatives"] or []
    rivals = [other for other in others if other["rival"]]
    if rivals:
        fits = "fits" if len(rivals) == 1 else "fit"
        told = "; ".join(
            f"{alternative_in_words(r)} (ΔBIC {_difference(r)}"
            f"{', the same at these sensors' if r['same_as_best'] else ''})"
            for r in rivals
        )
        lines.append(f"The recording does not decide: {told} {fits} about as well.")
    elif others:
        nearest = min(others, key=lambda other: other["delta_bic"])
        lines.append(
            f"The next best explanation, {alternative_in_words(nearest)}, "
            f"is worse by ΔBIC {_difference(nearest)}."
        )
    return lines


def places(where: Mapping[str, Any] | None, units: Mapping[str, str]) -> list[str]:
    """In which equations, and where and when, the law acts."""
    if where is None:
        return []
    shares = sorted(where["equation"].items(), key=lambda item: -item[1])
    told = [f"{percent(share)} in the equation of {field}" for field, share in shares if share]
    if len(shares) == 1:
        told = [f"in the equation of {shares[0][0]}"]
    return [f"It acts {', '.join(told)}; {acting(where, units)}."]


def acting(where: Mapping[str, Any], units: Mapping[str, str] = NO_UNITS) -> str:
    """``for 10.1 < x < 16.0 (± 0.1)``, ``where u > 1.76 (…)``, or ``everywhere``."""
    if where["region"]:
        [region] = where["region"]
        return f"for {bounds(region, units)}"
    return f"where {where['regime']}" if where["regime"] else "everywhere"


def bounds(region: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """A region as it is told: ``10.1 < x < 16.0 m (± 0.1)``."""
    of, std = region.get("axis") or region["field"], region["std"]
    unit = units.get(of)
    if "to" in region:
        (begin, _), (end, error) = (rounded(region[key], std) for key in ("from", "to"))
        return f"{begin} < {of} < {with_unit(end, unit)} (± {error})"
    if "below" in region:
        place, error = rounded(region["below"], std)
        return f"{of} < {with_unit(place, unit)} (± {error})"
    place, error = rounded(region["from"] if "from" in region else region["above"], std)
    return f"{of} > {with_unit(place, unit)} (± {error})"


def consequences(findings: Mapping[str, Any]) -> list[str]:
    """What the law does to the system's energy, and to its structure."""
    return [*_energy(findings["energy"]), *_structure(findings["structure"])]


def _energy(energy: Mapping[str, Any] | None) -> list[str]:
    """How much energy the corrected system loses or gains a cycle."""
    if energy is None:
        return []
    first, last = (_share(energy[name]) for name in ("first", "last"))
    cycles = energy["cycles"]
    return [f"Its energy {first} in the first cycle and {last} in the last of {cycles}."]


def _structure(found: Mapping[str, Any] | None) -> list[str]:
    """Which part of a port-Hamiltonian system the law changes, and whether it stays one."""
    if found is None:
        return []
    kept = found["port_hamiltonian"]
    stays = "stays" if kept else "does not stay"
    told = "; ".join(f"{each['term']} changes {_part(each, kept)}" for each in found["changes"])
    return [f"{told}: the corrected system {stays} port-Hamiltonian."]


def _part(change: Mapping[str, Any], kept: bool) -> str:
    if change["part"] == "R" and not change["passive"]:
        return "R, and less energy is taken away" if kept else "R, and gives energy"
    return PARTS[change["part"]]


def _share(share: Mapping[str, Any]) -> str:
    value, std = rounded(100 * abs(share["lost"]), 100 * share["std"])
    return f"{'falls' if share['lost'] >= 0 else 'grows'} by {value} ± {std} %"


def unknowable(findings: Mapping[str, Any]) -> list[str]:
    """What snapshots alone cannot tell."""
    if findings["verdict"] not in UNTESTED:
        return []
    unknown = [sentence(text) for text in findings["causes"][0]["cannot_know"]]
    return ["What this cannot know:", *(f"- {text}" for text in unknown)]


def _in_symbols(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """A term that was found, as those that were tried are told: ``u: −0.0251·u³ for u > 0.4``."""
    region = term["region"]
    return _tried({**term, "region": f"for {bounds(region[0], units)}" if region else None})


def _tried(term: Mapping[str, Any]) -> str:
    value = number(float(f"{term['coefficient']:.3g}"))
    if term["equation"] is None:
        sign = "+" if term["coefficient"] > 0 else ""
        return f"{term['term']} {sign}{value}"
    where = f" {term['region']}" if term["region"] else ""
    return f"{term['equation']}: {value}·{pretty(term['term'])}{where}"


def _difference(alternative: Mapping[str, Any]) -> str:
    return number(float(f"{alternative['delta_bic']:.2g}"))


def _p(p: float) -> str:
    text = probability(p)
    return text if p < CERTAIN else f"= {text}"
