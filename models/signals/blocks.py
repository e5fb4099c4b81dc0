"""Signal blocks without memory: sources, sums, and the limits of amplifiers.

Corners are rounded: with r = rounding * corner,

    sat(u, limit) = (sqrt((u + limit)^2 + r^2) - sqrt((u - limit)^2 + r^2)) / 2

is odd, stays within the limit, and is off by r/2 at most (at a corner), by limit (r/u)^2 / 2 far beyond it. The rounding is no physics.
"""

import math
from typing import Any

import casadi as ca

from ..language import Component, Equation, Parameter, SignalInput, SignalOutput, equal


def rounded_saturation(u: Any, limit: Any, rounding: Any) -> Any:
    """u between -limit and limit, with corners rounded over rounding * limit (see the head of the file)."""
    r2 = (rounding * limit) ** 2
    return (ca.sqrt((u + limit) ** 2 + r2) - ca.sqrt((u - limit) ** 2 + r2)) / 2


class Constant(Component):
    """A constant.   y = value

    Signals:    y (output)
    Parameters: value, 0 by default
    """

    y = SignalOutput(description="the constant")
    value = Parameter("", 0.0, description="the constant")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"constant": equal(c.y, c.value)}


class Sine(Component):
    """A sine.   y = offset + amplitude sin(2 pi frequency t + phase)

    Signals:    y (output)
    Parameters: amplitude, 1 by default; frequency [Hz], 1 by default; phase [rad], 0 by default; offset, 0 by default
    """

    y = SignalOutput(description="the sine")
    amplitude = Parameter("", 1.0, description="amplitude")
    frequency = Parameter("Hz", 1.0, min=0.0, description="frequency")
    phase = Parameter("rad", 0.0, description="phase at t = 0")
    offset = Parameter("", 0.0, description="mean value")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"sine": equal(c.y, c.offset + c.amplitude * ca.sin(2 * ca.pi * c.frequency * c.time + c.phase))}


class Gain(Component):
    """A gain.   y = gain u

    Signals:    u (input), y (output), of one unit
    Parameters: gain [1] 1 by default
    """

    u = SignalInput()
    y = SignalOutput()
    gain = Parameter("1", 1.0, description="output over input")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"gain": equal(c.y, c.gain * c.u)}


class Offset(Component):
    """A constant error.   y = u + bias

    Signals:    u (input), y (output), of one unit
    Parameters: bias [that unit] 0 by default (absent)
    """

    u = SignalInput()
    y = SignalOutput()
    bias = Parameter("", 0.0, description="output without input")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"offset": equal(c.y, c.u + c.bias)}


class Drift(Component):
    """An error that grows with time.   y = u + rate (t - t_0)

    Signals:    u (input), y (output), of one unit
    Parameters: rate [that unit/s] 0 by default (absent); t_0 [s] when it is nothing, 0 by default
    """

    u = SignalInput()
    y = SignalOutput()
    rate = Parameter("/s", 0.0, description="growth of the error per second")
    t_0 = Parameter("s", 0.0, description="time at which the error is nothing")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drift": equal(c.y, c.u + c.rate * (c.time - c.t_0))}


class PeriodicError(Component):
    """An error that comes back with every period of the signal: a disk that is not centred.   y = u + amplitude sin(2 pi u/period + phase)

    Signals:    u (input), y (output), of one unit
    Parameters: amplitude [that unit] 0 by default (absent); period [that unit] 2 pi by default, a turn in radians; phase [rad] 0 by default
    """

    u = SignalInput()
    y = SignalOutput()
    amplitude = Parameter("", 0.0, description="largest error")
    period = Parameter("", 2 * math.pi, min=1e-12, description="of the error, in the signal")
    phase = Parameter("rad", 0.0, description="of the error where the signal is nothing")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"periodic error": equal(c.y, c.u + c.amplitude * ca.sin(2 * ca.pi * c.u / c.period + c.phase))}


class Sum(Component):
    """A weighted sum of two signals of one unit.   y = k_1 u_1 + k_2 u_2

    Signals:    u_1, u_2 (inputs), y (output)
    Parameters: k_1, k_2 [1], 1 by default
    """

    u_1 = SignalInput()
    u_2 = SignalInput()
    y = SignalOutput()
    k_1 = Parameter("1", 1.0, description="weight of u_1")
    k_2 = Parameter("1", 1.0, description="weight of u_2")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"sum": equal(c.y, c.k_1 * c.u_1 + c.k_2 * c.u_2)}


class Rotation(Component):
    """Two components of one vector, read in axes that are turned.   y_1 = cos(a) u_1 + sin(a) u_2    y_2 = cos(a) u_2 - sin(a) u_1

    Signals:    u_1, u_2 (inputs), y_1, y_2 (outputs), of one unit
    Parameters: angle a [rad] 0 by default (absent)
    """

    u_1 = SignalInput()
    u_2 = SignalInput()
    y_1 = SignalOutput()
    y_2 = SignalOutput()
    angle = Parameter("rad", 0.0, description="by which the axes of y are turned from those of u")

    def equations(self, c: Any) -> dict[str, Equation]:
        cos, sin = ca.cos(c.angle), ca.sin(c.angle)
        return {"first axis": equal(c.y_1, cos * c.u_1 + sin * c.u_2), "second axis": equal(c.y_2, cos * c.u_2 - sin * c.u_1)}


class Saturation(Component):
    """A limit to both sides.   y = sat(u, limit)

    Signals:    u (input), y (output), of one unit
    Parameters: limit [that unit] 1 by default; rounding [1] of the corners over the limit, 0.01 by default
    """

    u = SignalInput()
    y = SignalOutput()
    limit = Parameter("", 1.0, min=1e-12, description="largest output")
    rounding = Parameter("1", 1e-2, min=1e-12, description="rounding of the corners over the limit", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"saturation": equal(c.y, rounded_saturation(c.u, c.limit, c.rounding))}


class DeadZone(Component):
    """A band without effect: y = 0 for |u| <= width, u -+ width beyond.   y = u - sat(u, width)

    Signals:    u (input), y (output), of one unit
    Parameters: width [that unit] half the band, 1 by default; rounding [1] of the corners over the width, 0.01 by default
    """

    u = SignalInput()
    y = SignalOutput()
    width = Parameter("", 1.0, min=1e-12, description="half of the band without effect")
    rounding = Parameter("1", 1e-2, min=1e-12, description="rounding of the corners over the width", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"dead zone": equal(c.y, c.u - rounded_saturation(c.u, c.width, c.rounding))}
