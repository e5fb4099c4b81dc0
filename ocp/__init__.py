"""From a DAE and samples to a nonlinear program and its solution.

horizon.py, mesh.py                    what is given: samples, held inputs, knots
interpolation.py, polynomials.py       how unknowns give variables between the knots
pieces.py, terms.py                    the model's expressions at places of the mesh; what a program is made of
spline.py, collocation.py              two transcriptions of the equations
transcription.py                       the whole problem as terms of a program
nlp.py, evaluated.py                   the program, and its terms in numbers
pointwise.py, lifting.py, blocks.py    derivatives at points, what a mesh makes of them, a term of both; columnwise.py carries them out
follow.py, scaling.py, linear.py       where a solve starts, in which units, how fast its answer can move
gauss_newton.py, constrained.py        solving it by plain steps: without constraints, and with them
ipopt.py, oracle.py, fixed_point.py    its end, exact steps, what Ipopt asks, and what terms are referred to
solved.py                              what is asked of a solve, and what comes of it
curvature.py, blocktridiagonal.py      covariances
solution.py, readout.py, forces.py     the answer in the terms of the model
"""

from .horizon import Horizon
from .ipopt import Solver
from .mesh import Mesh, mesh_over
from .solution import Sampled, Solution
from .solved import Options, Solved, Status
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
