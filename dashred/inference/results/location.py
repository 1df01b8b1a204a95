"""Location of the law: its equations, its states, its times and its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from scipy.stats import chi2
from torch import Tensor

from dashred.core.findings.law_schema import (
    Forcing,
    LocalisedSource,
    Profile,
    Region,
    SensorGain,
    Where,
)
from dashred.inference.fit.law import Law
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.forward.candidates import candidate_rates
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.results.explanation import region_of
from dashred.inference.results.regime import active_states
from dashred.inference.results.source_of_law import source_of_discovery
from dashred.physics.expressions import algebra
from dashred.physics.runs.tendency_size import tendency_size
from dashred.physics.system import System

# Largest number of points of the profile in time.
LONGEST_PROFILE = 200


def locate(
    system: System,
    discovery: Discovery,
    states: Tensor,
    times: Tensor,
    sensors: Sequence[str],
    recorded: Tensor,
    near: Tensor | None = None,
) -> Where:
    """Return ``findings["where"]``, for the fit window.

    Args:
        system: the simulator as it is.
        discovery: the best law and the empty law, each with its own start.
        states: trajectory of the best law, ``(time, field, *grid)``; for several episodes, the
            trajectory of the longest, whose times are used for the residuals of the others, too.
        times: times of the trajectory, ``(time,)``.
        sensors: names of the fit sensors, in the order of the residuals.
        recorded: σ of the noise as stated or estimated from the traces, ``(sensor,)``, in the order
            of the residuals. The residuals of a law that does not fit are no measure of it.
        near: whether each state is in the range of the recording, ``(time,)``; None if all are. A
            run that leaves it tells nothing about the states in which the law acts.
    """
    law = discovery.best
    ratios = law_tendency(system, law, states, times)
    # A trajectory that blows up says nothing after that.
    ratios[~ratios.flatten(1).isfinite().all(dim=1)] = 0.0
    shares = ratios.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
    total = float(shares.sum())
    power = ratios.square().sum(dim=1)
    visited = torch.ones(len(states), dtype=torch.bool) if near is None else near
    count = len(discovery.noise.available)
    old, new = (_padded(each.residuals, count) for each in (discovery.uncorrected, law))
    # Samples that either law leaves out, such as spikes, are not compared.
    left_out = old.isnan() | new.isnan()
    noise = replace(discovery.noise, available=discovery.noise.available & ~left_out)
    decrease = noise.whiten(old).square() - noise.whiten(new).square()
    of_traces = replace(noise, std=recorded, correlation=torch.zeros_like(noise.correlation))
    before, after = of_traces.whiten(old), of_traces.whiten(new)
    available = noise.available
    source = source_of_discovery(system, discovery, times)
    return Where(
        equation={
            field: float(share) / total if total else 0.0
            for field, share in zip(system.fields, shares, strict=True)
        },
        region=region_of(system, law) or _region_of_source(source),
        time=[float(times[0]), float(times[-1])],
        states=active_states(system, states[visited], power[visited], _reads(system, law))
        if total
        else None,
        sensors=_sensors(sensors, before, after, available, decrease, len(law.candidates)),
        significance=_significance(decrease, len(law.candidates), discovery.refit_count),
        profile=_profile(times, before, after, available),
        forcing=_forcing(system, discovery.forcing_map),
        source=_source(source, as_terms=law.source is not None),
    )


def _region_of_source(source: LocatedSource | None) -> list[Region] | None:
    """Return the region of a source on one axis; None of others, as for a law everywhere."""
    if source is None or len(source.axes) != 1:
        return None
    [axis], [(begin, end)], [std] = source.axes, source.region, source.place_std
    return [{"axis": axis, "from": begin, "to": end, "std": std}]


def _source(source: LocatedSource | None, *, as_terms: bool) -> LocalisedSource | None:
    if source is None:
        return None
    return LocalisedSource(
        equation=source.equation,
        place=list(source.place),
        place_std=list(source.place_std),
        region=[
            {"axis": axis, "from": begin, "to": end}
            for axis, (begin, end) in zip(source.axes, source.region, strict=True)
        ],
        period=source.period,
        period_std=source.period_std,
        begin=source.begin,
        begin_std=source.begin_std,
        strength=source.strength,
        strength_std=source.strength_std,
        share=source.share,
        times=list(source.times),
        rates=list(source.rates),
        as_terms=as_terms,
    )


def _padded(residuals: Tensor, count: int) -> Tensor:
    """Return residuals of the first samples with NaN after them, ``(time, sensor)``."""
    missing = residuals.new_full((count - len(residuals), residuals.shape[1]), torch.nan)
    return torch.cat([residuals, missing])


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
    """Return ``Σ ξ θ / rms(N)`` of every equation over a trajectory, ``(time, field, *grid)``.

    The part of each equation is in units of the rms of its tendency N over the trajectory, which
    makes equations with different units comparable.
    """
    rms = tendency_size(system, states, times)
    ratios = torch.zeros_like(states, dtype=torch.float64)
    for candidate, value in zip(law.candidates, law.coefficients.tolist(), strict=True):
        ratios += value * candidate_rates(system, candidate, states, times)
    return ratios / rms.reshape(-1, *(1,) * len(system.grid.shape))


def _reads(system: System, law: Law) -> set[str]:
    named = (algebra.names(term.expression) for c in law.candidates for term in c.terms)
    return set().union(*named) & set(system.fields)


def _sensors(
    names: Sequence[str],
    before: Tensor,
    after: Tensor,
    available: Tensor,
    decrease: Tensor,
    degrees_of_freedom: int,
) -> list[SensorGain]:
    """Return the gain of the law at each sensor, from residuals in units of the noise.

    p is the probability that noise alone lowers χ² of this sensor as much, with the same number of
    coefficients. It is not corrected for the search: ``significance`` tests whether there is a law,
    and p tests only at which sensors it has an effect.
    """
    found = []
    before, after, available, decrease = (
        part.reshape(-1, len(names)) for part in (before, after, available, decrease)
    )
    for column, name in enumerate(names):
        count = int(available[:, column].sum())
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
                p=float(chi2.sf(max(float(decrease[:, column].sum()), 0.0), degrees_of_freedom))
                if degrees_of_freedom
                else None,
            )
        )
    return found


def _significance(decrease: Tensor, degrees_of_freedom: int, tried: int) -> float | None:
    """Return the p-value of the law against the empty law, from a likelihood-ratio test.

    For noise alone, the decrease of χ² is χ²-distributed with one degree of freedom for each
    coefficient. The p-value is multiplied by the number of sets tried (Bonferroni).
    """
    if not degrees_of_freedom:
        return None
    chance = float(chi2.sf(max(float(decrease.sum()), 0.0), degrees_of_freedom))
    return min(1.0, chance * max(1, tried))


def _profile(times: Tensor, before: Tensor, after: Tensor, available: Tensor) -> Profile:
    """Return the rms residual in units of the noise by time, in at most 200 groups of samples."""
    # All groups but the last have the same size, so that the curve has one roughness.
    groups = torch.arange(len(times)).split(-(-len(times) // LONGEST_PROFILE))
    return Profile(
        times=[float(times[group].mean()) for group in groups],
        before=[_rms(before[group], available[group]) for group in groups],
        after=[_rms(after[group], available[group]) for group in groups],
    )


def _rms(scaled: Tensor, available: Tensor) -> float | None:
    count = int(available.sum())
    return float((scaled.square().sum() / count).sqrt()) if count else None
