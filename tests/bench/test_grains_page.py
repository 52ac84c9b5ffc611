"""The page on many grains: trends are told by their errors, figures show the records."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from reports import grains as page
from saltation.regressions import REGRESSIONS

STAGES = (2.0, 2.5, 3.0)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def changes(slope=0.0, count=200, sd=1.0):
    """Records of both concentrations, with scatter and without: sizes that are a line over T."""
    labels = [(c, scatter, name) for c in (page.LOW, page.HIGH) for scatter in (False, True) for name in page.CHANGED]
    rows = [{"concentration": c, "scatter": scatter, "quantity": name} for c, scatter, name in labels]
    return [row | {"stage": T, "mean_size": 5.0 + slope * T, "sd_size": sd, "count": count, "slow": 3} for row in rows for T in STAGES]


def test_a_trend_is_the_slope_of_least_squares_and_its_error():
    """A hundred encounters of unit deviation at each of three stages half a unit apart: 1/√(100 · 2 · ¼)."""
    slope, error = page.trend(changes(-0.3)[:3])
    assert slope == pytest.approx(-0.3, rel=1e-12) and error == pytest.approx(50.0**-0.5, rel=1e-12)


@pytest.mark.parametrize(("slope", "told"), [(-0.3, "falling xz (−0.30 ± 0.14)"), (0.3, "growing xz (+0.30 ± 0.14)"), (0.25, "two standard errors xz")])
def test_what_is_told_of_a_trend_follows_its_error(slope, told):
    assert told in page.trends({"study": {"changes": changes(slope)}}, page.HIGH)


def test_every_change_is_drawn_for_both_concentrations():
    figure = page.draw_changes(changes(0.5))
    assert len(figure.axes) == 9
    for axes in figure.axes:
        points = [container.lines[0].get_ydata() for container in axes.containers]
        assert len(points) == 4 and all(values == pytest.approx([6.0, 6.25, 6.5]) for values in points)


def test_regressions_are_drawn_beside_a_single_grain():
    """Those of `saltation.regressions`; van Rijn's H at R_p 73, T 2.5 is 2.72."""
    rows = []
    for size in (73.0, 250.0):
        for T in STAGES:
            published = {name: regression(size, T)._asdict() for name, regression in REGRESSIONS.items()}
            own = {name: {"mean": 1.0, "sd": 0.3, "se": 0.01} for name in ("height", "length")}
            rows.append({"particle_reynolds": size, "stage": T, "regressions": published, **own})
    panels = np.array(page.draw_validation(rows).axes).reshape(2, 2)
    for column, size in enumerate((73.0, 250.0)):
        for line, name in enumerate(("height", "length")):
            drawn = {artist.get_label(): artist for artist in panels[line, column].lines}
            for key, (label, _) in page.REGRESSIONS.items():
                assert drawn[label].get_ydata() == pytest.approx([getattr(REGRESSIONS[key](size, T), name) for T in STAGES], rel=1e-12)
            thin, thick = (container.lines[2][0].get_segments() for container in panels[line, column].containers)
            assert np.ptp(thin[0][:, 1]) == pytest.approx(1.2) and np.ptp(thick[0][:, 1]) == pytest.approx(0.04)
    van_rijn = next(artist for artist in panels[0, 0].lines if artist.get_label() == "van Rijn 1984")
    assert van_rijn.get_ydata()[1] == pytest.approx(2.72, abs=5e-3)


def test_means_of_the_first_jumps_are_drawn():
    rows = [{"jumps": n, "height": 1.0, "height_sd": 0.4, "height_se": 0.1, "length": 9.0, "length_sd": 3.0, "length_se": 1.0} for n in (100, 517)]
    figure = page.draw_first(rows)
    assert [container.lines[0].get_ydata().tolist() for axes in figure.axes for container in axes.containers] == [[1.0, 1.0]] * 2 + [[9.0, 9.0]] * 2
