"""Terms that act everywhere are followed beyond the first part of a record; a source is not."""

from __future__ import annotations

import torch

from dashred.inference.hypotheses.first_part import first_parts
from dashred.inference.hypotheses.sources.bump import Bump
from dashred.inference.hypotheses.terms_everywhere import (
    TermsEverywhere,
    best_terms_everywhere,
    follow_beyond,
)
from tests.channel import Channel

FIRST = 6


def searched(channel: Channel, hidden: list[tuple[str, float]]) -> tuple[TermsEverywhere, bool]:
    """Return the best terms over the first part of a recording, and whether they go on."""
    null = channel.objective(channel.recorded(hidden))
    phi = torch.zeros(null.modes, dtype=torch.float64)
    part = next(first_parts(null, phi, FIRST, channel.size))
    objective = channel.objective(null.recorded, channel.library)
    everywhere = best_terms_everywhere(objective, part)
    return everywhere, follow_beyond(objective, part, everywhere)


def test_a_term_everywhere_is_followed(channel: Channel) -> None:
    everywhere, follows = searched(channel, [("c", -0.1)])
    assert everywhere.explain and follows
    names = [str(channel.library[j]) for j in everywhere.members]
    assert "c: c" in names


def test_a_source_is_not_followed_by_terms_everywhere(channel: Channel) -> None:
    source = f"{Bump((8.2,), 0.4).text(channel.system)}*1"
    _, follows = searched(channel, [(source, 0.3)])
    assert not follows
