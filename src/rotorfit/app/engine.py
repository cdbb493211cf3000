"""The engine of the page: calls by name on a folder, JSON in and out; see protocol.md.

It has no thread, process or server: the server runs each long call in a process, a web worker runs
it in the browser itself. Heavy imports happen inside the long calls.
"""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any, Final

from rotorfit import version
from rotorfit.app.files import (
    Progress,
    dropped,
    file_named,
    forget,
    json_with_shown_names,
    receive,
    save_description,
)
from rotorfit.app.form import described, form_of_file
from rotorfit.app.outcome import exported, missing_numbers
from rotorfit.errors import ExperimentError, MissingNumbersError, RotorfitError
from rotorfit.export.targets import OFFERED
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.logs.formats import FORMATS
from rotorfit.model.vehicle import LAYOUTS, layout_rotors
from rotorfit.report.parameters import VERDICT_MEANING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

JsonObject = dict[str, Any]
ACCEPTS: Final = (
    *(suffix for form in FORMATS for suffix in form.suffixes),
    *(".log", ".txt", ".toml", ".json", ".zip", ".gz"),
)
MOST_BYTES: Final = 2_000_000_000
"""Most bytes of all files of a page, where nobody says otherwise."""
DOCUMENTS: Final = {
    "report": "report.html",
    "result": "result.json",
    "experiment": "experiment.toml",
    "card": "card.html",
    "loop": "loop.html",
}
LONG: Final = ("add_file", "look", "identify", "plan", "export", "example")
"""Calls that take seconds or minutes, and read files from outside."""


