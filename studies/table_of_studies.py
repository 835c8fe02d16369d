"""The studies by name: what each shows, what it runs, and which of its results the documents take.

`python -m studies` lists them, `python -m studies NAME` runs one. A study is declared once, here: the list and
the command read it.
"""

from __future__ import annotations

from dataclasses import dataclass

DATA = "../shared/data"  # real data beside the checkout: `make data`
RECIPES = "examples/recipes"
WIDE_SCENES = ("--first", "1000", "--scenes", "14", "--pixels", "64", "--seconds", "12", "--mode", "full")
CLOSELY = ("maps.jpg", "profile.png", "raking.jpg", "page.jpg")  # pictures of studies.closely
SIX_OBJECTS = "gray buddha cat horse owl rock".split()


@dataclass(frozen=True)
class Study:
    """A study: its purpose, its commands, and what is copied into the documents.

    runs: arguments of `python`, one tuple a command, in order. copies: pairs of a pattern of results and the folder of
    the documents that they go to. takes: how long, on two cores. needs_demo: the folder of the demo is made before it.
    """

    shows: str
    takes: str
    runs: tuple[tuple[str, ...], ...]
    copies: tuple[tuple[str, str], ...] = ()
    needs_demo: bool = False


def _page(name: str, *pictures: str, at: str = "") -> tuple[tuple[str, str], ...]:
    """A page and its pictures, from the folder `at` (default: out/NAME) to docs."""
    home = at or f"out/{name}"
    return ((f"{home}/{name}.md", "docs"), *((f"{home}/{picture}", "docs/figures") for picture in pictures))


def _module(name: str, *arguments: str) -> tuple[str, ...]:
    return ("-m", f"studies.{name}", *arguments)


