"""A real browser and a real server, as a reader of the pages has them."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit
from urllib.request import urlopen

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Dialog, Request, Response
from playwright.sync_api import Error as BrowserError

from tests.support.processes.commands import start
from tests.support.processes.workers import PATIENCE

NARROW, WIDE = 400, 1600
# The width of an A4 sheet at a style sheet's 96 pixels per inch.
PAPER = 794
WIDTHS = (NARROW, WIDE)
Scheme = Literal["light", "dark"]
# Contrast depends on the scheme, space on the width: two pairs show as much as all four.
LOOKS: tuple[tuple[int, Scheme], ...] = ((NARROW, "light"), (WIDE, "dark"))
# Other host names lead nowhere, so nothing leaves the machine, whatever a page requests.
ARGUMENTS = (
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1 , EXCLUDE localhost",
    "--disable-gpu",
)
_MILLISECONDS = 30_000
# Elements at which the key Tab stops, as a reader sees them; one of each group of radio buttons.
_STOPS = """() => [...document.querySelectorAll(
    'main a[href], main button, main input, main select, main textarea, main summary,' +
    'main [tabindex]')].filter(each => each.tabIndex >= 0 && !each.disabled &&
    each.type !== 'hidden' && each.type !== 'radio' && each.checkVisibility()).length"""
_FOCUSED = """() => {
    const each = document.activeElement;
    if (!each || each === document.body) return null;
    const style = getComputedStyle(each), box = each.getBoundingClientRect();
    each.dataset.visited = '1';
    return {
        visited: document.querySelectorAll('main [data-visited]').length,
        name: each.outerHTML.slice(0, 200),
        inMain: !!each.closest('main') && each.id !== 'content',
        isSeen: (style.outlineStyle !== 'none' || style.boxShadow !== 'none') && box.width > 0,
    };
}"""
_VISITED = "() => document.querySelectorAll('main [data-visited]').length"
_OVERFLOW = """() => {
    const root = document.documentElement, wide = [];
    if (root.scrollWidth <= root.clientWidth) return wide;
    for (const each of document.querySelectorAll('body *'))
        if (each.getBoundingClientRect().right > root.clientWidth + 1)
            wide.push(each.outerHTML.slice(0, 160));
    return wide.length ? wide.slice(0, 5) : ['the page'];
}"""


def chromium() -> str | None:
    """Find Debian's browser, or the one in `KANT_SQL_TEST_BROWSER`."""
    return os.environ.get("KANT_SQL_TEST_BROWSER") or shutil.which("chromium")


