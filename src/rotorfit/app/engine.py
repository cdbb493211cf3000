"""The engine of the page: calls by name on a folder, JSON in and out; see protocol.md.

No thread, no process, no server: what runs it decides where it runs, the server in a process for
each long call, a web worker in the browser itself. What only long calls need is imported by them.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rotorfit import version
from rotorfit.app.files import Progress, dropped, file_named, forget, in_their_names, receive, tell
from rotorfit.app.form import described, form_of_file
from rotorfit.errors import (
    ExperimentError,
    MissingNumbersError,
    RotorfitError,
)
from rotorfit.export.targets import OFFERED
from rotorfit.logs.files import write_whole
from rotorfit.logs.formats import FORMATS
from rotorfit.model.layouts import LAYOUTS, layout_rotors
from rotorfit.report.number_words import VERDICT_MEANING

Reply = dict[str, Any]
ACCEPTS: Final = (
    *(suffix for form in FORMATS for suffix in form.suffixes),
    *(".log", ".txt", ".toml", ".json"),
)
MOST_BYTES: Final = 2_000_000_000
"""Of all files of a page, where nobody says otherwise."""
DOCUMENTS: Final = {
    "report": "report.html",
    "result": "result.json",
    "experiment": "experiment.toml",
    "card": "card.html",
}
LONG: Final = ("add_file", "look", "identify", "plan", "export", "example")
"""Calls that take seconds or minutes, and look into files from outside."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Engine:
    """What a page can ask.

    Attributes
    ----------
    folder
        Where all that the page has done is kept.
    most_bytes
        That its files may hold together.
    """

    folder: Path
    most_bytes: int = MOST_BYTES

    def call(self, name: str, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return what a call answers, or ``{"refused": one line, ...}``; never raises on input.

        Parameters
        ----------
        name, argument
            As protocol.md has them; anything may come from outside.
        progress
            Told what is being done, by the long calls.
        """
        try:
            return _CALLS[name](self, argument, progress)
        except RotorfitError as error:
            return in_their_names(self.folder, _refusal(error))
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            words = f"{name} was asked in a way that it does not understand ({error!r})"
            return {"refused": f"{words}: reload the page"}

    def options(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return layouts, targets, limits: what the page shows before anything is dropped."""
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

    def restore(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return all that was done on the page."""
        del argument, progress
        return {
            "files": [dict(one.told) for one in dropped(self.folder) if one.told],
            "form": _kept(self.folder / "form.json"),
            "outcome": _kept(self.folder / "outcome.json"),
            "running": False,
        }

    def receive(self, name: str) -> tuple[str, Path]:
        """Return the name that a new file has here, and where its bytes are to be written.

        Raises
        ------
        OutputError
            If there are too many files.
        """
        one = receive(self.folder, name)
        return one.name, one.path

    def add_file(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return what is to be said of a file whose bytes have come."""
        return self.look({"name": argument["name"]}, progress)

    def look(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return what is to be said of a file, of one log in it where it holds several."""
        from rotorfit.app.findings import looked_at

        one = file_named(self.folder, argument["name"])
        progress(f"reading {one.name}", None)
        told = looked_at(one, log_number=argument.get("log"))
        tell(one, told)
        return told

    def remove_file(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Forget a file."""
        del progress
        forget(file_named(self.folder, argument["name"]))
        return {}

    def describe(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return the experiment file of the form, or what is wrong with it; keep the form."""
        del progress
        form = argument["form"]
        write_whole(self.folder / "form.json", json.dumps(form), force=True)
        answer = described(self.folder, form)
        if answer["text"] is not None:
            write_whole(self.folder / DOCUMENTS["experiment"], answer["text"], force=True)
        return answer

    def identify(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return the outcome of an identification."""
        from rotorfit.app.outcome import identified

        form = argument["form"]
        write_whole(self.folder / "form.json", json.dumps(form), force=True)
        return identified(self.folder, form, progress=progress)

    def plan(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return the flight to fly next, for the form as it was described last."""
        from rotorfit.app.next_flight import planned

        form = argument.get("form") or _kept(self.folder / "form.json")
        if form is None:
            raise ExperimentError("a plan needs the airframe: describe the vehicle first")
        return planned(self.folder, form, str(argument.get("accuracy", 5)), progress=progress)

    def export(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Return the result as the file of another tool."""
        from rotorfit.app.exports import exported

        progress("writing the file", None)
        return exported(self.folder, argument)

    def example(self, argument: Mapping[str, Any], progress: Progress) -> Reply:
        """Fly a vehicle in simulation, and return its logs and a form that describes them."""
        from rotorfit.simulation.experiment_files import experiment_files
        from rotorfit.simulation.experiments import plan_experiment

        del argument
        flown = plan_experiment("single", "real", seed=1, seconds=EXAMPLE_SECONDS)
        files = experiment_files(flown, progress=lambda words: progress(words, None))
        told: dict[str, Reply] = {}
        for name, text in files.items():
            if name.endswith((".csv", ".toml")):
                own, path = self.receive(f"example-{name}")
                path.write_text(text, encoding="utf-8")
                told[name] = {"name": own, "path": path}
        form = form_of_file(told["experiment.toml"]["path"])
        self.remove_file(told.pop("experiment.toml"), progress)
        for entry in form["configuration"]:
            for flight in (*entry["flights"], *entry["validation"]):
                flight["file"] = told[flight["file"]]["name"]
        return {"files": [self.look(one, progress) for one in told.values()], "form": form}

    def document(self, kind: str, name: str | None = None) -> Path | None:
        """Return where a document is, ``findings`` being those on the file of a name."""
        if kind == "findings":
            path = file_named(self.folder, name or "").page
        else:
            path = self.folder / DOCUMENTS[kind] if kind in DOCUMENTS else None
        return path if path is not None and path.exists() else None

    def bytes_held(self) -> int:
        """Return how large the dropped files are together."""
        paths = [one.path for one in dropped(self.folder)]
        return sum(path.stat().st_size for path in paths if path.exists())

    def clear(self) -> None:
        """Forget everything."""
        shutil.rmtree(self.folder, ignore_errors=True)


EXAMPLE_SECONDS: Final = 30.0
"""Of each flight of the example, in the air [s]."""
_CALLS: Final[Mapping[str, Callable[[Engine, Mapping[str, Any], Progress], Reply]]] = {
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


def _refusal(error: RotorfitError) -> Reply:
    answer: Reply = {"refused": " ".join(str(error).split())}
    if isinstance(error, ExperimentError) and error.problems:
        answer["problems"] = [{"place": p, "words": words} for p, words in error.problems]
    if isinstance(error, MissingNumbersError):
        from rotorfit.app.exports import missing_numbers

        answer["missing"] = missing_numbers(error)
    return answer


def _kept(path: Path) -> Any:
    """Return the JSON of a file; None where there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
