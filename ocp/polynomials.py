"""Points, weights and polynomial bases on the unit interval, as data.

Sources: Gauss and Radau points from Hairer & Wanner, Solving Ordinary Differential Equations II, section IV.5;
Hermite cubics and their interior bubbles from de Boor, A Practical Guide to Splines, chapter IV.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial import legendre as _legendre
from numpy.typing import NDArray

Array = NDArray[Any]  # of float64, but where longer numbers are meant to be kept


def gauss(count: int) -> tuple[Array, Array]:
    """Gauss points on (0, 1) and their weights (sum 1); exact for polynomials of degree 2 count - 1."""
    x, weight = _legendre.leggauss(count)
    return (x + 1) / 2, weight / 2


def radau(count: int) -> Array:
    """Right Radau points on (0, 1], the last one being 1: the zeros of P_count - P_(count - 1)."""
    series = np.zeros(count + 1)
    series[count], series[count - 1] = 1.0, -1.0
    x = np.sort(_legendre.legroots(series).real)
    x[-1] = 1.0
    return np.asarray((x + 1) / 2, dtype=np.float64)


def radau_weights(count: int) -> Array:
    """Quadrature weights (sum 1) of the right Radau points; exact to degree 2 count - 2."""
    tau = radau(count)
    return np.linalg.solve(np.vander(tau, increasing=True).T, 1.0 / np.arange(1, count + 1))


def legendre(count: int, tau: Array) -> Array:
    """Legendre polynomials of degree 0 .. count-1, orthonormal on [0, 1]; shape (count, len(tau))."""
    values = _legendre.legvander(2.0 * np.asarray(tau) - 1.0, count - 1)
    return np.asarray((values * np.sqrt(2.0 * np.arange(count) + 1.0)).T, dtype=np.float64)


def hermite_basis(degree: int) -> tuple[Polynomial, ...]:
    """C1 basis of degree >= 3: value and slope at 0, value and slope at 1, then degree - 3 bubbles that vanish there doubly."""
    corners = (Polynomial([1, 0, -3, 2]), Polynomial([0, 1, -2, 1]), Polynomial([0, 0, 3, -2]), Polynomial([0, 0, -1, 1]))
    bubble = Polynomial([0, 0, 16, -32, 16])
    return corners + tuple(bubble * _shifted_legendre(j) for j in range(degree - 3))


def lagrange_basis(degree: int) -> tuple[Polynomial, ...]:
    """C0 basis of degree >= 1: value at 0, value at 1, then degree - 1 bubbles that vanish at both."""
    bubble = Polynomial([0, 4, -4])
    return (Polynomial([1, -1]), Polynomial([0, 1]), *(bubble * _shifted_legendre(j) for j in range(degree - 1)))


def cardinal_basis(nodes: Array) -> tuple[Polynomial, ...]:
    """Lagrange polynomials: the j-th is 1 at nodes[j] and 0 at the others."""
    basis = []
    for j, node in enumerate(nodes):
        others = np.delete(nodes, j)
        basis.append(Polynomial.fromroots(others) / np.prod(node - others) if len(others) else Polynomial([1.0]))
    return tuple(basis)


def _shifted_legendre(order: int) -> Polynomial:
    series = _legendre.Legendre.basis(order).convert(kind=Polynomial)
    shifted = series(Polynomial([-1, 2]))
    return shifted if isinstance(shifted, Polynomial) else Polynomial([float(shifted)])