STUDIES: dict[str, Study] = {
    "real": Study(
        "every real photograph of six objects, predicted from the eleven others",
        "minutes",
        (_module("real", f"{DATA}/uw_psm", "--out", "out/real", "--force"),),
    ),
    "relit": Study(
        "the same objects as volume boxes under lamps kept aside, and what limits them: docs/relighting.md",
        "an hour",
        (
            _module("relit_objects", f"{DATA}/uw_psm", "--out", "out/relit", "--force"),
            _module(
                *("relit_objects", f"{DATA}/uw_psm", "--out", "out/relit_rig"),
                *("--objects", *SIX_OBJECTS, "--rig", "--force"),
            ),
            _module(
                *("relit_objects", f"{DATA}/uw_psm", "--out", "out/relit_rig_quarter"),
                *("--objects", *SIX_OBJECTS, "--rig", "--shrink", "4", "--force"),
            ),
            _module("relit_limits", f"{DATA}/uw_psm", "--shrink", "4", "--out", "out/relit_limits", "--force"),
        ),
    ),
    "random-captures": Study(
        "photographs of things that nobody chose: how far predictions are off, and which mistakes are named",
        "20 minutes",
        (_module("random_captures", "--out", "out/random_captures", "--force"),),
    ),
    "highlights": Study(
        "where unseen lamps are missed on glossy objects, and what each step gives: docs/relighting.md",
        "10 minutes",
        (_module("highlights", "--out", "out/highlights", "--force"),),
    ),
    "recover": Study(
        "objects recovered from simulated and real photographs of many views, against views and lamps kept aside",
        "two hours",
        (_module("recovery", "--data", DATA, "--out", "out/recovery"),),
    ),
    "recover-strangers": Study(
        "objects recovered from captures that nobody tuned to: masks, units, lamps, files, and what is said of them",
        "half an hour",
        (_module("recover_strangers", "--out", "out/recover_strangers"),),
    ),
    "recover-random": Study(
        "objects recovered from captures that nobody chose: pictures, forms and intervals, and what is said of them",
        "half an hour",
        (_module("recover_random", "--out", "out/recover_random"),),
    ),
    "recover-materials": Study(
        "how often the intervals that recoveries state of β, γ and n hold the truth, over twelve captures",
        "a quarter of an hour",
        (_module("recovery_materials", "--out", "out/recovery_materials"),),
    ),
    "real-object": Study(
        "a real object under a new lamp, as films and as a page",
        "ten minutes",
        (_module("real_object", "--data", DATA, "--out", "out/real_object"),),
    ),
    "recover-workers": Study(
        "recoveries by workers beside one in this process: bits, processor seconds, what is sent",
        "ten minutes",
        (
            _module("recovery_workers", "--out", "out/recovery_workers.json"),
            _module(
                *("recovery_workers", "--side", "128", "--steps", "30", "--workers", "0", "2"),
                *("--out", "out/recovery_workers_128.json"),
            ),
        ),
    ),
    "tutorial-views": Study(
        "the tutorial of many views as it stands on its page, and its picture",
        "ten minutes",
        (_module("tutorial_views", "--out", "out/tutorial_views"),),
        (("out/tutorial_views/tutorial_views.jpg", "docs/figures"),),
    ),
    "lamps": Study(
        "how far readings of the same real lamps agree: of a mirror ball, of a grey ball, of the objects themselves",
        "minutes",
        (_module("lamps", f"{DATA}/uw_psm", "--out", "out/lamps.json", "--force"),),
    ),
    "calibration": Study(
        "boards in blurred photographs, and lamps on mirror balls with streaks of glare, simulated",
        "a minute",
        (_module("calibration", "--out", "out/calibration.json", "--force"),),
    ),
    "balls": Study(
        "lamps read off balls that are scratched, dusty, glossy, or beside their mask, simulated and real",
        "minutes",
        (_module("ball_photographs", "--out", "out/balls.json", "--real", f"{DATA}/uw_psm", "--force"),),
    ),
    "near": Study(
        "normals and depth under near lamps in perspective, simulated, highlights from narrow to wide",
        "minutes",
        (_module("near_lamps", "--out", "out/near_lamps.json", "--leds", f"{DATA}/near_ps_leds", "--force"),),
    ),
    "spectra": Study(
        "spectra from camera colours, over 28 cameras",
        "minutes",
        (_module("spectra", DATA, "--out", "out/spectra", "--force"),),
    ),
    "response": Study(
        "cameras' responses from readings without faults and with: docs/response.md",
        "minutes",
        (_module("response_study", DATA, "--out", "out/response", "--force"),),
        _page("response", "response.png"),
    ),
    "coverage": Study(
        "how often the intervals of materials hold the truth, over 1800 simulations: docs/coverage.md",
        "minutes",
        (_module("coverage", "--out", "out/coverage", "--force"),),
        _page("coverage", "coverage.png"),
    ),
    "errors-of-normals": Study(
        "how often the errors of normals hold the truth, on simulated and real balls: docs/errors_of_normals.md",
        "a quarter of an hour",
        (_module("errors_of_normals", "--out", "out/errors_of_normals", "--real", f"{DATA}/uw_psm", "--force"),),
        _page("errors_of_normals"),
    ),
    "forecasts": Study(
        "errors of photographs under lamps left out, beside those that were expected",
        "a quarter of an hour",
        (_module("forecasts", f"{DATA}/uw_psm", "--out", "out/forecasts.json", "--force"),),
    ),
    "first-order": Study(
        "the march against an independent program of its equations in float64: docs/first_order.md",
        "a minute",
        (_module("first_order", "--out", "out/first_order", "--force"),),
        _page("first_order", "*.png"),
    ),
    "noise": Study(
        "how often pictures of mode path keep the error that they are asked for, and what it costs: docs/noise.md",
        "an hour",
        (_module("walk_noise", RECIPES, "--out", "out/noise", "--force"),),
        _page("noise"),
    ),
    "blender": Study(
        "a ball that is dressed with skin in Blender, by both programs: docs/howto/blender.md (after `make cycles`)",
        "minutes",
        (_module("blender", "--out", "out/blender", "--force"),),
        (("out/blender/blender.jpg", "docs/figures"),),
    ),
    "orders": Study(
        "recipes by modes march, full and path, side by side: docs/orders.md",
        "minutes",
        (_module("orders", RECIPES, "--out", "out/orders", "--force"),),
        _page("orders", "orders.png", "orders_colour.png"),
    ),
    "modes": Study(
        "the gallery and figures 6 to 8 by all three modes: docs/modes.md; out/modes stays, and rows of others",
        "an hour",
        (_module("modes", "out/demo", RECIPES, "--out", "out/modes"),),
        (
            ("out/modes/modes.md", "docs"),
            ("out/modes/modes/*.jpg", "docs/figures/modes"),
            ("out/modes/modes_rows.json", "studies"),
        ),
        needs_demo=True,
    ),
    "stills": Study(
        "backlit linen, hair and the angel in 1080 px by each mode, with time, memory and command: docs/stills.md",
        "an hour",
        (_module("stills", RECIPES, "--out", "out/stills"),),
        (("out/stills/stills.md", "docs"), ("out/stills/stills/*.jpg", "docs/figures/stills")),
        needs_demo=True,
    ),
    "full-error": Study(
        "what mode full is off, what it says of that, and its mend by walks: docs/full_error.md",
        "an hour",
        (
            _module("full_error", RECIPES, "--out", "out/full_error"),
            _module("few_walks", RECIPES, "--out", "out/full_error"),
            _module("random_scenes", *WIDE_SCENES, "--out", "out/full_error"),
        ),
        _page("full_error"),
    ),
    "random-scenes": Study(
        "scenes that nobody chose by march and full, beside path and what full states: docs/random_scenes.md",
        "half an hour",
        (_module("random_scenes", "--out", "out/random_scenes"),),
        _page("random_scenes"),
    ),
    "cluster": Study(
        "workers on this machine, one of them killed, and a simulation of many: docs/cluster.md",
        "minutes",
        (_module("cluster", "--out", "out/cluster", "--demo", "out/demo", "--force"),),
        (*_page("cluster", "cluster.png"), ("out/cluster/cluster_orders.json", "studies")),
        needs_demo=True,
    ),
    "merl": Study(
        "80 measured materials, fitted with our model and with GGX and Lambert: docs/merl.md; goes on where it stopped",
        "an hour",
        (_module("merl", f"{DATA}/merl_fits", "--out", "out/merl", "--force"),),
        _page("merl", "merl.png"),
    ),
    "tables": Study(
        "measured materials as files of MERL and RGL, fitted, beside published fits: docs/tables.md",
        "ten minutes",
        (_module("tables", f"{DATA}/merl_fits", "--out", "out/tables", "--force"),),
        _page("tables"),
    ),
    "gallery": Study(
        "every recipe close up, whole and under a moving lamp, and what it costs: docs/gallery.md",
        "a quarter of an hour",
        (_module("gallery.gallery", RECIPES, "--out", "docs"),),
    ),
    "viewer": Study(
        "the pictures of docs/howto/view.md, of the viewer in Chromium",
        "a minute",
        (_module("viewer", "--out", "out/viewer", "--force"),),
        tuple(
            (f"out/viewer/{name}.jpg", f"docs/figures/view_{name}.jpg")
            for name in ("scene", "image", "photograph", "measurement")
        ),
    ),
    "laboratory": Study(
        "the picture of docs/howto/lab.md, of the window in Chromium",
        "a minute",
        (_module("laboratory", "--out", "out/laboratory", "--force"),),
        (("out/laboratory/lab.jpg", "docs/figures/lab.jpg"),),
    ),
    "turning": Study(
        "figure 8 as a film, and its first picture: docs/howto/film.md",
        "an hour",
        (("-m", "hagoromo_matter.demo.turning", "out/demo", "out/turning", "docs"),),
        needs_demo=True,
    ),
    "published": Study(
        "the page of docs/howto/publish.md, made and opened in Chromium",
        "minutes",
        (_module("published", "--out", "out/published", "--force"),),
        (("out/published/published.jpg", "docs/figures"),),
    ),
    "closely": Study(
        "the pictures of docs/howto/closely.md: maps, profile, raking light and page of a cracked tile",
        "minutes",
        (_module("closely", "--out", "out/closely", "--force"),),
        tuple((f"out/closely/{one}", f"docs/figures/closely_{one}") for one in CLOSELY),
    ),
    "tutorials": Study(
        "the pictures of the tutorials, by the commands of their pages",
        "minutes",
        (_module("tutorial_pictures", "--out", "out/tutorials", "--force"),),
        (("out/tutorials/tutorial_dome.jpg", "docs/figures"), ("out/tutorials/tutorial_skin.png", "docs/figures")),
    ),
}
