"""The sampled position control of an axis: encoder, filtered difference quotient, proportional-derivative law, limit."""

import math
from dataclasses import dataclass

__all__ = ["Encoder", "Servo", "Tracking"]


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """Position rounded to whole steps of `resolution` [m] after white interpolation noise of standard deviation `noise_std` [m]."""

    resolution: float
    noise_std: float

    def read(self, position: float, standard_normal: float) -> float:
        """The reading [m] of `position` [m], given one draw of a standard normal variable."""
        return round((position + self.noise_std * standard_normal) / self.resolution) * self.resolution


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """What the law remembers from sample to sample: the last reading [m] and the filtered velocity [m/s]."""

    reading: float
    velocity: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Servo:
    """F = k_p (r - y) + k_d (r' - v), limited to +-limit and rounded to whole steps of the force converter.

    y is the encoder's reading and v its difference quotient behind a first-order lag of time constant `lag` [s].
    k_p [N/m], k_d [N s/m], limit [N], resolution [N]; `step` [s] is the sampling time, over which F is held. The same law gives currents
    [A] and torques [N m], from metres or radians; the gains have the units that go with them.
    """

    k_p: float
    k_d: float
    lag: float
    limit: float
    resolution: float
    step: float

    def command(self, before: Tracking, reading: float, position_ref: float, velocity_ref: float) -> tuple[float, Tracking]:
        """The force [N] held until the next sample, and what to remember until then."""
        keep = math.exp(-self.step / self.lag)
        velocity = keep * before.velocity + (1.0 - keep) * (reading - before.reading) / self.step
        wanted = self.k_p * (position_ref - reading) + self.k_d * (velocity_ref - velocity)
        limited = min(max(wanted, -self.limit), self.limit)
        return round(limited / self.resolution) * self.resolution, Tracking(reading=reading, velocity=velocity)
