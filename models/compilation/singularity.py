"""Equations that depend on each other in value though their structure is sound: their Jacobian is singular at random points.

Singular at random parameters, a model says something twice; singular only at those in force, it lacks an inertia or repeats a ratio.

A block triangular matrix is singular when one of its diagonal blocks is, so the blocks are tested one by one and a chain of bodies costs as
much as its bodies. Only to name the equations at fault is the whole matrix decomposed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from ..errors import ModelError
from .flat import FlatModel
from .index_reduction import Semi
from .structure import blocks

SX = Any
_POINTS = 4
_TOLERANCE = 1e-12  # of the smallest singular value of a block, where all entries are 1 at most


def refuse_singular(flat: FlatModel, system: Semi) -> None:
    """Raise ModelError, naming equations, when the highest derivatives and algebraics are not determined at random points.

    First with random parameters, then with those in force; of the latter it names those whose zero makes the model singular.
    """
    unknown = ca.vertcat(*system.dx, *system.z)
    rows = ca.vertcat(*(e.residual for e in system.equations))
    if rows.shape[0] != unknown.shape[0]:
        raise ModelError(
            f"model '{flat.name}': {rows.shape[0]} equations are left for {unknown.shape[0]} unknowns; "
            "a coupling is stated twice or missing"
        )
    if unknown.shape[0] == 0:
        return
    if (weak := _weak_rows(sample(flat, rows, unknown))) is not None:
        raise ModelError(
            f"model '{flat.name}' is singular: the equations {_origins(system, weak)} depend on each other and leave a variable free; "
            "remove the coupling that says the same twice, or give the part without inertia a mass or damper"
        )
    values = {name: value for name, (_, value, _) in flat.parameters.items()}
    if (weak := _weak_rows(sample(flat, rows, unknown, values))) is not None:
        slopes = ca.jacobian(rows[weak.tolist()], unknown)
        held = [name for s in ca.symvar(slopes) if (name := s.name()) in values]
        zero = [n for n in held if values[n] == 0.0 and _weak_rows(sample(flat, rows, unknown, values | {n: 1.0})) is None]
        cause = ", ".join(f"{n} = {values[n]:g} [{flat.parameters[n][0].unit}]" for n in zero or held)
        remedy = "give it another value, or add an inertia there" if zero else "change one of them, or remove a coupling"
        raise ModelError(
            f"model '{flat.name}' is singular at its parameter values: with {cause}, the accelerations, velocities and forces in "
            f"{_origins(system, weak)} are not determined; {remedy}"
        )


def sample(flat: FlatModel, rows: SX, unknown: SX, values: Mapping[str, float] | None = None) -> Iterator[csr_array]:
    """The Jacobian of the rows at random points around typical values, equilibrated; `values` are taken as they are."""
    symbols = ca.symvar(ca.vertcat(rows, unknown))
    jacobian = ca.Function("J", [ca.vertcat(*symbols)], [ca.jacobian(rows, unknown)])
    sizes = np.array([typical(flat, s.name()) for s in symbols])
    fixed = np.array([s.name() in (values or {}) for s in symbols], dtype=bool)
    exact = np.array([(values or {}).get(s.name(), 0.0) for s in symbols])
    generator = np.random.default_rng(0)
    for _ in range(_POINTS):
        matrix = csr_array(jacobian(np.where(fixed, exact, sizes * generator.uniform(0.5, 1.5, len(sizes)))).sparse())
        if np.all(np.isfinite(matrix.data)):
            yield _equilibrated(matrix)


def _weak_rows(matrices: Iterator[csr_array]) -> NDArray[np.intp] | None:
    """The rows that depend on each other, where all matrices are singular; None where one is regular or there is none."""
    singular = None
    for matrix in matrices:
        parts = blocks(matrix)
        if parts is not None and all(_smallest(matrix, *part) > _TOLERANCE for part in parts):
            return None
        singular = matrix
    if singular is None:
        return None
    weakest = np.linalg.svd(singular.toarray())[0][:, -1]
    return np.flatnonzero(np.abs(weakest) > 1e-6)


def _origins(system: Semi, rows: Collection[int] | NDArray[np.intp]) -> str:
    return ", ".join(f"'{system.equations[int(i)].origin}'" for i in rows)


def _equilibrated(matrix: csr_array) -> csr_array:
    """Rows, then columns, scaled so that their largest entry is 1; entries that are zero in value are left out."""
    matrix.eliminate_zeros()
    for axis in (1, 0):
        largest = np.maximum(abs(matrix).max(axis=axis).toarray().ravel(), 1e-300)
        scale = diags_array(1 / largest)
        matrix = csr_array(scale @ matrix if axis == 1 else matrix @ scale)
    return matrix


def _smallest(matrix: csr_array, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> float:
    """The smallest singular value of a block."""
    block = matrix[rows][:, columns].toarray()
    return float(np.linalg.svd(block, compute_uv=False)[-1]) if len(rows) > 1 else abs(float(block[0, 0]))


def typical(flat: FlatModel, name: str) -> float:
    """The size of a symbol of the flat model."""
    if name in flat.parameters:
        declared, value, _ = flat.parameters[name]
        return value or declared.size(value)
    return flat.variables[name].nominal if name in flat.variables else 1.0
