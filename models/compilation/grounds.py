"""Circuits without a ground: potentials that occur as differences only have no origin, and the sum of their flows is told twice."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..errors import ModelError
from ..model import GROUNDS, Model
from .flat import FlatModel

SX = Any


def refuse_floating(model: Model, flat: FlatModel) -> None:
    """Raise ModelError where all potentials of a network can be shifted together and no equation notices or differentiates them."""
    for kind, ground in GROUNDS.items():
        ends = [f"{n}.{port}" for n, c in model.components.items() for port, end in c.declared_connectors.items() if type(end) is kind]
        for pair in kind.pairs:
            for network in _networks(flat, [f"{end}.{pair.potential}" for end in ends]):
                if not any(name in flat.derivatives for name in network) and _floats(flat, network):
                    shown = ", ".join(network[:6]) + (" ..." if len(network) > 6 else "")
                    end = network[0].rpartition(".")[0]
                    port = next(iter(ground.declared_connectors))
                    raise ModelError(
                        f"model '{model.name}': the potentials {shown} ({len(network)}) occur as differences only and have no origin; "
                        f"add {_article(ground.__name__)} 'ground' and connect it to one of them, ('{end}', 'ground.{port}')"
                    )


def _networks(flat: FlatModel, names: list[str]) -> list[list[str]]:
    """Potentials that equations tie to each other."""
    column = {name: i for i, name in enumerate(names)}
    held = [[column[name] for name in e.held if name in column] for e in flat.equations]
    pairs = np.array([(row[0], other) for row in held for other in row[1:]], dtype=np.intp).reshape(-1, 2)
    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(names), len(names)))
    label = connected_components(graph, directed=False)[1]
    networks: dict[int, list[str]] = {}
    for name, own in zip(names, label.tolist(), strict=True):
        networks.setdefault(own, []).append(name)
    return list(networks.values())


def _floats(flat: FlatModel, network: list[str]) -> bool:
    """Whether the sum of the slopes over the network is zero in every equation, at a random point."""
    potentials, names = ca.vertcat(*(flat.symbols[name] for name in network)), set(network)
    rows = ca.vertcat(*(e.residual for e in flat.equations if not names.isdisjoint(e.held)))
    if len(network) < 2 or not rows.shape[0]:
        return False
    shift = ca.jtimes(rows, potentials, ca.SX.ones(len(network)))
    symbols = ca.vertcat(*ca.symvar(shift))
    point = np.random.default_rng(0).uniform(0.5, 1.5, symbols.shape[0])
    return bool(np.abs(ca.Function("shift", [symbols], [shift])(point).full()).max() < 1e-12)


def _article(word: str) -> str:
    return f"an {word}" if word[0] in "AEIOU" else f"a {word}"
