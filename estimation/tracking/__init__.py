"""The moving horizon on-line: an estimate for every sample as it comes."""

from .estimate import Estimate, Outcome, Sample
from .estimator import Estimator
from .phases import LawPhase, PhaseEstimate, PhaseEstimator, follow_phases
from .state import resumed, save
from .track import Tracking, track

__all__ = [
    "Estimate",
    "Estimator",
    "LawPhase",
    "Outcome",
    "PhaseEstimate",
    "PhaseEstimator",
    "Sample",
    "Tracking",
    "follow_phases",
    "resumed",
    "save",
    "track",
]
