"""What a campaign ends in: its verdict, its report, and its test cases."""

from dataclasses import replace
from xml.etree import ElementTree

import pytest
from support.campaigns.spec import campaign
from support.campaigns.work import fake
from support.html_page import check_self_contained

from sidestep.validation.campaigns.campaign import cases
from sidestep.validation.campaigns.campaign_figures import influences, telling
from sidestep.validation.campaigns.campaign_report import junit_cases, sentence, summarised, write_campaign_report
from sidestep.validation.campaigns.campaign_run import run_campaign, run_case
from sidestep.validation.report.exports.junit import write_junit
from sidestep.validation.studies.limits import deciding_runs, lower_bound, upper_bound


def test_a_campaign_ends_in_a_verdict_a_report_and_test_cases(tmp_path):
    spec = campaign(tmp_path)
    rows = [
        *run_campaign(spec, tmp_path / "c.jsonl", 1, work=fake)[1:],
        run_case(replace(spec, set={"a": 1}), cases(spec)[0]),
    ]
    summary = summarised(spec, rows)
    failed = sum(row["values"]["plant.noise"] >= 1.25 for row in rows[:-1]) + 1
    assert (summary["n"], summary["failures"], summary["verdict"]) == (40, failed, "fail")
    assert failed / 40 < summary["failure_rate_upper_bound_95"] < failed / 40 + 0.2
    assert summarised(replace(spec, failure_rate=0.9), rows)["verdict"] == "pass"
    assert summary["influences"][0]["key"] == "plant.noise"
    assert telling(rows[:-1], influences(rows))[0] == "plant.noise"
    write_campaign_report(tmp_path / "r.html", spec, rows, summary, {"Command": "sidestep campaign"})
    html = (tmp_path / "r.html").read_text()
    page = check_self_contained(html)
    text = " ".join(" ".join(page.words).split())
    assert f"FAIL: 40 runs, {failed} failures, 0 inconclusive" in text
    assert "plant.noise 0 to 2" in text
    write_junit(tmp_path / "j.xml", spec.name, junit_cases(spec, rows))
    suite = ElementTree.parse(tmp_path / "j.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("40", str(failed - 1), "1")
    assert len(suite.findall("testcase/failure")) == failed - 1


@pytest.mark.parametrize(("failures", "runs", "allowed", "needed"), [(0, 10, 0.05, 59), (0, 0, 0.01, 299)])
def test_runs_that_would_decide_are_the_least_that_do(failures, runs, allowed, needed):
    assert deciding_runs(failures, runs, allowed) == needed
    assert upper_bound(0, needed) <= allowed < upper_bound(0, needed - 1)


def test_runs_that_would_decide_may_show_a_failure_or_be_too_many():
    needed = deciding_runs(4, 40, 0.05)
    assert lower_bound(needed // 10, needed) > 0.05
    assert lower_bound(4, 40) < 0.05
    assert deciding_runs(5, 100, 0.05) is None


def test_an_undecided_campaign_says_what_would_decide(tmp_path):
    spec = replace(campaign(tmp_path), runs=10, failure_rate=0.05)
    rows = [{**fake(case), "verdict": "pass", "label": "ok"} for case in cases(spec)]
    summary = summarised(spec, rows)
    assert (summary["verdict"], summary["deciding_runs"]) == ("inconclusive", 59)
    assert "59 conclusive runs would decide" in sentence(summary)


def test_names_have_no_direction():
    rows = [{"row": i, "values": {"plant.kind": "ab"[i % 2]}, "margin_m": float(i % 2)} for i in range(40)]
    (found,) = influences(rows)
    assert found.share > 0.5
    assert found.trend == 0.0


@pytest.mark.parametrize(
    ("counts", "allowed", "verdict", "bound"),
    [
        ((20, 0, 0), None, "pass", 1.0 - 0.05 ** (1 / 20)),
        ((19, 0, 1), None, "inconclusive", 1.0 - 0.05 ** (1 / 19)),
        ((18, 1, 1), None, "fail", upper_bound(1, 19)),
        ((19, 0, 1), 0.3, "pass", 1.0 - 0.05 ** (1 / 19)),
        ((15, 0, 5), 0.3, "inconclusive", 1.0 - 0.05 ** (1 / 15)),
        ((10, 9, 1), 0.3, "inconclusive", upper_bound(9, 19)),
        ((5, 14, 1), 0.3, "fail", upper_bound(14, 19)),
        ((20, 0, 0), 0.05, "inconclusive", 1.0 - 0.05 ** (1 / 20)),
        ((0, 0, 20), 0.3, "inconclusive", 1.0),
        ((0, 0, 20), None, "inconclusive", 1.0),
    ],
)
def test_inconclusive_runs_are_neither_passes_nor_failures(tmp_path, counts, allowed, verdict, bound):
    spec = replace(campaign(tmp_path), runs=20, failure_rate=allowed)
    names = ("pass", "fail", "inconclusive")
    verdicts = [name for name, count in zip(names, counts, strict=True) for _ in range(count)]
    rows = [{**fake(case), "verdict": one} for case, one in zip(cases(spec), verdicts, strict=True)]
    summary = summarised(spec, rows)
    assert (summary["verdict"], summary["failures"], summary["inconclusive"]) == (verdict, *counts[1:])
    assert summary["failure_rate_upper_bound_95"] == pytest.approx(bound)
    assert sentence(summary).startswith(
        f"{verdict.upper()}: 20 runs, {counts[1]} failure{'' if counts[1] == 1 else 's'}, {counts[2]} inconclusive"
    )
    cases_of = junit_cases(spec, rows)
    assert [sum(bool(getattr(c, kind)) for c in cases_of) for kind in ("failure", "error")] == list(counts[1:])


@pytest.mark.parametrize("passed", [0, 1, 5])
def test_reports_of_small_and_of_hopeless_campaigns(tmp_path, passed):
    spec = campaign(tmp_path, 'scenario = "moose"\nruns = 5\nvary.speed = {low = 1.0, high = 2.0}')
    rows = [
        {
            **run_case(replace(spec, set={"x": 0}), case),
            "verdict": "pass" if case.row < passed else "fail",
            "margin_m": 0.1 * case.row or None,
        }
        for case in cases(spec)
    ]
    for chosen in (rows, rows[:1]):
        write_campaign_report(tmp_path / "r.html", spec, chosen, summarised(spec, chosen), {})
        check_self_contained((tmp_path / "r.html").read_text())