@frozen_dataclass
class Engine:
    """The calls of a page, all of whose state is in its folder."""

    folder: Path
    most_bytes: int = MOST_BYTES

    def call(self, name: str, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Run a call of protocol.md; refuse with ``{"refused": one line, ...}``, never raise."""
        try:
            return _CALLS[name](self, argument, progress)
        except RotorfitError as error:
            return json_with_shown_names(self.folder, _describe_refusal(error))
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            problem = f"{name} was asked in a way that it does not understand ({error!r})"
            return {"refused": f"{problem}: reload the page"}

    def options(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """List layouts, targets and limits, which the page shows before anything is dropped."""
        del argument, progress
        return {
            "version": version.__version__,
            "layouts": [
                {
                    "layout": layout,
                    "order": order,
                    "rotors": [
                        {"position": list(r.position), "spin": r.spin}
                        for r in layout_rotors(layout, arm=1.0, order=order)
                    ],
                }
                for layout, order in LAYOUTS
            ],
            "targets": [
                {"target": name, "suffix": target.suffix, "title": target.title}
                for name, target in OFFERED.items()
            ],
            "meanings": VERDICT_MEANING,
            "most_bytes": self.most_bytes,
            "accepts": list(ACCEPTS),
        }

    def restore(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Collect all that was done on the page."""
        del argument, progress
        return {
            "files": [dict(one.description) for one in dropped(self.folder) if one.description],
            "form": _saved_json(self.folder / "form.json"),
            "outcome": _saved_json(self.folder / "outcome.json"),
            "running": False,
        }

    def receive(self, name: str) -> tuple[str, Path]:
        """Return the name of a new file on the page, and the path for its bytes."""
        one = receive(self.folder, name)
        return one.name, one.path

    def add_file(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Describe a file whose bytes have come."""
        return self.look({"name": argument["name"]}, progress)

    def look(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Describe a file, one log in it where it holds several, a table by given columns."""
        from rotorfit.app.findings import inspected

        one = file_named(self.folder, argument["name"])
        progress(f"reading {one.name}", None)
        description = inspected(
            one,
            log_number=argument.get("log"),
            replies=argument.get("columns"),
            form=_saved_json(self.folder / "form.json"),
        )
        save_description(one, description)
        return description

    def remove_file(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Forget a file."""
        del progress
        forget(file_named(self.folder, argument["name"]))
        return {}

    def describe(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Describe the form by its experiment file, or what is wrong with it; save both."""
        del progress
        form = argument["form"]
        write_whole(self.folder / "form.json", json.dumps(form), force=True)
        description = described(self.folder, form)
        if description["text"] is not None:
            write_whole(self.folder / DOCUMENTS["experiment"], description["text"], force=True)
        return description

    def identify(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Identify the flights of a form."""
        from rotorfit.app.outcome import identified

        form = argument["form"]
        write_whole(self.folder / "form.json", json.dumps(form), force=True)
        return identified(self.folder, form, progress=progress)

    def plan(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Plan the flight to fly next, for the form as it was described last."""
        from rotorfit.app.outcome import planned

        form = argument.get("form") or _saved_json(self.folder / "form.json")
        if form is None:
            raise ExperimentError("a plan needs the airframe: describe the vehicle first")
        return planned(self.folder, form, str(argument.get("accuracy", 5)), progress=progress)

    def export(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Export the result as the file of another tool."""
        progress("writing the file", None)
        return exported(self.folder, argument)

    def example(self, argument: Mapping[str, Any], progress: Progress) -> JsonObject:
        """Fly a vehicle in simulation, and add its logs and a form that describes them."""
        from rotorfit.simulation.experiment_files import experiment_files
        from rotorfit.simulation.experiments import plan_experiment

        del argument
        flown = plan_experiment("single", "real", seed=1, seconds=EXAMPLE_SECONDS)
        files = experiment_files(flown, progress=lambda words: progress(words, None))
        added: dict[str, JsonObject] = {}
        for name, text in files.items():
            if name.endswith((".csv", ".toml")):
                shown_name, path = self.receive(f"example-{name}")
                path.write_text(text, encoding="utf-8")
                added[name] = {"name": shown_name, "path": path}
        form = form_of_file(added["experiment.toml"]["path"])
        self.remove_file(added.pop("experiment.toml"), progress)
        for entry in form["configuration"]:
            for flight in (*entry["flights"], *entry["validation"]):
                flight["file"] = added[flight["file"]]["name"]
        return {"files": [self.look(one, progress) for one in added.values()], "form": form}

    def document(self, kind: str, name: str | None = None) -> Path | None:
        """Find the path of a document, ``findings`` being those on the file of a name."""
        if kind == "findings":
            path = file_named(self.folder, name or "").page
        else:
            path = self.folder / DOCUMENTS[kind] if kind in DOCUMENTS else None
        return path if path is not None and path.exists() else None

    def bytes_held(self) -> int:
        """Sum the sizes of the dropped files [bytes]."""
        paths = [one.path for one in dropped(self.folder)]
        return sum(path.stat().st_size for path in paths if path.exists())

    def clear(self) -> None:
        """Forget everything."""
        shutil.rmtree(self.folder, ignore_errors=True)


EXAMPLE_SECONDS: Final = 30.0
"""Length of each flight of the example, in the air [s]."""
_CALLS: Final[Mapping[str, Callable[[Engine, Mapping[str, Any], Progress], JsonObject]]] = {
    "options": Engine.options,
    "restore": Engine.restore,
    "add_file": Engine.add_file,
    "look": Engine.look,
    "remove_file": Engine.remove_file,
    "describe": Engine.describe,
    "identify": Engine.identify,
    "plan": Engine.plan,
    "export": Engine.export,
    "example": Engine.example,
}
CALLS: Final = tuple(_CALLS)


def _describe_refusal(error: RotorfitError) -> JsonObject:
    refusal: JsonObject = {"refused": " ".join(str(error).split())}
    if isinstance(error, ExperimentError) and error.problems:
        refusal["problems"] = [{"place": p, "words": text} for p, text in error.problems]
    if isinstance(error, MissingNumbersError):
        refusal["missing"] = missing_numbers(error)
    return refusal


def _saved_json(path: Path) -> Any:
    """Read the JSON of a file; None if there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
