"""Names that files bring are shown as text: no page runs them, no terminal obeys them, no plot fails on them."""

import html
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import escaped, one_line
from hagoromo.files.names import plot_label, printable
from hagoromo.files.plot import curves_png
from hagoromo.files.png import write_png
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_page.report.page import page_drawing, page_picture, page_text, page_viewer

EVIL = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(1)>\n{{ 7 * 7 }}&amp;"
CODES = "\x1b[2J\x1b]0;title\x07 \x9b31m \u202egpj.exe\r\b\x7f"


class Elements(HTMLParser):
    """Elements of a page and the attributes that run a script."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.handlers: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]


def of_names(name: str) -> list[str]:
    """Pages, and the views of a notebook, in which a name stands at every place that takes one."""
    picture = np.zeros((4, 4, 3), np.uint8)
    shown = {"name": name, "pictures": [page_picture(picture, name, name), page_drawing("<svg></svg>", name)]}
    measured = page_text(
        "measure.html.j2", name=name, head=[name], rows=[[name]], parameters=1, remarks=[name], unconverged=[name],
        separation=shown, gloss=None, findings=[{"name": name, "sentences": [name]}], missing=[name],
        assumptions=[name], bent=True, maps=shown["pictures"], spectra=shown["pictures"], sheet=[shown],
        **page_viewer(None),
    )  # fmt: skip
    matter = Reflectance(0.2, 0.5, 0.2, 1.5, Spectrum.constant(0.8), name=name)
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (5, 5, 5, 3))
    box = VolumeBox.from_arrays(np.ones((5, 5, 5), np.float32), axis, 0.01, 100.0, [matter], name=name)
    return [measured, box._repr_html_()]


def test_a_page_shows_a_name_as_text():
    plain, evil = (map(Elements, of_names(name)) for name in ("a name", EVIL))
    for one, other in zip(plain, evil, strict=True):
        assert one.tags == other.tags and "script" not in other.tags and not other.handlers
    assert html.escape("<img src=x") in of_names(EVIL)[0]


def test_codes_for_a_terminal_are_escaped():
    assert printable("α  ΔE₀₀\n→ 1\u202f000 Å 雪") == "α ΔE₀₀ → 1 000 Å 雪"
    assert escaped("  a\u2009 b") == one_line("  a\u2009 b") == "  a\u2009 b"
    for shown in (printable(CODES), escaped(CODES), one_line(CODES)):
        assert shown.isprintable() and "\\x1b[2J" in shown and "\\u202e" in shown and "\\x9b" in shown


@pytest.mark.parametrize("name", ["$\\frac$", "$_{", "_hidden", CODES, "a$b"])
def test_a_plot_takes_any_name(name):
    assert curves_png(np.array([400.0, 700.0]), {name: np.array([0.0, 1.0])}, "value").startswith(b"\x89PNG")
    assert not plot_label(name).startswith("_")


def test_commands_print_no_codes_of_names(tmp_path, capsys, scene):
    evil = tmp_path / f"a{CODES}.png".replace("/", "")
    write_png(evil, np.zeros((3, 3), np.uint8))
    shutil.copy(evil, tmp_path / f"b{CODES}.toml")
    named = scene('name = "key"', 'name = "\\u001b[2J"')
    for path in (evil, tmp_path / f"b{CODES}.toml", tmp_path / f"absent{CODES}", named):
        main(["info", str(path)])
        said = "".join(capsys.readouterr())
        assert said and all(line.isprintable() for line in said.splitlines())
