"""Sparse regression: it finds a known law, proposes nothing else, and ignores units."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.latent_sindy.blocks import Blocks
from dashred.inference.latent_sindy.sparse_regression import SparseFit, sparse_fit

BLOCKS, ROWS, TERMS = 15, 40, 12
THRESHOLD, BOOTSTRAPS = 0.05, 10
LAW = {2: 0.7, 9: -1.5}


def columns(rng: np.random.Generator) -> np.ndarray:
    """Correlated columns, as of a library, ``(block, term, row)``."""
    independent = rng.standard_normal((BLOCKS, TERMS, ROWS))
    return independent + 0.8 * rng.standard_normal((BLOCKS, 1, ROWS))


def target(design: np.ndarray, law: dict[int, float]) -> np.ndarray:
    zero = np.zeros((BLOCKS, ROWS))
    return sum((value * design[:, j] for j, value in law.items()), zero)


def fit(expected: np.ndarray, design: np.ndarray, *, seed: int = 0) -> SparseFit:
    rng = np.random.default_rng(seed)
    return sparse_fit(Blocks.from_arrays(expected, design), THRESHOLD, BOOTSTRAPS, rng)


def support(found: SparseFit) -> set[int]:
    return set(np.flatnonzero(found.coefficients).tolist())


@pytest.fixture
def noisy() -> tuple[np.ndarray, np.ndarray]:
    """The law's target with 30 % of noise, and the columns."""
    rng = np.random.default_rng(5)
    design = columns(rng)
    clean = target(design, LAW)
    return clean + 0.3 * clean.std() * rng.standard_normal(clean.shape), design


def test_blocks_sum_up_the_normal_equations(noisy):
    expected, design = noisy
    blocks = Blocks.from_arrays(expected, design)
    matrix = design.transpose(0, 2, 1).reshape(-1, TERMS)
    np.testing.assert_allclose(blocks.gram.sum(axis=0), matrix.T @ matrix)
    np.testing.assert_allclose(blocks.moment.sum(axis=0), matrix.T @ expected.ravel())
    np.testing.assert_allclose(blocks.power.sum(), (expected**2).sum())
    assert blocks.rows.tolist() == [ROWS] * BLOCKS
    twice = blocks.weighted(np.arange(BLOCKS, dtype=float))
    np.testing.assert_allclose(twice.gram[3], 3 * blocks.gram[3])
    kept = np.arange(BLOCKS) < 4
    np.testing.assert_allclose(blocks.selected(kept).moment, blocks.moment[:4])


def test_a_sparse_law_is_found_in_noise(noisy):
    found = fit(*noisy)
    assert support(found) == set(LAW)
    for j, value in LAW.items():
        assert found.coefficients[j] == pytest.approx(value, rel=0.06)
        assert found.inclusion[j] == 1.0
    assert set(found.ranking[:2]) == set(LAW)


def test_a_law_without_noise_is_found_exactly():
    design = columns(np.random.default_rng(1))
    found = fit(target(design, LAW), design)
    assert support(found) == set(LAW)
    expected = [LAW.get(j, 0.0) for j in range(TERMS)]
    np.testing.assert_allclose(found.coefficients, expected, rtol=1e-9)


def test_two_terms_that_nearly_cancel_are_found():
    rng = np.random.default_rng(2)
    design = columns(rng)
    design[:, 1] = design[:, 0] + 0.1 * design[:, 1]
    design[:, 2] = (design[:, 1] - design[:, 0]) + 0.12 * design[:, 2]
    expected = target(design, {0: -1.0, 1: 1.0})
    expected = expected + 0.02 * expected.std() * rng.standard_normal(expected.shape)
    found = fit(expected, design)
    assert found.ranking[0] == 2 or support(found) == {0, 1}
    assert support(found) == {0, 1}


@pytest.mark.parametrize("hidden", [0.0, 0.7])
def test_a_library_of_one_term(hidden: float) -> None:
    """The other columns may be zero: terms without an effect on the sensors."""
    rng = np.random.default_rng(4)
    design = columns(rng)
    design[:, 1:] = 0.0
    noise = 0.1 * rng.standard_normal((BLOCKS, ROWS))
    found = fit(hidden * design[:, 0] + noise, design)
    assert support(found) == ({0} if hidden else set())


def test_noise_alone_proposes_nothing():
    invented = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 1])
        found = fit(rng.standard_normal((BLOCKS, ROWS)), columns(rng))
        invented += bool(support(found))
    assert invented <= 2


