"""Functions at many columns against CasADi's own map of them."""

import casadi as ca
import numpy as np
import pytest

from backsight.ocp import columnwise
from backsight.ocp.columnwise import FEWEST, OPERATIONS, REPAYS, STRIP, Columnwise, matrices

RNG = np.random.default_rng(0)


def everything():
    """A function with all kinds of operations that an expression can have, of (x, p, y)."""
    x, p, y = ca.SX.sym("x", 3), ca.SX.sym("p", 2), ca.SX.sym("y", 2)
    a, b = x[0], y[0]
    unit = ca.tanh(a) * 0.9
    parts = [
        ca.exp(a), ca.log(a**2 + 1), ca.sqrt(ca.fabs(b)), ca.sin(a), ca.cos(b), ca.tan(unit), ca.asin(unit), ca.acos(unit), ca.atan(a),
        ca.sinh(unit), ca.cosh(unit), ca.asinh(a), ca.acosh(a**2 + 1), ca.atanh(unit), ca.atan2(a, b), ca.log1p(a**2), ca.expm1(unit),
        a < b, a <= b, a == b, a != b, ca.logic_not(a > 0), ca.logic_and(a > 0, b > 0), ca.logic_or(a > 0, b > 0), ca.floor(a), ca.ceil(b),
        ca.fmod(a, b), ca.sign(a), ca.copysign(a, b), ca.if_else(a > 0, ca.sqrt(a), b), ca.fmin(a, b), ca.fmax(a, b), 1 / a, a + a, -a,
        ca.fabs(a) ** p[0], x[1] ** 3, ca.hypot(a, b), a / b - x[2] * p[1], p[0] * p[1] + ca.sin(p[0]), ca.SX(2.5), p[1],
    ]  # fmt: skip
    return ca.Function("everything", [x, p, y], [ca.vertcat(*parts), a * ca.vertcat(y, p)])


def by_map(function, x, p, y):
    count = x.shape[1]
    return [np.asarray(part) for part in function.map(count)(x, np.repeat(p[:, None], count, axis=1), y)]


def at(count):
    return RNG.normal(size=(3, count)), RNG.uniform(0.5, 2.0, 2), RNG.normal(size=(2, count))


def repaid(function, shared):
    """Called so often that its operations have been read."""
    wide = Columnwise(function, shared)
    while wide._seen < REPAYS:
        wide(*at(FEWEST))
    return wide


def test_every_kind_of_operation_is_among_those_tried():
    f = everything()
    tried = {f.instruction_id(k) for k in range(f.n_instructions())}
    rare = {ca.OP_ASSIGN, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV, ca.OP_FABS}  # CasADi may write them otherwise
    assert set(OPERATIONS) - tried <= rare


@pytest.mark.parametrize("count", [1, FEWEST - 1, FEWEST, STRIP, STRIP + 1, 2 * STRIP + 777])
def test_results_are_those_of_the_map(count):
    f = everything()
    wide = repaid(f, (1,))
    for _ in range(2):  # another time in the same work vector, with other parameters
        x, p, y = at(count)
        for got, wanted in zip(wide(x, p, y), by_map(f, x, p, y), strict=True):
            assert got.shape == wanted.shape
            np.testing.assert_allclose(got, wanted, rtol=1e-13, atol=1e-13)


def test_numbers_that_are_none_go_through_as_in_the_map():
    f = everything()
    wide = repaid(f, (1,))
    x, p, y = at(FEWEST)
    x[0, 3], y[0, 5], y[0, 7] = np.nan, np.inf, 0.0
    for got, wanted in zip(wide(x, p, y), by_map(f, x, p, y), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-13, atol=1e-13)


def test_a_function_that_calls_another_is_left_to_the_map():
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    f = ca.Function("outer", [x], [ca.SX(inner(x)) * 2])
    wide = Columnwise(f)
    values = RNG.normal(size=(2, REPAYS + FEWEST))
    wide(values)
    np.testing.assert_allclose(wide(values)[0], 2 * np.sin(values))
    assert wide._operations is None


def test_operations_are_read_only_where_that_repays(monkeypatch):
    wide = Columnwise(everything(), (1,))
    monkeypatch.setattr(columnwise, "_Bound", None)  # to be called would be an error
    wide(*at(FEWEST - 1))
    wide(*at(REPAYS))
    with pytest.raises(TypeError):
        wide(*at(FEWEST))


def test_an_argument_may_be_empty():
    x, none = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    wide = Columnwise(ca.Function("f", [x, none[[]]], [x * 2]), (1,))
    values = RNG.normal(size=(2, REPAYS))
    for _ in range(2):
        np.testing.assert_allclose(wide(values, np.empty(0))[0], 2 * values)


@pytest.mark.parametrize("repays", [REPAYS, np.inf])
def test_numbers_of_columns_may_change_from_call_to_call(repays, monkeypatch):
    monkeypatch.setattr(columnwise, "REPAYS", repays)
    f = everything()
    wide = Columnwise(f, (1,))
    for count in (0, 1500, 700, 513, 600, 900, 1024, 1, 3, 0):
        x, p, y = at(count)
        for got, wanted in zip(wide(x, p, y), by_map(f, x, p, y) if count else f(np.ones(3), p, np.ones(2)), strict=True):
            assert got.shape == (wanted.shape[0], count)
            if count:
                np.testing.assert_allclose(got, wanted, rtol=1e-13, atol=1e-13)
    programs = wide._mapped if repays == np.inf else wide._bound
    assert len(programs) <= 5


def test_matrices_of_their_entries():
    M = ca.SX.sym("M", 2, 3)
    values = RNG.normal(size=(5, 2, 3))
    (entries,) = Columnwise(ca.Function("entries", [ca.vec(M)], [ca.vec(M)]))(np.array([m.ravel(order="F") for m in values]).T)
    np.testing.assert_array_equal(matrices(entries, 2), values)
    assert matrices(np.empty((0, 5)), 0, 3).shape == (5, 0, 3)
