"""The equation of motion of a grain, and the kinks of the stream it moves in.

States y are x, [y,] z, slip u − u_f in the same directions, the spin where it is integrated (ω_y in the plane, all
three in space), and of a turbulent stream the eddies' clock, drift and its rate; effects that a scene does not name add no state. Slips, not velocities,
because they are what the history acts on; at an impact both jump alike. Up to a level at which the stream, or the lift by it, has a kink a step sees
the stream continued smoothly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from basset._compile import compiled, entry, overloads, shared
from basset.kernels import Floats
from basset.solvers import stepper
from basset.solvers.stepper import at, restart
from saltation.effects.base import Situation, force, torque, total_force
from saltation.effects.turbulence import fluctuation, motion
from saltation.flight.layout import Model
from saltation.flow import continued, velocity_and_shear
from saltation.grain import Triple

BESIDE = 1e-9  # d: a grain this near to a kink is at it


class Equation(NamedTuple):
    """What moves the grain: α, the stream, the height where it begins (d), forces, torque; `across`, `turning`, `eddies` are None where there is no such state.

    Its type says which effects there are: a new one compiles `rates_of` and nothing that steps.
    """

    alpha: float
    profile: Any
    begins: float
    forces: Any
    torque: Any
    across: Any
    turning: Any
    eddies: Any = None


@shared
def stream_at(model: Model, z: float, clock: float, drift: float, own: Any) -> Triple:
    """Velocity of the fluid at a height, V; clock and drift of its eddies count where there are any."""
    u = velocity_and_shear(model.profile, z)[0]
    beside = fluctuation(model.eddies, z, clock, drift, own)
    if model.eddies is None:
        return u, 0.0, 0.0
    return u + beside[0], beside[1], beside[2]


@shared
def stream_of(model: Model, y: Any, own: Any) -> Triple:
    """Velocity of the fluid around a grain in the states y, V."""
    d, clock, drift = model.dimensions, 0.0, 0.0
    if model.eddies is not None:
        first = 2 * d + model.spins
        clock, drift = y[first], y[first + 1]
    return stream_at(model, y[d - 1], clock, drift, own)


@shared
def velocity_of(model: Model, y: Any, own: Any) -> Triple:
    """Velocity of a grain in the states y, V."""
    d = model.dimensions
    stream = stream_of(model, y, own)
    u, v, w = y[d] + stream[0], 0.0 if model.dimensions == 2 else y[d + 1], y[2 * d - 1]
    if model.eddies is None:
        return u, v, w
    return u, v + stream[1], w + stream[2]


@shared
def rise_of(model: Model, y: Any, own: Any) -> float:
    """How fast a grain in the states y rises, V."""
    w: float = y[2 * model.dimensions - 1]
    if model.eddies is None:
        return w
    return w + stream_of(model, y, own)[2]


@shared
def rise_at(model: Model, polynomial: Floats, y: Floats, kind: int, theta: float, own: Any) -> float:
    """How fast a grain rises at θ of a step, V; in a turbulent stream of that sign only, from the polynomial of its height."""
    d = model.dimensions
    if model.eddies is None:
        return at(polynomial, y, kind, theta, 2 * d - 1)
    x = 2.0 * (math.sqrt(theta) if kind == 1 else theta) - 1.0
    rise: float = polynomial[1, d - 1]
    older, newer, before, slope = 1.0, x, 0.0, 1.0
    for k in range(2, len(polynomial)):
        older, newer = newer, ((2 * k - 1) * x * newer - (k - 1) * older) / k
        before, slope = slope, before + (2 * k - 1) * older  # P_k' = P_(k−2)' + (2k − 1) P_(k−1)
        rise += polynomial[k, d - 1] * slope
    return rise


@shared
def layer_of(model: Model, z: float, w: float) -> float:
    """How many kinks lie below a grain; of one at a kink where it goes: right behind a jump of the slip no step can be cut there."""
    z += math.copysign(BESIDE, w)
    return (1.0 if z > model.kinks[0] else 0.0) + (1.0 if z > model.kinks[1] else 0.0) + (1.0 if z > model.kinks[2] else 0.0)


def rates_of(equation: Equation, t: float, y: Any, out: Any, own: Any) -> None:
    """Rates without history of the states y, into `out`; `own`: the spin of a grain whose spin is no state, the layer between two kinks, and
    of a turbulent stream which grain it is, and room for its eddies.
    """
    if equation.across is None:
        z, sx, sy, sz = y[1], y[2], 0.0, y[3]
    else:
        z, sx, sy, sz = y[2], y[3], y[4], y[5]
    if equation.turning is None:
        ox, oy, oz = own[0], own[1], own[2]
    elif equation.across is None:
        ox, oy, oz = 0.0, y[4], 0.0
    else:
        ox, oy, oz = y[6], y[7], y[8]
    ahead = equation.begins + 0.5 * own[3] - 0.75 - z  # to the middle of the layer: kinks are half a diameter apart
    stream, shear = continued(equation.profile, z, ahead)
    s = Situation(z, sx, sy, sz, stream, shear, ox, oy, oz, ahead)
    fx, fy, fz = total_force(equation.forces, s)
    if equation.across is None:
        out[0], out[1] = sx + stream, sz
        out[2], out[3] = equation.alpha * fx - shear * sz, equation.alpha * fz
    else:
        out[0], out[1], out[2] = sx + stream, sy, sz
        out[3], out[4], out[5] = equation.alpha * fx - shear * sz, equation.alpha * fy, equation.alpha * fz
    if equation.turning is not None:
        tx, ty, tz = torque(equation.torque, s)
        if equation.across is None:
            out[4] = ty
        else:
            out[6], out[7], out[8] = tx, ty, tz
    if equation.eddies is not None:
        first = 4 if equation.across is None else 6
        if equation.turning is not None:
            first += 1 if equation.across is None else 3
        m = motion(equation.eddies, z, y[first], y[first + 1], y[first + 2], (sx, sy, sz), shear, own)
        (u, v, w), (ax, ay, az), (fx, fy, fz) = m.velocity, m.rate, m.acceleration
        if equation.across is None:
            out[0], out[1] = out[0] + u, out[1] + w
            out[2], out[3] = out[2] - shear * w + equation.alpha * fx - ax, out[3] + equation.alpha * fz - az
        else:
            out[0], out[1], out[2] = out[0] + u, out[1] + v, out[2] + w
            out[3], out[4], out[5] = out[3] - shear * w + equation.alpha * fx - ax, out[4] + equation.alpha * fy - ay, out[5] + equation.alpha * fz - az
        out[first], out[first + 1], out[first + 2] = m.clock, m.drift, m.bend


rates_entry = entry(rates_of)


@shared
def motion_of(model: Model, y: Any, own: Any) -> Any:
    """What the eddies do around a grain in the states y."""
    d, first = model.dimensions, 2 * model.dimensions + model.spins
    slip = y[d], 0.0 if model.dimensions == 2 else y[d + 1], y[2 * d - 1]
    shear = velocity_and_shear(model.profile, y[d - 1])[1]
    return motion(model.eddies, y[d - 1], y[first], y[first + 1], y[first + 2], slip, shear, own)


@shared
def leaving(model: Model, polynomial: Floats, y: Floats, kind: int, own: Any, states: Floats) -> float:
    """θ at which the step leaves its layer between two kinks, 2 if it does not; `states` at its stages, the end among them."""
    d = model.dimensions
    k = int(own[3])
    low = model.kinks[k - 1] if k > 0 else -math.inf
    high = model.kinks[k] if k < 3 else math.inf
    least = most = y[d - 1]
    for i in range(len(states)):
        least, most = min(least, states[i, d - 1]), max(most, states[i, d - 1])
    reach = most - least  # between stages it goes no farther beyond them
    if least - reach >= low and most + reach <= high:
        return 2.0
    places = 2 * len(polynomial) + 1
    before, earlier = 0.0, rise_of(model, y, own)
    for i in range(1, places + 1):
        after = i / places
        if kind == 1:
            after *= after
        later = rise_at(model, polynomial, y, kind, after, own)
        for trial in range(2):  # where it turns, and at the end
            place = after
            if trial == 0:
                if earlier * later >= 0.0:
                    continue
                place = crossed(model, polynomial, y, kind, own, True, 0.0, earlier > 0.0, before, after)
            z = at(polynomial, y, kind, place, d - 1)
            if z < low:
                return crossed(model, polynomial, y, kind, own, False, low, True, before, place)
            if z > high:
                return crossed(model, polynomial, y, kind, own, False, high, False, before, place)
        before, earlier = after, later
    return 2.0


@shared
def crossed(model: Model, polynomial: Floats, y: Floats, kind: int, own: Any, turns: bool, level: float, falls: bool, low: float, high: float) -> float:
    """The first θ found beyond `level` of the height, which is crossed between `low` and `high`, or of how fast it rises (`turns`), by bisection."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        value = rise_at(model, polynomial, y, kind, middle, own) if turns else at(polynomial, y, kind, middle, model.dimensions - 1)
        if value < level if falls else value > level:
            high = middle
        else:
            low = middle
    return high


