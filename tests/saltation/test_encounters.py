"""Encounters of grains: against exact two-body motions and an exact event-driven motion of many, conservation, nothing missed, hard cases."""

from __future__ import annotations

import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scene_cases import cloud_scene, fly_cloud, interpreted, merged, sand_cloud, scene, separations, vectors
from scipy.spatial import cKDTree

import saltation
from basset._compile import compiled
from saltation.bed.contact import strike_pair
from saltation.flight import cloud
from saltation.flight import collisions as encounters
from saltation.flight.collisions import DEEPEST_OVERLAP
from saltation.flow import velocity_and_shear

TOUCH = 1e-12  # d: surfaces nearer than this (and rounding of the time, 1e-14 of it) touch; the rest is rounding
ELASTIC = {"restitution": 1.0, "friction": 0.0, "slowest": 0.0}
FLAT = {"rebound": "tsuji", "roughness": "flat", "restitution": 1.0, "friction": 0.0, "span_scatter": False}


def two_body(n, velocities, spins, radii, masses, restitution, friction):
    """Velocities, spins and impulse from the matrix that takes an impulse at the contact to the jump of the slip there."""
    inverse = np.zeros((3, 3))
    for mass, radius in zip(masses, radii, strict=True):
        arm = np.cross(np.eye(3), radius * n)  # impulse -> torque, rows
        inverse += np.eye(3) / mass + arm @ arm.T / (0.4 * mass * radius**2)
    slip = velocities[0] - velocities[1] + np.cross(radii[0] * spins[0] + radii[1] * spins[1], n)
    closing = slip @ n
    impulse = np.linalg.solve(inverse, -slip - restitution * closing * n)
    push = -(impulse @ n)
    if np.linalg.norm(impulse + push * n) > friction * push:
        tangent = slip - closing * n
        impulse = -push * n - friction * push * tangent / np.linalg.norm(tangent)
    after = [velocities[0] + impulse / masses[0], velocities[1] - impulse / masses[1]]
    turned = [spins[k] + np.cross(radii[k] * n, impulse) / (0.4 * masses[k] * radii[k] ** 2) for k in (0, 1)]
    return after, turned, impulse


class Meeting:
    """Two grains that meet at a time with a normal: closing speed `speed`·√(1 − offset²), the paths' offset being `offset` d."""

    def __init__(self, seed, offset, in_plane):
        rng = np.random.default_rng(seed)
        self.time, self.speed, self.offset = rng.uniform(0.2, 2.0), rng.uniform(0.5, 2.0), offset
        free = np.array([1.0, 0.0 if in_plane else 1.0, 1.0])
        along, aside = free * rng.standard_normal(3), free * rng.standard_normal(3)
        along /= np.linalg.norm(along)
        aside -= (aside @ along) * along
        aside /= np.linalg.norm(aside)
        self.normal = offset * aside + math.sqrt(1.0 - offset**2) * along
        common = 0.5 * free * rng.standard_normal(3)
        self.velocities = np.array([common + 0.3 * self.speed * along, common - 0.7 * self.speed * along])
        place = free * [6.0, 6.0, 9.0] + free * rng.standard_normal(3)
        self.places = np.array([place, place + self.normal + self.speed * self.time * along])
        self.spins = 3.0 * rng.standard_normal((2, 3)) * ([0.0, 1.0, 0.0] if in_plane else [1.0, 1.0, 1.0])


@pytest.mark.parametrize("in_plane", [False, True])
@pytest.mark.parametrize("boundary", ["open", "periodic"])
@pytest.mark.parametrize("friction", [0.0, 0.05, 2.0])
@pytest.mark.parametrize("offset", [0.0, 0.6, 0.95, 1.0 - 1e-6, 1.0 - 1e-9])
def test_two_grains_on_parabolas(offset, friction, boundary, in_plane):
    """Time, place, velocities and spins in closed form: both fall alike, so they approach each other uniformly."""
    exact = Meeting(round(1e3 * offset) + round(10 * friction), offset, in_plane)
    law = {"restitution": 0.6, "friction": friction, "slowest": 0.0}
    made = cloud_scene(2, exact.time + 0.5, dimensions=2 if in_plane else 3, cloud={"boundary": boundary}, encounters=law)
    met = fly_cloud(made, exact.places, exact.velocities, exact.spins).encounters
    (row,) = met.itertuples()
    closing = exact.speed * math.sqrt(1.0 - offset**2)
    late = (TOUCH + 1e-13) / closing  # the gap that is taken for a touch, in time; 1e-13 for rounding of positions of ten
    gravity = made.numbers.alpha / made.numbers.shields
    fallen = np.array([0.0, 0.0, gravity * exact.time])
    assert abs(row.distance - 1.0) < 2.0 * TOUCH
    assert abs(row.time - exact.time) < late
    place = exact.places[0] + (exact.velocities[0] - 0.5 * fallen) * exact.time
    assert np.abs(np.array([row.x, row.y, row.z]) - place).max() < 5.0 * late + 1e-13
    (normal,) = (met[["n_x", "n_y", "n_z"]].to_numpy()[0],)
    turned = exact.speed * late + 1e-13  # by which the normal may be off
    assert np.abs(normal - exact.normal).max() < turned
    after, spun, impulse = two_body(exact.normal, exact.velocities - fallen, exact.spins, (0.5, 0.5), (1.0, 1.0), 0.6, friction)
    slip = exact.speed + np.abs(exact.spins).sum()
    blur = 4.0 * (1.0 + friction) * slip * turned + 1e-13  # an impulse of mass ½ and slip, every factor off by `turned`
    for name, value in (("first", after[0]), ("second", after[1])):
        assert np.abs(vectors(met, f"{name}_after")[0][0] - value).max() < blur
    for name, value in (("first_spin", spun[0]), ("second_spin", spun[1])):
        assert np.abs(vectors(met, f"{name}_after")[0][0] - value).max() < 5.0 * blur
    assert np.abs(vectors(met, "impulse")[0][0] - impulse).max() < blur


