"""Laboratory: what the window does: messages change files of a folder or run steps; its state is read from files."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.record import decode_one, read_json
from hagoromo.measurement.health.health import Health
from hagoromo_page.lab import messages
from hagoromo_page.lab.corrections import clear_mask, paint, reorder, swapped, write_profile
from hagoromo_page.lab.folder import MASK, ON_BALL, Folder
from hagoromo_page.lab.job import CommandRun
from hagoromo_page.lab.pictures import FOUND_MASK, Pictures
from hagoromo_page.lab.said import in_the_window
from hagoromo_page.lab.step import LabStep, Option
from hagoromo_page.lab.steps import HEALTH, STEPS, TABLE

LEAST_PHOTOGRAPHS = 4  # for a shape that nobody knows


class Exists(InputError):
    """Results are there already. names: of those that a run would replace."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(f"{', '.join(names)} would be replaced")
        self.names = names


class Laboratory:
    """What stands behind the window. root: nothing outside of it is shown; folder: the chosen one, below it."""

    def __init__(self, root: Path) -> None:
        self.root, self.relative = Folder(root).root, "."
        self.pictures, self.job = Pictures(), None
        self._lock = threading.RLock()

    job: CommandRun | None

    def folder(self) -> Folder:
        """The chosen folder, as it is now."""
        return Folder(self.root, self.relative)

    def do(self, data: Any) -> None:
        """Do what a message asks for; `InputError` for one that is none, or that cannot be done."""
        message = decode_one(data, messages.MESSAGES, "the message")
        with self._lock:
            if isinstance(message, messages.Cancel):
                if self.job is not None:
                    self.job.cancel()
                return
            if self._busy():
                raise InputError("a command runs: wait for it, or cancel it")
            self._heed(message)

    def _heed(self, message: Any) -> None:
        folder = self.folder()
        if isinstance(message, messages.Open):
            self.relative, self.job = Folder(self.root, message.folder).relative, None
        elif isinstance(message, messages.Choose):
            _choose(folder, message)
        elif isinstance(message, messages.Swap):
            reorder(folder, swapped(folder, message.names))
        elif isinstance(message, messages.Reverse):
            reorder(folder, folder.ordered[::-1])
        elif isinstance(message, messages.AsNamed):
            reorder(folder, folder.photographs)
        elif isinstance(message, messages.Circles):
            folder.keep(circles=message.circles)
        elif isinstance(message, messages.SetCorners):
            folder.keep(corners=message.corners)
        elif isinstance(message, messages.Stroke):
            paint(folder, message, self.pictures.shape(_with_photographs(folder)))
        elif isinstance(message, messages.ClearMask):
            clear_mask(folder)
        elif isinstance(message, messages.SetProfile):
            write_profile(folder, message.values)
        elif isinstance(message, messages.Run):
            self._start(_step(message.step), message.replace)

    def _start(self, step: LabStep, replace: bool) -> None:
        """Run a step and those before it; `Exists` where that replaces a result and nobody has agreed."""
        folder = _with_photographs(self.folder())
        lacking = step.lacks(folder)
        if lacking:
            raise InputError(f"{step.title}: fill in {', '.join(lacking)} first")
        steps = step.chain(folder)
        there = [one.makes for one in steps if (folder.home / one.makes).exists()]
        if there and not replace:
            raise Exists(there)
        self.job = CommandRun(self.folder, steps)
        self.job.start()

    def stop(self) -> None:
        """End what runs."""
        if self.job is not None and self._busy():
            self.job.cancel()

    def _busy(self) -> bool:
        return self.job is not None and self.job.status is None

    def progress(self) -> dict[str, Any] | None:
        """How far the last command is, and what a refusal says in the window's words; None where there was none."""
        job = self.job
        if job is None:
            return None
        step = job.steps[job.now]
        said = in_the_window(job.lines[-1] if job.lines and job.status else "", step, TABLE)
        return job.record() | {"refused": said.text, "circle": said.circle}

    def state(self) -> dict[str, Any]:
        """All that the page shows. What cannot be read is a line of `faults`."""
        folder = self.folder()
        faults: list[str] = []
        try:
            folder.record  # noqa: B018 - read once, and kept
        except (InputError, OSError) as error:
            faults.append(str(error))
        known: dict[str, Any] = {
            "root": str(self.root), "folder": folder.relative, "path": str(folder.home), "folders": folder.folders,
            "photographs": folder.photographs, "left_out": folder.left_out, "advice": [] if faults else _advice(folder),
            "job": self.progress(), "faults": faults,
        }  # fmt: skip
        if faults or not folder.photographs:
            return known

        def read(what: Callable[[], Any], instead: Any) -> Any:
            try:
                return what()
            except (InputError, OSError) as error:
                if str(error) not in faults:
                    faults.append(str(error))
                return instead

        return known | {
            "order": folder.ordered, "as_named": folder.ordered == folder.photographs,
            "lamps_in_file": folder.has_lamp_file, "ball_here": folder.lamps_from == ON_BALL,
            "ball_photographs": [] if folder.has_lamp_file else folder.ball_photographs,
            "lamps": read(lambda: _directions(folder), []), "circles": read(folder.circles, []),
            "by_hand": bool(folder.record.circles), "painted": (folder.home / MASK).exists(),
            "mask_found": (folder.home / FOUND_MASK).exists(),
            "size": read(lambda: self.pictures.shape(folder)[::-1], None),
            "ball_size": read(lambda: _ball_size(folder, self.pictures), None),
            "chart": folder.chart, "corners": folder.record.corners,
            "chart_size": read(lambda: self.pictures.shape(folder, folder.chart)[::-1], None) if folder.chart else None,
            "health": read(lambda: _health(folder), []), "layers": read(lambda: self.pictures.layers(folder), []),
            "maps_size": read(lambda: self.pictures.maps_size(folder), None),
            "profile": read(lambda: folder.profile, {}),
            "steps": [_shown(step, folder) for step in TABLE if step.applies(folder) or step.options],
        }  # fmt: skip


