"""Classical identification methods, beside the smoother and to compare it with: the same recordings in, the same kind of result out.

filtered_least_squares.py   balances linear in the parameters; zero-phase filter and differences, or state-variable filters
harmonic.py                 the same balances by the harmonics of periodic motions
prediction_error.py         any plant: output error of its simulation, whole or in segments
zoh_prediction_error.py     plants that are linear about a point: exact discretisation and a noise model
two_stage.py                closed loops with an unknown controller: the input that the reference explains, then one of the others
armax.py, recursive.py      difference equations of one output, and their orders; coefficients that wander
multiple_model.py           a plant that jumps between modes: which one is in force when
comparison.py               one table of all

result.py                                        what they give back
regression.py, shooting.py                       deviations under coloured residuals; simulations from many starts
measured_states.py, balances.py                  states from filtered samples; balances as linear rows
linear_plant.py, linear_predictor.py, kalman.py  a plant as a difference equation, and its innovations
sampling.py                                      what filters ask of a recording

    from backsight.estimation.classical import compare, filtered_least_squares
    compare(problem, [filtered_least_squares])                 a table: the smoother's row, then one per method

None of them takes correlated residual forces, noise in the inputs or parameters that vary between recordings. Each says by an InputError
when a plant or a recording is not for it.
"""

from .armax import Armax, Orders, armax, select_orders
from .comparison import compare
from .filtered_least_squares import filtered_least_squares, state_variable_filter
from .harmonic import harmonic
from .multiple_model import Modes, multiple_models
from .prediction_error import prediction_error
from .recursive import Tracked, recursive_armax
from .result import Baseline
from .two_stage import two_stage
from .zoh_prediction_error import zoh_prediction_error

__all__ = [
    "Armax",
    "Baseline",
    "Modes",
    "Orders",
    "Tracked",
    "armax",
    "compare",
    "filtered_least_squares",
    "harmonic",
    "multiple_models",
    "prediction_error",
    "recursive_armax",
    "select_orders",
    "state_variable_filter",
    "two_stage",
    "zoh_prediction_error",
]
