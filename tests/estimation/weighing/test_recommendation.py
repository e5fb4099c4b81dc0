"""Which weights are recommended, and what is said of why, where not all of them could be judged."""

from __future__ import annotations

import pytest
from weighings import candidates, lost

from backsight.estimation.weighing.recommendation import LIKELIHOOD, RULE, recommended
from backsight.models import InputError

NAN = float("nan")


def scores(likelihood: float, first: float, rule: float) -> dict[str, dict[str, object]]:
    """Of what was held out; what was fitted speaks for the rule of magnitudes, which must not matter."""
    fitted = {"likelihood": 5.0, "first": 6.0, "rule": 9.0}
    held = {"likelihood": likelihood, "first": first, "rule": rule}
    return {key: {"held_out": held[key], "log_likelihood": fitted[key]} for key in held}


def test_those_of_greatest_likelihood_are_unless_others_are_ahead_by_more_than_makes_no_difference():
    chosen, why = recommended(candidates(**scores(100.0, 102.0, 60.0)), held_out=True)
    assert chosen.setting.name == LIKELIHOOD
    assert "than with those of the rule of magnitudes (by 40 nats); between them and those that smooth chooses" in why
    assert why.endswith("it makes no difference of more than 3 nats.")
    chosen, why = recommended(candidates(**scores(100.0, 110.0, 60.0)), held_out=True)
    assert chosen.setting.name == "as smooth chooses them"
    assert why.endswith("than with the weights of greatest likelihood (by 10 nats).")


def test_what_was_held_out_judges_the_others_where_those_of_greatest_likelihood_did_not_converge():
    likelihood, *others = candidates(**scores(NAN, 100.0, 60.0))
    chosen, why = recommended([lost(likelihood), *others], held_out=True)
    assert chosen.setting.name == "as smooth chooses them"
    assert "more probable with them than with those of the rule of magnitudes (by 40 nats)" in why
    assert "no convergence with the weights of greatest likelihood" in why


def test_and_where_it_could_not_be_smoothed_with_them():
    chosen, why = recommended(candidates(**scores(NAN, 60.0, 100.0)), held_out=True)
    assert chosen.setting.name == RULE
    assert why.endswith("what was held out could not be smoothed with the weights of greatest likelihood.")
    assert "convergence" not in why


def test_one_that_alone_could_be_judged_is_before_others_that_what_was_fitted_speaks_for():
    likelihood, *others = candidates(**scores(NAN, 60.0, NAN))
    chosen, why = recommended([lost(likelihood), *others], held_out=True)
    assert chosen.setting.name == "as smooth chooses them"
    assert why.endswith("could not be smoothed with those of the rule of magnitudes.")


@pytest.mark.parametrize(("held_out", "said"), [(True, "what was held out could not be smoothed"), (False, "nothing was held out")])
def test_where_nothing_judges_the_reason_is_said(held_out, said):
    every = candidates(**scores(NAN, NAN, NAN))
    chosen, why = recommended(every, held_out=held_out)
    assert chosen.setting.name == LIKELIHOOD
    assert said in why
    assert "convergence" not in why
    chosen, why = recommended([lost(every[0]), *every[1:]], held_out=held_out)
    assert chosen.setting.name == RULE  # by what was fitted
    assert said in why
    assert "no convergence with the weights of greatest likelihood" in why


def test_where_no_candidate_converged_there_is_nothing_to_recommend():
    with pytest.raises(
        InputError, match=r"no candidate converged \(limit of iterations with the weights of greatest likelihood, .*weigh again"
    ):
        recommended([lost(o) for o in candidates()], held_out=True)
