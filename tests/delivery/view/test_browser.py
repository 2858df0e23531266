"""The page in a headless Chromium: what is clicked and typed happens, and nothing is asked for or wrong."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from delivery.view.page import gather, write_view
from tests.support.view_runs import campaign, with_diagnosis

# A headless Chromium driven over its debugging pipe
AT_THREE_AND_FOUR = """import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 100) for end in sys.argv[1:3]]
for end, number in zip(ends, (3, 4)):
    os.dup2(end, number)
os.execv(sys.argv[3], sys.argv[3:])"""
"""A program that becomes another one whose descriptors 3 and 4 are the ends of two pipes."""
NAMES = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str | None:
    """The path of a Chromium on this machine, None where there is none or none can be driven by pipes."""
    return None if os.name == "nt" else next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One tab. console: errors and warnings of its pages, uncaught ones and refusals of the policy included; requests:
    addresses that were asked for."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self.to_browser, self.from_browser = to_browser, from_browser
        self.buffer, self.number, self.session = b"", 0, ""
        self.console: list[str] = []
        self.requests: list[str] = []
        self.loaded = 0
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """The answer of the browser to a method of its protocol."""
        self.number += 1
        number = self.number
        message = {"id": number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to_browser, json.dumps(message).encode() + b"\0")
        while True:
            found = self.receive(60.0)
            assert found is not None, f"no answer to {method}"
            if found.get("id") == number:
                assert "error" not in found, (method, found["error"])
                return dict(found["result"])

    def receive(self, seconds: float) -> dict[str, Any] | None:
        """The next message, noted if it is an event; None if none comes within ``seconds``."""
        end = time.monotonic() + seconds
        while b"\0" not in self.buffer:
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.from_browser], [], [], left)[0]:
                return None
            self.buffer += os.read(self.from_browser, 1 << 20)
        text, _, self.buffer = self.buffer.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        self.note(message.get("method", ""), message.get("params", {}))
        return message

    def note(self, method: str, params: dict[str, Any]) -> None:
        """Keep what an event says of errors and requests."""
        if method == "Runtime.exceptionThrown":
            self.console.append(str(params["exceptionDetails"].get("exception", params["exceptionDetails"])))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.console.append(str(params["args"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.console.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Page.loadEventFired":
            self.loaded += 1

    def open(self, path: Path, width: int = 1280, height: int = 900) -> None:
        """Open the file ``path`` in a window of ``width`` by ``height`` pixels and wait until it is loaded."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        before = self.loaded
        self.send("Page.navigate", url=path.absolute().as_uri())
        while self.loaded == before:
            assert self.receive(30.0) is not None, "the page does not load"
        self.send("Page.bringToFront")

    def value(self, expression: str) -> Any:
        """The value of a JavaScript ``expression``, awaited if it is a promise."""
        found = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def drawn(self) -> None:
        """Wait until two frames have been drawn."""
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def key(self, key: str, text: str = "", shift: bool = False) -> None:
        """Press and release ``key``; text: that it types."""
        common: dict[str, Any] = {"key": key, "modifiers": 8 * shift}
        self.send("Input.dispatchKeyEvent", type="keyDown", **common, **({"text": text} if text else {}))
        self.send("Input.dispatchKeyEvent", type="keyUp", **common)

    def click(self, selector: str) -> None:
        """Click the middle of the element that ``selector`` names."""
        x, y = self.middle(selector)
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def hover(self, x: float, y: float) -> None:
        """Move the mouse to ``x``, ``y`` [pixels]."""
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element [pixels], scrolled into view."""
        script = (
            f"(() => {{const e = document.querySelector({json.dumps(selector)}); "
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect(); "
            "return [b.x + b.width / 2, b.y + b.height / 2]})()"
        )
        x, y = self.value(script)
        return float(x), float(y)


@contextmanager
def browser() -> Iterator[Browser]:
    """A headless browser with a profile of its own, ended at the end; ``chromium`` must be there."""
    program = chromium()
    assert program is not None
    own_read, to_browser = os.pipe()
    from_browser, own_write = os.pipe()
    with tempfile.TemporaryDirectory(prefix="profile", ignore_cleanup_errors=True) as profile:
        flags = [
            "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-dev-shm-usage", "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank",
        ]  # fmt: skip
        command = [sys.executable, "-c", AT_THREE_AND_FOUR, str(own_read), str(own_write), program, *flags]
        process = subprocess.Popen(
            command, pass_fds=(own_read, own_write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(own_read)
        os.close(own_write)
        try:
            yield Browser(to_browser, from_browser)
        finally:
            os.close(to_browser)
            os.close(from_browser)
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


# What the page shows and answers
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
