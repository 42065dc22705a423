"""The page in Chromium: it fetches nothing, has no errors, fits the window, and its controls work."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.report import build_comparison, build_report
from tests.support.waiting import wait_until

from ..conftest import facts, score

pytestmark = pytest.mark.browser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --remote-debugging-port=0"
)
TIMEOUT_S = 60.0


class Browser:
    """One browser tab, controlled over the DevTools protocol."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._ids = itertools.count(1)
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    _session: str | None = None

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._ids)
        message = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=TIMEOUT_S))
            if answer.get("id") == number:
                assert "error" not in answer, answer["error"]
                result: dict[str, Any] = answer["result"]
                return result
            self.events.append(answer)

    def point(self, kind: str, x: float, y: float, **parameters: Any) -> None:
        """Move, press or release the mouse at a place of the window, in pixels."""
        self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **parameters)

    def drag(self, from_xy: tuple[float, float], to_xy: tuple[float, float]) -> None:
        """Drag with the left button."""
        self.point("Moved", *from_xy)
        self.point("Pressed", *from_xy, button="left", buttons=1, clickCount=1)
        self.point("Moved", *to_xy, button="left", buttons=1)
        self.point("Released", *to_xy, button="left", clickCount=1)

    def press(self, key: str) -> None:
        """Press a key; one character is typed."""
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def box(self, css: str) -> tuple[float, float, float, float]:
        """Scroll an element into view; return its left, top, width and height in the window."""
        script = f"""(() => {{
          const node = document.querySelector({json.dumps(css)});
          node.scrollIntoView({{block: 'center', behavior: 'instant'}});
          const box = node.getBoundingClientRect();
          return [box.left, box.top, box.width, box.height];
        }})()"""
        left, top, width, height = self.evaluate(script)
        return left, top, width, height

    def open(self, page: Path, width: int, scheme: str = "light", media: str = "screen", fragment: str = "") -> None:
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", media=media, features=features)
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
        self.events.clear()
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=f"{page.as_uri()}{fragment}")
        # Polled, not awaited: promises never resolve on a page whose scripts are disabled.
        loaded = f"{page.as_uri()}{fragment}complete"
        wait_until(lambda: self.evaluate("location.href + document.readyState") == loaded, f"{page}", interval_s=0.02)

    def evaluate(self, expression: str) -> Any:
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def screenshot(self, path: Path) -> None:
        """Save a PNG of the whole page, for looking at it while debugging."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def errors(self) -> list[str]:
        """Return all exceptions of the page and log entries of the browser."""
        names = ("Runtime.exceptionThrown", "Log.entryAdded")
        return [json.dumps(e["params"]) for e in self.events if e.get("method") in names]

    def requests(self) -> list[str]:
        urls = [e["params"]["request"]["url"] for e in self.events if e.get("method") == "Network.requestWillBeSent"]
        return [url for url in urls if not url.startswith(("data:", "about:"))]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; install the package chromium")
    connect = pytest.importorskip("websockets.sync.client").connect
    profile = tmp_path_factory.mktemp("chromium")
    command = [CHROMIUM, *FLAGS.split(), f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True)
    try:
        assert process.stderr is not None
        url = next(line.split(" on ")[1].strip() for line in process.stderr if "DevTools listening" in line)
        with connect(url, max_size=64_000_000, open_timeout=TIMEOUT_S) as socket:
            yield Browser(socket)
    finally:
        os.killpg(process.pid, 15)
        try:
            process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait(TIMEOUT_S)
        if process.stderr is not None:
            process.stderr.close()


@pytest.fixture(scope="module")
def page(mission_run: Path) -> Path:
    return build_report(mission_run, facts(), score).page


@pytest.fixture(scope="module")
def comparison(mission_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "20260315-101500-9f9f"
    shutil.copytree(mission_run, folder, ignore=shutil.ignore_patterns("report"))
    other = build_report(folder, facts() | {"state": "FAULT", "collisions": 2}, score)
    return build_comparison(build_report(mission_run, facts(), score), other).page


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    ("width", "media"),
    [(390, "screen"), (820, "screen"), (1400, "screen"), (1920, "screen"), (718, "print")],  # A4 less its margins is 718
)
def test_page_loads_without_errors_and_fits_the_width(
    browser: Browser, page: Path, width: int, media: str, scheme: str
) -> None:
    browser.open(page, width, scheme, media)
    assert browser.errors() == []
    assert browser.requests() == [page.as_uri()]
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate("document.getElementById('map').getBoundingClientRect().height") > 200


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_has_enough_contrast(browser: Browser, page: Path, comparison: Path, scheme: str) -> None:
    for path in (page, comparison):
        browser.open(path, 1400, scheme)
        assert browser.evaluate(WEAK_TEXTS) == []


# WCAG 2.1, 1.4.3
WEAK_TEXTS = """(() => {
      const luminance = (color) => {
        const [r, g, b] = color.match(/[0-9.]+/g).slice(0, 3).map((v) => v / 255)
          .map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
      };
      const ground = (node) => {
        for (; node; node = node.parentElement) {
          const color = getComputedStyle(node).backgroundColor;
          if (color.startsWith('rgb(')) return color;
        }
        return 'rgb(255, 255, 255)';
      };
      const weak = [];
      for (const node of document.querySelectorAll('h1, h2, p, dt, dd, b, small, th, td, li, summary, label, .badge, .mark')) {
        if (!node.textContent.trim() || !node.offsetParent || node.closest('.row-track, [hidden]')) continue;
        const [a, b] = [luminance(getComputedStyle(node).color), luminance(ground(node))].sort((x, y) => y - x);
        if ((a + 0.05) / (b + 0.05) < 4.5) weak.push(`${node.tagName} ${node.className} ${node.textContent.slice(0, 30)}`);
      }
      return weak;
    })()"""


@pytest.mark.parametrize("width", [390, 820, 1400])
def test_comparison_loads_without_errors_and_fits_the_width(browser: Browser, comparison: Path, width: int) -> None:
    browser.open(comparison, width)
    assert browser.errors() == []
    assert browser.requests() == [comparison.as_uri()]
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate("[...document.querySelectorAll('.map')].every((map) => map.getBoundingClientRect().width > 200)")


def test_charts_of_a_comparison_show_both_runs(browser: Browser, comparison: Path) -> None:
    browser.open(comparison, 1400)
    plot = '.chart[data-chart="0"] .plot'
    left, top, width, height = browser.box(plot)
    browser.point("Moved", left + width * 100.0 / 180.0, top + height / 2)
    values = "[...document.querySelectorAll('.value')].slice(0, 2).map((node) => node.textContent)"
    assert browser.evaluate(values) == ["2", "2"]
    browser.evaluate("document.getElementById('charts-in').click()")
    assert browser.evaluate(f"document.querySelector('{plot} svg').getAttribute('viewBox').split(' ')[2]") == "300"
    assert browser.errors() == []


def test_slider_moves_robot_and_updates_values(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    at = """(t) => {
      const slider = document.getElementById('time');
      slider.value = t; slider.dispatchEvent(new Event('input'));
      const text = (id) => document.getElementById(id).textContent;
      return [text('clock'), text('state'), text('leg'), Number(text('known')), document.querySelectorAll('#so-far li').length,
              document.getElementById('robot').getAttribute('transform'), document.querySelectorAll('.leg.ahead').length];
    }"""
    early = browser.evaluate(f"({at})(20)")
    scanning = browser.evaluate(f"({at})(125)")
    end = browser.evaluate(f"({at})(1e9)")
    assert early[:3] == ["0:20", "EXPLORING", "–"]
    assert scanning[:3] == ["2:05", "MONITORING · e-stop", "tag 2, scanning"]
    assert early[3] < scanning[3] == end[3] == 8
    assert early[4] < scanning[4] < end[4] == 6
    assert len({early[5], scanning[5], end[5]}) == 3
    assert early[6] > scanning[6] > end[6] == 0
    assert browser.evaluate("document.getElementById('scan').getAttribute('d')") == "M0 0"
    browser.evaluate(f"({at})(60)")
    assert len(browser.evaluate("document.getElementById('scan').getAttribute('d')")) > 500
    assert browser.evaluate("document.getElementById('picture').src").startswith("data:image/jpeg")
    assert browser.errors() == []


def test_replay_stops_at_the_end(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    script = """new Promise((done) => {
      document.getElementById('pace').value = '60';
      document.getElementById('play').click();
      const started = performance.now(), words = () => document.getElementById('play').getAttribute('aria-label');
      const poll = () => words() === 'Play' || performance.now() - started > 20000
        ? done([document.getElementById('clock').textContent, words()]) : setTimeout(poll, 50);
      setTimeout(poll, 200);
    })"""
    assert browser.evaluate(script) == ["3:00", "Play"]


def test_layer_heat_and_zoom_controls_work(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    shown = "(css) => getComputedStyle(document.querySelector(css)).display !== 'none'"
    assert browser.evaluate(f"({shown})('.heat-co2')") is False
    browser.evaluate("(s => { s.value = 'co2'; s.dispatchEvent(new Event('change')); })(document.getElementById('heat'))")
    assert browser.evaluate(f"({shown})('image.heat-co2') && ({shown})('.heat-legend.heat-co2')") is True
    assert browser.evaluate(f"({shown})('image.heat-light')") is False
    assert browser.evaluate(f"({shown})('.layer.truth')") is False
    browser.evaluate("document.querySelector('[data-layer=truth]').click()")
    assert browser.evaluate(f"({shown})('.layer.truth')") is True
    browser.evaluate("document.querySelector('[data-layer=tags]').click()")
    assert browser.evaluate(f"({shown})('.layer.tags')") is False
    whole = browser.evaluate("document.getElementById('map').getAttribute('viewBox')")
    browser.evaluate("document.getElementById('zoom-in').click()")
    near = browser.evaluate("document.getElementById('map').getAttribute('viewBox')")
    assert float(near.split()[2]) == pytest.approx(float(whole.split()[2]) / 1.5, rel=1e-3)
    browser.evaluate("document.getElementById('zoom-reset').click()")
    assert [float(v) for v in browser.evaluate("document.getElementById('map').getAttribute('viewBox')").split()] == [
        float(v) for v in whole.split()
    ]


CHART = '.chart[data-chart="3"]'  # the localization error
CHART_STATE = f"""(() => {{
  const chart = document.querySelector('{CHART}');
  return [...chart.querySelectorAll('.value, .ends span')].map((node) => node.textContent);
}})()"""


def test_charts_show_the_values_at_the_pointer(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    left, top, width, height = browser.box(f"{CHART} .plot")
    browser.point("Moved", left + width * 141.0 / 180.0, top + height / 2)
    value, _, at, _ = browser.evaluate(CHART_STATE)
    assert float(value) == pytest.approx(15.5, abs=1.5)  # centimeters, between two corrections
    assert at in ("2:20", "2:21")
    others = "[...document.querySelectorAll('.value')].every((node) => node.textContent)"
    assert browser.evaluate(others) is True  # all charts show the same time
    browser.point("Moved", 2, top)
    assert browser.evaluate(CHART_STATE)[::2] == ["", ""]


def test_dragging_on_a_chart_zooms_all_charts(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    left, top, width, height = browser.box(f"{CHART} .plot")
    before = browser.evaluate("document.getElementById('clock').textContent")
    browser.drag((left + width / 3, top + height / 2), (left + width / 2, top + height / 2))
    assert browser.evaluate(CHART_STATE)[1::2] == ["1:00", "1:30"]
    views = browser.evaluate("[...document.querySelectorAll('.plot svg')].map((svg) => svg.getAttribute('viewBox').split(' '))")
    assert all(float(x) == pytest.approx(200.0, abs=3) and float(w) == pytest.approx(100.0, abs=3) for x, _, w, _ in views)
    assert browser.evaluate("document.getElementById('clock').textContent") == before  # a drag is no click
    browser.evaluate("document.getElementById('charts-all').click()")
    assert browser.evaluate(CHART_STATE)[1::2] == ["0:00", "3:00"]
    browser.drag((left + width / 3, top + height / 2), (left + width / 3, top + height / 2))
    assert browser.evaluate("document.getElementById('clock').textContent") in ("0:59", "1:00")
    assert browser.errors() == []


def test_charts_obey_the_keyboard(browser: Browser, page: Path) -> None:
    browser.open(page, 1400, fragment="#t=90")
    plot = f"document.querySelector('{CHART} .plot')"
    browser.evaluate(f"{plot}.focus()")
    assert browser.evaluate(f"{plot}.getAttribute('role')") == "slider"
    assert browser.evaluate(f"{plot}.getAttribute('aria-valuetext')").startswith("1:30: distance to the truth ")
    browser.press("+")
    assert browser.evaluate(CHART_STATE)[1:] == ["0:45", "1:30", "2:15"]
    browser.press("ArrowRight")
    browser.press("ArrowRight")
    assert float(browser.evaluate(f"{plot}.getAttribute('aria-valuenow')")) == pytest.approx(91.8, abs=0.2)
    browser.press("Enter")
    assert browser.evaluate("document.getElementById('clock').textContent") == "1:31"
    browser.press("0")
    assert browser.evaluate(CHART_STATE)[1::2] == ["0:00", "3:00"]


def test_slider_obeys_the_keyboard(browser: Browser, page: Path) -> None:
    browser.open(page, 1400, fragment="#t=60")
    clock = "document.getElementById('clock').textContent"
    browser.evaluate("document.getElementById('time').focus()")
    browser.press("ArrowRight")
    assert browser.evaluate(clock) == "1:01"
    browser.press("ArrowDown")
    browser.press("ArrowDown")
    assert browser.evaluate(clock) == "0:59"
    browser.evaluate("document.getElementById('next-event').click()")
    browser.evaluate("document.getElementById('previous-event').click()")
    assert browser.evaluate(clock) < "0:59"


def test_slider_shows_only_what_was_known_then(browser: Browser, page: Path) -> None:
    known = """(() => {
      const shown = (css) => [...document.querySelectorAll(css)].filter((node) => getComputedStyle(node).display !== 'none');
      return {
        tags: shown('.for-wide .tag').length,
        judged: shown('.for-wide .tag').filter((tag) => !tag.classList.contains('unjudged-yet')).length,
        pots: shown('.pot').length, boxes: shown('.boxes polygon').length, corrections: shown('.correction').length,
        end: shown('.for-wide .end.end').length, grid: document.querySelector('.grid.light').getAttribute('href'),
        note: !document.getElementById('known-at').hidden,
      };
    })()"""
    browser.open(page, 1400, fragment="#t=15")
    early = browser.evaluate(known)
    browser.open(page, 1400, fragment="#t=90")
    middle = browser.evaluate(known)
    browser.open(page, 1400)
    whole = browser.evaluate(known)
    assert [state["tags"] for state in (early, middle, whole)] == [2, 8, 8]
    assert [state["judged"] for state in (early, middle, whole)] == [0, 1, 8]  # tag 3 is read at 1:21
    assert [state["pots"] for state in (early, middle, whole)] == [0, 1, 7]
    assert [state["corrections"] for state in (early, middle, whole)] == [0, 0, 2]
    assert [state["end"] for state in (early, middle, whole)] == [1, 1, 2]  # the start, then also the end
    assert len({state["grid"] for state in (early, middle, whole)}) == 3
    assert [state["note"] for state in (early, middle, whole)] == [True, True, False]
    assert early["boxes"] < whole["boxes"]


def test_finding_leads_to_its_time_on_the_map(browser: Browser, page: Path) -> None:
    browser.open(page, 1400)
    browser.evaluate("[...document.querySelectorAll('.warn .go')].find((node) => node.textContent.includes('2:00')).click()")
    assert browser.evaluate("document.getElementById('state').textContent") == "MONITORING · e-stop"
    assert browser.evaluate("document.querySelector('.finding a').getAttribute('href')") == "#tag-3"


def test_map_fits_a_phone_and_its_numbers_can_be_read(browser: Browser, page: Path) -> None:
    browser.open(page, 390)
    _, _, frame_width, frame_height = browser.box("#map-frame")
    _, _, map_width, _ = browser.box("#map")
    assert map_width <= frame_width <= 390
    assert frame_height < 500
    assert browser.evaluate("document.getElementById('map-frame').scrollWidth") <= frame_width
    heights = "[...document.querySelectorAll('.for-phone .pin-text')].map((node) => node.getBoundingClientRect().height)"
    assert min(browser.evaluate(heights)) >= 9.0
    assert browser.evaluate("getComputedStyle(document.querySelector('.for-wide')).display") == "none"


def test_two_fingers_zoom_the_map(browser: Browser, page: Path) -> None:
    browser.open(page, 390)
    left, top, width, height = browser.box("#map-frame")
    x, y = left + width / 2, top + height / 2

    def touch(kind: str, *apart: float) -> None:
        points = [{"x": x + sign * half, "y": y, "id": i} for half in apart for i, sign in enumerate((-1, 1))]
        browser.call("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)

    browser.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    try:
        whole = float(browser.evaluate("document.getElementById('map').getAttribute('viewBox')").split()[2])
        touch("Start", 30.0)
        touch("Move", 40.0)
        touch("Move", 60.0)
        touch("End")
    finally:
        browser.call("Emulation.setTouchEmulationEnabled", enabled=False)
    near = float(browser.evaluate("document.getElementById('map').getAttribute('viewBox')").split()[2])
    assert near == pytest.approx(whole / 2.0, rel=0.05)


def test_url_fragment_sets_the_time(browser: Browser, page: Path) -> None:
    browser.open(page, 1400, fragment="#t=42")
    assert browser.evaluate("document.getElementById('clock').textContent") == "0:42"


def test_page_is_complete_without_scripts(browser: Browser, page: Path) -> None:
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(page, 1400)
        assert "0:" in browser.evaluate("document.querySelector('.timeline').textContent")
        assert browser.evaluate("document.querySelectorAll('table.tags tbody tr').length") == 8
        assert browser.evaluate("getComputedStyle(document.querySelector('.tools')).display") == "none"
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
