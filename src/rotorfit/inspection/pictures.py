"""What a pilot looks at first in a log, as numbers to draw: curves, marks, spectra, filters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.inspection.recording import ChannelReport
from rotorfit.inspection.spectra import RotorBand, Spectrum, rotor_bands, spectrum
from rotorfit.inspection.time_picture import TimePicture, time_picture
from rotorfit.logs.firmware import Filter
from rotorfit.logs.flight_log import FlightLog
from rotorfit.logs.formats import BY_NAME, load
from rotorfit.preprocessing.prepare import PreparedFlight


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPictures:
    """What there is to draw of one log; it does not grow with the log's length.

    Attributes
    ----------
    time
        Over time; None where no channel can be drawn.
    spectra
        Of gyro and accelerometer, as far as they can be made.
    bands
        Where the rotors' harmonics are; none where rotor speed was not measured.
    filters
        On board, as the log's settings tell them.
    left_out
        What cannot be drawn, and why: one sentence each.
    """

    time: TimePicture | None
    spectra: tuple[Spectrum, ...]
    bands: tuple[RotorBand, ...]
    filters: tuple[Filter, ...]
    left_out: tuple[str, ...]


def log_pictures(
    log: FlightLog, prepared: PreparedFlight | None, reports: Mapping[str, ChannelReport]
) -> LogPictures:
    """Return what there is to draw of a log.

    Parameters
    ----------
    log
        As its reader gave it.
    prepared
        Its airborne part, where it was found.
    reports
        Of its channels, by name.
    """
    shares = {name: r.true_rate / r.rate for name, r in reports.items() if r.rate > 0}
    time, left_out = time_picture(
        log,
        zero=first_sample(log) if prepared is None else float(prepared.data.time[0]),
        cuts=() if prepared is None else prepared.cuts,
        new_share=shares,
    )
    spans = _flown(prepared)
    rotor_speed = log.channels.get("rotor_speed")
    spectra: list[Spectrum] = []
    for name in ("gyro", "accel"):
        if name not in log.channels:
            left_out.append(f"no spectrum of {name}: the log does not have it")
            continue
        try:
            spectra.append(
                spectrum(
                    name,
                    log.channels[name],
                    spans=spans,
                    rotor_speed=rotor_speed,
                    new_share=shares.get(name, 1.0),
                )
            )
        except FlightError as error:
            left_out.append(f"no spectrum of {name}: {error}")
    return LogPictures(
        time=time,
        spectra=tuple(spectra),
        bands=rotor_bands(rotor_speed, spans),
        filters=filters_of(log),
        left_out=tuple(left_out),
    )


def filters_of(log: FlightLog) -> tuple[Filter, ...]:
    """Find the filters on board by a log's settings; none where its format says nothing of them."""
    form = BY_NAME.get(log.format)
    return tuple(load(form.filters)(log)) if form is not None and form.filters else ()


def first_sample(log: FlightLog) -> float:
    """Return the time of the gyro's first sample, or of any channel's without one [s]."""
    firsts = {
        name: float(t[0])
        for name, t in ((n, c.time[np.isfinite(c.time)]) for n, c in log.channels.items())
        if len(t)
    }
    return firsts.get("gyro", min(firsts.values(), default=0.0))


def _flown(prepared: PreparedFlight | None) -> Sequence[tuple[float, float]]:
    """Return the airborne stretches on the log's clock."""
    if prepared is None:
        return ()
    t = prepared.data.time
    return [(float(t[s.start]), float(t[s.stop - 1])) for s in prepared.data.segments]
