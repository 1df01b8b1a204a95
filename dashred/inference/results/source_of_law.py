"""The localised source that a discovery has found, also if its law is a constant in a region."""

from __future__ import annotations

import math

from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.hypotheses.result import Discovery
from dashred.physics.system import System


def source_of_discovery(
    system: System, discovery: Discovery, times: Tensor
) -> LocatedSource | None:
    """Return the localised source of a discovery; None without one.

    Args:
        system: the simulator.
        discovery: the laws, and the source.
        times: of the fit window, ``(time,)``.
    """
    law = discovery.best
    if discovery.source is not None or not _is_constant_in_box(system, law):
        return discovery.source
    [candidate], window, [axis] = law.candidates, law.window, system.axes
    assert window is not None and candidate.equation is not None
    centre, half = window.values[:2]
    value, std = float(law.coefficients[0]), float(law.std[0])
    strength = 2 * half * value
    before, after = (max(found.chi2 - 1, 0.0) for found in (discovery.uncorrected, law))
    ends = float(times[0]), float(times[-1])
    return LocatedSource(
        equation=candidate.equation,
        axes=(axis.name,),
        place=(axis.wrap(centre),),
        place_std=(law.edges[0],),
        region=(axis.interval(centre - half, centre + half),),
        period=None,
        period_std=None,
        begin=None,
        begin_std=None,
        strength=strength,
        strength_std=2 * math.hypot(half * std, law.edges[1] * value),
        share=1 - after / before if before else 0.0,
        times=ends,
        rates=(strength, strength),
    )


def _is_constant_in_box(system: System, law: Law) -> bool:
    """Return whether a law is a single constant in a region of the only axis."""
    window, names = law.window, [candidate.name for candidate in law.candidates]
    return (
        window is not None
        and window.shape.kind == "box"
        and names == ["1"]
        and len(system.axes) == 1
    )
