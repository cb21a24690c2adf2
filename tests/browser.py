"""A headless Chromium, driven by Playwright: for tests of pages and for pictures of them.

Use a `Browser` as a context. It has one page, and holds what went wrong there and what the page asked for. Every wait is for
an event, and ends with an error after `HANG_SECONDS` alone: a busy machine makes a test slow, not wrong.
"""

import shutil
import time
from pathlib import Path

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
HANG_SECONDS = 300
CENTRE = """([selector, x, y]) => { const e = document.querySelector(selector); e.scrollIntoView({block: 'center'});
    const r = e.getBoundingClientRect(); return [r.x + x * r.width, r.y + y * r.height]; }"""
GIVE = """([selector, value]) => { const e = document.querySelector(selector);
    if (e.type === 'checkbox') e.checked = Boolean(value); else e.value = String(value);
    for (const name of ['input', 'change']) e.dispatchEvent(new Event(name, {bubbles: true})); }"""


class Browser:
    """A browser with one page. `problems`: its errors and warnings; `requests`: addresses it asked for, but data: ones."""

    def __enter__(self):
        from playwright.sync_api import sync_playwright

        self.problems, self.requests = [], []
        self._playwright = sync_playwright().start()
        try:
            self._program = self._playwright.chromium.launch(executable_path=PROGRAM, args=FLAGS, timeout=1000 * HANG_SECONDS)
            self._context = self._program.new_context(accept_downloads=False)
        except BaseException:
            self._playwright.stop()
            raise
        self._context.set_default_timeout(1000 * HANG_SECONDS)
        self.page = self._context.new_page()
        self._devtools = self._context.new_cdp_session(self.page)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", self._note)
        self.page.on("request", lambda request: self.requests.append(request.url))
        return self

    def __exit__(self, *_):
        try:
            self._program.close()
        finally:
            self._playwright.stop()

    def _note(self, message):
        if message.type in ("error", "warning", "assert"):
            self.problems.append(message.text)

    def open(self, address, width=1280, height=900, dark=False):
        """Loads an address, or a file with the network off, and waits for it."""
        self.window(width, height, dark)
        self._context.set_offline(isinstance(address, Path))
        self.page.goto(address.resolve().as_uri() if isinstance(address, Path) else address)

    def window(self, width, height, dark):
        """Gives the window a size and the theme that pages are asked for."""
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.emulate_media(color_scheme="dark" if dark else "light")

    def evaluate(self, script):
        """The value of a JavaScript expression; that of a promise is waited for."""
        return self.page.evaluate(script)

    def wait_for(self, script):
        """Waits until an expression is true, in this page or the one that it leads to."""
        # A function, for a page whose policy forbids `eval` refuses an expression.
        self.page.wait_for_function(f"() => {script}", polling=50)

    def until(self, holds):
        """Waits until `holds()` is true: what only a test can tell of a page."""
        end = time.monotonic() + HANG_SECONDS
        while not holds():
            assert time.monotonic() < end, "it never came to hold"
            self.page.wait_for_timeout(50)

    def press(self, *keys):
        """Keys by name, as `a`, `ArrowLeft` or `Shift+ArrowLeft`, on whatever has the focus."""
        for key in keys:
            self.page.keyboard.press(key)

    def click(self, selector):
        """A click in the middle of an element, once it can be clicked."""
        self.page.click(selector)

    def set(self, selector, value):
        """Gives a control a value, as somebody at the page would."""
        self.page.locator(selector).wait_for(state="attached")
        self.page.evaluate(GIVE, [selector, value])

    def spot(self, x, y, selector="#canvas"):
        """Where a place of an element, in shares of its size, is in the window."""
        return self.page.evaluate(CENTRE, [selector, x, y])

    def point(self, x, y):
        """Moves the pointer to a place in the window."""
        self.page.mouse.move(x, y)

    def drag(self, start, end, steps=8):
        """A drag with the left button, in pixels of the window, at the pace of a hand."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for step in range(1, steps + 1):
            self.page.mouse.move(*(a + (b - a) * step / steps for a, b in zip(start, end, strict=True)))
            self.page.wait_for_timeout(20)
        self.page.mouse.up()

    def touch(self, kind, points):
        """A touch event of the DevTools protocol, as `touchMove`, of fingers at these places: {id: (x, y)}."""
        touches = [{"x": x, "y": y, "id": finger} for finger, (x, y) in points.items()]
        self._devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    def picture(self, path, whole=False):
        """Writes a PNG of the window, or of the whole page."""
        self.page.screenshot(path=path, full_page=whole)
