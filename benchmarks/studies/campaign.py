"""What a campaign costs, and that killing it costs nothing: 1000 closed-loop runs on the single-track FMU.

    .venv/bin/python benchmarks/studies/campaign.py                         eight minutes on two idle cores
    .venv/bin/python benchmarks/studies/campaign.py --runs 100 --kills 5    a quick look

Efficiency is the time that the runs take one after the other in one process, from a tenth of them, over the cores'
time in parallel; the processes are started before, their start is listed apart. The same rows then come from a Dask
cluster of two workers on this machine, if distributed is installed, and from a campaign that is killed by SIGKILL at
random moments and gone on with.
"""

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from sidestep.validation.campaigns.campaign import Campaign, cases, load_campaign
from sidestep.validation.campaigns.campaign_run import load_rows, run_campaign, run_case
from sidestep.validation.campaigns.journal import Row

SPEC = Path(__file__).parents[2] / "examples" / "friction_sweep.toml"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--kills", type=int, default=20)
    options = parser.parse_args()
    campaign = replace(load_campaign(SPEC), runs=options.runs)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows, start, parallel = in_parallel(campaign, folder, options.jobs)
        each = one_after_the_other(campaign, options.runs // 10)
        efficiency = each * options.runs / (options.jobs * parallel)
        print(f"{options.runs} runs on {options.jobs} processes: {parallel:.1f} s, start {start:.1f} s")
        print(f"one run in one process: {1e3 * each:.0f} ms; parallel efficiency {efficiency:.3f}")
        print("outcomes:", dict(Counter(row["label"] for row in rows)))
        print("Dask cluster:", "rows identical" if on_a_cluster(campaign, folder) == rows else "ROWS DIFFER")
        killed = replace(campaign, runs=max(options.runs // 5, 4 * options.kills))
        print(f"{options.kills} times SIGKILL:", with_kills(killed, folder, options.kills, options.jobs))


def in_parallel(campaign: Campaign, folder: Path, jobs: int) -> tuple[list[Row], float, float]:
    """The rows, how long the processes took to start, and how long all runs took then, in [s]."""
    began = time.perf_counter()
    run_campaign(replace(campaign, runs=4 * jobs), folder / "start.jsonl", jobs)  # the processes stay
    started = time.perf_counter()
    rows = run_campaign(campaign, folder / "all.jsonl", jobs)
    return rows, started - began, time.perf_counter() - started


def one_after_the_other(campaign: Campaign, count: int) -> float:
    """Time a run takes in this process, in [s]; every tenth case."""
    chosen = cases(campaign)[:: max(1, campaign.runs // count)]
    run_case(campaign, chosen[0])  # loads the kernels
    began = time.perf_counter()
    for case in chosen:
        run_case(campaign, case)
    return (time.perf_counter() - began) / len(chosen)


def on_a_cluster(campaign: Campaign, folder: Path) -> list[Row]:
    """The rows from two Dask workers."""
    from distributed import LocalCluster

    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1")
    with cluster:
        return run_campaign(campaign, folder / "dask.jsonl", dask=cluster.scheduler_address)


def with_kills(campaign: Campaign, folder: Path, kills: int, jobs: int) -> str:
    """Kill `sidestep campaign` at random moments, go on, and compare with an undisturbed run."""
    spec, out, moments = folder / "spec.toml", folder / "killed", random.Random(0)
    spec.write_text(SPEC.read_text(encoding="utf-8").replace("runs = 256", f"runs = {campaign.runs}"), encoding="utf-8")
    command = [sys.executable, "-m", "sidestep.validation", "campaign", str(spec)]
    command += ["--out", str(out), "--jobs", str(jobs)]
    journal, done = out / "campaign.jsonl", 0
    for _ in range(kills):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None and (not journal.exists() or journal.read_bytes().count(b"\n") <= done + 1):
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 1.0))
        process.kill()
        process.wait()
        done = len(load_rows(journal)[1])
    whole = run_campaign(load_campaign(spec), journal, jobs)
    undisturbed = run_campaign(load_campaign(spec), folder / "undisturbed.jsonl", jobs)
    lines = journal.read_text(encoding="utf-8").splitlines()
    once = len(lines) == len(whole) + 1 == campaign.runs + 1 and all(json.loads(line) for line in lines)
    same = "same rows, each once" if whole == undisturbed and once else "ROWS DIFFER"
    return f"{done} of {campaign.runs} rows before the last start; {same}"


if __name__ == "__main__":
    main()
