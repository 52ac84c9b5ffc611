"""A campaign on a cluster: workers over TCP, one of them killed in the midst."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pandas as pd
import pytest

import saltation
from saltation.scene import read, scene_of
from saltation.study import campaigns
from saltation.study.campaigns import campaign

distributed = pytest.importorskip("distributed")


def scenes():
    """Single grains, enough to keep workers busy, and a cloud."""
    made = []
    for seed in range(1, 9):
        content = read("sand")
        content["run"] |= {"jumps": 200, "seed": seed, "trajectory": False}
        made.append(({"name": f"grain{seed}"}, scene_of(content)))
    content = read("sand_cloud")
    content["effects"].remove("encounters")
    del content["encounters"]
    content["cloud"]["number"] = 14
    content["run"] |= {"duration": 0.3, "discard": 1}
    return [*made, ({"name": "cloud"}, scene_of(content))]


def test_a_campaign_outlives_a_worker_of_a_cluster(tmp_path, monkeypatch):
    """The scheduler gives the dead worker's tasks to others; the table is that of one process, and the files are written here."""
    monkeypatch.setattr(campaigns, "CHUNK", 60)  # one scene at a time
    runs, killed = scenes(), []
    with (
        distributed.LocalCluster(n_workers=2, processes=True, threads_per_worker=1, dashboard_address=":0", protocol="tcp://") as cluster,
        distributed.Client(cluster) as client,
    ):
        workers = sorted(client.run(os.getpid).values())
        assert len(workers) == 2
        assert os.getpid() not in workers

        def report(share):
            if share > 0.1 and not killed:
                killed.append(workers[0])
                os.kill(workers[0], signal.SIGKILL)

        found = campaign(runs, client.get_executor(), progress=report, store=tmp_path / "store", results=tmp_path / "runs")
        assert workers[0] not in client.run(os.getpid).values()
    assert killed
    here = campaign(runs, ThreadPoolExecutor(1), results=tmp_path / "here")
    pd.testing.assert_frame_equal(found, here, check_exact=True)
    for labels, _ in runs:
        assert (tmp_path / "runs" / f"{labels['name']}.nc").read_bytes() == (tmp_path / "here" / f"{labels['name']}.nc").read_bytes()
    assert len(saltation.open(tmp_path / "runs" / "cloud.nc").trajectory["grain"]) == 14
