"""What the user asks for: recordings, studies, smoothing and their results.

    from backsight.estimation import Free, Problem, Recording, smooth

The names below are loaded when they are first used, so that `backsight --help` need not wait for CasADi.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .classical.armax import Armax, Orders, armax, select_orders
    from .classical.comparison import compare
    from .classical.filtered_least_squares import filtered_least_squares, state_variable_filter
    from .classical.harmonic import harmonic
    from .classical.multiple_model import Modes, multiple_models
    from .classical.prediction_error import prediction_error
    from .classical.recursive import Tracked, recursive_armax
    from .classical.result import Baseline
    from .classical.two_stage import two_stage
    from .classical.zoh_prediction_error import zoh_prediction_error
    from .diagnosis.answer.verdict import Diagnosis
    from .diagnosis.diagnose import diagnose
    from .problem import Free, Known, Problem, Weights
    from .recordings.columns import InputColumn, OutputColumn
    from .recordings.recording import Recording
    from .results import Criteria, OutputFit, ParameterEstimate, Profile, ResidualSummary, Smoothing, SolverFacts
    from .simulation import Simulation, simulate_study
    from .smoothing.profile import profile
    from .smoothing.program import Settings
    from .smoothing.smoother import smooth
    from .study.study import Study
    from .tracking.estimate import Estimate, Sample
    from .tracking.estimator import Estimator
    from .tracking.phases import LawPhase, PhaseEstimate, PhaseEstimator, follow_phases
    from .tracking.track import Tracking, track
    from .weighing.estimated import variance_components
    from .weighing.weigh import Weighing, weigh

_HOME = {
    "classical.armax": ("Armax", "Orders", "armax", "select_orders"),
    "classical.comparison": ("compare",),
    "classical.filtered_least_squares": ("filtered_least_squares", "state_variable_filter"),
    "classical.harmonic": ("harmonic",),
    "classical.multiple_model": ("Modes", "multiple_models"),
    "classical.prediction_error": ("prediction_error",),
    "classical.recursive": ("Tracked", "recursive_armax"),
    "classical.result": ("Baseline",),
    "classical.two_stage": ("two_stage",),
    "classical.zoh_prediction_error": ("zoh_prediction_error",),
    "diagnosis.diagnose": ("diagnose",),
    "diagnosis.answer.verdict": ("Diagnosis",),
    "problem": ("Free", "Known", "Problem", "Weights"),
    "recordings.columns": ("InputColumn", "OutputColumn"),
    "recordings.recording": ("Recording",),
    "results": ("Criteria", "OutputFit", "ParameterEstimate", "Profile", "ResidualSummary", "Smoothing", "SolverFacts"),
    "simulation": ("Simulation", "simulate_study"),
    "smoothing.profile": ("profile",),
    "smoothing.program": ("Settings",),
    "smoothing.smoother": ("smooth",),
    "study.study": ("Study",),
    "tracking.estimate": ("Estimate", "Sample"),
    "tracking.estimator": ("Estimator",),
    "tracking.phases": ("LawPhase", "PhaseEstimate", "PhaseEstimator", "follow_phases"),
    "tracking.track": ("Tracking", "track"),
    "weighing.estimated": ("variance_components",),
    "weighing.weigh": ("Weighing", "weigh"),
}

__all__ = [
    "Armax",
    "Baseline",
    "Criteria",
    "Diagnosis",
    "Estimate",
    "Estimator",
    "Free",
    "InputColumn",
    "Known",
    "LawPhase",
    "Modes",
    "Orders",
    "OutputColumn",
    "OutputFit",
    "ParameterEstimate",
    "PhaseEstimate",
    "PhaseEstimator",
    "Problem",
    "Profile",
    "Recording",
    "ResidualSummary",
    "Sample",
    "Settings",
    "Simulation",
    "Smoothing",
    "SolverFacts",
    "Study",
    "Tracked",
    "Tracking",
    "Weighing",
    "Weights",
    "armax",
    "compare",
    "diagnose",
    "filtered_least_squares",
    "follow_phases",
    "harmonic",
    "multiple_models",
    "prediction_error",
    "profile",
    "recursive_armax",
    "select_orders",
    "simulate_study",
    "smooth",
    "state_variable_filter",
    "track",
    "two_stage",
    "variance_components",
    "weigh",
    "zoh_prediction_error",
]


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
