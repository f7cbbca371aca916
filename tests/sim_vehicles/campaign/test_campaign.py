"""Campaigns: what was flown is kept, what is missing is flown, wherever the work is done."""

import json
import subprocess
import sys

import pytest

from gcs.errors import ConfigError, RecordingError
from sim_vehicles.campaign.campaign import Campaign, Store, fly, fly_all, fly_on_dask

GCS = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
QUICK = ("mission.max_duration_s=20",)
"""A mission that is cut short flies as well as a whole one, and takes a tenth of the time."""


def test_every_scenario_value_seed_and_planner_meets_every_other():
    campaign = Campaign(
        ("prescribed", "deterministic"), 3, sweep_key="planning.period_s", sweep_values=("1", "5")
    )
    jobs = campaign.jobs()
    assert len(jobs) == len({job.digest for job in jobs}) == 2 * 2 * 3 * 2
    assert [job.seed for job in jobs] == sorted(job.seed for job in jobs)


def test_a_mistake_is_reported_before_anything_flies():
    with pytest.raises(ConfigError, match="period"):
        Campaign(("prescribed",), 1, sweep_key="planning.period_s", sweep_values=("1", "-1")).jobs()


def test_the_same_job_gives_the_same_row_in_any_process():
    jobs = Campaign(("prescribed",), 1, settings=QUICK).jobs()
    assert [fly(job) for job in jobs] == sorted(fly_all(jobs, 2), key=lambda row: row.planner)


def test_a_planner_that_is_given_the_truth_sees_everything_at_once():
    job = Campaign(
        ("prescribed",), 1, settings=("simulation.death.prescribed=[{system_id=2, at_s=5}]", *QUICK)
    )
    own, truth = (fly(job) for job in job.jobs())
    assert truth.ospa_agents_m == truth.ospa_targets_m == 0.0
    assert truth.losses_detected_after_s == [0.0]
    assert truth.uploads > 0, "the truth reaches the planner"
    assert own.ospa_agents_m > 0.0
    assert own.losses_detected_after_s[0] > 0.0


def test_a_campaign_goes_on_where_it_was_cut_off(tmp_path):
    job, *_ = Campaign(("prescribed",), 1, settings=QUICK).jobs()
    row = fly(job)
    store = Store(tmp_path)
    store.add(row)
    store.close()
    with (tmp_path / "runs.jsonl").open("ab") as file:
        file.write(b'{"digest": "torn')

    again = Store(tmp_path)
    assert again.rows == {job.digest: row}
    again.add(row)
    again.close()
    assert (tmp_path / "runs.jsonl").read_bytes().count(b"\n") == 2
    assert Store(tmp_path).rows == {job.digest: row}


def test_rows_of_other_software_are_not_mixed(tmp_path):
    (tmp_path / "runs.jsonl").touch()
    (tmp_path / "versions.json").write_text(json.dumps({"numpy": "0.1"}))
    with pytest.raises(RecordingError, match="other software"):
        Store(tmp_path)


def test_flies_on_a_dask_cluster():
    distributed = pytest.importorskip("distributed")
    job, *_ = Campaign(("prescribed",), 1, settings=QUICK).jobs()
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert list(fly_on_dask([job], cluster.scheduler_address)) == [fly(job)]


def test_a_missing_service_is_reported():
    pytest.importorskip("distributed")
    with pytest.raises(RecordingError, match="no Dask scheduler"):
        list(fly_on_dask([], "tcp://127.0.0.1:1", timeout_s=0.5))


@pytest.mark.real_time
def test_the_command_writes_results_and_report_and_goes_on(tmp_path):
    command = [*GCS, "montecarlo", "prescribed", "--runs", "1", "-o", str(tmp_path), "--json"]
    command += ["--set", QUICK[0], "--sweep", "planning.period_s=2,5", "--workers", "1", "--parquet"]
    first = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert first.returncode == 1, first.stderr  # cut short: not complete, and said so
    assert [group["value"] for group in json.loads(first.stdout)] == ["2", "2", "5", "5"]
    assert "NaN" not in first.stdout  # JSON has none
    assert "Missions that were not complete" in first.stderr
    assert (tmp_path / "report.html").read_text().count("<svg") == 2
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 5
    assert (tmp_path / "results.parquet").stat().st_size > 1000

    second = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert "4 of 4 missions were flown before" in second.stderr
    assert second.stdout == first.stdout
