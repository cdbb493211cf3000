"""Which flights made a result: its records beside the entries of its settings, by their order."""

from rotorfit.errors import ExperimentError
from rotorfit.experiment.experiment import (
    ConfigurationEntry,
    FlightEntry,
    experiment_of_settings,
)
from rotorfit.results.result import FlightRecord, IdentificationResult


def fitted_flights(
    result: IdentificationResult,
) -> list[tuple[ConfigurationEntry, FlightEntry, FlightRecord]]:
    """Return configuration, entry and record of each flight of the fit.

    The record has the file as the user wrote it; the entry has the path by which it is found.

    Parameters
    ----------
    result
        As `identify` made it.

    Raises
    ------
    ExperimentError
        If the result has other flights than its settings.
    """
    entries = [
        (configuration, entry)
        for configuration in experiment_of_settings(result.settings).configuration
        for entry in configuration.flights
    ]
    if len(entries) != len(result.flights):
        raise ExperimentError(
            f"the result was made from {len(result.flights)} flights, but its settings name "
            f"{len(entries)}: it was edited; identify again"
        )
    return [(*entry, record) for entry, record in zip(entries, result.flights, strict=True)]
