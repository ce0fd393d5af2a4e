"""The page in a real browser, before the simulated sensor: skipped where there is no browser, or nothing to drive it with."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from prismstereo.opening import open_camera
from prismstereo.viewer.hub import Hub
from prismstereo.viewer.records import Records
from prismstereo.viewer.serving import ViewerServer
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.truth import true_disparity
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
)  # fmt: skip
WAIT_S = 30.0


@dataclass
class Watched:
    """A page, and everything that it asked for or complained about."""

    page: Any
    records: Path
    asked: list[str]
    complaints: list[str]

    def stats(self) -> dict[str, Any]:
        found = self.page.evaluate("window.stats")
        assert isinstance(found, dict)
        return found

    def until(self, condition: str) -> None:
        """Wait for what JavaScript says; asked from outside, because the page itself lets nobody evaluate anything."""
        deadline_s = time.monotonic() + WAIT_S
        while not self.page.evaluate(condition):
            assert time.monotonic() < deadline_s, (condition, self.stats(), self.complaints)
            self.page.wait_for_timeout(30)


@pytest.fixture(scope="module")
def quick(oak: Rig) -> Rig:
    """An OAK-1 that is read out with a sixteenth of the pixels, stills included."""
    camera = msgspec.structs.replace(
        oak.camera, video=Mode(width=320, height=180, rate_hz=30.0), still=Mode(width=640, height=360, rate_hz=0.0)
    )
    return msgspec.structs.replace(oak, name="quick", camera=camera)


@pytest.fixture(scope="module")
def watched(quick: Rig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no browser is driven")
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: the page is not opened")
    folder = tmp_path_factory.mktemp("viewer")
    path = folder / "quick.toml"
    path.write_text(quick.toml())
    target = f"simulated:{path}:desk"
    with (
        Hub(lambda: open_camera(target, timeout_s=60), "simulated", Records(folder / "records"), rig=quick) as hub,
        ViewerServer(hub) as server,
        sync_api.sync_playwright() as play,
    ):
        browser = play.chromium.launch(executable_path=CHROMIUM, headless=True, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="dark")
        found = Watched(page, folder / "records", [], [])
        page.on("request", lambda request: found.asked.append(request.url))
        page.on("websocket", lambda line: found.asked.append(line.url))
        page.on(
            "console", lambda said: found.complaints.append(said.text) if said.type in ("error", "warning") else None
        )
        page.on("pageerror", lambda error: found.complaints.append(str(error)))
        page.goto(f"{server.url}?stride=2")
        found.until("window.stats.frames >= 2 && window.stats.drawn >= 1 && window.stats.pictures >= 1")
        yield found
        browser.close()


def test_points_are_drawn_and_change_with_the_scene(watched: Watched) -> None:
    first = watched.page.locator("#cloud").screenshot()
    before = watched.stats()["frames"]
    watched.until(f"window.stats.frames >= {before + 3}")
    watched.page.wait_for_timeout(300)
    second = watched.page.locator("#cloud").screenshot()

    pictures = [cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR) for png in (first, second)]
    assert watched.stats()["points"] > 5_000
    assert np.mean(cv2.cvtColor(pictures[0], cv2.COLOR_BGR2HSV)[..., 1] > 120) > 0.03  # coloured, not the dark ground
    assert np.any(pictures[0] != pictures[1])


def _shown_at(watched: Watched, x: int, y: int, width: int, height: int) -> tuple[float, float]:
    """Where a pixel of the map lies on the page."""
    box = watched.page.locator("#depth").bounding_box()
    scale = min(box["width"] / width, box["height"] / height)
    left = box["x"] + (box["width"] - scale * width) / 2
    top = box["y"] + (box["height"] - scale * height) / 2
    return left + (x + 0.5) * scale, top + (y + 0.5) * scale


def test_the_distance_of_two_picked_points_is_right_within_two_percent(watched: Watched, quick: Rig) -> None:
    twin, made = Twin(quick, named(quick, "desk")), rectification(Calibration.nominal(quick))
    truth = true_disparity(twin.truth(0), made)
    depth = made.window.depth_map(truth)
    known = cv2.erode(np.isfinite(depth).astype(np.uint8), np.ones((9, 9), np.uint8))
    wall = cv2.erode((known & (abs(depth - np.nanmedian(depth)) < 1)).astype(np.uint8), np.ones((7, 7), np.uint8))
    panel = known & (depth > 900) & (depth < 1150)  # it stands before the wall, both at rest
    ends = []
    for mask in (panel, wall):
        rows, columns = np.nonzero(mask)
        lowest = np.argmin(columns + rows)
        ends.append((int(columns[lowest]), int(rows[lowest])))
    points = made.points(np.nan_to_num(depth))
    expected = float(np.linalg.norm(points[ends[0][1], ends[0][0]] - points[ends[1][1], ends[1][0]]))

    for x, y in ends:
        watched.page.mouse.click(*_shown_at(watched, x, y, made.width, made.height))
    watched.until("window.stats.picked !== null")
    picked = watched.stats()["picked"]
    watched.page.click("#clear")

    assert picked["distance"] == pytest.approx(expected, rel=0.02)
    assert 0 < picked["sigma"] < 0.05 * expected


def test_an_empty_pixel_says_why_and_a_matched_one_how_far(watched: Watched) -> None:
    watched.page.check("#why")
    watched.until("window.stats.reasons >= 1")
    watched.page.mouse.move(*_shown_at(watched, 2, 2, 160, 180))
    watched.until("document.querySelector('#hover').textContent.includes('nothing matched:')")
    watched.page.mouse.move(*_shown_at(watched, 80, 100, 160, 180))
    watched.until("/ mm ± /.test(document.querySelector('#hover').textContent)")
    watched.page.uncheck("#why")


def test_record_writes_a_file_that_another_reader_accepts(watched: Watched) -> None:
    from mcap.reader import make_reader

    watched.page.click("#record")
    watched.until("/Stop 0:0[1-9]/.test(document.querySelector('#record-text').textContent)")
    watched.page.click("#record")
    watched.until("document.querySelector('#record-text').textContent === 'Record'")

    files = list(watched.records.glob("*.mcap"))
    assert len(files) == 1
    with files[0].open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > 5
    assert re.search(r"[0-9]{8}-[0-9]{6}", watched.page.inner_text("#records"))


def test_a_still_arrives_whole_in_a_session_folder(watched: Watched, quick: Rig) -> None:
    from prismstereo_hw.session import Session

    watched.page.click("#still")
    watched.until("window.stats.still")
    made = watched.stats()["still"]
    session = Session.open(watched.records / made["session"])

    stills = list(session.frames("stills"))
    assert (stills[0].width, stills[0].height) == (640, 360)
    assert next(iter(session.frames("video"))).width == 320
    assert session.calibration_path is not None


def test_a_phone_can_use_all_of_it(watched: Watched) -> None:
    page = watched.page
    page.set_viewport_size({"width": 390, "height": 780})
    try:
        for tab, shown in (("space", "#cloud"), ("picture", "#picture"), ("depth", "#depth")):
            page.click(f"#tabs button[data-tab={tab}]")
            box = page.locator(shown).bounding_box()
            assert box["width"] >= 300
            assert box["height"] >= 400
        page.click("#tabs button[data-tab=more]")
        assert page.locator("#distance").is_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for button in page.locator("header button, #tabs button").all():
            assert button.bounding_box()["height"] >= 40
    finally:
        page.set_viewport_size({"width": 1280, "height": 800})


def test_everything_that_can_be_operated_has_a_name_and_can_be_reached_by_keyboard(watched: Watched) -> None:
    page = watched.page
    nameless = page.evaluate(
        "[...document.querySelectorAll('button, input, select, canvas[tabindex], a')].filter((one) => !("
        "one.textContent.trim() || one.getAttribute('aria-label') || one.closest('label')?.textContent.trim()"
        " || document.querySelector(`label[for='${one.id}']`))).map((one) => one.outerHTML)"
    )
    page.focus("#cloud")
    page.keyboard.press("ArrowRight")
    page.focus("#depth")
    page.keyboard.press("ArrowDown")

    assert nameless == []
    assert "column" in page.inner_text("#hover")


def test_nothing_was_asked_of_another_host_and_nothing_went_wrong(watched: Watched) -> None:
    foreign = [url for url in watched.asked if not re.match(r"(http|ws)://127\.0\.0\.1:|blob:", url)]

    assert foreign == []
    assert watched.complaints == []
