"""What the plant is: acausal components -> flat equations -> an index-reduced implicit model. No data, no estimation.

model = actuator()            a Model: components, connections, inputs, outputs
dae = compile_model(model)    a Dae: F(x', x, z, u, p, w, t) = 0 as CasADi SX
simulate(dae, t, {"F": f})    a Trajectory
"""

from .compilation.compiler import compile_model
from .connectors import BodyFrame, Electrical, Frame, Planar, Rotational, Translational
from .dae import Dae, EquationInfo, ParameterInfo, Place, Quantity
from .errors import BacksightError, InputError, ModelError, SolveError
from .language import Component, Connector, Equation, Pair, Parameter, Shared, SignalInput, SignalOutput, Variable, balance, equal, law
from .model import Model, Output
from .simulation.events import Event
from .simulation.simulate import Trajectory, simulate
from .text import equations_text

__all__ = [
    "BacksightError",
    "BodyFrame",
    "Component",
    "Connector",
    "Dae",
    "Electrical",
    "Equation",
    "EquationInfo",
    "Event",
    "Frame",
    "InputError",
    "Model",
    "ModelError",
    "Output",
    "Pair",
    "Parameter",
    "ParameterInfo",
    "Place",
    "Planar",
    "Quantity",
    "Rotational",
    "Shared",
    "SignalInput",
    "SignalOutput",
    "SolveError",
    "Trajectory",
    "Translational",
    "Variable",
    "balance",
    "compile_model",
    "equal",
    "equations_text",
    "law",
    "simulate",
]
