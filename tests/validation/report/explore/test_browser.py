"""The reports in a browser: values under the pointer, one cursor everywhere, zoom, switches, tables, phone, paper."""

import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.stored_runs import drive

from sidestep.validation.campaigns.campaign import cases, load_campaign
from sidestep.validation.campaigns.campaign_report import summarised, write_campaign_report
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.report.credibility import credibility_report
from sidestep.validation.report.evidence import Evidence
from sidestep.validation.report.report import demo_report

pytestmark = pytest.mark.browser

CAMPAIGN = """
scenario = "double-obstacle"
runs = 40
vary.speed = { low = 10.0, high = 18.0 }
vary.plant.noise = { low = 0.0, high = 2.0 }
"""


@pytest.fixture(scope="module")
def demo(collided):
    other = drive(overrides=["controller.preset=paper"], duration=2.0, aim=1.0)
    return demo_report([collided, other], [collided.summary, other.summary], Verdict.FAIL)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Fails where the speed is above 16 m/s."""
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "spec.toml").write_text(CAMPAIGN)
    spec = load_campaign(folder / "spec.toml")
    rows = [
        {
            "row": case.row, "seed": case.seed, "values": dict(case.values),
            "verdict": "fail" if case.values["speed"] > 16.0 else "pass",
            "label": "collision" if case.values["speed"] > 16.0 else "ok",
            "margin_m": 0.1 * (16.0 - case.values["speed"]), "error": None,
        }
        for case in cases(spec)
    ]  # fmt: skip
    write_campaign_report(folder / "report.html", spec, rows, summarised(spec, rows), {"Command": "sidestep campaign"})
    return rows, (folder / "report.html").read_text()


@pytest.fixture(scope="module")
def browser():
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright")
    if chromium is None:
        pytest.skip("needs Chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def opened(browser, folder, text, width=1400, **settings):
    """The page in a window, from a file; its console has to stay empty and the network unused."""
    (folder / "page.html").write_text(text, encoding="utf-8")
    said, asked = [], []
    context = browser.new_context(viewport={"width": width, "height": 950}, **settings)
    page = context.new_page()
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto((folder / "page.html").as_uri())
    yield page
    page.wait_for_timeout(50)  # two pictures: what was asked for is drawn, or has failed
    assert said == []
    assert all(url.startswith(("data:", "file:")) for url in asked)
    context.close()


def chart(page, title):
    return page.locator(".chart", has=page.locator("h4", has_text=title)).first


def hover(page, one, share):
    """Put the pointer on a chart, at a share of its abscissa's way."""
    one.scroll_into_view_if_needed()
    box = one.locator("svg").bounding_box()
    x = box["x"] + 46 + share * (box["width"] - 56)
    page.mouse.move(x, box["y"] + 0.4 * box["height"])
    page.wait_for_timeout(60)
    return x, box["y"] + 0.4 * box["height"]


def value(one, name):
    words = one.locator(".key", has_text=name).locator("output").text_content()
    return float(words.replace("\u2212", "-"))


def now(page):
    return float(page.locator("#now").text_content().split()[0])


def car_at(page):
    moved = "document.querySelector('.scene path.car').transform.baseVal[0].matrix"
    return page.evaluate(f"[{moved}.e, {moved}.f]")


def ticks(one):
    return one.locator(".axes text").all_text_contents()


def test_the_pointer_on_one_chart_moves_all_of_them_the_scene_and_the_slider(browser, tmp_path, html, collided):
    recording = collided.recording
    with opened(browser, tmp_path, html) as page:
        hover(page, chart(page, "Lateral offset"), 0.5)
        time = now(page)
        assert time == pytest.approx(0.5 * recording["time"][-1], abs=0.05)
        assert float(page.locator("#time").input_value()) == pytest.approx(time, abs=0.01)
        seen = value(chart(page, "Steering angle"), "realised")
        assert seen == pytest.approx(np.degrees(np.interp(time, recording["time"], recording["steer_angle"])), abs=0.02)
        x, y = car_at(page)
        assert x == pytest.approx(np.interp(time, recording["time"], recording["x"]), abs=0.15)
        assert y == pytest.approx(np.interp(time, recording["time"], recording["y"]), abs=0.02)
        cursors = page.evaluate(
            "[...document.querySelectorAll('.chart .cursor')].map(c => c.getAttribute('visibility'))"
        )
        assert cursors.count("visible") == 7  # every chart over time