@shared
def cross_kink(model: Model, p: stepper.Parts) -> None:
    """Enter the next layer: the slip goes on, its rate jumps. Where no time has passed since the layer before, steps shrink until one passes."""
    control, own, z = p.state.control[0], p.equation.own, p.state.y[model.dimensions - 1]
    k = int(own[3])
    if k > 0 and (k == 3 or abs(z - model.kinks[k - 1]) < abs(z - model.kinks[k])):
        own[3] = layer_of(model, model.kinks[k - 1] - 0.25, 0.0)
    else:
        own[3] = layer_of(model, model.kinks[k] + 0.25, 0.0)
    restart(p.problem, control, control.step if control.time > control.last_jump else 0.25 * control.step)


def each_force(effects: tuple[Any, ...], s: Situation, out: Floats, row: int, column: int) -> None:
    """The force of every effect into out[row, column:], three numbers each."""
    for effect in effects:
        out[row, column], out[row, column + 1], out[row, column + 2] = force(effect, s)
        column += 3


@overloads(each_force)
def _each_force(effects: Any, s: Any, out: Any, row: Any, column: Any) -> Callable[..., None]:
    def none(effects: Any, s: Any, out: Any, row: Any, column: Any) -> None:
        pass

    def each(effects: Any, s: Any, out: Any, row: Any, column: Any) -> None:
        out[row, column], out[row, column + 1], out[row, column + 2] = force(effects[0], s)
        each_force(effects[1:], s, out, row, column + 3)

    return each if len(effects) else none


@compiled()
def budget(equation: Equation, situations: Floats, out: Floats) -> None:
    """Forces of each effect, times α, at situations (points, 9) into `out` (points, 3·effects)."""
    for i in range(len(situations)):
        r = situations[i]
        each_force(equation.forces, Situation(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], 0.0), out, i, 0)
        for k in range(out.shape[1]):
            out[i, k] *= equation.alpha


@compiled(allocates=False)
def beside(model: Model, states: Floats, own: Floats, out: Floats) -> None:
    """Fluctuation, its rate along the path and the fluid's acceleration (x, y, z each) at states (points, states) into `out` (points, 9)."""
    for i in range(len(states)):
        m = motion_of(model, states[i], own)
        for k in range(3):
            out[i, k], out[i, 3 + k], out[i, 6 + k] = m.velocity[k], m.rate[k], m.acceleration[k]