@pytest.mark.parametrize("miss", [1e-3, 1e-6, 1e-9, 1e-11])
def test_a_near_miss_is_no_encounter(miss):
    """Straight past each other, the gap at its least being `miss`: no encounter, and both go on as if alone."""
    exact = Meeting(7, 0.5, False)
    along = (exact.velocities[0] - exact.velocities[1]) / exact.speed
    aside = exact.normal - (exact.normal @ along) * along
    places = exact.places.copy()
    places[1] += (1.0 + miss) * aside / np.linalg.norm(aside) - aside
    result = fly_cloud(cloud_scene(2, exact.time + 2.0, cloud={"interval": 0.25}), places, exact.velocities)
    assert result.encounters.empty
    path = result.trajectory
    for k in (0, 1):
        assert np.abs(path["x"].to_numpy()[:, k] - places[k, 0] - exact.velocities[k, 0] * path["time"].to_numpy()).max() < 1e-13


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (3.0, -2.0)])
def test_across_the_edge_of_a_periodic_box(shift):
    """A grain's image in another period meets the same; in an open world they pass."""
    exact = Meeting(11, 0.3, False)
    laws = {"restitution": 0.6, "friction": 0.1}
    made = cloud_scene(2, exact.time + 0.5, encounters=laws)
    here = fly_cloud(made, exact.places, exact.velocities, exact.spins).encounters
    moved = exact.places + np.array([[0.0, 0.0, 0.0], [shift[0] * made.box[0], shift[1] * made.box[1], 0.0]])
    there = fly_cloud(made, moved, exact.velocities, exact.spins).encounters
    np.testing.assert_allclose(there.to_numpy(), here.to_numpy(), rtol=0.0, atol=2e-11)
    lonely = fly_cloud(cloud_scene(2, exact.time + 0.5, encounters=laws, cloud={"boundary": "open"}), moved, exact.velocities, exact.spins).encounters
    assert lonely.empty == any(shift)


@pytest.mark.parametrize("speed", np.linspace(40.0, 160.0, 9))
def test_the_image_that_is_nearest_now_is_not_the_one_that_is_met(speed):
    """Two grains set out back to back and meet on the far side of the box, within a step or two."""
    made = cloud_scene(2, 13.0 / (2.0 * speed))
    length = made.box[0]
    met = fly_cloud(made, [[1.0, 5.0, 5.0], [length - 0.2, 5.0, 5.0]], [[speed, 0.0, 0.0], [-speed, 0.0, 0.0]]).encounters
    (row,) = met.itertuples()
    assert row.time == pytest.approx((length - 2.2) / (2.0 * speed), rel=1e-12)


def test_unequal_grains_against_the_matrix_of_their_contact():
    """Radii over a decade, masses over three: sticking, sliding, and parting."""
    rng = np.random.default_rng(21)
    kinds = {"sticks": 0, "slides": 0}
    for _ in range(3000):
        n = rng.standard_normal(3)
        n /= np.linalg.norm(n)
        velocities, spins = rng.standard_normal((2, 3)), 2.0 * rng.standard_normal((2, 3))
        radii, masses = 0.5 * 10.0 ** rng.uniform(-0.5, 0.5, 2), 10.0 ** rng.uniform(-1.5, 1.5, 2)
        e, f = rng.uniform(0.0, 1.0), rng.choice([0.05, 0.3, 2.0])
        if (velocities[0] - velocities[1]) @ n <= 0.0:
            continue
        after, turned, impulse = two_body(n, velocities, spins, radii, masses, e, f)
        push = -(impulse @ n)
        kinds["slides" if np.linalg.norm(impulse + push * n) > f * push * (1.0 - 1e-9) else "sticks"] += 1
        first, second, spin, other, j = strike_pair(*n.tolist(), *velocities.tolist(), *spins.tolist(), radii, masses, e, f)
        size = 1.0 + np.abs([*after, *turned]).max()
        assert np.abs(np.array([first, second]) - after).max() < 1e-12 * size
        assert np.abs(np.array([spin, other]) - turned).max() < 1e-12 * size
        assert np.abs(np.array(j) - impulse).max() < 1e-12 * (1.0 + np.abs(impulse).max())
    assert min(kinds.values()) > 300