def test_the_slider_and_play_move_the_car(browser, tmp_path, html, collided):
    with opened(browser, tmp_path, html) as page:
        slider = page.locator("#time")
        for key, end in (("Home", 0), ("End", -1)):
            slider.press(key)
            page.wait_for_timeout(60)
            last = collided.recording.steps["time"][end]
            i = int(np.argmin(np.abs(collided.recording["time"] - last)))
            assert car_at(page) == pytest.approx([collided.recording["x"][i], collided.recording["y"][i]], abs=1e-3)
            assert page.locator(".scene .words span").first.text_content() == f"{last:.2f} s"
        slider.press("Home")
        page.locator("#play").click()
        page.wait_for_function("+document.getElementById('time').value > 0.2")
        page.locator("#play").click()
        assert page.locator("#play").text_content() == "Play"
        assert 0.2 < now(page) < 6.0


def test_a_stretch_of_time_is_zoomed_moved_and_left_again_in_every_chart(browser, tmp_path, html):
    with opened(browser, tmp_path, html) as page:
        one, other = chart(page, "Lateral offset"), chart(page, "Yaw rate")
        before = ticks(other)
        hover(page, one, 0.25)
        page.mouse.down()
        hover(page, one, 0.5)
        page.mouse.up()
        page.wait_for_timeout(60)
        zoomed = ticks(other)
        assert zoomed != before
        hover(page, one, 0.0)
        left = now(page)
        hover(page, one, 1.0)
        assert (left, now(page)) == pytest.approx((2.0, 4.0), abs=0.1)
        page.keyboard.down("Shift")
        hover(page, one, 0.5)
        page.mouse.down()
        hover(page, one, 0.75)
        page.mouse.up()
        page.keyboard.up("Shift")
        hover(page, one, 0.0)
        assert now(page) == pytest.approx(1.5, abs=0.1)
        assert other.locator(".back").is_visible()
        other.locator(".back").click()
        page.wait_for_timeout(60)
        assert ticks(other) == before
        page.keyboard.down("Control")
        hover(page, one, 0.5)
        page.mouse.wheel(0, -200)
        page.keyboard.up("Control")
        page.wait_for_timeout(60)
        assert ticks(other) != before


def test_a_name_in_the_legend_switches_its_line(browser, tmp_path, html):
    with opened(browser, tmp_path, html) as page:
        one = chart(page, "Steering angle")
        drawn = one.locator("g[clip-path] path")
        before = drawn.count()
        key = one.locator(".key", has_text="commanded")
        key.click()
        assert (drawn.count(), key.get_attribute("aria-pressed")) == (before - 1, "false")
        key.click()
        assert (drawn.count(), key.get_attribute("aria-pressed")) == (before, "true")


def test_the_scene_is_zoomed_moved_and_follows_again(browser, tmp_path, html):
    with opened(browser, tmp_path, html) as page:
        view = page.locator(".scene .view")

        def looked_at():
            page.wait_for_timeout(60)
            return [float(value) for value in view.get_attribute("viewBox").split()]

        x, y, width, _ = looked_at()
        page.get_by_role("button", name="+").click()
        assert looked_at()[2] == pytest.approx(0.7 * width)
        page.get_by_role("button", name="Follow").click()
        assert looked_at()[:3] == pytest.approx([x, y, width], abs=0.01)
        box = view.bounding_box()
        page.mouse.move(box["x"] + 300, box["y"] + 100)
        page.mouse.down()
        page.mouse.move(box["x"] + 200, box["y"] + 100, steps=4)
        page.mouse.up()
        assert looked_at()[0] == pytest.approx(x + 100 * width / box["width"], abs=0.2)
        page.get_by_role("button", name="Whole road").click()
        assert looked_at()[2] > 100.0


