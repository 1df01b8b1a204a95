"""A law as findings: its terms with error bars and probabilities, and the alternatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dashred.core.findings.law_schema import (
    Alternative,
    AlternativeTerm,
    MissingTerm,
    ParameterChange,
    Region,
    SmallerLaw,
)
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN, Discovery
from dashred.inference.results.parameter_change import exact_change, is_exact, parameter_change
from dashred.inference.results.posterior_probabilities import inclusion
from dashred.physics.boundaries.entries import offset_meanings
from dashred.physics.system import System
from dashred.physics.terms.term_units import coefficient_unit
from dashred.physics.window import Window

# Number of other laws that are listed if not so many are rivals.
ALTERNATIVES = 3
# Alternatives within this ΔBIC are listed before the best law of one term.
NEAR = 12.0


def terms_of_discovery(system: System, discovery: Discovery) -> list[MissingTerm | ParameterChange]:
    """Return ``findings["terms"]``: one entry for each candidate of the best law."""
    return terms_of_law(system, discovery.best, lambda candidate: inclusion(discovery, candidate))


def terms_of_law(
    system: System, law: Law, probability: Callable[[Candidate], float] = lambda _: 1.0
) -> list[MissingTerm | ParameterChange]:
    """Return one entry for each candidate of a law.

    Args:
        system: the simulator.
        law: the law.
        probability: probability that a candidate belongs to the law; 1 for a given law.
    """
    found: list[MissingTerm | ParameterChange] = []
    for index, candidate in enumerate(law.candidates):
        included = probability(candidate)
        if candidate.equation is None:
            found.append(_parameter(system, law, index, included))
        else:
            found.append(_term(system, law, index, included))
    return found


def alternatives(discovery: Discovery, system: System) -> list[Alternative]:
    """Return all rivals, and other laws by score if there are fewer than three.

    If the best law has several terms, the best law of one term is among them for comparison.
    """
    best, rivals = discovery.best, discovery.rivals
    # By identity, because laws contain tensors, whose comparison is elementwise.
    rival_ids = {id(law) for law in rivals}
    others = [law for law in discovery.laws[1:] if id(law) not in rival_ids]
    chosen = [*rivals, *others[: max(0, ALTERNATIVES - len(rivals))]]
    single = [law for law in discovery.laws[1:] if len(law.candidates) == 1]
    chosen_ids = {id(law) for law in chosen}
    if single and len(best.candidates) > 1 and id(single[0]) not in chosen_ids:
        # It replaces an alternative that is not nearly as good as the best law.
        near = [law for law in chosen if law.score < best.score + NEAR]
        chosen = [*near, single[0]] if len(near) < ALTERNATIVES else chosen
    return [
        Alternative(
            terms=_terms_tried(system, law.candidates, law.coefficients.tolist()),
            delta_bic=law.score - best.score,
            rival=id(law) in rival_ids,
            same_as_best=_has_same_readings(discovery, law),
        )
        for law in chosen
    ]


def smaller_laws(discovery: Discovery, system: System) -> list[SmallerLaw]:
    """Return the best laws with fewer terms than the best law; none if it has a window.

    A law of k terms explains the share ``(F₀ - F_k) / (F₀ - F)``, with F₀ of the empty law, F_k of
    k terms and F of the best law.
    """
    count = len(discovery.best.candidates)
    misfits = {len(law.candidates): law.rmse**2 for law in discovery.path}
    if discovery.best.window is not None or not {0, count} <= misfits.keys() or not count:
        return []
    explained = misfits[0] - misfits[count]
    return [
        SmallerLaw(
            terms=_terms_tried(system, law.candidates, law.coefficients),
            explained=(misfits[0] - law.rmse**2) / explained,
        )
        for law in discovery.path
        if 0 < len(law.candidates) < count
    ]


def also_supported(discovery: Discovery, system: System) -> list[AlternativeTerm]:
    """Return the terms that the evidence supports beside the law in the headline."""
    pairs = discovery.also_supported
    return _terms_tried(system, [pair[0] for pair in pairs], [pair[1] for pair in pairs])


def _term(system: System, law: Law, index: int, included: float) -> MissingTerm:
    candidate = law.candidates[index]
    assert candidate.equation is not None
    found = MissingTerm(
        equation=candidate.equation,
        term=candidate.name,
        coefficient=float(law.coefficients[index]),
        std=float(law.std[index]),
        ci95=list(law.interval(index)),
        inclusion=included,
        region=region_of(system, law) if candidate.window is not None else None,
    )
    key = f"library.{candidate.equation}"
    expression = system.parse(candidate.name, key, equation=candidate.equation)
    unit = coefficient_unit(system, candidate.equation, expression)
    if unit is not None:
        found["unit"] = unit
    return found


def region_of(system: System, law: Law) -> list[Region] | None:
    """Return the region where the law acts, with the std of its edges; None for everywhere.

    The ``std`` of the edges of a box combines those of its centre and its half width.
    """
    window = law.window
    if window is None:
        return None
    region, stds = _region(system, window), law.edges
    region["std"] = math.hypot(stds[0], stds[1]) if window.shape.kind == "box" else stds[0]
    if window.shape.side is not None and law.threshold:
        region["ci95"] = list(law.threshold)
    return [region]


def _region(system: System, window: Window) -> Region:
    """Return the bounds of a window; those of a box are on the axis, and it may wrap around."""
    of, place = window.shape.of, window.values[0]
    match window.shape.side:
        case "above":
            return {"field": of, "above": place}
        case "below":
            return {"field": of, "below": place}
    if window.shape.axis is not None:
        begin, end = window.shape.axis.interval(place - window.values[1], place + window.values[1])
        return {"axis": of, "from": begin, "to": end}
    return {"axis": of, "from": place}


def _parameter(system: System, law: Law, index: int, included: float) -> ParameterChange:
    candidate = law.candidates[index]
    old = system.config.parameters[candidate.name]
    change, std = _change(system, law, index)
    found: ParameterChange = {
        "equation": None,
        "parameter": candidate.name,
        "term": candidate.name,
        "from": old,
        "to": old + change,
        "coefficient": change,
        "std": std,
        "ci95": [old + change + end for end in _interval_ends(system, law, index)],
        "aliases": list(candidate.aliases),
        "inclusion": included,
        "region": None,
        "exact": is_exact(system, candidate.name, float(law.coefficients[index])),
    }
    if candidate.name in system.units:
        found["unit"] = system.units[candidate.name]
    if meaning := offset_meanings(system.config, system.where).get(candidate.name):
        found["meaning"] = meaning
    return found


def _change(system: System, law: Law, index: int) -> tuple[float, float]:
    """Return the change of a parameter and its standard deviation."""
    name, xi = law.candidates[index].name, float(law.coefficients[index])
    std = float(law.std[index])
    ahead, behind = (parameter_change(system, name, xi + step) for step in (std / 2, -std / 2))
    return parameter_change(system, name, xi), abs(ahead - behind)


def _interval_ends(system: System, law: Law, index: int) -> list[float]:
    """Return the ends of the 95 % interval of a parameter, relative to its change."""
    name, xi = law.candidates[index].name, float(law.coefficients[index])
    change = exact_change(system, name, xi)
    found = []
    for end in law.interval(index):
        end_change = exact_change(system, name, end)
        found.append(end - xi if change is None or end_change is None else end_change - change)
    return sorted(found)


def _terms_tried(
    system: System, candidates: Sequence[Candidate], coefficients: Sequence[float]
) -> list[AlternativeTerm]:
    return [
        AlternativeTerm(
            equation=candidate.equation,
            term=candidate.name,
            coefficient=value
            if candidate.equation
            else parameter_change(system, candidate.name, value),
            window=None if candidate.window is None else _region(system, candidate.window),
        )
        for candidate, value in zip(candidates, coefficients, strict=True)
    ]


def _has_same_readings(discovery: Discovery, law: Law) -> bool:
    """Return whether the readings of a law and the best law differ by less than rivals do."""
    difference = discovery.noise.whiten(law.residuals - discovery.best.residuals)
    return float(difference.square().sum()) < AMBIGUITY_MARGIN
