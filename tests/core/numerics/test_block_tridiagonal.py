"""The banded solution is that of the whole matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.numerics.block_tridiagonal import Array, BlockNormal


def assembled(normal: BlockNormal) -> tuple[Array, Array]:
    """Return the whole matrix and its right-hand side."""
    nodes, fields = normal.node_gradient.shape
    size = nodes * fields
    whole = np.zeros((size + len(normal.corner),) * 2)
    for k in range(nodes):
        mine = slice(k * fields, (k + 1) * fields)
        whole[mine, mine] = normal.diagonal[k]
        whole[mine, size:] = normal.border[k]
        whole[size:, mine] = normal.border[k].T
        if k + 1 < nodes:
            ahead = slice((k + 1) * fields, (k + 2) * fields)
            whole[mine, ahead] = normal.upper[k]
            whole[ahead, mine] = normal.upper[k].T
    whole[size:, size:] = normal.corner
    return whole, np.concatenate([normal.node_gradient.ravel(), normal.shared_gradient])


def drawn(nodes: int, fields: int, shared: int) -> BlockNormal:
    rng = np.random.default_rng(nodes)
    square = rng.standard_normal((nodes, fields, fields))
    corner = rng.standard_normal((shared, shared))
    return BlockNormal(
        diagonal=square @ square.swapaxes(1, 2) + 9 * np.eye(fields),
        upper=rng.standard_normal((nodes - 1, fields, fields)),
        border=0.1 * rng.standard_normal((nodes, fields, shared)),
        corner=corner @ corner.T + 9 * np.eye(shared),
        node_gradient=rng.standard_normal((nodes, fields)),
        shared_gradient=rng.standard_normal(shared),
        cost=100.0,
    )


@pytest.mark.parametrize(
    ("nodes", "fields", "shared"), [(1, 3, 2), (7, 3, 4), (6, 1, 2), (5, 4, 0)]
)
def test_a_step_solves_the_whole_system(nodes: int, fields: int, shared: int) -> None:
    normal = drawn(nodes, fields, shared)
    whole, right = assembled(normal)
    step = normal.step(0.0)
    assert step is not None
    np.testing.assert_allclose(
        np.concatenate([step[0].ravel(), step[1]]), np.linalg.solve(whole, right)
    )
    assert normal.decrease(step) == pytest.approx(right @ np.linalg.solve(whole, right))


def test_damping_multiplies_what_it_is_given() -> None:
    normal = replace(drawn(7, 3, 4), damped=np.full((7, 3), 2.0))
    whole, right = assembled(normal)
    damped = np.concatenate([np.full(21, 2.0), normal.corner.diagonal()])
    step = normal.step(0.3)
    assert step is not None
    expected = np.linalg.solve(whole + 0.3 * np.diag(damped), right)
    np.testing.assert_allclose(np.concatenate([step[0].ravel(), step[1]]), expected)


def test_profiling_eliminates_the_nodes() -> None:
    normal = drawn(7, 3, 4)
    whole, right = assembled(normal)
    profiled = normal.profiled()
    assert profiled is not None
    gram, target, constant = profiled
    shared = np.array([0.3, -0.2, 0.1, 0.5])
    inner, border = whole[:21, :21], whole[:21, 21:]
    nodes = np.linalg.solve(inner, right[:21] - border @ shared)
    both = np.concatenate([nodes, shared])
    expected = normal.cost - 2 * right @ both + both @ whole @ both
    assert constant - 2 * target @ shared + shared @ gram @ shared == pytest.approx(expected)


def test_a_matrix_that_is_not_positive_definite_has_no_step() -> None:
    normal = drawn(3, 2, 1)
    normal.diagonal[1] *= -1
    assert normal.step(0.0) is None and normal.profiled() is None
