"""Numerical rank and null spaces of matrices whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.models.analysis.null_space import Direction, directions, rank_of, together

rng = np.random.default_rng(1)


def dependent(size: float = 1.0, noise: float = 0.0) -> np.ndarray:
    """Four columns, of which the last is the sum of the first two, their sizes `size` apart."""
    free = rng.normal(size=(30, 3))
    matrix = np.column_stack([free, free[:, 0] + free[:, 1]])
    return matrix * np.array([1.0, size, 1.0, 1.0 / size]) + noise * rng.normal(size=matrix.shape)


@pytest.mark.parametrize("size", [1.0, 1e4, 1e-5])
def test_the_rank_does_not_depend_on_the_sizes_of_the_columns(size: float) -> None:
    rank = rank_of(dependent(size))
    assert (rank.number, rank.deficiency, rank.clear) == (3, 1, True)
    assert [rank.lowered_without(i) for i in range(4)] == [False, False, True, False]


def test_columns_that_nearly_depend_are_independent_with_a_small_margin() -> None:
    matrix = dependent()
    matrix[:, 3] += 1e-7 * rng.normal(size=30)
    rank = rank_of(matrix)
    assert rank.number == 4
    assert 1e-9 < rank.margin(0) < 1e-6
    assert rank.margin(2) > 0.1


def test_the_margin_is_the_sine_of_the_angle_to_the_others() -> None:
    angle = 0.3
    columns = np.array([[1.0, np.cos(angle), 0.0], [0.0, np.sin(angle), 0.0], [0.0, 0.0, 5.0]])
    rank = rank_of(columns)
    assert [rank.margin(i) for i in range(3)] == pytest.approx([np.sin(angle), np.sin(angle), 1.0])


def test_noise_that_fills_the_gap_is_said() -> None:
    left, right = (np.linalg.qr(rng.normal(size=(5, 5)))[0] for _ in range(2))
    rank = rank_of(left @ np.diag([1.0, 1e-2, 1e-5, 1e-9, 5e-12]) @ right)
    assert not rank.clear
    assert rank.kept < 1e3 * rank.dropped


def test_an_empty_column_counts_for_nothing() -> None:
    rank = rank_of(np.diag([1.0, 0.0, 2.0]))
    assert (rank.number, rank.deficiency) == (2, 0)
    assert rank_of(np.zeros((3, 3))).number == 0


def sensitivities(values: np.ndarray) -> np.ndarray:
    """Outputs of a b and c + d on a state-free model, to relative changes of a, b, c, d."""
    a, b, c, d = values
    outputs = np.random.default_rng(5).normal(size=(20, 2))
    return outputs @ np.array([[a * b, a * b, 0.0, 0.0], [0.0, 0.0, c, d]])


def test_products_and_sums_are_told_by_what_the_experiments_have_in_common() -> None:
    values = [np.array([1.3, 2.0, 0.7, 5.0]), np.array([1.1, 2.6, 0.6, 4.0]), np.array([1.6, 1.7, 0.9, 4.4])]
    draws = [(rank_of(sensitivities(v)), v) for v in values]
    found = directions(draws, ["a", "b", "c", "d"], [0, 1, 2, 3], [])
    assert {d.kind: {name: abs(v) for name, v in d.changes.items()} for d in found} == {
        "factor": {"a": 1.0, "b": 1.0},
        "summand": {"c": 1.0, "d": 1.0},
    }
    assert all(np.prod(list(d.changes.values())) == -1.0 for d in found)
    once = directions(draws[:1], ["a", "b", "c", "d"], [0, 1, 2, 3], [])
    assert {d.kind for d in once} == {"local"}


def test_local_directions_that_share_parameters_are_one_sentence() -> None:
    found = [
        Direction(changes={"a": 1.0, "b": -0.37}, pivot="a", kind="local"),
        Direction(changes={"e": 1.0, "f": 2.0}, pivot="e", kind="factor"),
        Direction(changes={"b": 0.2, "c": 1.0}, pivot="c", kind="local"),
    ]
    assert together(found) == [
        "only in combination: e*c, f*c^2 (any factor c leaves the outputs as they are)",
        "only in combination: a, b, c (2 of them must be known, for instance a, c)",
    ]


def test_a_direction_reads_as_what_can_be_changed() -> None:
    assert str(Direction(changes={"a": -2.5, "b": 1.0}, pivot="b", kind="summand", states=("x",))) == (
        "only in combination: a - 2.5 c, b + c (any summand c leaves the outputs as they are, with other initial x)"
    )
    assert "a +1 %, b -0.5 %" in str(Direction(changes={"a": 1.0, "b": -0.5}, pivot="a", kind="local"))
