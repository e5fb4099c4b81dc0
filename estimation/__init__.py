"""What the user asks for: recordings, studies, smoothing and their results.

    from backsight.estimation import Free, Problem, Recording, smooth

The names below are loaded when they are first used, so that `backsight --help` need not wait for CasADi.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .problem import Free, Problem, Weights
    from .recordings.recording import InputColumn, OutputColumn, Recording
    from .results import OutputFit, ParameterEstimate, ResidualSummary, Smoothing, SolverFacts
    from .simulation import Simulation, simulate_study
    from .smoothing.smoother import smooth
    from .study.study import Study

_HOME = {
    "problem": ("Free", "Problem", "Weights"),
    "recordings.recording": ("InputColumn", "OutputColumn", "Recording"),
    "results": ("OutputFit", "ParameterEstimate", "ResidualSummary", "Smoothing", "SolverFacts"),
    "simulation": ("Simulation", "simulate_study"),
    "smoothing.smoother": ("smooth",),
    "study.study": ("Study",),
}

__all__ = [
    "Free",
    "InputColumn",
    "OutputColumn",
    "OutputFit",
    "ParameterEstimate",
    "Problem",
    "Recording",
    "ResidualSummary",
    "Simulation",
    "Smoothing",
    "SolverFacts",
    "Study",
    "Weights",
    "simulate_study",
    "smooth",
]


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
