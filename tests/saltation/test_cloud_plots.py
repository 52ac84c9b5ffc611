"""Pictures of many grains show what the tables say; data are made by hand: straight flights in plan, parabolas above the bed, two encounters."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.collections import EllipseCollection
from PIL import Image

from basset._look import RED
from saltation import cli, statistics
from saltation.flight import layout
from saltation.plots import film as animation
from saltation.plots import highlights
from saltation.plots.cloud import CLOUD_PLOTS
from saltation.plots.tracks import BED, MET, image, meeting_places, track
from saltation.results.result import Result
from saltation.results.tables import UNITS, path_dataset, tables_to_dataset
from saltation.scene import read, scene_of
from saltation.study import grains

END, STEP, PERIOD, RISE, LOW, SPEED = 20.0, 0.1, 2.0, 1.2, 0.6, 6.0
MOMENTS = (5.33, 11.13)  # of the encounters of grains 0 and 1, 2 and 3
NORMALS = (np.array([0.8, 0.6, 0.0]), np.array([0.6, 0.8, 0.0]))
BEFORE, AFTER = 0.5, -0.325  # u*, of the first grain along the normal


def scene(**changes):
    content = read("sand_cloud")
    content["run"] |= {"discard": 1, "duration": 0.5}
    for name, value in changes.items():
        content[name] = content[name] | value if isinstance(value, dict) else value
    return scene_of(content)


def state(grain, time, box, after=True):
    """Place and velocity; the second pair meets over the edge of the box."""
    pair, second = divmod(grain, 2)
    moment, normal = MOMENTS[pair], NORMALS[pair]
    share = BEFORE if time < moment or (time == moment and not after) else AFTER
    sign = -1.0 if second else 1.0
    phase = time % PERIOD if after or time % PERIOD else PERIOD
    fall = 8.0 * RISE / PERIOD**2
    start = np.array([3.0, 5.0 if pair == 0 else box[1] - 0.3, LOW])
    if grain == 3:
        start[1] -= box[1]
    place = start + second * normal + sign * share * (time - moment) * normal + [SPEED * time, 0.0, 0.5 * fall * phase * (PERIOD - phase)]
    return place, sign * share * normal + [SPEED, 0.0, 0.5 * fall * (PERIOD - 2.0 * phase)]


def cloud(met=True, kept=True, made=None):
    made = made or scene()
    times = np.arange(0.0, END + 0.5 * STEP, STEP)
    values = np.array([[np.concatenate(state(grain, time, made.box)) for grain in range(4)] for time in times])
    rows = []
    for grain in range(4):
        for start in np.arange(0.0, END - PERIOD, PERIOD):
            (here, out), (there, into) = state(grain, start, made.box), state(grain, start + PERIOD, made.box, after=False)
            row = dict.fromkeys(UNITS, 0.0) | {"grain": grain, "start": start, "duration": PERIOD, "height": RISE, "height_above_bed": LOW + RISE}
            row |= {"length": there[0] - here[0], "drift": there[1] - here[1], "stokes": 20.0, "velocity": SPEED}
            row |= {f"takeoff_{c}": out[k] for k, c in enumerate("xyz")} | {f"impact_{c}": into[k] for k, c in enumerate("xyz")}
            rows.append(row)
    table = np.zeros((2 if met else 0, len(layout.ENCOUNTER_COLUMNS)))
    for k, row in enumerate(table):
        found = {"time": MOMENTS[k], "first": 2 * k, "second": 2 * k + 1, "distance": 1.0, "restitution": 0.65}
        found |= dict(zip(("x", "y", "z"), state(2 * k, MOMENTS[k], made.box)[0], strict=True))
        found |= dict(zip(("n_x", "n_y", "n_z"), NORMALS[k], strict=True))
        for who, grain in (("first", 2 * k), ("second", 2 * k + 1)):
            for end in ("", "_after"):
                found |= {f"{who}_{c}{end}": v for c, v in zip("uvw", state(grain, MOMENTS[k], made.box, after=bool(end))[1], strict=True)}
            found[f"{who}_spin_y_after"] = 0.25
        row[:] = [found.get(name, 0.0) for name in layout.ENCOUNTER_COLUMNS]
    met_table = pd.DataFrame(dict(zip(layout.ENCOUNTER_COLUMNS, table.T, strict=True))).astype({"first": np.int32, "second": np.int32})
    path = path_dataset(made, times, values) if kept else None
    fates = pd.DataFrame({"grain": [], "time": [], "fate": []})
    return Result(made, pd.DataFrame(rows), "finished", "run.duration is reached", {"seed": 1}, END, met_table, fates, path)


@pytest.fixture(scope="module")
def result():
    return cloud()


def rings(axes):
    """Number of marks at encounters."""
    return sum(len(line.get_xdata()) for line in axes.lines if line.get_color() == RED and line.get_marker() == "o")


# Tracks


@pytest.mark.parametrize("grain", range(4))
def test_a_track_is_the_path(result, grain):
    """Through stored positions, and right between them and on both sides of contacts."""
    found = track(result, grain)
    assert (found.kind == BED).sum() == len(np.arange(0.0, END - PERIOD, PERIOD)) - 1
    assert (found.kind == MET).sum() == 1
    path = result.trajectory.isel(grain=grain).sel(time=slice(0.0, 17.95))
    at = found.at(path["time"])[0]
    for k, name in enumerate("xyz"):
        assert at[:, k] == pytest.approx(path[name].to_numpy(), abs=1e-12)
    times = np.linspace(0.0, 17.85, 1001)
    exact = np.array([np.concatenate(state(grain, time, result.scene.box)) for time in times])
    places, velocities = found.at(times)
    assert places == pytest.approx(exact[:, :3], abs=1e-9)
    assert velocities == pytest.approx(exact[:, 3:], abs=1e-7)
    assert np.isnan(found.at([-0.1, END + 0.1])[0]).all()


def test_grains_that_meet_over_the_edge_touch(result):
    first, second = meeting_places(result)
    near, far = np.linalg.norm(second - first, axis=1)
    assert near == pytest.approx(1.0, abs=1e-9)
    assert far > 10.0
    one, other = (track(result, grain).at([MOMENTS[1]])[0][0] for grain in (2, 3))
    assert np.linalg.norm(one - other) > 10.0
    assert np.linalg.norm(one - other - image(result, one, other)) == pytest.approx(1.0, abs=1e-9)


def test_accelerations_leave_out_contacts(result):
    """Across the stream nothing but an encounter acts: zero between contacts, whatever the interval."""
    found = track(result, 0)
    ends, rates = found.mean_accelerations()
    assert (np.diff(ends, axis=1) > 0.0).all()
    assert np.abs(rates[:, 1]).max() < 1e-9
    assert rates[:, 2] == pytest.approx(-8.0 * RISE / PERIOD**2)


# Figures


@pytest.mark.parametrize("name", ["three_dimensional", "plan"])
def test_marks_are_the_encounters_in_the_window(result, name):
    group = highlights.group_of(result, 4.0 * PERIOD)
    figure = CLOUD_PLOTS[name](result)
    assert rings(figure.axes[0]) == len(group.of(result)) == 1
    lines = [line for line in figure.axes[0].lines if line.get_linewidth() == 1.6]
    assert len(lines) == len(group.offsets) == 2
    for line, (grain, offset) in zip(lines, group.offsets.items(), strict=True):
        drawn = np.array(line.get_data_3d() if name == "three_dimensional" else line.get_data())
        path = result.trajectory.isel(grain=grain)
        inside = ((path["time"] > group.low) & (path["time"] < group.high)).to_numpy()
        y = path["y"].to_numpy()[inside] + offset[1]
        assert np.isclose(drawn[1][:, None], y, atol=1e-9).any(axis=0).all()


def test_three_grains_in_a_chain_come_into_one_image(result):
    """Grains are joined by whom they meet, and drawn where they meet."""
    met = result.encounters.copy()
    met.loc[len(met)] = met.iloc[0].to_dict() | {"first": 1, "second": 2, "time": 6.0}
    met["first"], met["second"] = met["first"].astype(int), met["second"].astype(int)
    places = tuple(np.array([[1.0, y, 1.0] for y in values]) for values in ((5.0, 22.0, 22.0), (5.9, -0.3, 0.5)))
    offsets = highlights.grow(met, 1, places, result)
    assert set(offsets) == {0, 1, 2, 3}
    width = result.scene.box[1]
    assert offsets[2][1] == pytest.approx(width)
    assert offsets[3][1] == pytest.approx(2.0 * width)


def test_pair_points_at_every_contact(result):
    figure = CLOUD_PLOTS["pair"](result)
    found = highlights.undisturbed_pair(result, "pair")
    low, high = found.row["time"] - 1.3 * PERIOD, found.row["time"] + 1.3 * PERIOD
    contacts = sum(((path.time > low) & (path.time < high) & (path.kind != 0)).sum() for path in found.tracks)
    assert all(len(axes.texts) == contacts for axes in figure.axes)


def test_snapshots_touch_at_contact_alone(result):
    """The line of centres at contact lies in the picture; circles are one diameter wide."""
    apart = []
    for axes in CLOUD_PLOTS["snapshots"](result).axes:
        circles = [drawn for drawn in axes.collections if isinstance(drawn, EllipseCollection)]
        apart.append(np.linalg.norm(circles[0].get_offsets() - circles[1].get_offsets()))
        assert [circle.get_widths()[0] for circle in circles] == [1.0, 1.0]
        assert axes.get_aspect() == 1.0
    assert apart[2] == pytest.approx(1.0, abs=1e-9)
    assert min(apart[:2] + apart[3:]) > 1.05
    assert apart[0] > apart[1]
    assert apart[4] > apart[3]


def test_grain_history_shows_the_jumps_of_the_table(result):
    figure = CLOUD_PLOTS["grain_history"](result)
    assert figure.get_suptitle().startswith(("Grain 0", "Grain 1", "Grain 2", "Grain 3"))
    velocity = next(line for line in figure.axes[2].lines if line.get_linestyle() == "-").get_ydata()
    sizes = BEFORE * NORMALS[0][1], AFTER * NORMALS[0][1], BEFORE * NORMALS[1][1], AFTER * NORMALS[1][1]
    assert np.ptp(velocity) == pytest.approx(max(abs(sizes[0] - sizes[1]), abs(sizes[2] - sizes[3])))
    dotted = [line for line in figure.axes[0].lines if line.get_linestyle() == ":"]
    assert [line.get_xdata()[0] for line in dotted] == [MOMENTS[1]]
    chosen = CLOUD_PLOTS["grain_history"](result, grain=0, start=0.0)
    assert "Grain 0" in chosen.get_suptitle()
    with pytest.raises(ValueError, match="grain must be from 0 to 3, got 7"):
        CLOUD_PLOTS["grain_history"](result, grain=7)


def test_profiles_are_those_of_the_result(result):
    figure = CLOUD_PLOTS["profiles"](result)
    table = result.profiles(start=highlights.settled(result))
    assert figure.axes[0].lines[0].get_xdata() == pytest.approx(100.0 * table["concentration"].to_numpy())
    stream = next(line for line in figure.axes[1].lines if line.get_linestyle() == "--")
    height, velocity = stream.get_ydata()[-1], stream.get_xdata()[-1]
    assert velocity == pytest.approx(result.scene.profile.velocity_and_shear(height)[0])


def test_the_sizes_of_what_encounters_change(result):
    """Two encounters, whose grains change alike."""
    panels = {axes.get_xlabel(): axes for axes in CLOUD_PLOTS["encounters"](result).axes}
    assert len(panels) == 9
    turn = np.degrees(np.arctan2(0.3, 6.4) + np.arctan2(0.325 * 0.6, 6.0 - 0.325 * 0.8))
    turns = [turn, np.degrees(np.arctan2(0.4, 6.3) + np.arctan2(0.325 * 0.8, 6.0 - 0.325 * 0.6))]
    for label, mean in (("along |Δu| (u*)", 0.825 * 0.7), ("across |Δv| (u*)", 0.825 * 0.7), ("|Δω_y| (u*/d)", 0.25)):
        assert panels[label].lines[0].get_xdata()[0] == pytest.approx(mean)
        assert sum(bar.get_height() for bar in panels[label].patches) == pytest.approx(100.0)
    first = grains.changes(result)["angle_xy"].abs()
    assert first.iloc[[0, 2]].tolist() == pytest.approx(turns)


def test_second_moments_are_those_of_statistics(result):
    figure = CLOUD_PLOTS["second_moments"](result, without=cloud(met=False))
    path = result.trajectory
    moments = statistics.moments_of_grains(path["time"], np.stack([path["x"], path["y"]], axis=2))
    for k, axes in enumerate(figure.axes):
        line = axes.lines[0]
        rows = np.round(line.get_xdata() / STEP).astype(int)
        assert line.get_ydata() == pytest.approx(moments[rows, k])
    assert figure.get_suptitle().count("γ = 1.00") == 2  # straight flights within a jump


# Animation


@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_animation_has_the_frames_asked_for(tmp_path, boundary):
    shown = cloud(made=scene(cloud={"boundary": boundary}))
    target, told = tmp_path / "x.gif", []
    animation.animate(shown, target, frames=8, start=MOMENTS[0] - 0.38, progress=told.append)
    assert told == pytest.approx(np.arange(1, 9) / 8)
    with Image.open(target) as picture:
        assert picture.n_frames == 8
        red = []
        for k in range(8):
            picture.seek(k)
            pixels = np.array(picture.convert("RGB")).astype(int)
            red.append(int((np.abs(pixels - [0xD5, 0x5E, 0x00]).sum(axis=2) < 30).sum()))
    assert red[:4] == [0] * 4  # the first four positions come before the encounter
    assert min(red[4:]) > 20
    assert [path.name for path in tmp_path.iterdir()] == ["x.gif"]


def test_a_part_of_a_wide_box_is_animated():
    """Grains stay round and large enough to be seen; those outside are not drawn."""
    made = cloud(made=scene(cloud={"number": 450}))
    assert made.scene.box[0] > 2.0 * animation.WIDEST
    scenery = animation.Scenery(made, np.array([5.0, 7.0]), 2.5)
    places = np.array([[1.0, 1.0, 1.0], [animation.WIDEST + 1.0, 1.0, 1.0], [1.0, animation.WIDEST + 1.0, 1.0]])
    scenery.show(places, np.full(3, 6.0), np.zeros(3), "")
    assert all(len(drawn.get_offsets()) == 1 for drawn in scenery.grains)
    assert "part of the box of 71.1 d" in scenery.figure.axes[1].get_xlabel()


def test_grains_over_the_edge_are_seen_at_both():
    places, owner = animation.folded(np.array([[10.2, -0.1, 1.0], [5.0, 4.0, 1.0]]), (10.0, 8.0))
    assert sorted(owner) == [0, 0, 0, 0, 1]
    corner = {tuple(np.round(place[:2], 9)) for place, who in zip(places, owner, strict=True) if who == 0}
    assert corner == {(0.2, 7.9), (10.2, 7.9), (0.2, -0.1), (10.2, -0.1)}


# Mistakes


@pytest.mark.parametrize("name", ["three_dimensional", "plan", "pair", "snapshots", "grain_history", "encounters"])
def test_without_encounters(name):
    with pytest.raises(ValueError, match=f"{name} needs grains that meet: the run has no encounter"):
        CLOUD_PLOTS[name](cloud(met=False))


@pytest.mark.parametrize("name", sorted({*CLOUD_PLOTS} - {"encounters", "jumps", "stream"}))
def test_without_paths(name):
    with pytest.raises(ValueError, match=r"trajectory was not stored: set run\.trajectory = true"):
        CLOUD_PLOTS[name](cloud(kept=False))


@pytest.mark.parametrize("name", ["three_dimensional", "plan", "grain_history"])
def test_in_the_plane_there_is_no_plan(name):
    flat = scene(dimensions=2, cloud={"concentration": 0.1, "number": 45})
    with pytest.raises(ValueError, match=f"{name} needs three dimensions"):
        CLOUD_PLOTS[name](cloud(made=flat))


@pytest.mark.parametrize(
    ("options", "words"),
    [({"frames": 0}, "frames must be 1 or greater, got 0"), ({"start": 30.0}, "start must be 20 d/u"), ({"path": "x.mp4"}, r"path must end in \.gif")],
)
def test_animation_mistakes(result, tmp_path, options, words):
    with pytest.raises(ValueError, match=words):
        animation.animate(result, **{"path": tmp_path / "x.gif"} | options)
    assert not list(tmp_path.iterdir())


# The command


def plot(*arguments):
    return CliRunner().invoke(cli.main, ["plot", *map(str, arguments)])


@pytest.fixture
def saved(result, tmp_path):
    result.save(tmp_path / "cloud.nc")
    return tmp_path / "cloud.nc"


def test_command_draws_all_that_a_cloud_has(saved, tmp_path):
    out = plot(saved, "--output", tmp_path / "x.png")
    assert out.exit_code == 0, (out.output, out.exception)
    drawn = {path.name for path in tmp_path.glob("x_*.png")}
    assert drawn >= {f"x_{name}.png" for name in CLOUD_PLOTS if name not in ("jumps", "stream")}  # the stream feels nothing of these grains


def test_command_takes_the_folder_of_a_long_run(result, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    tables_to_dataset(result.scene, result.all_jumps, result.encounters).merge(result.trajectory).to_netcdf(folder / "part-00000.nc", engine="scipy")
    told = {"key": "", "status": "finished", "message": "", "parts": 1, "time": END, "fates": [], "provenance": result.provenance}
    (folder / "run.json").write_text(json.dumps(told | {"scene": json.loads(result.scene.model_dump_json(exclude_none=True))}), encoding="utf-8")
    out = plot(folder, "--figure", "plan")
    assert out.exit_code == 0, (out.output, out.exception)
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_command_animates(saved, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "FRAMES", 3)
    monkeypatch.setattr(animation.animate, "__defaults__", (3, None, None))
    out = plot(saved, "--animate", tmp_path / "x.gif")
    assert out.exit_code == 0, (out.output, out.exception)
    with Image.open(tmp_path / "x.gif") as picture:
        assert picture.n_frames == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cloud.nc", "x.gif"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--figure", "plann"], "did you mean 'plan'?"),
        (["--figure", "budget"], "--figure budget: of many grains there are"),
        (["--animate", "x.mp4"], "--animate must end in .gif, got 'x.mp4'"),
        (["--animate", "no/x.gif"], "--animate: the folder 'no' does not exist"),
    ],
)
def test_command_mistakes(saved, tmp_path, arguments, words):
    out = plot(saved, *arguments)
    assert out.exit_code == 2
    assert words in out.stderr
    assert out.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["cloud.nc"]
