"""The data of a flight: indices and tables that compiled code shares with the rest of the simulator."""

from __future__ import annotations

from typing import Any, NamedTuple

from basset._compile import record_type
from basset.kernels import Floats

SHORTEST_FLIGHT = 1e-5  # d/V: shorter ones do not count as flights

# why `fly` returns, beside the codes of `basset.solvers.stepper`
JUMPS, REST, ALOFT, HORIZON, CROWDED = 20, 21, 22, 23, 24

# of a flight: takeoff, highest point and angle turned so far; of a grain: draws at the bed, short flights in a row, rows of the table of jumps, jumps
FLIGHT = record_type(
    "start", "x", "y", "z", "u", "v", "w", "top", "turned", ("impacts", "i8"), ("short", "i8"), ("done", "i8"), ("taken", "i8")
)  # fmt: skip

# columns of the table of jumps, as recorded: takeoff, flight, impact
COLUMNS = (
    "start", "x", "y", "z", "u", "v", "w", "duration", "length", "drift", "rise", "turned",
    "u_in", "v_in", "w_in", "normal_speed", "tilt", "clipped", "impulse_x", "impulse_y", "impulse_z", "contacts",
    "spin_x", "spin_y", "spin_z",
)  # fmt: skip

# columns of the table of encounters: n from the first grain to the second
ENCOUNTER_COLUMNS = (
    "time", "first", "second", "x", "y", "z", "n_x", "n_y", "n_z", "distance", "restitution",
    "first_u", "first_v", "first_w", "second_u", "second_v", "second_w",
    "first_spin_x", "first_spin_y", "first_spin_z", "second_spin_x", "second_spin_y", "second_spin_z",
    "first_u_after", "first_v_after", "first_w_after", "second_u_after", "second_v_after", "second_w_after",
    "first_spin_x_after", "first_spin_y_after", "first_spin_z_after", "second_spin_x_after", "second_spin_y_after", "second_spin_z_after",
    "impulse_x", "impulse_y", "impulse_z",
)  # fmt: skip

# the same as a record of numbers and vectors
VECTORS = [(name, "f8", (2, 3)) for name in ("velocity", "spin", "velocity_after", "spin_after")]
ENCOUNTER = record_type(*ENCOUNTER_COLUMNS[:11], *VECTORS, ("impulse", "f8", (3,)))

IMPULSE, RESTART, RESET, NOTHING = range(4)  # treatment of the history force at an impact


class Model(NamedTuple):
    """An equation as the loop sees it: its rates, to be called; the stream's table; dimensions (2, 3), states of the spin (0, 1, 3).

    `kinks` (d, rising): heights of the centre at which rates have a kink: the stream begins at the lower lift point, the centre, the
    upper lift point; without lift, three times at the centre. `eddies`: what moves the fluid beside the mean stream, None where nothing does.
    """

    rates: Any
    profile: Any
    kinks: tuple[float, float, float]
    dimensions: int
    spins: int
    eddies: Any = None


class Bed(NamedTuple):
    """Rebound, to be called; roughness, the highest contact (−∞ where there is no bed), and the seed and grain of its random numbers."""

    rebound: Any
    roughness: Any
    highest: float
    seed: int
    grain: int


class Memory(NamedTuple):
    """Treatment of the history force at an impact, how long the memory reaches; for a memory of so many jumps what came before each of them
    (jump, memory, terms) and when that was (jump,), both empty without such a limit.
    """

    rebound: int
    horizon: float
    before: Floats
    when: Floats


class Limits(NamedTuple):
    """The longest flight (a longer one ends the run), and the shortest: so many shorter ones in a row (`patience`) are rest.

    `above` (d): how far above a takeoff the acceleration is taken that tells how long the flight may last; 0 but for grains that leave a wall.
    """

    longest: float
    shortest: float
    patience: float
    max_jumps: float  # jumps wanted in all
    prescribed: int  # contacts do not turn the grain where 1
    above: float
