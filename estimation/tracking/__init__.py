"""The moving horizon on-line: an estimate for every sample as it comes."""

from .estimate import Estimate, Outcome, Sample
from .estimator import Estimator
from .state import resumed, save
from .track import Tracking, track

__all__ = ["Estimate", "Estimator", "Outcome", "Sample", "Tracking", "resumed", "save", "track"]
