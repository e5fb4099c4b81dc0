"""A model with more in it that is uncertain: pure functions from a `Dae` to a `Dae`.

coloured.py      a residual force with a memory: Ornstein-Uhlenbeck, Matern 3/2
inputs.py        an input that acts as recorded plus noise
parameters.py    a parameter that drifts, or that differs from case to case
kinematics.py    a position whose rate is its velocity but for a residual
delay.py         an output that lags by an unknown time

What the model had keeps its index: its states, algebraic variables, inputs, parameters, rows and places come first, in their order, and
a parameter that something else stands for keeps its entry in p, which no equation uses any more. White noise enters through places, of
spectral density std^2 * 1 s in the row that carries them, whatever the std: no function here needs to know it.
"""

from .coloured import SHAPES, Shape, coloured, stationary_std, white_std
from .inputs import measured_input
from .kinematics import relaxed_kinematics
from .parameters import by_case, drifting

__all__ = ["SHAPES", "Shape", "by_case", "coloured", "drifting", "measured_input", "relaxed_kinematics", "stationary_std", "white_std"]