class Serving:
    """`kant-sql serve` as its own process.

    Attributes:
        address: its address, without a slash at the end.
        token: the token that readers need, if any.
        process: its process.
    """

    def __init__(
        self, url: str, folder: Path, *words: str, port: int = 0, program: Sequence[str] = ()
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._log = folder / "serve.log"
        with self._log.open("ab") as log:
            self.process = start(
                *("serve", url, "--port", str(port), *words), program=program, stderr=log
            )
        assert self.process.stdout is not None
        first = self.process.stdout.readline().decode()
        assert first.startswith("http://"), self.log()
        self.address = first.strip().rstrip("/")
        self.token = None
        if "--host" in words:
            self.token = self.process.stdout.readline().decode().strip().removeprefix("token: ")
        self._wait()

    def _wait(self) -> None:
        """Wait until it answers; the socket exists before that."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and self.process.poll() is None:
            with suppress(OSError):
                name = self.address.replace("//0.0.0.0", "//127.0.0.1")
                urlopen(f"{name}/static/style.css", timeout=PATIENCE).close()
                return
            time.sleep(0.02)
        raise AssertionError(f"the server does not answer: {self.log()}")

    def log(self) -> str:
        """Its output on standard error."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def stop(self) -> None:
        """Stop it like Ctrl-C."""
        self.process.terminate()
        try:
            self.process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()


class Visitor:
    """A reader with their own browser: opens pages, and records faults.

    Attributes:
        page: the page of the browser.
        faults: errors in its console or scripts, dialogs, requests to others, refused requests.
        answers: status and address of each answer.
    """

    def __init__(
        self,
        browser: Browser,
        address: str,
        *,
        width: int = WIDE,
        height: int = 900,
        scheme: Scheme = "light",
        **options: Any,
    ) -> None:
        self.address = address
        self.faults: list[str] = []
        self.answers: list[tuple[int, str]] = []
        self._context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            reduced_motion="reduce",
            **options,
        )
        self._context.set_default_timeout(_MILLISECONDS)
        self.page = self._context.new_page()
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.faults.append(f"script: {error}"))
        self.page.on("dialog", self._asked)
        self.page.on("request", self._requested)
        self.page.on("response", self._answered)

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.faults.append(f"console: {message.text} {message.location}")

    def _asked(self, dialog: Dialog) -> None:
        self.faults.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    def _requested(self, request: Request) -> None:
        url = request.url
        if urlsplit(url).scheme not in ("data", "blob") and not self._is_own(url):
            self.faults.append(f"request: {url}")

    def _answered(self, response: Response) -> None:
        self.answers.append((response.status, response.url))

    def _is_own(self, url: str) -> bool:
        # Not by prefix: `http://127.0.0.1:80` is a prefix of another, `http://127.0.0.1:8001`.
        own, other = urlsplit(self.address), urlsplit(url)
        return (own.scheme, own.netloc) == (other.scheme, other.netloc)

    def open(self, path: str, status: int = 200) -> None:
        """Open a page of the server, and wait until it is drawn."""
        answer = self.page.goto(self.address + path)
        assert answer is None or answer.status == status, (answer.status, path)
        self.settle()
        if status >= 400:
            self.forgive(status)

    def forgive(self, status: int) -> None:
        """Forget answers with a status: the browser reports each of them."""
        said = f"the server responded with a status of {status}"
        self.faults = [fault for fault in self.faults if said not in fault]

    def settle(self) -> None:
        """Wait until no part of the page is still loading."""
        self.page.wait_for_load_state("load")
        self.page.wait_for_function("() => !document.querySelector('[aria-busy=true]')")

    def look(self, width: int, scheme: Scheme) -> None:
        """Set the width of the window and the preferred colour scheme."""
        self.page.set_viewport_size({"width": width, "height": 900})
        self.page.emulate_media(color_scheme=scheme)
        self.settle()

    def violations(self) -> list[str]:
        """List the rules of accessibility that the page violates, and where."""
        found = Axe().run(self.page).response["violations"]
        return [
            f"{each['id']}: {node['html'][:200]} ({node.get('failureSummary', '')[:300]})"
            for each in found
            for node in each["nodes"][:5]
        ]

    def overflow(self) -> list[str]:
        """List the elements wider than the window, which require sideways scrolling."""
        found: list[str] = self.page.evaluate(_OVERFLOW)
        return found

    def tab_through(self, most: int) -> tuple[int, int]:
        """Go through the page with the key Tab, from its beginning.

        Returns:
            The number of content elements where the key stopped, and where it should stop.
        """
        expected: int = self.page.evaluate(_STOPS)
        self.page.evaluate("() => { document.activeElement?.blur(); window.scrollTo(0, 0); }")
        for _ in range(most):
            self.page.keyboard.press("Tab")
            focused = self.page.evaluate(_FOCUSED)
            if focused is None:
                break
            assert focused["isSeen"], f"the focus is not seen: {focused['name']}"
            if focused["visited"] >= expected:
                break
        visited: int = self.page.evaluate(_VISITED)
        return visited, expected

    def text(self) -> str:
        """The text of the content, as a reader sees it."""
        return self.page.locator("main").inner_text()

    def close(self) -> None:
        """Close the window."""
        with suppress(BrowserError):
            self._context.close()
