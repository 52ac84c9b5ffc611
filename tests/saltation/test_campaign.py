"""Campaigns: one table on any workers in any order, bit for bit; interrupted and continued; the thesis's runs, judged."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import saltation
from saltation import _keys, cli, regressions, statistics
from saltation._keys import key_of
from saltation.results.files import unpacked
from saltation.scene import read, scene_of
from saltation.simulation import run_cloud
from saltation.study import campaigns
from saltation.study import thesis as study
from saltation.study.campaigns import COLUMNS, QUANTITIES, Store, campaign
from saltation.study.thesis import judge, thesis
from saltation.workers import Processes, cores, processes


def sand(stage: float = 1.87, seed: int = 1, jumps: int = 60):
    content = read("sand")
    content["channel"]["transport_stage"] = stage
    content["run"] |= {"jumps": jumps, "discard": 20, "seed": seed}
    return scene_of(content)


def same(one: pd.DataFrame, two: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(one, two, check_exact=True)
    assert one.to_csv() == two.to_csv()


@pytest.fixture(scope="module")
def few():
    return [({"number": seed, "T": stage}, sand(stage, seed)) for stage in (1.87, 2.67) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def table(few):
    """One after the other, in this process."""
    with ThreadPoolExecutor(1) as executor:
        return campaign(few, executor)


@pytest.fixture(scope="module")
def pool():
    """Three processes: their tables of step sizes are empty at first, then those of what they flew before."""
    with processes(3) as pool:
        yield pool


def test_the_same_table_on_any_number_of_workers(few, table, monkeypatch, pool):
    """Three: `table` is what one makes, two are tested where they are killed."""
    monkeypatch.setattr(campaigns, "CHUNK", 60)  # one scene at a time: the workers come in any order
    same(campaign(few, pool), table)


def test_the_same_rows_in_any_order(few, table, monkeypatch):
    monkeypatch.setattr(campaigns, "CHUNK", 60)
    order = list(range(len(few)))
    random.Random(3).shuffle(order)
    with ThreadPoolExecutor(4) as executor:
        shuffled = campaign([few[k] for k in order], executor)
    same(shuffled, table.iloc[order].reset_index(drop=True))


def test_the_default_executor(few, table):
    same(campaign(few), table)
    assert cores() >= 1


def test_a_row_is_what_a_run_says(few, table):
    scene = few[1][1]
    result = saltation.run(scene)
    row, summary = table.iloc[1], result.summary()
    for name in QUANTITIES[:-1]:
        assert row[[name, f"{name}_sd", f"{name}_se"]].tolist() == summary.loc[name, ["mean", "standard_deviation", "standard_error"]].tolist()
    angle = result.jumps["deviation_angle"].abs()
    assert row["abs_deviation_angle"] == angle.mean()
    assert row["abs_deviation_angle_se"] == statistics.standard_error(angle)
    assert (row["jumps"], row["status"], row["clipped"], row["creeping"]) == (40, "finished", *(result.provenance[key] for key in ("clipped", "creeping")))
    assert list(table) == ["number", "T", *COLUMNS]


def test_equal_scenes_run_once_and_labels_are_the_caller_s():
    calls = []

    class Counting(ThreadPoolExecutor):
        def submit(self, function, texts, whole):
            calls.extend(texts)
            return super().submit(function, texts, whole)

    with Counting(1) as executor:
        found = campaign([({"a": 1}, sand(jumps=30)), ({"b": 2}, sand(jumps=30)), sand(jumps=30)], executor)
    assert len(calls) == 1
    assert found["height"].nunique() == 1
    assert found["a"].isna().tolist() == [False, True, True]
    assert found["b"].isna().tolist() == [True, False, True]


def test_what_is_no_campaign():
    assert list(campaign([])) == list(COLUMNS)
    with pytest.raises(TypeError, match="scenes must hold scenes"):
        campaign(["sand"])
    with pytest.raises(ValueError, match="labels must not be called like a result, got 'height'"):
        campaign([({"height": 1}, sand())])


def test_a_scene_without_jumps_that_count_has_no_means():
    content = read("sand")
    content["history"]["horizon"] = 1.0
    with ThreadPoolExecutor(1) as executor:
        (row,) = campaign([scene_of(content)], executor).to_dict("records")
    assert (row["status"], row["jumps"]) == ("horizon", 0)
    assert np.isnan(row["height"])
    assert np.isnan(row["clipped"])


def test_batches_share_a_compiled_form_and_the_first_of_each_come_first():
    scenes = {key_of(scene): scene for _, scene in thesis()}
    found = campaigns.chunks(scenes)
    assert sorted(key for batch in found for key in batch) == sorted(scenes)
    forms = [{campaigns.form_of(scenes[key]) for key in batch} for batch in found]
    assert all(len(form) == 1 for form in forms)
    assert len({form for batch in forms[:8] for form in batch}) == 8  # Runs A to H
    assert all(sum(scenes[key].run.jumps for key in batch) <= campaigns.CHUNK for batch in found)


# The store


def test_a_store_is_used_and_what_is_broken_in_it_is_not(few, table, tmp_path):
    shares: list[float] = []
    with ThreadPoolExecutor(1) as executor:
        same(campaign(few, executor, store=tmp_path / "new" / "store"), table)
        store = tmp_path / "new" / "store"
        files = sorted(store.iterdir())
        assert [path.suffix for path in files] == [".json"] * len(few)
        whole = {path: path.read_bytes() for path in files}
        files[0].write_bytes(b"")
        files[1].write_bytes(whole[files[1]][:-40])
        changed = json.loads(whole[files[2]])
        changed["row"]["height"] += 1.0
        files[2].write_text(json.dumps(changed))
        files[3].write_bytes(b"\xff\xfe")
        (store / ".half.json.x1").write_text("{")
        same(campaign(few, executor, store=store, progress=shares.append), table)
        assert shares[0] == pytest.approx(2 / 6)
        assert shares[-1] == 1.0
        assert {path: path.read_bytes() for path in files} == whole
        same(campaign(few, executor, store=store, progress=shares.append), table)
        assert shares[-1] == 1.0


def test_a_complete_store_needs_no_worker(few, table, tmp_path):
    with ThreadPoolExecutor(1) as executor:
        campaign(few, executor, store=tmp_path)

    class Lazy(ThreadPoolExecutor):
        def submit(self, *arguments):
            raise AssertionError

    same(campaign(few, Lazy(1), store=tmp_path), table)


def test_another_scene_version_or_code_is_another_key(monkeypatch):
    keys = {key_of(sand()), key_of(sand(seed=2)), key_of(sand(stage=1.87 + 1e-15))}
    monkeypatch.setattr(_keys, "__version__", "0.0.0")
    keys.add(key_of(sand()))
    monkeypatch.setattr(_keys, "digest_of", lambda package: "another")
    keys.add(key_of(sand()))
    assert len(keys) == 5


def test_rows_come_back_bit_for_bit(tmp_path):
    row = dict.fromkeys(COLUMNS, float("nan")) | {"height": 0.1 + 0.2, "length": 5e-324, "velocity": 1e308 / 3.0, "jumps": 3, "status": "finished"}
    store = Store(tmp_path)
    store.put("key", sand(), row)
    back = store.get("key")
    assert {name: repr(value) for name, value in back.items()} == {name: repr(value) for name, value in row.items()}
    assert store.get("another") is None


def test_an_error_keeps_what_is_finished(few, tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns, "CHUNK", 60)
    broken = few[3][1]
    true = campaigns.outcome
    monkeypatch.setattr(campaigns, "outcome", lambda result: 1 / 0 if (result.scene.channel, result.scene.run.seed) == (broken.channel, 1) else true(result))
    with ThreadPoolExecutor(1) as executor, pytest.raises(ZeroDivisionError):
        campaign(few, executor, store=tmp_path)
    kept = len(list(tmp_path.iterdir()))
    assert 0 < kept < 6


def children(process: int) -> list[int]:
    return [int(word) for task in Path(f"/proc/{process}/task").iterdir() for word in (task / "children").read_text().split()]


def lives(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


SEEDS, JUMPS = range(1, 9), 500
ONE_AT_A_TIME = "from saltation.study import campaigns; campaigns.CHUNK = 60; from saltation.__main__ import main; main()"
COMMAND = [sys.executable, "-c", ONE_AT_A_TIME, "campaign", "sand", "--set", f"run.jumps={JUMPS}", "--vary"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(saltation.__file__).parents[1])}


@pytest.fixture(scope="module")
def undisturbed():
    """What the command makes."""
    return campaign([({"number": seed}, sand(seed=seed, jumps=JUMPS)) for seed in SEEDS], ThreadPoolExecutor(1))


def results(folder: Path) -> int:
    return len(list((folder / "store").glob("[!.]*.json")))


def command(folder: Path, seeds: Iterable[int], *options: str) -> list[str]:
    return [*COMMAND, f"run.seed={','.join(map(str, seeds))}", "--output", str(folder), *options]


def stopped(folder: Path, seeds: Iterable[int], how: str, least: int, *options: str, wait: float = 0.0) -> tuple[int, str]:
    """Exit status and stderr of the command, stopped when there are so many results; no process stays behind."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what starts in the background ignores interrupts, and so does what it starts
    with subprocess.Popen(command(folder, seeds, *options), env=ENVIRONMENT, start_new_session=True, **pipes) as process:
        signal.signal(signal.SIGINT, before)
        while process.poll() is None and results(folder) < least:
            time.sleep(0.01)
        time.sleep(wait)
        workers = children(process.pid) if process.poll() is None and Path("/proc/self/task").exists() else []
        if how == "SIGINT":  # as from a keyboard: to all of them
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.send_signal(getattr(signal, how))
        _, error = process.communicate()
    deadline = time.monotonic() + 10.0
    while any(map(lives, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(lives, workers))
    return process.returncode, error


@pytest.mark.parametrize("how", ["SIGTERM", "SIGINT"])
def test_a_stopped_campaign_says_how_it_goes_on(tmp_path, how):
    """From the command line, in the midst of what would last several times as long."""
    folder, seeds = tmp_path / "stopped", range(1, 61)
    status, error = stopped(folder, seeds, how, 2, "--workers", "1")
    assert 2 <= results(folder) < len(seeds), error
    assert not (folder / "table.csv").exists()
    assert (status, error) == (130, f"stopped: what is finished is kept in {str(folder)!r}, the same command goes on from there\n")


def test_a_campaign_killed_again_and_again(tmp_path, undisturbed):
    """The main process is killed at two random times; the same command ends with the same table, as if nothing had been."""
    folder, chance, kept = tmp_path / "killed", random.Random(2), 0
    for _ in range(2):
        stopped(folder, SEEDS, "SIGKILL", kept + 1, wait=chance.uniform(0.0, 0.2))
        before, kept = kept, results(folder)
        assert before < kept
        assert kept < len(SEEDS) or before
        assert not (folder / "table.csv").exists() or kept == len(SEEDS)
    done = subprocess.run(command(folder, SEEDS), env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    pd.testing.assert_frame_equal(pd.read_csv(folder / "table.csv")[list(COLUMNS)], undisturbed[list(COLUMNS)], check_exact=True)


# Workers that die


def test_killed_workers_change_nothing(tmp_path, monkeypatch, undisturbed):
    """Four are killed at random times; the task in hand is done again by another."""
    monkeypatch.setattr(campaigns, "CHUNK", 60)
    many = [({"number": seed}, sand(seed=seed, jumps=JUMPS)) for seed in SEEDS]
    chance, killed = random.Random(1), []

    def kill(pool, over):
        while len(killed) < 4 and not over.wait(chance.uniform(0.0, 0.7)):
            victim = chance.choice(pool._workers)[0]
            if victim.is_alive():
                victim.kill()
                killed.append(victim.pid)

    over = threading.Event()
    with processes(2) as pool:
        killer = threading.Thread(target=kill, args=(pool, over))
        killer.start()
        found = campaign(many, pool, store=tmp_path)
        over.set()
        killer.join()
    assert len(killed) >= 3
    assert len(set(killed)) == len(killed)
    same(found, undisturbed)
    assert len(list(tmp_path.iterdir())) == 8


def test_too_many_deaths_end_with_an_error():
    with Processes(1, replacements=1) as pool:
        deadly = pool.submit(os._exit, 9)
        after = pool.submit(int, "3")
        with pytest.raises(BrokenExecutor, match="too many workers were killed"):
            deadly.result()
        with pytest.raises(BrokenExecutor):
            after.result()


def test_errors_come_back_and_the_worker_goes_on():
    with processes(1) as pool:
        wrong, odd, own, right = (pool.submit(*task) for task in ((int, "x"), (threading.Lock,), (len, threading.Lock()), (int, "3")))
        with pytest.raises(ValueError, match="invalid literal"):
            wrong.result()
        with pytest.raises(RuntimeError, match="answer cannot be sent"):
            odd.result()
        with pytest.raises(TypeError, match="pickle"):
            own.result()
        assert right.result() == 3
    with pytest.raises(RuntimeError, match="after shutdown"):
        pool.submit(int)


# Many grains


def cloud(meeting: bool = True, duration: float = 0.3, number: int = 14):
    content = study.case("sand_cloud")
    content["cloud"]["number"] = number
    content["run"] |= {"duration": duration, "discard": 1}
    if not meeting:
        content["effects"].remove("encounters")
        del content["encounters"]
    return scene_of(content)


@pytest.fixture(scope="module")
def clouds():
    return [({"name": "with"}, cloud()), ({"name": "without"}, cloud(False)), ({"name": "single"}, sand(jumps=30))]


@pytest.fixture(scope="module")
def kept(clouds, tmp_path_factory):
    """A campaign that keeps all: its folder and its table."""
    folder = tmp_path_factory.mktemp("kept")
    with ThreadPoolExecutor(1) as executor:
        return folder, campaign(clouds, executor, store=folder / "store", results=folder / "runs")


def test_a_row_of_many_grains_is_what_their_run_says(clouds, kept):
    folder, found = kept
    for (labels, scene), (_, row) in zip(clouds, found.iterrows(), strict=True):
        result = saltation.run(scene)
        summary = result.summary()
        for name in QUANTITIES[:-1]:
            assert row[[name, f"{name}_sd", f"{name}_se"]].tolist() == summary.loc[name, ["mean", "standard_deviation", "standard_error"]].tolist()
        assert row["jumps"] == len(result.jumps) > 9
        opened = saltation.open(folder / "runs" / f"{labels['name']}.nc")
        assert opened.dataset().identical(result.dataset())
        if scene.cloud is not None:
            assert (row["bed_frequency"], row["pair_frequency"]) == (result.frequencies()["bed"], result.frequencies()["pairs"])
    assert found["pair_frequency"].isna().tolist() == [False, False, True]
    assert found["pair_frequency"][0] > found["pair_frequency"][1] == 0.0


def test_results_that_are_lost_or_of_another_run_are_made_again(clouds, kept):
    folder, found = kept
    lost, other = folder / "runs" / "single.nc", folder / "runs" / "without.nc"
    true = other.read_bytes()
    lost.unlink()
    other.write_bytes((folder / "runs" / "with.nc").read_bytes())
    (folder / "runs" / "with.nc").touch()
    shares: list[float] = []
    with ThreadPoolExecutor(1) as executor:
        same(campaign(clouds, executor, store=folder / "store", results=folder / "runs", progress=shares.append), found)
    assert shares[0] == pytest.approx(1 / 3)
    assert lost.exists()
    assert other.read_bytes() == true


@pytest.mark.parametrize("labels", [{}, {"name": "../a"}, {"name": "b"}])
def test_results_need_names(labels, tmp_path):
    with pytest.raises(ValueError, match="results need a label 'name'"):
        campaign([({"name": "b"}, sand()), (labels, sand(seed=2))], results=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_the_same_rows_of_clouds_from_processes(clouds, kept, tmp_path, pool):
    same(campaign(clouds, pool, results=tmp_path), kept[1])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["single.nc", "with.nc", "without.nc"]


@pytest.mark.parametrize("meeting", [False, True])
def test_blocks_of_grains_over_an_executor_come_to_the_same_bits(meeting, monkeypatch, pool):
    monkeypatch.setattr("saltation.simulation.CHUNK", 20)
    scene, shares, blocks = cloud(meeting), [], []

    class Counting(ThreadPoolExecutor):
        def submit(self, function, text, first, last):
            blocks.append(range(first, last))
            return pool.submit(function, text, first, last)

    found = saltation.run(scene, shares.append, executor=Counting(1))
    assert [number for block in blocks for number in block] == list(range(14))
    assert (len(blocks) > 3) == (not meeting)
    assert shares[-1] == 1.0
    assert found.dataset().identical(saltation.run(scene).dataset())


def test_blocks_from_which_grains_leave(monkeypatch):
    monkeypatch.setattr("saltation.simulation.CHUNK", 20)
    scene = cloud(False)
    scene = scene.model_copy(update={"run": scene.run.model_copy(update={"longest_flight": 1.5})})
    with ThreadPoolExecutor(1) as executor:
        found = saltation.run(scene, executor=executor)
    assert len(found.fates) > 3
    assert found.fates["time"].is_monotonic_increasing
    assert found.dataset().identical(saltation.run(scene).dataset())


def test_where_a_block_fails_the_run_is_that_in_one_piece(monkeypatch):
    monkeypatch.setattr("saltation.simulation.CHUNK", 20)
    opened = []

    def first_fails(content):
        opened.append(unpacked(content))
        if len(opened) == 1:
            opened[0].status = "failed"
        return opened[-1]

    monkeypatch.setattr("saltation.simulation.unpacked", first_fails)
    whole = saltation.run(cloud(False))
    monkeypatch.setattr("saltation.simulation.run_cloud", lambda scene, *rest, grains=None: whole if grains is None else run_cloud(scene, grains=grains))
    with ThreadPoolExecutor(1) as executor:
        assert saltation.run(cloud(False), executor=executor) is whole
    assert len(opened) > 1


def test_what_an_executor_is_not_for(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(ValueError, match="executor needs a multi-grain scene"):
            saltation.run(sand(), executor=executor)
        with pytest.raises(ValueError, match="either an output or an executor"):
            saltation.run(cloud(), output=tmp_path / "out", executor=executor)


def test_what_a_cloud_costs():
    """About its number of jumps: one and a half d/u* for each."""
    scene = cloud(False, 12.9, 45)
    assert campaigns.cost_of(scene) == pytest.approx(45 * 500 / 1.5, rel=0.01)
    assert campaigns.form_of(cloud()) != campaigns.form_of(cloud(False)) == campaigns.form_of(scene) != campaigns.form_of(sand())


# The thesis


def test_table_4_1_has_24_runs():
    found = study.grains()
    labels = pd.DataFrame([labels for labels, _ in found])
    assert len({key_of(scene) for _, scene in found}) == labels["name"].nunique() == 24
    assert labels.drop(columns="name").drop_duplicates().shape == (24, 6)
    assert [sorted(labels[name].unique()) for name in ("concentration", "particle_reynolds", "stage")] == [[0.0013, 0.0233], [73.0, 250.0], [2.0, 2.5, 3.0]]
    for given, scene in found:
        assert scene.numbers.particle_reynolds == pytest.approx(given["particle_reynolds"], rel=1e-14)
        assert scene.numbers.stage == pytest.approx(given["stage"], rel=1e-14)
        assert scene.run.duration / scene.numbers.time == pytest.approx(500.0, rel=1e-12)
        assert np.prod(scene.box) * given["concentration"] == pytest.approx(scene.cloud.number * np.pi / 6.0)
        assert (scene.bed.restitution, scene.bed.friction, scene.bed.span_scatter, scene.run.seed) == (0.65, 0.1, False, 1)
        assert ("encounters" in scene.names) == given["encounters"]


def test_table_4_1_from_eight_seeds_on_a_bed_that_scatters():
    once, found = study.grains(), study.grains(range(1, 9), scatter=True)
    labels = pd.DataFrame([labels for labels, _ in found])
    assert len({key_of(scene) for _, scene in found}) == labels["name"].nunique() == 192
    assert not {key_of(scene) for _, scene in once} & {key_of(scene) for _, scene in found}
    assert [scene.run.seed for _, scene in found] == labels["seed"].tolist() == list(range(1, 9)) * 24
    assert all((scene.bed.roughness, scene.bed.reading, scene.bed.span_scatter) == ("R7", "literal", True) for _, scene in found)


def test_the_command_runs_table_4_1_compares_and_goes_on(tmp_path, monkeypatch):
    """Four of its runs, short, of fewer grains; a lost result is made again, and with all of them there nothing is."""
    monkeypatch.setattr(study, "CONCENTRATIONS", {0.0233: 20})
    monkeypatch.setattr(study, "REYNOLDS", (73.0,))
    monkeypatch.setattr(study, "STAGES_OF_GRAINS", (2.0, 3.0))
    monkeypatch.setattr(study, "LASTING", 30.0)
    monkeypatch.setattr(campaigns, "cores", lambda: 1)  # in this process: on several it is killed above
    arguments = ["campaign", "grains", "--set", "run.discard=2", "--output", str(tmp_path / "out")]
    out = CliRunner().invoke(cli.main, arguments)
    assert out.exit_code == 0, (out.output, out.exception)
    names = ["table", "table_4_2", "comparison", "changes", "exponents", "convergence"]
    tables = {name: pd.read_csv(tmp_path / "out" / f"{name}.csv") for name in names}
    assert tables["table"]["status"].eq("finished").all()
    results = [saltation.open(tmp_path / "out" / "runs" / f"{name}.nc") for name in tables["table"]["name"]]
    assert tables["table"]["bed_frequency"].tolist() == [result.frequencies()["bed"] for result in results]
    row = tables["comparison"].set_index(["stage", "quantity"]).loc[(3.0, "height")]
    assert row["difference"] == pytest.approx(results[2].jumps["height"].mean() - results[3].jumps["height"].mean(), rel=1e-9)
    assert tables["table_4_2"]["pair_frequency_printed"].tolist() == [4.51, 5.31]
    assert "(4.51)" in out.stdout
    files = [*(tmp_path / "out" / "runs").iterdir(), *(tmp_path / "out" / "store").iterdir()]
    content = {path: path.read_bytes() for path in files}
    files[0].unlink()
    monkeypatch.setattr(campaigns, "processes", None)  # one run needs none
    again = CliRunner().invoke(cli.main, arguments)
    assert again.stdout == out.stdout
    monkeypatch.setattr(campaigns, "fly", None)
    again = CliRunner().invoke(cli.main, arguments)
    assert again.stdout == out.stdout
    assert {path: path.read_bytes() for path in files} == content


@pytest.mark.parametrize("given", [["--set", "cloud.number=10"], ["--vary", "run.seed=1,2"]])
def test_what_the_command_for_table_4_1_refuses(given, tmp_path):
    out = CliRunner().invoke(cli.main, ["campaign", "grains", *given, "--output", str(tmp_path / "out")])
    assert out.exit_code == 2
    assert given[0] in out.stderr
    assert out.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def runs():
    return thesis()


def test_the_thesis_has_256_runs(runs):
    labels = pd.DataFrame([labels for labels, _ in runs])
    assert len(runs) == len({key_of(scene) for _, scene in runs}) == 256
    assert labels.groupby(["run", "set"]).ngroups == 32
    assert sorted(labels[labels["particle_reynolds"] == 73.0]["stage"].unique()) == [1.79, 1.87, 2.43, 2.50, 2.67]
    assert sorted(labels[labels["particle_reynolds"] == 250.0]["stage"].unique()) == [2.31, 3.08, 3.85]
    for given, scene in runs:
        assert scene.numbers.particle_reynolds == pytest.approx(given["particle_reynolds"], rel=1e-14)
        assert scene.numbers.stage == pytest.approx(given["stage"], rel=1e-14)
        assert (scene.run.jumps, scene.run.discard, scene.run.seed) == (220, 20, 1)
        assert scene.in_plane == (given["run"] == "A")
        assert scene.bed.roughness == f"R{'ABCDEFGH'.index(given['run']) + 1}"
        assert scene.bed.restitution == {1: "set1", 2: 0.65, 3: 0.8, 4: 0.95}[given["set"]] == given["restitution"]
        if given["run"] == "A":
            assert (scene.bed.rebound, scene.bed.tangential_retention, scene.options("rotation").law) == ("garcia_nino", given["f"], "prescribed")
        else:
            assert (scene.bed.rebound, scene.bed.friction, scene.options("rotation").law) == ("tsuji", given["f"], "yamamoto")
        assert (given["f"], given["f_is"]) == ({1: 0.89, 2: 0.1, 3: 0.4, 4: 0.3}[given["set"]], "retention" if given["run"] == "A" else "Coulomb")


def test_one_share_kept_for_all_sets_changes_run_a_alone(runs):
    for (labels, scene), (given, other) in zip(thesis(0.89), runs, strict=True):
        if labels["run"] == "A":
            assert scene.bed.tangential_retention == labels["f"] == 0.89
            assert scene.changed(bed={"tangential_retention": given["f"]}) == other
        else:
            assert (labels, scene) == (given, other)


@pytest.fixture(scope="module")
def run_a(runs):
    """Run A as Table 3-4 has it, and over planes uniform within ±30°, with each Set's f and with 0.89 for all: a table with the label `roughness`."""
    pairs = [
        ({**labels, "roughness": roughness, "own": own}, scene.changed(bed={"roughness": roughness}))
        for own, found in ((True, runs), (False, thesis(0.89)))
        for labels, scene in found
        if labels["run"] == "A"
        for roughness in ("R1", "R1_uniform")
        if roughness == "R1_uniform" or labels["particle_reynolds"] == 73.0
    ]
    with ThreadPoolExecutor(1) as executor:
        return campaign(pairs, executor)


def test_with_each_set_s_own_f_set_2_comes_last_of_run_a(run_a):
    """As in thesis Table 3-5; with 0.89 for all, which keeps nearly all of the tangential velocity, Set 1 does, which loses most at the normal."""
    for own, order in ((True, ["A4", "A3", "A1", "A2"]), (False, ["A3", "A4", "A2", "A1"])):
        table = run_a[(run_a["own"] == own) & (run_a["roughness"] == "R1") & (run_a["particle_reynolds"] == 73.0)]
        assert judge(table)["model"].tolist() == order


def test_planes_uniform_within_30_degrees_make_large_or_extremely_small_jumps(run_a):
    """As thesis section 3.4.2 says of Run A; its (3-5) does not. Contacts follow each other closely there, and all runs finish."""
    assert run_a["status"].eq("finished").all()
    at = run_a[(run_a["stage"] == 1.87) & (run_a["set"] == 2)].set_index(["roughness", "own"])
    assert at.loc["R1_uniform", "creeping"].gt(0.2).all()
    assert at.loc[("R1", False), "creeping"] < 0.01
    spread = at["height_sd"] / at["height"]
    assert spread["R1_uniform"].gt(0.7).all() and spread["R1"].lt(0.3).all()


def test_contacts_that_follow_each_other_closely_end_no_run():
    """In these, a lee side throws a grain up that meets the bed again within 1e-5 d/u*."""
    for retention, roughness, number, stage in ((None, "R1_uniform", 2, 2.43), (0.89, "R2", 4, 1.87)):
        (scene,) = [s for labels, s in thesis(retention) if list(labels.values())[:4] == ["A", number, 73.0, stage]]
        assert saltation.run(scene.changed(bed={"roughness": roughness}, run={"seed": 2, "trajectory": False})).status in ("finished", "at rest")


def test_g2_is_the_shipped_sand_with_the_thesis_s_laws(runs):
    """Up to the rounding of its diameter."""
    (scene,) = [scene for labels, scene in runs if (labels["run"], labels["set"], labels["stage"]) == ("G", 2, 1.87)]
    sand = scene_of(study.case("sand"))
    assert scene.model_copy(update={"grain": sand.grain}) == sand
    assert scene.grain.diameter == pytest.approx(0.69e-3, rel=1e-3)


def invented(runs, factor):
    """A table whose means are the mean regression times factor(run, set)."""
    rows = []
    for labels, _ in runs:
        means = np.mean([regression(labels["particle_reynolds"], labels["stage"]) for regression in regressions.REGRESSIONS.values()], axis=0)
        scaled = dict(zip(statistics.VARIABLES, factor(labels["run"], labels["set"]) * means, strict=True))
        rows.append({**labels, **dict.fromkeys(COLUMNS, 0.1), **scaled})
    return pd.DataFrame(rows)


def test_models_are_ranked_by_their_distance_from_the_mean_regression(runs):
    def factor(run, number):
        return 1.0 + 0.1 * "GABCDEFH".index(run) + 0.01 * (number - 1)

    ranking = judge(invented(runs, factor))
    assert len(ranking) == 64
    assert ranking["model"][::2].tolist() == [f"{run}{number}" for run in "GABCDEFH" for number in (1, 2, 3, 4)]
    assert ranking["mean_rank"][::2].tolist() == list(range(1, 33))
    assert ranking["source"].eq("regressions").all()
    best = ranking[ranking["model"] == "G1"]
    assert best["error_index"].to_numpy() == pytest.approx(0.0, abs=1e-12)
    assert best["inside"].tolist() == [1.0, 1.0]
    assert best[[f"{name}_place" for name in statistics.VARIABLES]].stack().between(0.2, 0.8).all()
    # at 1.1 times the mean the RMSE over the mean is a tenth of the root mean square over the mean
    table = invented(runs, factor)
    own = table[(table["run"] == "A") & (table["set"] == 1) & (table["particle_reynolds"] == 73.0)]
    expected = np.mean([0.1 * np.sqrt(np.mean((own[name] / 1.1) ** 2)) / np.mean(own[name] / 1.1) for name in statistics.VARIABLES])
    assert ranking[(ranking["model"] == "A1") & (ranking["particle_reynolds"] == 73.0)]["error_index"].item() == pytest.approx(expected, rel=1e-12)


def test_a_model_without_a_mean_has_no_rank(runs):
    table = invented(runs, lambda run, number: 1.0 + 0.01 * number)
    table.loc[(table["run"] == "B") & (table["set"] == 3) & (table["stage"] == 1.87), "height"] = np.nan
    ranking = judge(table)
    assert ranking["model"].iloc[-1] == "B3"
    assert ranking["mean_rank"].isna().tolist() == [False] * 62 + [True] * 2


def test_measurements_replace_the_regressions_at_their_particle_reynolds_number(runs):
    table = invented(runs, lambda run, number: 1.0 + 0.05 * number)
    own = table[(table["run"] == "D") & (table["set"] == 3) & (table["particle_reynolds"] == 73.0)]
    rows = [
        (name, stage, mean, 0.1, 100, "invented for this test") for name in statistics.VARIABLES for stage, mean in zip(own["stage"], own[name], strict=True)
    ]
    beyond = [("height", 1.0, 9.0, 0.1, 100, "invented for this test")]  # a stage that no run reaches
    reference = pd.DataFrame(rows + beyond, columns=list(statistics.REFERENCE_COLUMNS))
    ranking = judge(table, reference)
    measured = ranking[ranking["particle_reynolds"] == 73.0]
    assert set(measured["source"]) == {"invented for this test"}
    assert set(ranking[ranking["particle_reynolds"] == 250.0]["source"]) == {"regressions"}
    best = measured[measured["model"].str.endswith("3")]
    assert best["overlap_index"].to_numpy() == pytest.approx(100.0)  # sd 0.1 in both
    assert best["error_index"].to_numpy() == pytest.approx(0.0, abs=1e-12)
    assert best["rank"].eq(4.5).all()  # all runs alike: ranks 1 to 8
    without = judge(table, reference.assign(sd=np.nan))
    assert without[without["particle_reynolds"] == 73.0]["overlap_index"].isna().all()
    with pytest.raises(ValueError, match="reference must reach a stage of the campaign at R_p = 100"):
        judge(table, reference, particle_reynolds=100.0)
    with pytest.raises(ValueError, match="reference must reach"):
        judge(table, reference.assign(T=9.0))


def test_what_cannot_be_judged(runs):
    table = invented(runs, lambda run, number: 1.0)
    with pytest.raises(ValueError, match="table must have the label 'stage'"):
        judge(table.drop(columns="stage"))
    with pytest.raises(ValueError, match="one run per model and stage, got two of 'A1'"):
        judge(pd.concat([table, table.iloc[:1]], ignore_index=True))
