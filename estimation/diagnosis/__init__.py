"""What the model left out: where, when, what it is, and how sure that is.

candidates.py, laws.py, channels.py, frames.py, library.py     what may be missing, at which place
supermodel.py, enlarged.py, score.py, screen.py                all of it looked at at once: gains, chances, what is alike
refit.py, choice.py                                            a candidate as a full problem, and whether it is borne out
worth.py                                                       how much more probable one model is than another
search.py, round.py, standing.py                               round by round; the model with what was found so far
findings.py, elimination.py, hold.py                           what is said of it; what goes out again; held inputs or straight ones
diagnose.py, shares.py, verdict.py                             all of it, and its answer
proof.py                                                       before and after on what was held out
"""

from .diagnose import diagnose
from .verdict import Diagnosis, Errors, Explanation, Finding, HeldOut, Mismatch, Strength, Tried, Undetectable

__all__ = ["Diagnosis", "Errors", "Explanation", "Finding", "HeldOut", "Mismatch", "Strength", "Tried", "Undetectable", "diagnose"]