def test_a_repeating_error_below_the_threshold_is_not_a_term():
    design = columns(np.random.default_rng(3))
    design -= design.mean(axis=(0, 2), keepdims=True)
    clean = target(design, LAW)
    small = 0.03 * clean.std() / design[:, 6].std()
    assert support(fit(clean + small * design[:, 6], design)) == set(LAW)
    large = 5 * small
    assert support(fit(clean + large * design[:, 6], design)) == {*LAW, 6}


def test_the_path_falls_from_one(noisy):
    found = fit(*noisy)
    sizes, errors = zip(*found.path, strict=True)
    assert sizes[0] == 0
    assert errors[0] == pytest.approx(1.0)
    assert list(sizes) == sorted(set(sizes))
    # Sets along the path are not nested, but the best two terms leave only the noise.
    noise = 0.3 / np.sqrt(1 + 0.3**2)
    assert dict(found.path)[2] == pytest.approx(noise, rel=0.05)
    assert dict(found.path)[1] > 1.2 * dict(found.path)[2]
    assert min(errors) > 0.95 * noise * np.sqrt(1 - TERMS / (BLOCKS * ROWS))


def test_the_ranking_names_every_term_once_and_the_proposed_ones_first(noisy):
    found = fit(*noisy)
    assert sorted(found.ranking) == list(range(TERMS))
    count = len(support(found))
    assert set(found.ranking[:count]) == support(found)


def test_zero_columns_are_skipped(noisy):
    expected, design = noisy
    whole = fit(expected, design)
    emptied = design.copy()
    emptied[:, 4] = 0.0
    found = fit(expected, emptied)
    assert np.isfinite(found.coefficients).all()
    assert support(found) == support(whole)
    assert found.coefficients[4] == found.inclusion[4] == 0.0
    assert found.ranking[-1] == 4


def test_a_target_of_zero_proposes_nothing(noisy):
    _, design = noisy
    found = fit(np.zeros((BLOCKS, ROWS)), design)
    assert support(found) == set()
    assert np.isfinite([error for _, error in found.path]).all()


def test_zero_columns_alone_propose_nothing(noisy):
    expected, design = noisy
    found = fit(expected, np.zeros_like(design))
    assert support(found) == set()
    assert found.ranking == list(range(TERMS))


def test_collinear_columns_do_not_both_enter(noisy):
    expected, design = noisy
    doubled = design.copy()
    doubled[:, 0] = -3 * design[:, 2]
    found = fit(expected, doubled)
    assert len(support(found)) == 2
    assert 9 in support(found)


def test_units_of_the_columns_do_not_matter(noisy):
    expected, design = noisy
    units = 10.0 ** np.linspace(-6, 6, TERMS)
    plain, scaled = fit(expected, design), fit(expected, design * units[:, None])
    assert support(scaled) == support(plain)
    np.testing.assert_allclose(scaled.coefficients * units, plain.coefficients, rtol=1e-6)
    np.testing.assert_allclose(scaled.contribution, plain.contribution, rtol=1e-6)
    np.testing.assert_array_equal(scaled.inclusion, plain.inclusion)
    assert scaled.ranking == plain.ranking


def test_units_of_the_target_do_not_matter(noisy):
    expected, design = noisy
    plain, scaled = fit(expected, design), fit(1e-5 * expected, design)
    np.testing.assert_allclose(scaled.coefficients, 1e-5 * plain.coefficients, rtol=1e-6)
    assert scaled.ranking == plain.ranking


def test_the_same_seed_gives_the_same_answer(noisy):
    expected, design = noisy
    first, again = (fit(expected, design, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.coefficients, again.coefficients)
    np.testing.assert_array_equal(first.inclusion, again.inclusion)
    assert first.ranking == again.ranking
    assert first.path == again.path


def test_inclusion_separates_stable_terms_from_chance():
    rng = np.random.default_rng(8)
    design = columns(rng)
    expected = target(design, {2: 1.0}) + 1.5 * rng.standard_normal((BLOCKS, ROWS))
    found = fit(expected, design)
    assert found.inclusion[2] == 1.0
    others = np.delete(found.inclusion, 2)
    assert others.mean() < 0.9
    assert ((others >= 0) & (others <= 1)).all()


def test_few_blocks_are_sufficient():
    design = columns(np.random.default_rng(1))[:2]
    expected = target(np.concatenate([design] * 8)[:BLOCKS], LAW)[:2]
    found = fit(expected, design)
    assert set(LAW) <= support(found)


def test_one_block_proposes_nothing():
    design = columns(np.random.default_rng(1))
    assert support(fit(target(design, LAW)[:1], design[:1])) == set()
