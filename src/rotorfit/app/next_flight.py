"""The flight to fly next: a plan after the last outcome, or before any flight."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from threadpoolctl import threadpool_limits

from rotorfit.app.files import Progress
from rotorfit.app.form import rows, table
from rotorfit.errors import ExperimentError
from rotorfit.experiment.declared_vehicle import vehicle_of
from rotorfit.experiment.experiment import airframe_of_tables
from rotorfit.logs.files import write_whole
from rotorfit.planning.after import check_same_vehicle, result_mass
from rotorfit.planning.plan import PlanRequest, plan
from rotorfit.planning.wanted import wanted_accuracy
from rotorfit.report.plan_card import card_html
from rotorfit.report.plan_text import plan_text
from rotorfit.results.sound_result import load_sound

SOURCE: Final = Path("experiment.toml")


def planned(
    folder: Path, form: Mapping[str, Any], accuracy: str, *, progress: Progress
) -> dict[str, Any]:
    """Return the flight to fly next, and keep the card for the pilot.

    Parameters
    ----------
    folder
        Of the page; where it holds a result, what that knows already counts.
    form
        With the airframe, and a mass where there is no result yet.
    accuracy
        As `rotorfit plan --accuracy` takes it.
    progress
        Told what is being done.

    Raises
    ------
    RotorfitError
        If the airframe or the mass is missing, or no plan can be made.
    """

    def tell(done: int, total: int) -> None:
        progress("flying the manoeuvres in simulation", done / total)

    request = _request(folder, form, accuracy)
    with threadpool_limits(limits=1, user_api="blas"):
        answer = plan(request, progress=tell)
    write_whole(folder / "card.html", card_html(answer), force=True)
    write_whole(folder / "plan.json", answer.to_json(), force=True)
    return {"text": plan_text(answer), "card": True, "plan": json.loads(answer.to_json())}


def _request(folder: Path, form: Mapping[str, Any], accuracy: str) -> PlanRequest:
    known = airframe_of_tables(form, source=SOURCE)
    vehicle, motors = vehicle_of(known.airframe), known.motors
    earlier = folder / "result.json"
    after = load_sound(earlier) if earlier.exists() else None
    if after is not None:
        check_same_vehicle(after, vehicle)
    return PlanRequest(
        name=str(form.get("name", "vehicle")),
        vehicle=vehicle,
        mass=_mass(form) if after is None else result_mass(after, None)[1],
        speed=motors.speed,
        timed=motors.delay is None and (motors.speed == "measured" or motors.lag is None),
        wanted=wanted_accuracy(accuracy),
        after=after,
    )


def _mass(form: Mapping[str, Any]) -> float:
    """Return the mass of the first configuration [kg]."""
    entry = next(iter(rows(form.get("configuration"))), None)
    mass = table(entry).get("mass")
    if not isinstance(mass, int | float):
        raise ExperimentError("a plan needs the mass of the vehicle as it flies: weigh it")
    return float(mass)
