"""Chromium: a page of the system's browser, drawn in software, for pictures of what people see."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

BROWSER = "/usr/bin/chromium"
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def chromium_page(address: str, size: tuple[int, int]) -> Iterator[Any]:
    """The page (of Playwright) at an address, in a window of `size` (width, height) [px]."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=list(FLAGS))
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        page.goto(address)
        yield page
        browser.close()
