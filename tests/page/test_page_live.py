"""`run --hand page` and a real browser: its keys move the arm, and without the browser it holds."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tams_app.recording import read_log
from tams_app.records import Tick
from tams_app.runtime.process import PROJECT_DIRECTORY
from tests.faults.applications import until
from tests.real_time import require_real_time

pytest.importorskip("playwright", reason="the browser is driven by Playwright")
from playwright.sync_api import Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.timed,
    pytest.mark.timeout(120),
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium"),
]
WITHIN_MS = 20_000.0
RISEN_MM = 15.0


@contextmanager
def session(out: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """The application as a process, and the file of what it says."""
    words = out.with_suffix(".out")
    command = ["run_tams.py", "run", "--hand", "page", "--seconds", "90", "--out", str(out)]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "DISPLAY": "", "WAYLAND_DISPLAY": ""}
    with (
        words.open("wb") as file,
        subprocess.Popen(
            [sys.executable, *command],
            cwd=PROJECT_DIRECTORY,
            env=environment,
            stdout=file,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        try:
            yield process, words
        finally:
            process.kill()


@contextmanager
def browser(profile: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Chromium as a process group of its own, and where Playwright reaches it."""
    assert CHROMIUM is not None
    options = ["--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--no-first-run"]
    process = subprocess.Popen(
        [CHROMIUM, *options, f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    port = profile / "DevToolsActivePort"
    try:
        until(lambda: port.exists() and "\n" in port.read_text(), "the browser")
        yield process, f"http://127.0.0.1:{port.read_text().split()[0]}"
    finally:
        kill(process)


def kill(process: subprocess.Popen[bytes]) -> None:
    """All processes of the browser at once."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def drive_up(page: Page) -> None:
    """Press keys until the arm follows and the tool is higher; again after a hold."""
    page.click("[data-tams=engage]:not([disabled])", timeout=WITHIN_MS)
    state, hand = page.locator("[data-tams=state]"), page.locator("[data-tams=hand]")

    def height_mm() -> float:
        shown = re.search(r"TCP\s+-?\d+, -?\d+, (-?\d+) mm", hand.inner_text())
        return float(shown[1]) if shown else np.nan

    until(lambda: height_mm() > 0, "the arm's state")
    begun_mm = height_mm()

    def is_higher() -> bool:
        if state.inner_text() == "DISARMED":
            page.keyboard.press("Enter")
        elif state.inner_text() in ("READY", "HOLDING"):
            page.keyboard.up("Shift")
            page.wait_for_timeout(300)
            page.keyboard.down("Shift")
            page.keyboard.down("KeyR")
        page.wait_for_timeout(100)
        return state.inner_text() == "ENGAGED" and height_mm() > begun_mm + RISEN_MM

    until(is_higher, "the arm")


def link_in(words: Path) -> str | None:
    found = re.search(r"http://\S+/#\S+", words.read_text())
    return found[0] if found else None


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> list[Tick]:
    """The ticks of a session that was driven from a page, which was killed while it drove."""
    require_real_time()
    out = tmp_path_factory.mktemp("page")
    with session(out) as (process, words), browser(out.with_suffix(".profile")) as (chrome, at):
        until(lambda: link_in(words) is not None or process.poll() is not None, "the link")
        link = link_in(words)
        assert link is not None, words.read_text()
        with sync_playwright() as playwright:
            page = playwright.chromium.connect_over_cdp(at).contexts[0].pages[0]
            page.goto(link)
            drive_up(page)
            assert link.split("#")[1] not in page.url
            kill(chrome)
        until(lambda: "holding" in words.read_text().rsplit("engaged", 1)[-1], "the arm to hold")
        time.sleep(1.0)  # it brakes, and stays
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130, words.read_text()
    (folder,) = out.iterdir()
    assert link.split("#")[1].encode() not in (folder / "session.mcap").read_bytes()
    return list(read_log(folder / "session.mcap").ticks)


def heights_mm(ticks: list[Tick]) -> np.ndarray:
    return np.array([tick.arm.tcp.position[2] for tick in ticks if tick.arm is not None]) * 1e3


def test_keys_in_the_browser_move_the_arm(driven: list[Tick]) -> None:
    engaged = [tick for tick in driven if tick.arming == "engaged"]
    assert np.ptp(heights_mm(engaged)) > RISEN_MM
    assert {tick.reason for tick in engaged} == {""}


def test_the_arm_holds_once_the_browser_is_killed(driven: list[Tick]) -> None:
    last = max(number for number, tick in enumerate(driven) if tick.arming == "engaged")
    held = [tick for tick in driven[last + 1 :] if tick.arming == "holding"]
    assert held
    assert held[0].reason
    assert np.ptp(heights_mm(held[-10:])) < 0.5
    assert all(np.allclose(tick.twist.linear, 0) for tick in held[-10:])
