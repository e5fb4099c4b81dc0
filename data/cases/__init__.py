"""Concealed cases: recordings of machines that do what their declared model does not say, with the truth in a folder of its own.

`python -m backsight.data.cases OUT --seed 1 --truth OUT_TRUTH` writes them all, `make_case` one. Every case has its own machine, its own
guesses and its own size of what is concealed, about the intended one. The simulators share no code with the estimator.
"""

from .suite import make_case, numbered, suite

__all__ = ["make_case", "numbered", "suite"]