@compiled()
def worst(n, u, s, radii, masses, laws, found):
    """Largest relative error of momentum, of angular momentum about the contact, largest relative gain of energy; how many closed."""
    for k in range(len(n)):
        a, m = (radii[k, 0], radii[k, 1]), (masses[k, 0], masses[k, 1])
        v0, v1 = (u[k, 0, 0], u[k, 0, 1], u[k, 0, 2]), (u[k, 1, 0], u[k, 1, 1], u[k, 1, 2])
        o0, o1 = (s[k, 0, 0], s[k, 0, 1], s[k, 0, 2]), (s[k, 1, 0], s[k, 1, 1], s[k, 1, 2])
        w0, w1, p0, p1, j = strike_pair(n[k, 0], n[k, 1], n[k, 2], v0, v1, o0, o1, a, m, laws[k, 0], laws[k, 1])
        i0, i1 = 0.4 * m[0] * a[0] * a[0], 0.4 * m[1] * a[1] * a[1]
        before, after, linear, size = 0.0, 0.0, 0.0, 0.0
        for q in range(3):
            before += 0.5 * (m[0] * v0[q] ** 2 + m[1] * v1[q] ** 2 + i0 * o0[q] ** 2 + i1 * o1[q] ** 2)
            after += 0.5 * (m[0] * w0[q] ** 2 + m[1] * w1[q] ** 2 + i0 * p0[q] ** 2 + i1 * p1[q] ** 2)
            linear = max(linear, abs(m[0] * (w0[q] - v0[q]) + m[1] * (w1[q] - v1[q])))
            size = max(size, m[0] * (abs(v0[q]) + abs(w0[q])), m[1] * (abs(v1[q]) + abs(w1[q])))
        found[0] = max(found[0], linear / size)
        for q in range(3):
            r, t = (q + 1) % 3, (q + 2) % 3
            # the contact lies at a_1 n from the first and at −a_2 n from the second centre
            x0, x1 = -a[0] * (n[k, r] * (w0[t] - v0[t]) - n[k, t] * (w0[r] - v0[r])), a[1] * (n[k, r] * (w1[t] - v1[t]) - n[k, t] * (w1[r] - v1[r]))
            angular = abs(m[0] * x0 + m[1] * x1 + i0 * (p0[q] - o0[q]) + i1 * (p1[q] - o1[q]))
            turning = i0 * (abs(o0[q]) + abs(p0[q])) + i1 * (abs(o1[q]) + abs(p1[q]))
            found[1] = max(found[1], angular / (turning + size * (a[0] + a[1])))
        found[2] = max(found[2], after / before - 1.0)
        found[3] += abs(j[0]) + abs(j[1]) + abs(j[2]) > 0.0


