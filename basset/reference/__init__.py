"""Reference solutions: closed forms of the history integral in double precision, and the same in mpmath to any number of digits.

Every function takes `digits=None`: then t may be an array (seconds) and the result is float64; with `digits` t is one
number and the result an mpmath number correct to that many digits, from a formula of its own where double precision
needs a special one. `product_weights` gives exact weights of product integration. All for K(s) = s^(-1/2) unless stated otherwise.
"""

from basset.reference.integrals import cosine, exponential, power, power_slip, product_weights, sine, step
from basset.reference.motions import (
    Bounces,
    Oscillator,
    VortexMotion,
    bagley_torvik,
    bouncing,
    oscillating_stream,
    relaxing,
    response,
    settling,
    settling_height,
    solid_body_vortex,
)

__all__ = [
    "Bounces",
    "Oscillator",
    "VortexMotion",
    "bagley_torvik",
    "bouncing",
    "cosine",
    "exponential",
    "oscillating_stream",
    "power",
    "power_slip",
    "product_weights",
    "relaxing",
    "response",
    "settling",
    "settling_height",
    "sine",
    "solid_body_vortex",
    "step",
]