def _shown(step: LabStep, folder: Folder) -> dict[str, Any]:
    """A step as the page shows it."""
    chain = [one.name for one in step.chain(folder)]
    return {
        "name": step.name, "title": step.title, "does": step.does, "makes": step.makes, "state": step.state(folder),
        "command": step.shown(folder) if step.applies(folder) else "", "chain": chain,
        "opens": [f"{step.makes}/{name}".rstrip("/") for name in step.opens],
        "options": [_option(one, step, folder) for one in step.options],
    }  # fmt: skip


def _option(option: Option, step: LabStep, folder: Folder) -> dict[str, Any]:
    return {
        "name": option.name, "label": option.label, "hint": option.hint, "aside": option.aside, "many": option.many,
        "value": option.value(step.name, folder), "choices": option.choices and option.choices(folder),
    }  # fmt: skip


def _step(name: str) -> LabStep:
    if name not in STEPS:
        raise InputError(f"there is no step {name!r}: reload the page")
    return STEPS[name]


def _choose(folder: Folder, message: messages.Choose) -> None:
    """Keep the value of an option; `InputError` for one that is not offered."""
    step = _step(message.step)
    option = next((one for one in step.options if one.name == message.option), None)
    if option is None:
        raise InputError(f"the step {message.step!r} has no option {message.option!r}: reload the page")
    parts: Iterable[str] = message.value.split() if option.many else [message.value]
    known = None if option.choices is None else option.choices(folder)
    if known is not None and not set(parts) <= set(known):
        raise InputError(f"{option.label}: {message.value!r} is not offered: choose one of {', '.join(known)}")
    if option.choices is None and message.value.startswith("-"):
        raise InputError(f"{option.label}: {message.value!r} begins with -, which commands take for an option")
    changes: dict[str, Any] = {"options": {**folder.record.options, f"{step.name}.{option.name}": message.value}}
    anew: dict[tuple[str, str], dict[str, Any]] = {
        ("lamps", "from"): {"order": []},
        ("response", "chart"): {"corners": []},
    }
    folder.keep(**changes, **anew.get((step.name, option.name), {}))


def _with_photographs(folder: Folder) -> Folder:
    if not folder.photographs:
        raise InputError(_advice(folder)[0])
    return folder


def _advice(folder: Folder) -> list[str]:
    """What a person should know before the first command, a line each."""
    count, here = len(folder.photographs), folder.home.name
    if not count:
        empty = "is empty" if not folder.files and not folder.folders else "has no photographs"
        return [f"{here} {empty}: choose a folder with RAW, TIFF, JPEG or PNG files, one lamp on in each"]
    said = []
    if count < LEAST_PHOTOGRAPHS:
        few = "one photograph" if count == 1 else f"{count} photographs"
        said.append(
            f"{here} has {few}: a shape needs {LEAST_PHOTOGRAPHS} or more, taken from one place, one lamp on in each"
        )
    if folder.left_out:
        names = ", ".join(folder.left_out[:3]) + (" …" if len(folder.left_out) > 3 else "")
        said.append(f"not taken for photographs, as they are of another format: {names}")
    if folder.lamps_from == ON_BALL and not (folder.home / STEPS["lamps"].makes).exists():
        said.append(
            "there is no .lp and no lamps.json here or in the folder above: lamps are read off a chrome ball in the "
            "photographs. If there is none in them, put the dome's .lp here"
        )
    return said


def _directions(folder: Folder) -> list[list[float]]:
    """Directions to the lamps; none as long as nobody has looked for a ball."""
    if not folder.has_lamp_file and not (folder.home / STEPS["lamps"].makes).exists():
        return []
    return [list(one) for one in folder.directions()]


def _ball_size(folder: Folder, pictures: Pictures) -> tuple[int, int] | None:
    """(width, height) of the photographs of a ball, where they are others; None where they are these."""
    others = [] if folder.lamps_from == ON_BALL or folder.has_lamp_file else folder.ball_photographs
    height, width = pictures.shape(folder, others[0]) if others else (0, 0)
    return (width, height) if others else None


def _health(folder: Folder) -> list[dict[str, Any]]:
    path = folder.home / HEALTH
    if not path.is_file():
        return []
    checks = Health.from_record(read_json(path), str(path)).record()["checks"]
    return [one | {"advice": in_the_window(one["advice"], STEPS["health"], TABLE).text} for one in checks]