def test_a_point_leads_to_its_row_and_the_command_that_runs_it_again(browser, tmp_path, campaign):
    rows, text = campaign
    failed = [row for row in rows if row["verdict"] == "fail"]
    with opened(browser, tmp_path, text) as page:
        first = page.locator("tr[id]").first
        assert "FAIL" in first.text_content()
        points = page.locator(".chart a[href^='#row-']")
        assert points.count() == len(rows)
        point = page.locator(f".chart a[href='#row-{failed[-1]['row']}']")
        point.scroll_into_view_if_needed()
        point.click(force=True)
        assert page.evaluate("location.hash") == f"#row-{failed[-1]['row']}"
        row = page.locator("tr:target")
        assert f"sidestep run --from campaign.jsonl:{failed[-1]['row']}" in row.text_content()
        row.get_by_role("button").click()
        assert row.get_by_role("button").text_content() in ("Copied", "Selected")
        chosen = page.evaluate("getSelection().toString()")
        assert chosen == f"sidestep run --from campaign.jsonl:{failed[-1]['row']}"


def test_tables_sort_and_filter(browser, tmp_path, campaign):
    rows, text = campaign
    failed = sum(row["verdict"] == "fail" for row in rows)
    with opened(browser, tmp_path, text) as page:
        page.locator(".filter").fill("fail")
        assert page.locator("tr[id]:visible").count() == failed
        assert page.locator(".sift output").text_content() == f"{failed} of {len(rows)}"
        page.locator(".filter").fill("")
        column = page.locator("tr[id] td:nth-child(1)")
        page.locator("th", has_text="row").get_by_role("button").click()
        assert column.all_text_contents() == [str(i) for i in range(len(rows))]
        page.locator("th", has_text="row").get_by_role("button").click()
        assert column.all_text_contents() == [str(i) for i in reversed(range(len(rows)))]


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_cut_or_wider_than_the_window(browser, tmp_path, html, demo, campaign, width, scheme):
    cloud = Figure()
    cloud.subplots().imshow(np.arange(4.0).reshape(2, 2))
    static = credibility_report("Cloud", "PASS", [Evidence("a", figure=cloud)], [], {"Command": 300 * "x"})
    shown = "[...document.querySelectorAll('.chart svg, .scene .view, .charts, th, td, p, h1, h4, figure img')]"
    for text in (html, demo, campaign[1], static):
        with opened(browser, tmp_path, text, width, color_scheme=scheme) as page:
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 0)")
            seen = f"{shown}.filter(one => one.offsetParent || one.clientWidth)"
            ends = page.evaluate(f"{seen}.map(one => one.getBoundingClientRect().right)")
            assert max(ends) <= width + 0.5
            rooms = page.evaluate("[...document.querySelectorAll('.chart svg')].map(one => one.clientHeight)")
            assert min(rooms, default=170) >= 170


def test_without_scripts_the_pictures_stand(browser, tmp_path, html):
    with opened(browser, tmp_path, html, java_script_enabled=False) as page:
        assert page.locator(".still svg").first.is_visible()
        assert page.locator(".still svg").count() == 3
        assert not page.locator(".keys").is_visible()


def test_on_paper_the_pictures_stand_and_stay_on_it(browser, tmp_path, html):
    with opened(browser, tmp_path, html) as page:
        assert not page.locator(".still svg").first.is_visible()
        page.emulate_media(media="print")
        assert page.locator(".still svg").first.is_visible()
        assert not any(page.locator(part).first.is_visible() for part in (".controls", ".charts", ".stage", ".words"))
        page.set_viewport_size({"width": 690, "height": 1000})  # A4 less its margins
        wide = "[...document.querySelectorAll('.still > svg, table')]"
        assert max(page.evaluate(f"{wide}.map(one => one.getBoundingClientRect().right)")) <= 690
        assert page.pdf(format="A4").startswith(b"%PDF")
