"""From a DAE and samples to a nonlinear program and its solution.

horizon.py, mesh.py          what is given: samples, held inputs, knots
interpolation.py             how unknowns give variables between the knots
spline.py, collocation.py    two transcriptions of the equations
transcription.py             the whole problem as terms of a program
nlp.py, blocks.py            the program and its sparse derivatives
ipopt.py                     solving it
curvature.py, solution.py    covariances, and the answer in the terms of the model
"""

from .horizon import Horizon
from .ipopt import Options, Solved, Solver, Status
from .mesh import Mesh, mesh_over
from .solution import Sampled, Solution
from .transcription import ParameterPrior, Transcription, transcribe

__all__ = [
    "Horizon",
    "Mesh",
    "Options",
    "ParameterPrior",
    "Sampled",
    "Solution",
    "Solved",
    "Solver",
    "Status",
    "Transcription",
    "mesh_over",
    "transcribe",
]
