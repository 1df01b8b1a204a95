"""The two ways to evaluate a forcing agree, and the cheaper one is taken."""

from __future__ import annotations

import pytest
import torch

from dashred.physics.solvers.dense_forcing import DenseForcing, forcing_evaluator
from dashred.physics.solvers.forcing import Forcing, RowwiseForcing
from dashred.physics.system import System, Term

TEXTS = {"u": ("1", "u*v", "sin(2*pi*x/5)", "u*d(v, x)"), "v": ("v**3", "d(u, x, 3)")}


@pytest.mark.parametrize("equations", [("u", "v"), ("v",)])
def test_dense_and_rowwise_forcing_agree(reaction: System, equations: tuple[str, ...]) -> None:
    terms = tuple(
        Term(name, reaction.parse(text, "library", equation=name))
        for name in equations
        for text in TEXTS[name]
    )
    generator = torch.Generator().manual_seed(0)
    state = torch.randn(3, 2, 32, generator=generator, dtype=torch.float64)
    coefficients = torch.randn(3, len(terms), generator=generator, dtype=torch.float64)
    forcing = Forcing(terms, coefficients)
    values = reaction.values(state, 0.0)
    pair = [
        [torch.as_tensor(reaction.operators.on_grid(v)).expand(3, 32) for v in evaluate(values)]
        for evaluate in (
            DenseForcing(forcing, reaction.fields, reaction.operators),
            RowwiseForcing(forcing, reaction.fields, reaction.operators),
        )
    ]
    torch.testing.assert_close(torch.stack(pair[0]), torch.stack(pair[1]))


def test_few_carriers_are_evaluated_row_by_row(reaction: System) -> None:
    terms = tuple(Term("u", reaction.parse(t, "library", equation="u")) for t in TEXTS["u"])
    sparse, full = torch.zeros(8, 4).double(), torch.ones(8, 4).double()
    sparse[0, 0] = 1.0
    for coefficients, kind in ((sparse, RowwiseForcing), (full, DenseForcing)):
        forcing = Forcing(terms, coefficients)
        found = forcing_evaluator(forcing, reaction.fields, reaction.operators)
        assert type(found) is kind
    none = Forcing((), torch.zeros(8, 0).double())
    rowwise = forcing_evaluator(none, reaction.fields, reaction.operators)
    assert isinstance(rowwise, RowwiseForcing)