@pytest.mark.parametrize("equal", [True, False])
def test_a_million_encounters_keep_momentum_and_gain_no_energy(equal):
    """Linear and angular momentum to rounding; e from 0 to 1 with both ends, f from 0, so that many lose nothing at all."""
    count = 10**6
    rng = np.random.default_rng(31)
    n = rng.standard_normal((count, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    u, s = rng.standard_normal((2, count, 2, 3))
    radii = np.full((count, 2), 0.5) if equal else 0.5 * 10.0 ** rng.uniform(-0.5, 0.5, (count, 2))
    masses = np.ones((count, 2)) if equal else 10.0 ** rng.uniform(-1.0, 1.0, (count, 2))
    laws = np.clip(rng.uniform([-0.2, -0.5], [1.2, 2.0], (count, 2)), 0.0, [1.0, np.inf])
    found = np.zeros(4)
    worst(n, u, 3.0 * s, radii, masses, laws, found)
    assert 0.49 < found[3] / count < 0.51
    assert found[0] < 2e-15
    assert found[1] < 2e-15
    assert found[2] < 4e-15


# Many grains, compiled: the two forms of the loop that these tests share


@pytest.fixture(scope="module")
def thin():
    return saltation.run(sand_cloud(30.0, cloud={"interval": 0.01}))


@pytest.fixture(scope="module")
def dense():
    """Ten percent of the volume are grains."""
    return saltation.run(sand_cloud(3.0, cloud={"interval": 0.01, "number": 300, "concentration": 0.1}))


@pytest.fixture(scope="module")
def crammed():
    """As many as may be asked for."""
    return saltation.run(sand_cloud(1.0, cloud={"interval": 0.01, "number": 300, "concentration": 0.3}))


@pytest.fixture(scope="module")
def long():
    """As shipped: grains that are caught between another and the bed meet again within 1e-5 d/u*."""
    return saltation.run(sand_cloud(500.0, cloud={"interval": 1.0}))


RUNS = pytest.mark.parametrize("name", ["thin", "dense", "crammed", "long"])


@RUNS
def test_every_encounter_keeps_momentum(name, request):
    """Linear, and angular about the contact: 0.1 d² m of inertia, arms of half a diameter."""
    met = request.getfixturevalue(name).encounters
    assert len(met) > 100
    u, v, after, other = vectors(met, "first", "second", "first_after", "second_after")
    spins = vectors(met, "first_spin", "second_spin", "first_spin_after", "second_spin_after")
    n = met[["n_x", "n_y", "n_z"]].to_numpy()
    size = np.abs([u, v, after, other]).max()
    assert np.abs(u + v - after - other).max() < 4e-16 * 4.0 * size
    turning = 0.5 * np.cross(n, v - u) + 0.1 * (spins[0] + spins[1])
    turned = 0.5 * np.cross(n, other - after) + 0.1 * (spins[2] + spins[3])
    assert np.abs(turned - turning).max() < 4e-16 * 4.0 * (size + 0.1 * np.abs(spins).max())
    assert np.abs(np.linalg.norm(n, axis=1) - 1.0).max() < 4e-16
    (impulse,) = vectors(met, "impulse")
    assert np.abs(after - u - impulse).max() < 4e-16 * 4.0 * size


@RUNS
def test_energy_grows_where_grains_would_part_too_slowly_alone(name, request):
    """Then they part with `slowest` exactly, and what is gained is at most ½ m_e slowest²; all others lose."""
    result = request.getfixturevalue(name)
    met, law = result.encounters, result.scene.options("encounters")
    energies = []
    for after in ("", "_after"):
        u, v, s, o = vectors(met, *(f"{word}{after}" for word in ("first", "second", "first_spin", "second_spin")))
        energies.append(0.5 * ((u**2).sum(1) + (v**2).sum(1)) + 0.05 * ((s**2).sum(1) + (o**2).sum(1)))
    gain = energies[1] - energies[0]
    helped = met["restitution"].to_numpy() > law.restitution
    rounding = 1e-15 * energies[0].max()
    assert (gain[~helped] < rounding).all()
    assert 0 < helped.sum() < len(met)
    assert gain[helped].max() < 0.25 * law.slowest**2 + rounding
    n = met[["n_x", "n_y", "n_z"]].to_numpy()
    u, v, after, other = vectors(met, "first", "second", "first_after", "second_after")
    closing, parting = ((u - v) * n).sum(1), ((other - after) * n).sum(1)
    assert (closing > 0.0).all()
    assert np.abs(parting - np.where(helped, law.slowest, law.restitution * closing)).max() < 4e-16 * 8.0 * np.abs([u, v, after, other]).max()
    assert (helped == (law.restitution * closing < law.slowest)).all()


@RUNS
def test_no_two_grains_ever_overlap(name, request):
    """At any stored time, sampled densely; and every encounter happens at a distance of one diameter."""
    result = request.getfixturevalue(name)
    length, width, _ = result.scene.box
    path = result.trajectory
    worst = math.inf
    for k in range(path.sizes["time"]):
        here = path.isel(time=k)
        places = np.column_stack([here["x"] % length, here["y"] % width, here["z"]])
        worst = min(worst, cKDTree(places, boxsize=[length, width, 0.0]).query(places, k=2)[0][:, 1].min())
    assert worst > 1.0 - DEEPEST_OVERLAP
    met = result.encounters
    assert (np.abs(met["distance"] - 1.0) < DEEPEST_OVERLAP).all()
    assert (np.diff(met["time"]) >= 0.0).all()


def test_without_the_search_they_would():
    """The same cloud that knows no encounters goes through itself."""
    effects = [name for name in saltation.load("sand_cloud").effects if name != "encounters"]
    assert separations(saltation.run(sand_cloud(3.0, effects=effects, cloud={"interval": 0.01}))).min() < 0.9


@pytest.mark.parametrize("name", ["thin", "dense", "crammed"])
def test_the_cells_hide_nobody(name, request, monkeypatch):
    """One cell with all grains in it is a search through all pairs: the same bits."""
    result = request.getfixturevalue(name)
    monkeypatch.setattr(cloud, "SMALLEST_CELL", 1e9)
    again = saltation.run(result.scene)
    assert again.encounters.equals(result.encounters)
    assert again.trajectory.equals(result.trajectory)


# One path per step


def test_a_path_is_the_integral_of_its_velocity_and_keeps_its_bounds():
    """At ten places of every step: positions against Gauss's rule, what leaves the chord against the bounds; it begins with the state's velocity."""
    kinds, x, w = [], *np.polynomial.legendre.leggauss(6)
    describe = encounters.describe_path

    def checked(model, singular, h, share, y, course, path):
        half = describe(model, singular, h, share, y, course, path)

        def flown(s):
            return [np.array(value) for value in encounters.place_and_velocity(model, course, s)]

        kinds.append(singular)
        stream = velocity_and_shear(model.profile, y[2])[0]
        assert np.abs(flown(0.0)[1] - [y[3] + stream, y[4], y[5]]).max() < 1e-12
        assert np.abs(flown(0.0)[0]).max() < 1e-14
        chord = np.array([path.u, path.v, path.w])
        last, before = 0.0, flown(0.0)[1]
        for s in np.linspace(0.1, 1.0, 10) * (math.sqrt(share) if singular else share):
            place, velocity = flown(s)
            time = h * s * s if singular else h * s
            nodes = 0.5 * s * (x + 1.0)
            integral = sum(0.5 * s * h * b * (2.0 * a if singular else 1.0) * flown(a)[1] for a, b in zip(nodes, w, strict=True))
            assert np.abs(place - integral).max() < 1e-13
            assert np.linalg.norm(place - chord * time) <= path.spread
            assert np.linalg.norm(velocity - chord) <= path.pace
            assert np.linalg.norm(velocity - before) <= (path.root * math.sqrt(h) if singular else path.bend * h) * (s - last) + 1e-12
            last, before = s, velocity
        return half

    made = sand_cloud(0.6, cloud={"number": 8, "boundary": "open", "concentration": 0.2, "spread": 2.0})
    with interpreted(), mock.patch.object(encounters, "describe_path", checked):
        saltation.run(made)
    assert min(kinds.count(0), kinds.count(1)) > 10


@st.composite
def clouds(draw):
    """Small clouds of the form that is compiled already: thin to dense, pressed together or not, with and without history."""
    one_of = lambda *words: draw(st.sampled_from(words))  # noqa: E731 - one word for a draw that is made a dozen times below
    between = lambda low, high: float(f"{10.0 ** draw(st.floats(math.log10(low), math.log10(high))):.4g}")  # noqa: E731
    diameter = between(2e-4, 5e-3)
    changes = {
        "fluid": {"viscosity": between(1e-6, 5e-6)},
        "grain": {"diameter": diameter, "density": between(1200.0, 4000.0)},
        "channel": {"transport_stage": between(1.2, 8.0), "profile": one_of("swamee", "reichardt")},
        "bed": {"roughness": one_of("flat", "R4", "R5"), "reading": "clip", "restitution": one_of(0.0, 0.045, 0.65), "friction": one_of(0.0, 0.1)},
        "encounters": {
            "restitution": one_of(0.0, 0.01, 0.65, 1.0),
            "friction": one_of(0.0, 0.1, 1.0),
            "slowest": one_of(0.01, 0.01, 1e-4, 0.0),
            "pile_up": 500,
        },
        "cloud": {"number": draw(st.integers(30, 80)), "concentration": between(0.01, 0.25), "spread": between(0.01, 1.0), "interval": 0.02},
        "run": {"seed": draw(st.integers(0, 10**6))},
    }
    changes["cloud"] |= {"boundary": one_of("periodic", "open"), "layer": one_of(1.2, 2.0, 3.0) * diameter}
    area = changes["cloud"]["number"] * math.pi / 6.0 / (changes["cloud"]["concentration"] * changes["cloud"]["layer"] / diameter)
    if area < 145.0:  # a periodic box is 12 d long at least
        changes["cloud"]["boundary"] = "open"
    if draw(st.booleans()):
        changes |= {"effects": [name for name in saltation.load("sand_cloud").effects if name != "history"], "history": None}
    return changes


SUNK = {  # to 3.6e-7 d, where positions and slips were two paths
    "fluid": {"viscosity": 2.013e-6},
    "grain": {"diameter": 1.016e-3, "density": 1861.0},
    "channel": {"transport_stage": 1.299, "profile": "reichardt"},
    "bed": {"roughness": "R4", "reading": "clip", "restitution": 0.045, "friction": 0.0},
    "encounters": {"restitution": 0.0, "friction": 1.0, "pile_up": 500},
    "cloud": {"number": 80, "concentration": 0.1, "spread": 0.04, "interval": 0.02},
    "run": {"seed": 313},
}


@pytest.mark.sweep
@settings(max_examples=3 * settings().max_examples // 10)
@given(clouds())
@example(SUNK)
def test_in_no_cloud_two_grains_overlap_or_meet_while_they_part(changes):
    """Distances at encounters and at all stored times against the promise; the rate at which they close in, rounding aside, is above 0."""
    try:
        unit = saltation.Scene.model_validate(merged(sand_cloud(1.0).model_dump(exclude_none=True), changes)).numbers.time
        made = scene("sand_cloud", **merged(changes, {"run": {"duration": 2.0 * unit, "discard": 0}}))
        result = saltation.run(made)
    except saltation.SceneError as error:
        assert "no room" in str(error)
        return
    assert result.status in ("finished", "pile-up"), result.message
    assert np.nanmin(separations(result), initial=1.0) > 1.0 - DEEPEST_OVERLAP
    met = result.encounters
    assert (np.abs(met["distance"] - 1.0) < DEEPEST_OVERLAP).all()
    n = met[["n_x", "n_y", "n_z"]].to_numpy()
    u, v = vectors(met, "first", "second")
    assert (((u - v) * n).sum(1) > (0.0 if made.options("encounters").slowest > 0.0 else -TOUCH)).all()


# Many grains against an exact motion


class Spheres:
    """Hard smooth spheres that fall alike over a smooth bed, event by event in closed form, all pairs and all images."""

    def __init__(self, places, velocities, gravity, period, restitution):
        self.x, self.v, self.gravity, self.period, self.restitution = places.copy(), velocities.copy(), gravity, period, restitution
        self.time, self.met, self.landed = 0.0, [], []

    def next_meeting(self):
        """(time to it, first, second, from the first to the second then)."""
        one, two = np.triu_indices(len(self.x), 1)
        v = self.v[two] - self.v[one]
        best = (math.inf, -1, -1, None)
        for image in np.stack(np.meshgrid((-2, -1, 0, 1, 2), (-2, -1, 0, 1, 2), (0,)), -1).reshape(-1, 3):
            r = self.x[two] - self.x[one]
            r[:, :2] -= self.period * np.round(r[:, :2] / self.period)
            r += self.period * image
            half, square, rest = (r * v).sum(1), (v * v).sum(1), (r * r).sum(1) - 1.0
            root = half**2 - square * rest
            meets = (half < 0.0) & (root > 0.0)
            time = np.where(meets, np.maximum(0.0, rest / np.where(meets, np.sqrt(np.where(meets, root, 0.0)) - half, 1.0)), math.inf)
            k = time.argmin()
            if time[k] < best[0]:
                best = (time[k], one[k], two[k], r[k] + v[k] * time[k])
        return best

    def run(self, end):
        """Up to a time."""
        while True:
            pause, one, two, r = self.next_meeting()
            fall = (self.v[:, 2] + np.sqrt(np.maximum(0.0, self.v[:, 2] ** 2 + 2.0 * self.gravity * (self.x[:, 2] - 0.5)))) / self.gravity
            low = int(fall.argmin())
            step = min(pause, fall[low], end - self.time)
            self.x += self.v * step
            self.x[:, 2] -= 0.5 * self.gravity * step**2
            self.v[:, 2] -= self.gravity * step
            self.time += step
            if step == pause:
                n = r / np.linalg.norm(r)
                jump = 0.5 * (1.0 + self.restitution) * ((self.v[one] - self.v[two]) @ n) * n
                self.v[one] -= jump
                self.v[two] += jump
                self.met.append((self.time, one, two))
            elif step == fall[low]:
                self.x[low, 2], self.v[low, 2] = 0.5, -self.v[low, 2]
                self.landed.append((self.time, low))
            else:
                return


@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_many_grains_against_the_exact_motion(restitution):
    """Every encounter in its turn, and no further off than a motion from starts that are 1e-12 d beside: each magnifies all differences."""
    rng = np.random.default_rng(41)
    made = cloud_scene(
        18, 4.0, bed=FLAT, encounters={"restitution": restitution, "friction": 0.0, "slowest": 0.0}, cloud={"concentration": 0.03, "interval": 0.05}
    )
    lattice = np.array([(a, b, c) for a in range(3) for b in range(3) for c in range(2)])
    places = lattice * [1.6, 1.6, 1.4] + [0.2, 0.2, 0.8] + rng.uniform(-0.15, 0.15, (18, 3))
    velocities = 1.5 * rng.standard_normal((18, 3)) - 1.2 * (places - places.mean(0))
    result = fly_cloud(made, places, velocities)
    gravity = made.numbers.alpha / made.numbers.shields
    exact = Spheres(places, velocities, gravity, made.box[0], restitution)
    exact.run(4.0)
    met, times = result.encounters, np.array([time for time, _, _ in exact.met])
    assert len(exact.met) > 25
    assert len(exact.landed) == len(result.all_jumps) > 5
    pairs = [tuple(sorted(pair)) for pair in zip(met["first"], met["second"], strict=True)]
    assert pairs == [(one, two) for _, one, two in exact.met]
    moved = np.zeros(len(times))
    for _ in range(4):
        other = Spheres(places + 1e-12 * rng.standard_normal(places.shape), velocities, gravity, made.box[0], restitution)
        other.run(4.0)
        moved = np.maximum(moved, np.abs([time for time, _, _ in other.met] - times))
    assert (np.abs(met["time"] - times) < 10.0 * np.maximum.accumulate(moved) + 1e-12).all()
    if restitution == 1.0:
        path = result.trajectory
        energy = sum(0.5 * path[name].to_numpy() ** 2 for name in "uvw") + gravity * path["z"].to_numpy()
        total = energy.sum(axis=1)
        assert np.abs(total / total[0] - 1.0).max() < 1e-13


# Hard cases


def test_a_row_of_grains_that_nearly_touch():
    """Newton's cradle: the blow goes through, whatever the gaps; touching exactly at relative rest is no encounter."""
    for gap in (1e-3, 1e-6, 1e-9):
        made = cloud_scene(4, 1.2, encounters=ELASTIC)
        places = [[2.0, 5.0, 5.0]] + [[3.5 + k * (1.0 + gap), 5.0, 5.0] for k in range(3)]
        met = fly_cloud(made, places, [[1.0, 0.0, 0.0]] + [[0.0, 0.0, 0.0]] * 3).encounters
        assert list(zip(met["first"], met["second"], strict=True)) == [(0, 1), (1, 2), (2, 3)], gap
        assert np.abs(met["time"] - [0.5, 0.5 + gap, 0.5 + 2.0 * gap]).max() < 4.0 * TOUCH
        assert np.abs(met["first_u_after"]).max() < 1e-11
        assert np.abs(met["second_u_after"] - 1.0).max() < 1e-11
    still = fly_cloud(cloud_scene(2, 0.02, encounters=ELASTIC), [[3.0, 5.0, 5.0], [4.0, 5.0, 5.0]], np.zeros((2, 3)))
    assert (still.status, len(still.encounters)) == ("finished", 0)


@pytest.mark.parametrize("restitution", [0.0, 0.05])
def test_inelastic_collapse(restitution):
    """Three in a row with e < 7 − 4√3 meet infinitely often in a finite time: a pile-up without `slowest`, an end with it."""
    places, velocities = [[2.0, 5.0, 5.0], [4.0, 5.0, 5.0], [6.3, 5.0, 5.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    law = {"restitution": restitution, "friction": 0.0, "pile_up": 100}
    stuck = fly_cloud(cloud_scene(3, 3.0, encounters=law | {"slowest": 0.0, "pile_up": 20}), places, velocities)
    assert stuck.status == "pile-up"
    assert "encounters.pile_up" in stuck.message
    assert 1.0 < stuck.time < 1.3  # both outer ones reach the middle by then
    assert stuck.time == stuck.encounters["time"].max()
    assert 0.0 <= stuck.time * (1.0 + 1e-12) - float(stuck.trajectory["time"].max()) < 0.1
    assert np.isfinite(stuck.trajectory.to_array()).all()
    assert np.isfinite(list(stuck.frequencies().values())).all()
    together = fly_cloud(cloud_scene(3, 3.0, encounters=law | {"slowest": 0.0}), places, velocities)  # nothing presses them
    assert together.status == "finished"
    assert np.abs(together.trajectory["u"].to_numpy()[-1]).max() < 1e-9
    loose = fly_cloud(cloud_scene(3, 3.0, encounters=law | {"slowest": 0.01}), places, velocities)
    assert loose.status == "finished"
    assert 3 < len(loose.encounters) < 30
    (u, v) = vectors(loose.encounters, "first_after", "second_after")
    assert ((v - u)[:, 0] * loose.encounters["n_x"]).min() > 0.01 * (1.0 - 1e-9)
    assert separations(loose).min() > 1.0 - 1e-9


def test_one_grain_settles_on_another():
    """On a flat bed: a lasting contact, told as a series of encounters; the lower one lies still in the end and leaves, with its fate."""
    bed = FLAT | {"restitution": 0.5, "friction": 0.1}
    result = fly_cloud(cloud_scene(2, 1.6, bed=bed, cloud={"interval": 0.01}), [[2.0, 5.0, 0.5], [2.0, 5.0, 1.6]], [[0.0, 0.0, 0.2], [0.0, 0.0, 0.0]])
    assert result.status == "finished"
    assert len(result.encounters) >= 5
    assert np.nanmin(separations(result)) > 1.0 - 1e-9
    assert np.isfinite(result.encounters.to_numpy()).all()


def test_grains_pressed_together_by_the_stream():
    """Drag pushes the grain behind, higher up in the shear, against the one in front: they stay in touch and never sink into each other."""
    made = cloud_scene(
        2, 2.0, dimensions=2, effects=["weight", "drag", "encounters"], channel={"profile": "swamee"}, encounters={"friction": 0.3}, cloud={"interval": 0.01}
    )
    result = fly_cloud(made, [[2.0, 0.0, 3.0], [2.98, 0.0, 2.75]], [[6.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    assert result.status == "finished"
    assert len(result.encounters) > 50
    gaps = separations(result)[:, 0] - 1.0
    assert gaps.min() > -1e-9
    assert gaps[100:].max() < 0.01
    assert np.isfinite(gaps).all()


def test_a_grain_at_rest_leaves_the_run():
    """It has a fate and a time, its path ends there, and the others go on."""
    bed = FLAT | {"restitution": 0.0}
    result = fly_cloud(cloud_scene(2, 3.0, bed=bed), [[2.0, 5.0, 0.8], [7.0, 5.0, 3.0]], [[0.0, 0.0, 0.0], [0.3, 0.0, 3.0]])
    assert result.status == "finished"
    gravity = result.scene.numbers.alpha / result.scene.numbers.shields
    (fate,) = result.fates.itertuples()
    assert (fate.grain, fate.fate) == (0, "at rest")
    assert fate.time == pytest.approx(math.sqrt(2.0 * 0.3 / gravity), rel=1e-12)
    gone = result.trajectory["time"].to_numpy() > fate.time
    assert (np.isnan(result.trajectory["z"].to_numpy()[:, 0]) == gone).all()
    assert np.isfinite(result.trajectory["z"].to_numpy()[:, 1]).all()


@pytest.mark.parametrize("number", [1, 2])
def test_few_grains_in_an_open_world(number):
    made = cloud_scene(number, 1.0, cloud={"boundary": "open"})
    result = saltation.run(made)
    assert (result.status, result.trajectory.sizes["grain"], len(result.encounters)) == ("finished", number, 0)
    assert result.trajectory.sizes["time"] == 11


def test_no_room_is_one_sentence(monkeypatch):
    """Random places in a thick layer do not come to 30 %; the tries are cut short, because all of them take 20 s."""
    monkeypatch.setattr(cloud, "ROUNDS", 20)
    with pytest.raises(saltation.SceneError, match=r"^cloud.concentration = 0.3 is too high: no room for 3000 grains that do not touch$"):
        saltation.run(cloud_scene(3000, 1.0, cloud={"concentration": 0.3, "layer": 0.69e-2}))


# Symmetry


def eight_grains(seed):
    rng = np.random.default_rng(seed)
    lattice = np.array([(a, b, c) for a in range(2) for b in range(2) for c in range(2)])
    places = lattice * [1.5, 1.5, 1.4] + [4.0, 4.0, 0.8] + rng.uniform(-0.15, 0.15, (8, 3))
    return places, rng.standard_normal((8, 3)) - 1.2 * (places - places.mean(0)), 2.0 * rng.standard_normal((8, 3))


SYMMETRIC = {"bed": FLAT | {"restitution": 0.65, "friction": 0.1}, "cloud": {"interval": 0.05, "boundary": "open"}}


def test_mirrored_across_the_stream():
    """Velocities mirror as vectors, spins as pseudovectors."""
    places, velocities, spins = eight_grains(51)
    made = cloud_scene(8, 1.5, **SYMMETRIC)
    here, there = fly_cloud(made, places, velocities, spins), fly_cloud(made, places * [1, -1, 1], velocities * [1, -1, 1], spins * [-1, 1, -1])
    assert len(here.encounters) > 5
    for name in here.encounters:
        odd = name.startswith("impulse_y") or name in ("y", "n_y") or "_v" in name or "spin_x" in name or "spin_z" in name
        np.testing.assert_allclose(there.encounters[name], (-1.0 if odd else 1.0) * here.encounters[name], atol=1e-9, err_msg=name)
    assert np.abs(there.trajectory["y"] + here.trajectory["y"]).max() < 1e-9
    assert np.abs(there.trajectory["z"] - here.trajectory["z"]).max() < 1e-9


def test_numbers_are_names():
    """A bed that draws nothing: grains in another order are the same motion."""
    places, velocities, spins = eight_grains(52)
    made = cloud_scene(8, 1.5, **SYMMETRIC)
    order = np.array([3, 1, 7, 0, 5, 2, 6, 4])
    here, there = fly_cloud(made, places, velocities, spins), fly_cloud(made, places[order], velocities[order], spins[order])
    assert len(here.encounters) > 5
    assert np.abs(here.encounters["time"] - there.encounters["time"]).max() < 1e-9
    named = [{order[one], order[two]} for one, two in zip(there.encounters["first"], there.encounters["second"], strict=True)]
    assert named == [set(pair) for pair in zip(here.encounters["first"], here.encounters["second"], strict=True)]
    for name in "xyzuvw":
        assert np.abs(there.trajectory[name].to_numpy() - here.trajectory[name].to_numpy()[:, order]).max() < 1e-9
