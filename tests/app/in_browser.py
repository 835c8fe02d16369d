"""A page in Chromium, with everything that it complained about or asked for."""

import base64
import json
import os

import numpy as np
import pytest

CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def started():
    """Playwright's context and Chromium; skips where one is absent."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if not os.path.exists(CHROMIUM):
        pytest.skip(f"{CHROMIUM} is not there")
    return playwright.sync_playwright()


class Opened:
    """A page of a published object."""

    def __init__(self, browser, path, width=1100, height=800, touch=False):
        self.page = browser.new_page(viewport={"width": width, "height": height}, has_touch=touch)
        self.said, self.asked = [], []
        self.page.on("console", lambda one: self.said.append(one.text))
        self.page.on("pageerror", lambda one: self.said.append(str(one)))
        self.page.on("dialog", lambda one: self.said.append(f"dialog {one.message}"))
        self.page.on("request", lambda one: self.asked.append(one.url))
        self.page.goto(path.resolve().as_uri())
        self.page.evaluate("() => hagoromo.ready")

    def pixels(self):
        """(h, w, 4) uint8 of the lit picture."""
        read = self.page.evaluate(
            "() => { const p = hagoromo.pixels(); let s = ''; for (const v of p.data) s += String.fromCharCode(v);"
            "return [p.width, p.height, btoa(s)]; }"
        )
        return np.frombuffer(base64.b64decode(read[2]), np.uint8).reshape(read[1], read[0], 4)

    def lamp(self):
        return self.page.evaluate("() => hagoromo.light()[0]")

    def state(self, *names):
        """Values of the viewer's state."""
        return [self.page.evaluate(f"() => hagoromo.state.{name}") for name in names]

    def point_lamp(self, to_lamp):
        """Turn the first lamp to a unit direction, page's axes."""
        angle, across = np.arccos(np.clip(to_lamp[2], -1, 1)) / (np.pi / 2), max(np.hypot(*to_lamp[:2]), 1e-12)
        x, y = (float(angle * one / across) for one in to_lamp[:2])
        self.page.evaluate(
            f"() => {{ const one = hagoromo.state.lamps[0]; one.x = {x}; one.y = {y}; one.capture = -1;"
            "hagoromo.redraw(); }"
        )

    def data(self):
        return json.loads(self.page.evaluate("() => document.getElementById('hv-data').textContent"))
