"""A hidden state that explains what no law of the library does, one step beyond the library."""

from __future__ import annotations

from dataclasses import replace

from dashred.inference.hidden_states.search import (
    HIDDEN_GAIN,
    HiddenSearch,
    search_hidden_states,
)
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.pipeline.problem import Problem

# Prior standard deviation of the time constant in the fits that follow, as a share of it. The fit
# over segments has determined it with a wider one.
TAU_SPREAD = 1 / 3


def with_hidden_state(
    problem: Problem, found: SegmentSearch, beside: SegmentSearch | None
) -> tuple[Problem, SegmentSearch] | None:
    """Return the problem and the laws with a hidden state; None if the evidence supports none.

    Args:
        problem: with the candidates that may act beside it.
        found: its laws without hidden states.
        beside: the laws beside sensor errors, if there are any; a hidden state has to be better.
    """
    if found.problem.deadline.is_over or found.errors:
        return None
    equations = list(dict.fromkeys(term.equation for term in problem.library))
    hidden = search_hidden_states(found, problem.split.fit.sensors, equations)
    if hidden is None:
        return None
    if beside is not None:
        score, least = (each.walking(each.best).score for each in (hidden.found, beside))
        if not score + hidden.price < least - HIDDEN_GAIN:
            return None
    tau = hidden.state.tau
    state = replace(hidden.state, start=_start(problem, hidden), tau_spread=TAU_SPREAD * tau)
    return problem.with_hidden_state(state, hidden.equation, hidden.term), hidden.found


def _start(problem: Problem, hidden: HiddenSearch) -> str:
    """Return the start of what the hidden state follows; of an input its first value."""
    follows, system = hidden.state.follows, problem.system
    if follows in system.fields:
        return str(system.config.start[follows])
    first = system.input_signals.at(float(problem.times[0]))[follows]
    return f"{float(first):.6g}"
