"""What was once asked of accuracy, held against the committed measurements; what was asked of speed depends on the machine and is in the pages."""

import math

import numpy as np
import pytest

import basset
from reports import choosing, flights, how_to_choose, memory, quadrature, scenes, solver
from reports.saltation import impacts, ranks, records
from reports.site.page import HERE, load
from reports.words import of, select


@pytest.fixture(scope="module")
def data():
    return load(HERE / "data")


def test_rules_keep_their_orders_and_their_floors(data):
    fresnel = data["fresnel"]["records"]
    assert all(row.slope >= row.declared - 0.25 for row in quadrature.convergence(fresnel))
    for scheme, n, limit in (("Daitche(8)", 1024, 2e-10), ("Daitche(8)", 4096, 5e-15), ("Daitche(4)", 65536, 1e-14)):
        assert of(fresnel, scheme=scheme, clock="cached", problem="fresnel", n=n)[0]["error_end"] <= limit
    for scheme in quadrature.schemes(fresnel):
        errors = [r["error_end"] for r in select(fresnel, scheme=scheme, clock="cached", problem="fresnel") if r["error_end"] is not None]
        below = [k for k, error in enumerate(errors) if error < 1e-12]
        assert not below or max(errors[below[0] :]) <= 1e-12


def test_a_low_order_is_for_noise_and_kinks_and_not_for_few_samples(data):
    """What README advises: five samples per oscillation, 0.6 of the noise; near a kink a third of the error, far from it the same."""
    for problem in ("fresnel", "fresnel_generic"):
        assert 5.0 < how_to_choose.fewest(select(data["fresnel"]["records"], problem=problem, clock="cached")) < 5.2
    assert 0.55 < how_to_choose.noise(2) / how_to_choose.noise(8) < 0.65
    dt, near, far = 1.0 / 400, {}, {}
    t = dt * np.arange(401)
    for order in (2, 8):
        errors = []
        for kink in 0.5 + dt * np.arange(8) / 8.0:  # at and between nodes
            exact = 2.0 * kink * np.sqrt(t) - 4.0 / 3.0 * t**1.5 + 8.0 / 3.0 * np.maximum(t - kink, 0.0) ** 1.5
            errors.append(np.abs(basset.cumulate(np.abs(t - kink), dt, basset.Daitche(order=order)) - exact))
        near[order], far[order] = np.max(errors), np.max(np.array(errors)[:, 260:])
    assert near[2] < near[8] / 3.0 and np.isclose(far[2], far[8], rtol=0.01)


def test_weights_are_exact(data):
    for row in data["weights"]["worst"]:
        assert row["error"] <= (2e-14 if row["order"] <= 4 else 1e-13)
    assert max(r["difference"] or 0.0 for r in data["trajectory"]["records"]) <= 1e-12


def test_sums_keep_their_promise_with_few_terms_and_so_do_streams(data):
    sums, stream = data["exponentials"], data["stream"]
    assert all(r["error"] <= r["rtol"] for r in sums["fitted"])
    assert all(r["n"] <= r["law"] + 2 for r in sums["fitted"] if any(math.isclose(r["rtol"], rtol) for rtol in (1e-3, 1e-6, 1e-9, 1e-12)))
    assert all(gain >= 10.0 for name in memory.PUBLISHED for gain in memory.gains(sums["floors"], name).values())
    assert max(r["difference"] for r in stream["agreement"]) <= 1e-9
    assert max(memory.above_full(stream["convergence"])) <= 1.4
    assert stream["headline"]["bytes"] <= 1000


def test_advice_keeps_the_error_asked_for(data):
    rows = data["advice"]["rows"]
    assert len({row["case"].split(",")[0] for row in rows}) >= 12
    assert all(row["measured"] <= row["error"] for row in rows)


def test_collocation_keeps_its_tolerance(data):
    found = data["coupled"]
    assert solver.worst_kept(found)[0] <= 10.0
    assert min(r["steps"] for r in of(found["records"], problem="relaxing", scheme=solver.OURS) if r["error_max"] <= 1e-9) <= 25
    assert all(r.get("lowest") is None or r["lowest"] >= -1e-10 for r in of(found["records"], problem="bouncing", scheme=solver.OURS))
    assert all(r["error"] <= r["rtol"] for r in found["without_history"] if r["solver"] == solver.OURS)
    assert found["rest"]["status"] == 2
    assert solver.linear(found, "nfev")[2] <= 0.1
    for name in ("Daitche(1)", "Daitche(2)", "Daitche(3)"):
        assert solver.order(found, "smooth", name) >= found["declared"][name] - 0.25


def test_flights_are_those_of_the_loop_written_by_hand_and_of_every_scheme_in_the_limit(data):
    found = data["flights"]
    assert all(r["apart"] <= 1e-12 for r in found["by_hand"]["records"])
    assert all(r["ratio"] < 1.0 for r in found["halving"])
    assert flights.limit_error(found, "height") <= 0.01
    for memories in ("remembered", "forgotten"):
        assert flights.equal(found[memories], flights.best_fixed(found[memories]))[1] >= 10.0


def test_collocation_reaches_every_error_of_a_mean_first(data):
    found = data["scenes"]
    assert all(r["height"] is not None for key in scenes.MEMORIES for r in found[key]["records"])
    for key in scenes.MEMORIES:
        assert found[key]["reference_apart"] <= 1e-8
        for quantity in scenes.QUANTITIES:
            for bound in scenes.BOUNDS:
                ours, theirs = (scenes.fastest(group(found[key]["records"]), bound, quantity)[0] for group in (scenes.collocated, scenes.stepped))
                assert ours is not None and (theirs is None or theirs["seconds"] >= ours["seconds"])


def test_jumps_are_the_prototypes_and_rise_with_the_stage(data):
    found = data["saltation"]
    apart = [z for r in found["memory"]["records"] if (z := impacts.deviation(r)) is not None]
    assert len(apart) > 20 and max(map(abs, apart)) <= impacts.KEPT_BY
    for reynolds in records.SIZES:
        runs = records.grid(found, found["grid"]["shipped"], reynolds)
        assert all(np.diff([run[quantity]["mean"] for run in runs]).min() > 0.0 for quantity in records.QUANTITIES)
    assert max(ranks.slow_runs(found, "BC", 73.0)) < ranks.CREEP and max(ranks.slow_runs(found, "BC", 250.0, (2,))) < ranks.CREEP


def test_auto_is_as_a_full_ablation(data):
    found = data["choosing"]
    for which in choosing.CHOICES:
        for name in found["sets"]:
            assert choosing.reference_row(found, name, which)["largest"] <= choosing.tolerance_of(found, which)
            assert choosing.fewest(found, name, which)
            assert all(set(run["left_out"]) == set(choosing.dropped(found, name, which)) for run in found[which][name])
    assert not {"history", "magnus"} & set(choosing.dropped(found, "sand")) and "history" in choosing.dropped(found, "gravel")


def test_grains_alone_are_grains_among_many(data):
    assert data["grains"]["independent"]["same"] and max(row["bytes"] for row in data["grains"]["scaling"] if row["number"] >= 1000) <= 2000
