import pytest
from matplotlib.figure import Figure
from support.html_page import check_self_contained

from sidestep.plant_models.errors import InputError
from sidestep.validation.report.credibility import credibility_report, write_credibility_report
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.pages import LARGEST_SVG, picture

NUMBERS = Table(("metric [m]", "verdict"), (("0.1 < 0.2", "PASS"), ("0.3", "FAIL")))


def drawn(points=2):
    figure = Figure(figsize=(4.0, 2.0))
    figure.subplots().scatter(range(points), range(points))
    return figure


def report(evidence, verdict="PASS: all is well"):
    return credibility_report("On <car>", verdict, evidence, ["rain & snow"], {"Command": "sidestep validate"})


def test_page_holds_everything_in_the_promised_order():
    evidence = [
        Evidence("Envelope", figure=drawn()),
        Evidence("Understeer", "One.\n\nTwo.", table=NUMBERS, passed=False, section="Accuracy"),
        Evidence("Step halving", passed=True),
    ]
    html = report(evidence, "FAIL: 1 of 2")
    page = check_self_contained(html)
    text = " ".join(" ".join(page.words).split())
    order = ["FAIL: 1 of 2", "Envelope", "Verdicts", "Accuracy", "One.", "Not covered", "rain & snow", "What was run"]
    places = [text.index(words, text.index("FAIL: 1 of 2")) for words in order]
    assert places == sorted(places)
    assert html.index("<svg") < html.index("Verdicts")
    assert page.links == ["#e1", "#e2"]
    assert all(f'id="e{i}"' in html for i in range(3))
    assert '<td class="pass">PASS</td>' in html
    assert "<p>One.</p>" in html
    assert "On &lt;car&gt;" in html


@pytest.mark.parametrize(("verdict", "tone"), [("PASS: x", "pass"), ("FAIL: x", "fail"), ("0.43 g at 8 m/s", "")])
def test_the_verdicts_colour_is_its_own(verdict, tone):
    assert f'<p class="verdict {tone}">' in report([], verdict)


def test_large_figures_become_pictures():
    assert picture(drawn()).drawn.startswith("<svg")
    html = report([Evidence("Cloud", figure=drawn(10_000))])
    assert 'src="data:image/png;base64,' in html
    assert len(html) < LARGEST_SVG
    check_self_contained(html)


def test_the_file_is_written_or_refused(tmp_path):
    file = tmp_path / "report.html"
    write_credibility_report(file, "t", "PASS", [], [], {})
    assert file.read_text().startswith("<!doctype html>")
    with pytest.raises(InputError, match="cannot write"):
        write_credibility_report(tmp_path / "no" / "report.html", "t", "PASS", [], [], {})
