"""What the model left out: where, when, what it is, and how sure that is. As a diagnosis goes through it:

diagnose.py    all of it
start/         the model as it is, and the recordings as they are taken
candidates/    what may be missing, at which place
scores/        all of it looked at at once: gains, chances, what is alike
search/        round by round: fits of the best, one that is kept
evidence/      how much more probable one model is than another
proof/         before and after on what was held out
answer/        the verdict, and how it is said
"""

from .answer.verdict import Diagnosis, Errors, Explanation, Finding, HeldOut, Mismatch, Strength, Tried, Undetectable
from .diagnose import diagnose

__all__ = ["Diagnosis", "Errors", "Explanation", "Finding", "HeldOut", "Mismatch", "Strength", "Tried", "Undetectable", "diagnose"]
