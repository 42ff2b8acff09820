"""A campaign's rows: none is lost, run twice or believed that it did not run."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.campaigns.spec import campaign
from support.campaigns.work import deadly, fake

from sidestep.plant_models.errors import InputError
from sidestep.validation.campaigns import journal
from sidestep.validation.campaigns.campaign import cases
from sidestep.validation.campaigns.campaign_run import load_rows, run_campaign, run_case
from sidestep.validation.campaigns.journal import open_journal, read_journal

TESTS = Path(__file__).parents[2]


def test_a_killed_campaign_goes_on_to_the_same_rows(tmp_path):
    """SIGKILL at any moment: every row that was there stays as it was, and each comes once."""
    spec = campaign(tmp_path)
    whole = run_campaign(spec, tmp_path / "whole.jsonl", 1, work=fake)
    assert [row["row"] for row in whole] == list(range(40))
    file = tmp_path / "killed.jsonl"
    script = "import sys; from support.campaigns.work import go_on; go_on(*sys.argv[1:])"
    for moment in np.random.default_rng(0).uniform(0.0, 0.15, 2):
        process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path), str(file)], cwd=TESTS)
        before = len(read_journal(file)[1]) if file.exists() else 0
        while process.poll() is None and (not file.exists() or file.read_bytes().count(b"\n") <= before + 1):
            time.sleep(0.002)
        time.sleep(moment)
        process.kill()
        process.wait()
    written = read_journal(file)[1]
    assert len(written) >= 4
    assert run_campaign(spec, file, 1, work=fake) == whole
    assert read_journal(file)[1][: len(written)] == written
    assert len(read_journal(file)[1]) == 40


def test_a_line_that_was_cut_short_is_run_again(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    whole = run_campaign(spec, file, 1, work=fake)
    text = file.read_bytes()
    for cut in (1, 40, len(text) - text.index(b"\n"), len(text) - 5):
        file.write_bytes(text[:-cut])
        assert run_campaign(spec, file, 1, work=fake) == whole
        assert file.read_bytes() == text


def test_a_disk_that_is_full_ends_a_campaign_that_goes_on_later(tmp_path, monkeypatch):
    spec, file, write = replace(campaign(tmp_path), runs=8), tmp_path / "c.jsonl", os.write
    left = iter((10_000, 10_000, 10_000, 100))  # the fourth line is cut short
    with monkeypatch.context() as patch:
        patch.setattr(journal.os, "write", lambda where, line: write(where, line[: next(left)]))
        with pytest.raises(InputError, match=r"--out: cannot write .*\(No space left"):
            run_campaign(spec, file, 1, work=fake)
    assert len(read_journal(file)[1]) == 2
    assert run_campaign(spec, file, 1, work=fake) == run_campaign(spec, tmp_path / "whole.jsonl", 1, work=fake)


def test_a_journal_belongs_to_one_specification_and_one_process(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    run_campaign(spec, file, 1, work=fake)
    with pytest.raises(InputError, match="another specification"):
        run_campaign(replace(spec, seed=9), file, 1, work=fake)
    head, _ = read_journal(file)
    with open_journal(file, head), pytest.raises(InputError, match="another process"):
        run_campaign(spec, file, 1, work=fake)
    assert load_rows(file)[0] == spec
    for text, message in (("", "is empty"), ("x\n", "line 1: is no JSON"), ("3\n", "no objects"), ("{}\n", "camp")):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            load_rows(file)
    with pytest.raises(InputError, match="cannot be read"):
        load_rows(tmp_path / "no.jsonl")


def forged(key: str, value: object):
    return lambda rows: [*rows[:-1], {**rows[-1], key: value}]


@pytest.mark.parametrize(
    ("forge", "reason"),
    [
        (lambda rows: [*rows, rows[1]], "line 10: row 1: is there twice"),
        (lambda rows: [*rows[:-1], {**rows[0], "row": 8}], r"row 8: is none of the campaign's 8 \(0 to 7\)"),
        (forged("row", -1), "row -1: is none of"),
        (forged("row", "7"), r"line 9: is no row of a campaign \(Expected `int`, got `str` - at `\$.row`"),
        (forged("row", 6), "line 9: row 6: is there twice"),
        (forged("seed", 1), r"row 7: has seed 1, not \d+"),
        (forged("values", {}), "row 7: was run with controller.tyre_model = None, not affine"),
        (lambda rows: [{**rows[0], "values": rows[0]["values"] | {"speed": 1.0}}], "row 0: was run with speed = 1.0"),
        (forged("margin_m", -0.1), "row 7: says that it passed, with margin_m -0.1"),
        (forged("error", "PlantError: fell over"), "row 7: says that it passed, with error 'PlantError: fell over'"),
        (forged("margin_m", float("nan")), "row 7: has a margin_m of nan"),
        (forged("verdict", True), "line 9: is no row of a campaign"),
        (lambda rows: [{"row": 0}], "line 2: is no row of a campaign"),
    ],
)
def test_rows_that_the_campaign_did_not_run_are_refused(tmp_path, forge, reason):
    """They counted as runs: a journal of four runs and a failure became a pass of seven."""
    spec, file = replace(campaign(tmp_path), runs=8), tmp_path / "c.jsonl"
    rows = [{**fake(case), "verdict": "pass", "label": "ok", "margin_m": 0.3} for case in cases(spec)]
    run_campaign(spec, file, 1, work=fake)
    head = file.read_text().splitlines()[0]
    file.write_text("\n".join([head, *map(json.dumps, rows), ""]))
    assert len(load_rows(file)[1]) == 8
    before = "\n".join([head, *map(json.dumps, forge(rows)), ""])
    file.write_text(before)
    with pytest.raises(InputError, match=reason):
        run_campaign(spec, file, 1, work=fake)
    with pytest.raises(InputError, match=reason):
        load_rows(file)
    assert file.read_text() == before


def test_a_process_that_dies_is_a_row(tmp_path):
    rows = run_campaign(replace(campaign(tmp_path), runs=9), tmp_path / "c.jsonl", 2, work=deadly)
    assert [row["row"] for row in rows] == list(range(9))
    assert [row["error"] for row in rows] == [None] * 7 + ["the process that ran it died", None]


def test_what_a_case_raises_is_a_row(tmp_path):
    spec = campaign(tmp_path)
    row = run_case(replace(spec, set={"plant.kind": "nothing.fmu"}), cases(spec)[0])
    assert (row["verdict"], row["label"], row["margin_m"]) == ("fail", "error", None)
    assert row["error"].startswith("InputError")


@pytest.mark.closed_loop
def test_rows_are_the_same_in_one_process_in_two_and_on_a_cluster(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    spec = replace(campaign(tmp_path), runs=6)
    alone = run_campaign(spec, tmp_path / "1.jsonl", 1)
    assert {(row["verdict"], row["label"]) for row in alone} == {("inconclusive", "scene too short")}
    assert run_campaign(spec, tmp_path / "2.jsonl", 2) == alone
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
        assert run_campaign(spec, tmp_path / "3.jsonl", dask=cluster.scheduler_address) == alone


def test_ctrl_c_keeps_what_is_done(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    script = "import sys; from support.campaigns.work import go_on; go_on(*sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path), str(file)], cwd=TESTS, stderr=subprocess.PIPE
    )
    while process.poll() is None and (not file.exists() or file.read_bytes().count(b"\n") < 3):
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert b"KeyboardInterrupt" in errors
    assert len(run_campaign(spec, file, 1, work=fake)) == 40
