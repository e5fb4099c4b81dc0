"""Matching and blocks, on matrices whose structure is known by construction."""

import casadi as ca
import numpy as np
import pytest
from scipy.sparse import csr_array

from backsight.models import Component, Model, ModelError, Variable, compile_model, equal
from backsight.models.compilation.structure import blocks, fault


@pytest.mark.parametrize("seed", range(5))
def test_a_hidden_block_triangular_form_is_found(seed: int) -> None:
    generator = np.random.default_rng(seed)
    sizes = generator.integers(1, 4, 6)
    ends = np.cumsum(sizes)
    matrix = np.triu(generator.random((ends[-1], ends[-1])) < 0.3)
    for start, end in zip(ends - sizes, ends, strict=True):
        matrix[start:end, start:end] = True  # irreducible
        matrix[end:, start:end] = False
    rows, columns = generator.permutation(ends[-1]), generator.permutation(ends[-1])
    found = blocks(csr_array(matrix[rows][:, columns]))
    assert found is not None
    truth = {frozenset(range(start, end)) for start, end in zip(ends - sizes, ends, strict=True)}
    assert {frozenset(rows[own].tolist()) for own, _ in found} == truth
    assert {frozenset(columns[own].tolist()) for _, own in found} == truth
    assert all(frozenset(rows[r].tolist()) == frozenset(columns[c].tolist()) for r, c in found)


def test_without_a_perfect_matching_there_are_no_blocks() -> None:
    assert blocks(csr_array(np.array([[True, True], [False, False]]))) is None
    assert blocks(csr_array(np.ones((2, 3), dtype=bool))) is None


def test_the_parts_at_fault_are_the_over_and_the_under_determined() -> None:
    incidence = np.zeros((5, 5), dtype=bool)
    incidence[0, 0] = incidence[1, 0] = incidence[2, 1] = incidence[3, [2, 3]] = True
    incidence[4, [2, 3, 4]] = True
    assert fault(incidence) == fault(csr_array(incidence)) == ([0, 1], [0], [3, 4], [2, 3, 4])


class Turned(Component):
    """x = 1 - y, and the same again multiplied by an expression that is 2 in truth: singular in value, sound in structure."""

    x, y, z = Variable("1"), Variable("1"), Variable("1")

    def equations(self, c):  # type: ignore[no-untyped-def]
        two = 2 * (ca.sin(c.z) ** 2 + ca.cos(c.z) ** 2)
        return {
            "third": equal(c.z**3 + c.z, 1),
            "one": equal(c.x**3 + c.y**3, 1),
            "two": equal(two * c.x**3 + two * c.y**3, 2),
        }


def test_equations_that_depend_on_each_other_are_named_among_those_that_do_not() -> None:
    with pytest.raises(ModelError, match=r"singular: the equations 'one of b', 'two of b' depend on each other"):
        compile_model(Model(name="m", components={"b": Turned()}))
