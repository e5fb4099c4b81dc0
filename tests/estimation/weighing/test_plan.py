"""Which settings a study solves, in what order, and that none is solved twice."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.weighing.plan import once, settings
from backsight.estimation.weighing.turned import Kind, Weight


def weight(name: str, kind: Kind) -> Weight:
    return Weight(name=name, kind=kind, std=1.0, unit="N", row=0)


ONE = [weight("mass", "W"), weight("x", "V")]
TWO = [*ONE, weight("motor", "W")]
HELD = [*TWO, weight("friction.f_c", "drift"), weight("the parameters", "prior")]


@pytest.mark.parametrize("weights", [ONE, TWO, HELD])
def test_names_are_one_each_and_paths_lead_away_from_the_candidate(weights):
    about = np.linspace(-0.3, 0.4, len(weights))
    chains = settings(weights, {"about": about}, about)
    every = [s for chain in chains for s in chain]
    assert len({s.name for s in every}) == len(every)
    for chain in chains:
        away = [np.linalg.norm(np.array(s.theta) - about) for s in chain]
        assert chain[0].group == "stage" or np.all(np.diff(away) > 0)


def test_what_two_names_mean_is_solved_once_and_by_the_path():
    """With one balance all W together are that one."""
    chains = settings(ONE, {"about": np.zeros(2), "the same": np.zeros(2)}, np.zeros(2))
    names = {s.name: s for chain in chains for s in chain}
    assert names["W x 0.1"].theta == names["W of mass x 0.1"].theta
    solved = [[s.name for s in chain] for chain in once(chains)]
    assert ["about"] in solved
    assert ["W x 0.316", "W x 0.1", "W x 0.0316", "W x 0.01"] in solved
    assert ["W of mass x 0.333"] in solved
    assert ["V of x x 0.333", "V of x x 0.1"] in solved
    assert not [chain for chain in solved if "the same" in chain]
    assert {s.theta for chain in once(chains) for s in chain} == {s.theta for s in names.values()}


def test_with_two_balances_nothing_is_the_same():
    chains = settings(TWO, {"about": np.zeros(3)}, np.zeros(3))
    assert once(chains) == chains


def test_what_holds_the_parameters_is_tightened_by_stages_in_one_chain():
    chains = settings(HELD, {"about": np.zeros(5)}, np.zeros(5))
    (stages,) = [chain for chain in chains if chain[0].group == "stage"]
    assert [s.factor for s in stages] == [100.0, 10.0, 0.1, 0.01]
    for s in stages:
        assert s.theta == pytest.approx([0, 0, 0, np.log(s.factor), np.log(s.factor)], abs=1e-6)
    assert not [chain for chain in settings(TWO, {"about": np.zeros(3)}, np.zeros(3)) if chain[0].group == "stage"]
