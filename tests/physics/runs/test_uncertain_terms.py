"""Deviations of the coefficients of a law have its covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from dashred.physics.expressions.nodes import Name
from dashred.physics.runs.uncertain_terms import UncertainTerms
from dashred.physics.system import Term

ANY: Any = None
COVARIANCE = torch.tensor([[0.04, -0.03], [-0.03, 0.09]], dtype=torch.float64)
TERMS = (Term("x", Name("x")), Term("y", Name("x")), Term("x", Name("y")))


def test_deviations_have_the_covariance_and_terms_may_share_one() -> None:
    law = UncertainTerms(TERMS, (0, 0, 1), COVARIANCE)
    forcing = law.draw(ANY, ANY, ANY, 20_000, np.random.default_rng(0))
    assert forcing.terms == TERMS
    first, shared, second = forcing.coefficients.T
    torch.testing.assert_close(first, shared, rtol=0, atol=0)
    found = torch.cov(torch.stack([first, second]))
    torch.testing.assert_close(found, COVARIANCE, rtol=0.05, atol=0)
    assert forcing.coefficients.mean(dim=0).abs().max() < 0.01


def test_a_law_that_is_known_exactly_has_no_deviations() -> None:
    law = UncertainTerms(TERMS, (0, 0, 1), torch.zeros(2, 2, dtype=torch.float64))
    assert not law.draw(ANY, ANY, ANY, 5, np.random.default_rng(0)).coefficients.any()


def test_the_empty_law_has_no_terms() -> None:
    law = UncertainTerms((), (), torch.zeros(0, 0, dtype=torch.float64))
    forcing = law.draw(ANY, ANY, ANY, 5, np.random.default_rng(0))
    assert forcing.terms == () and forcing.coefficients.shape == (5, 0)


def test_its_identity_depends_on_the_covariance() -> None:
    one, other = (UncertainTerms(TERMS, (0, 0, 1), factor * COVARIANCE) for factor in (1, 2))
    assert one.identity != other.identity
