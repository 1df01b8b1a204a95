"""Where the law acts: in which equation, in which states, when, and at which sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from scipy.stats import chi2
from torch import Tensor

from dashred.core.findings.law_schema import Forcing, Profile, SensorGain, Where
from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.results.explanation import region_of
from dashred.inference.results.regime import active_states
from dashred.physics.expressions import algebra
from dashred.physics.library import evaluate_terms
from dashred.physics.system import System, Term

# A long recording's profile is binned to so many points.
LONGEST_PROFILE = 200


def locate(
    system: System,
    discovered: Discovery,
    states: Tensor,
    times: Tensor,
    sensors: Sequence[str],
) -> Where:
    """Return ``findings["where"]``; everything in it is of the fit window.

    Args:
        system: the simulator as it is.
        discovered: the best law and the simulator without it, both with their own starts.
        states: the best law's trajectory, ``(time, field, *grid)``; of several episodes, that of
            the longest, whose clock is used for the residuals of the others, too.
        times: its clock, ``(time,)``.
        sensors: names of the fit sensors, in the order of the residuals.
    """
    law = discovered.best
    ratios = law_tendency(system, law, states, times)
    shares = ratios.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
    total = float(shares.sum())
    power = ratios.square().sum(dim=1)
    # A sample that either leaves out, as a spike, cannot compare the two.
    left_out = law.residuals.isnan() | discovered.uncorrected.residuals.isnan()
    noise = replace(discovered.noise, seen=discovered.noise.seen & ~left_out)
    before, after = noise.whiten(discovered.uncorrected.residuals), noise.whiten(law.residuals)
    seen = noise.seen
    return Where(
        equation={
            field: float(share) / total if total else 0.0
            for field, share in zip(system.fields, shares, strict=True)
        },
        region=region_of(law),
        time=[float(times[0]), float(times[-1])],
        states=active_states(system, states, power, _reads(system, law)) if total else None,
        sensors=_sensors(sensors, before, after, seen, len(law.candidates)),
        significance=_significance(before, after, len(law.candidates), discovered.refit_count),
        profile=_profile(times, before, after, seen),
        forcing=_forcing(system, discovered.forcing_map),
    )


def _forcing(system: System, found: ForcingMap | None) -> Forcing | None:
    if found is None:
        return None
    return Forcing(
        places=found.places.tolist(),
        times=found.times.tolist(),
        amplitude=dict(zip(system.fields, found.amplitudes.tolist(), strict=True)),
        std=dict(zip(system.fields, found.stds.tolist(), strict=True)),
        peak=found.peak,
        gain=found.gain,
    )


def law_tendency(system: System, law: Law, states: Tensor, times: Tensor) -> Tensor:
    """Return ``Σ ξ θ / rms(N)`` of every equation over a trajectory: ``(time, field, *grid)``.

    Each equation's part is in units of the rms, over the trajectory, of that equation's own
    tendency N: so equations with different units compare.
    """
    own = [Term(field, system.equations[field]) for field in system.fields]
    rms = evaluate_terms(system, own, states, times).flatten(1).square().mean(dim=1).sqrt()
    ratios = torch.zeros_like(states, dtype=torch.float64)
    for candidate, value in zip(law.candidates, law.coefficients.tolist(), strict=True):
        columns = evaluate_terms(system, candidate.terms, states, times)
        for term, column in zip(candidate.terms, columns, strict=True):
            index = system.fields.index(term.equation)
            ratios[:, index] += value * column / rms[index].clamp(min=1e-300)
    return ratios


def _reads(system: System, law: Law) -> set[str]:
    named = (algebra.names(term.expression) for c in law.candidates for term in c.terms)
    return set().union(*named) & set(system.fields)


def _sensors(
    names: Sequence[str], before: Tensor, after: Tensor, seen: Tensor, freedoms: int
) -> list[SensorGain]:
    """Return what the law gains at each sensor.

    p is the chance that noise alone lets χ² of this sensor fall so far under as many free
    coefficients; the search is not held against it: `significance` asks whether there is a law,
    this only where it shows.
    """
    found = []
    before, after, seen = (part.reshape(-1, len(names)) for part in (before, after, seen))
    for column, name in enumerate(names):
        count = int(seen[:, column].sum())
        if not count:
            found.append(SensorGain(name=name, before=None, after=None, gain=None, p=None))
            continue
        old, new = (float(part[:, column].square().sum()) for part in (before, after))
        found.append(
            SensorGain(
                name=name,
                before=old / count,
                after=new / count,
                gain=(old - new) / count,
                p=float(chi2.sf(max(old - new, 0.0), freedoms)) if freedoms else None,
            )
        )
    return found


def _significance(before: Tensor, after: Tensor, freedoms: int, tried: int) -> float | None:
    """Return p of the law against nothing: a likelihood ratio, corrected for the search.

    Under noise alone the fall of χ² is χ²-distributed with a degree of freedom for each
    coefficient; the best of so many tried sets is expected to fall that much farther (Bonferroni).
    """
    if not freedoms:
        return None
    fall = float(before.square().sum() - after.square().sum())
    return min(1.0, float(chi2.sf(max(fall, 0.0), freedoms)) * max(1, tried))


def _profile(times: Tensor, before: Tensor, after: Tensor, seen: Tensor) -> Profile:
    """Return the rms whitened residual at each time, or of each of 200 stretches of time."""
    bins = min(len(times), LONGEST_PROFILE)
    groups = torch.tensor_split(torch.arange(len(times)), bins)
    return Profile(
        times=[float(times[group].mean()) for group in groups],
        before=[_rms(before[group], seen[group]) for group in groups],
        after=[_rms(after[group], seen[group]) for group in groups],
    )


def _rms(whitened: Tensor, seen: Tensor) -> float | None:
    count = int(seen.sum())
    return float((whitened.square().sum() / count).sqrt()) if count else None
