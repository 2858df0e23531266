"""The page in a headless Chromium: what is clicked and typed happens, and nothing is asked for or wrong."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from delivery.view.page import gather, write_view
from tests.support.browser import Browser, browser, chromium
from tests.support.view_runs import campaign, with_diagnosis

pytestmark = [
    pytest.mark.usefixtures("blank_figures"),
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]


VALUES = "document.querySelectorAll('#values tbody tr')"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = campaign(tmp_path_factory.mktemp("view"))
    write_view(gather([run, with_diagnosis(run)]), run / "view.html")
    return run / "view.html"


@pytest.fixture(scope="module")
def opened(page: Path) -> Iterator[Browser]:
    with browser() as one:
        yield one


@pytest.fixture
def tab(page: Path, opened: Browser) -> Iterator[Browser]:
    opened.open(page)
    opened.drawn()
    yield opened
    assert opened.console == []
    assert {address.split(":")[0] for address in opened.requests} == {"file"}
    assert {address for address in opened.requests} == {page.absolute().as_uri()}


def chosen(tab: Browser, id: str) -> str:
    return str(tab.value(f"document.getElementById('{id}').value"))


def ink(tab: Browser, id: str) -> int:
    """Pixels of a canvas that are drawn."""
    script = f"(() => {{const c = document.getElementById('{id}'), o = new OffscreenCanvas(c.width, c.height); "
    script += "const k = o.getContext('2d', {willReadFrequently: true}); k.drawImage(c, 0, 0); "
    script += "const d = k.getImageData(0, 0, c.width, c.height).data; "
    return int(tab.value(script + "let n = 0; for (let i = 3; i < d.length; i += 4) if (d[i]) n++; return n})()"))


def test_the_page_is_ready_and_drawn(tab: Browser) -> None:
    assert float(tab.value("document.documentElement.dataset.ready")) > 0
    assert ink(tab, "track") > 2000 and ink(tab, "track-now") > 200 and ink(tab, "body") > 500
    assert tab.value("document.querySelectorAll('.uplot canvas').length") >= 8
    assert chosen(tab, "run") == "1" and "held out" in tab.value("document.getElementById('facts').textContent")
    assert "unknown" in tab.value("document.getElementById('diagnosis').textContent")
    assert tab.value(f"{VALUES}.length") == 3


def test_keys_change_run_window_time_and_what_is_shown(tab: Browser) -> None:
    tab.key("n", "n")
    assert chosen(tab, "run") == "0" and "held out" not in tab.value("document.getElementById('facts').textContent")
    tab.key("w", "w")
    assert chosen(tab, "length") == "1"
    tab.key("]", "]")
    tab.key("]", "]")
    assert chosen(tab, "window") == "1"
    first = tab.value("Charts.all[0].plot.scales.x.min")
    assert first == pytest.approx(100.0, abs=1.0) and float(tab.value("run().t[Chosen.row]")) == pytest.approx(first)
    tab.key("ArrowRight")
    tab.key("ArrowRight", shift=True)
    assert tab.value("Chosen.row - shownRows()[0]") == 11
    tab.key("Escape")
    assert chosen(tab, "window") == "-1" and tab.value("Charts.all[0].plot.scales.x.min") == 0
    before = ink(tab, "track")
    tab.key("1", "1")
    tab.drawn()
    assert tab.value("Chosen.visible[0]") is False and ink(tab, "track") < before
    assert tab.value(f"{VALUES}[1].hidden") is True


BOX = "document.querySelector('.uplot .u-over').getBoundingClientRect()"


def test_the_mouse_links_charts_slider_and_track(tab: Browser) -> None:
    x, y, width = (tab.value(f"{BOX}.{name}") for name in ("x", "y", "width"))
    tab.hover(x + 0.25 * width, y + 20)
    tab.hover(x + 0.5 * width, y + 20)
    time = tab.value("run().t[Chosen.row]")
    assert time == pytest.approx(0.5 * tab.value("run().t.at(-1)"), rel=0.05)
    assert int(chosen(tab, "slider")) == tab.value("Chosen.row") > 0
    lefts = tab.value("Charts.all.map(c => c.plot.valToPos(run().t[Chosen.row], 'x') - c.plot.cursor.left)")
    assert all(abs(left) < 2 for left in lefts)
    assert f"{time:.1f}"[:4] in tab.value("document.getElementById('time').textContent")


def test_dragging_in_one_chart_zooms_all(tab: Browser) -> None:
    x, y, width = (tab.value(f"{BOX}.{name}") for name in ("x", "y", "width"))
    moves = (("Moved", 0.3), ("Pressed", 0.3), ("Moved", 0.5), ("Moved", 0.6), ("Released", 0.6))
    for name, share in moves:
        where = {"x": x + share * width, "y": y + 30}
        tab.send("Input.dispatchMouseEvent", type=f"mouse{name}", button="left", clickCount=1, **where)
    tab.drawn()
    ranges = tab.value("Charts.all.map(c => [c.plot.scales.x.min, c.plot.scales.x.max])")
    span = tab.value("run().t.at(-1)")
    assert ranges[0][0] == pytest.approx(0.3 * span, rel=0.1) and ranges[0][1] == pytest.approx(0.6 * span, rel=0.1)
    assert all(pair == ranges[0] for pair in ranges)


def test_buttons_boxes_and_the_dialog_work(tab: Browser) -> None:
    tab.click("#run-back")
    assert chosen(tab, "run") == "0"
    before = ink(tab, "track")
    tab.click("#missing")
    tab.drawn()
    assert ink(tab, "track") < before
    for _ in range(6):
        tab.key("ArrowRight", shift=True)
    before = ink(tab, "track-now")
    tab.click("#bands")
    tab.click("#arrows")
    tab.drawn()
    assert ink(tab, "track-now") < before
    scale = tab.value("Track.scale")
    tab.click("#zoom-in")
    assert tab.value("Track.scale") == pytest.approx(1.4 * scale)
    tab.click("#fit")
    assert tab.value("Track.scale") == pytest.approx(scale)
    tab.key("?", "?")
    assert tab.value("document.getElementById('help').open") is True
    tab.click("#help button")
    assert tab.value("document.getElementById('help').open") is False


def test_play_runs_and_stops(tab: Browser) -> None:
    tab.click("#play")
    for _ in range(200):
        tab.drawn()
        if tab.value("Chosen.row") > 3:
            break
    assert tab.value("Chosen.row") > 3
    tab.click("#play")
    row = tab.value("Chosen.row")
    tab.drawn()
    assert tab.value("Chosen.row") == row and tab.value("Chosen.playing") is False


def test_forces_of_another_model_and_component_are_shown(tab: Browser) -> None:
    calibrated = tab.value("document.getElementById('forces').textContent")
    change = "s.value = 0; s.dispatchEvent(new Event('change'))"
    tab.value(f"(() => {{const s = document.getElementById('force-model'); {change}}})()")
    assert tab.value("document.getElementById('forces').textContent") != calibrated
    rows = tab.value("[...document.querySelectorAll('#forces tbody th')].map(c => c.textContent)")
    assert rows == ["hull", "propeller", "rudder", "wind", "sum"]
    channel = chosen(tab, "channel")
    tab.key("x", "x")
    assert chosen(tab, "channel") != channel


def test_it_fits_a_narrow_window(page: Path, opened: Browser) -> None:
    opened.open(page, 400, 800)
    opened.drawn()
    assert opened.value("document.documentElement.scrollWidth <= 400")
    assert opened.value("document.querySelector('.uplot').getBoundingClientRect().width <= 400")
