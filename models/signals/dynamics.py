"""Signal blocks with memory: lags, a delay, a controller.

The law of a lag or of an integrator may carry a residual when it is asked for; the delay is mathematics and carries none.
"""

from typing import Any

import casadi as ca

from ..language import Component, Equation, Parameter, SignalInput, SignalOutput, Variable, equal, law
from .blocks import rounded_saturation


class Lag(Component):
    """A lag of first order.   tau y' = u - y

    Signals:    u (input), y (output), of one unit; y is a state
    Parameters: tau [s] time constant, 1 by default
    """

    u = SignalInput()
    y = SignalOutput()
    tau = Parameter("s", 1.0, min=1e-9, description="time constant")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"lag": law(c.tau * c.der(c.y), c.u - c.y)}


class AsymmetricLag(Component):
    """A lag with two time constants.   y' = (u - y)/tau_up while y rises, (u - y)/tau_down while it falls

    With e = u - y the corner at e = 0 is rounded, and stays where it is:   2 y' = e (1/tau_up + 1/tau_down)
    + e tanh(e/width) (1/tau_up - 1/tau_down).

    Signals:    u (input), y (output), of one unit; y is a state
    Parameters: tau_up, tau_down [s] time constants, 1 by default; width [that unit] smoothing, 1e-3 by default
    """

    u = SignalInput()
    y = SignalOutput()
    tau_up = Parameter("s", 1.0, min=1e-9, description="time constant of rising")
    tau_down = Parameter("s", 1.0, min=1e-9, description="time constant of falling")
    width = Parameter("", 1e-3, min=1e-12, description="rounding of the corner at u = y", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        e = c.u - c.y
        rate = (e + e * ca.tanh(e / c.width)) / c.tau_up + (e - e * ca.tanh(e / c.width)) / c.tau_down
        return {"lag": law(c.der(c.y), rate / 2)}


class SecondOrderLag(Component):
    """A lag of second order, such as an amplifier's or a sensor's bandwidth.   y'' + 2 zeta omega_0 y' + omega_0^2 y = omega_0^2 u

    Variables:  rate (of y, per second)
    Signals:    u (input), y (output), of one unit; y and its rate are states
    Parameters: omega_0 [rad/s] natural frequency, 1 by default; zeta [1] damping ratio, 1/sqrt(2) by default (Butterworth)
    """

    rate = Variable("", state=True, description="rate of y")
    u = SignalInput()
    y = SignalOutput()
    omega_0 = Parameter("rad/s", 1.0, min=1e-9, description="natural frequency")
    zeta = Parameter("1", 0.5**0.5, min=0.0, description="damping ratio")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rate": equal(c.rate, c.der(c.y)),
            "lag": law(c.der(c.rate), c.omega_0**2 * (c.u - c.y) - 2 * c.zeta * c.omega_0 * c.rate),
        }


class Delay(Component):
    """A delay, y(t) = u(t - delay), by the Pade approximation of numerator degree 2 and denominator degree 3.

        y/u = (60 - 24 s + 3 s^2) / (60 + 36 s + 9 s^2 + s^3),    s in units of 1/delay

    Its relative error is (omega delay)^6 / 7200 to leading order: 1.4e-4 at omega delay = 1, 9e-3 at 2. The numerator has the lower degree
    so that a step of u makes no step of y at once, as equal degrees would. A delay of zero is excluded: leave the block out.
    G. A. Baker, P. Graves-Morris, Pade Approximants, 2nd ed., 1996, eq. 1.2.12.

    Variables:  x_1, x_2, x_3 (states): a filtered input and its derivatives times delay, delay^2; they start at u = 0
    Signals:    u (input), y (output), of one unit
    Parameters: delay [s], 1e-3 by default
    """

    x_1 = Variable("", state=True, description="input, filtered")
    x_2 = Variable("", state=True, description="its derivative times the delay")
    x_3 = Variable("", state=True, description="its second derivative times the delay squared")
    u = SignalInput()
    y = SignalOutput()
    delay = Parameter("s", 1e-3, min=1e-9, description="delay")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "first derivative": equal(c.delay * c.der(c.x_1), c.x_2),
            "second derivative": equal(c.delay * c.der(c.x_2), c.x_3),
            "denominator": equal(c.delay * c.der(c.x_3), 60 * (c.u - c.x_1) - 36 * c.x_2 - 9 * c.x_3),
            "numerator": equal(c.y, c.x_1 - 24 / 60 * c.x_2 + 3 / 60 * c.x_3),
        }


class PIController(Component):
    """A proportional-integral controller.   y = k u + x,   x' = k u / T_i

    Variables:  x integral part (state)
    Signals:    u control error (input), y (output); their units are those of what they are connected to
    Parameters: k [unit of y over unit of u] gain, 1 by default; T_i [s] integral time, 1 by default
    """

    converts_units = True
    x = Variable("", state=True, description="integral part")
    u = SignalInput(description="control error")
    y = SignalOutput(description="command")
    k = Parameter("", 1.0, min=1e-12, description="proportional gain")
    T_i = Parameter("s", 1.0, min=1e-9, description="integral time")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"integral": law(c.der(c.x), c.k * c.u / c.T_i), "command": equal(c.y, c.k * c.u + c.x)}


class LimitedPIController(Component):
    """A proportional-integral controller whose output is limited, with back-calculation against windup.

        v = k u + x,    y = sat(v, limit),    x' = k u / T_i + (y - v) / T_t

    K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., 2021, section 11.4.

    Variables:  x integral part (state), v command before the limit
    Signals:    u control error (input), y (output)
    Parameters: k gain, 1 by default; T_i [s] integral time, 1 by default; T_t [s] tracking time, 1 by default; limit of |y|, 1 by default;
                rounding [1] of the corners over the limit, 0.01 by default
    """

    converts_units = True
    x = Variable("", state=True, description="integral part")
    v = Variable("", description="command before the limit")
    u = SignalInput(description="control error")
    y = SignalOutput(description="command")
    k = Parameter("", 1.0, min=1e-12, description="proportional gain")
    T_i = Parameter("s", 1.0, min=1e-9, description="integral time")
    T_t = Parameter("s", 1.0, min=1e-9, description="tracking time")
    limit = Parameter("", 1.0, min=1e-12, description="largest output")
    rounding = Parameter("1", 1e-2, min=1e-12, description="rounding of the corners over the limit", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "integral": law(c.der(c.x), c.k * c.u / c.T_i + (c.y - c.v) / c.T_t),
            "unlimited command": equal(c.v, c.k * c.u + c.x),
            "command": equal(c.y, rounded_saturation(c.v, c.limit, c.rounding)),
        }
