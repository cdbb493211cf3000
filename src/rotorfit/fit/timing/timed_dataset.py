"""The flights of an experiment at a timing of their motors, with their band factors."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.factors import Factors, stack_recordings
from rotorfit.fit.dataset.dataset import Dataset, with_prepared
from rotorfit.fit.reduction.frequency_bands import banded_data, flight_bands, prepared_lines
from rotorfit.fit.reduction.line_moves import lines_at
from rotorfit.fit.reduction.motor_timing import FreeTiming, MotorTiming, TimedBands
from rotorfit.fit.reduction.reduce import BandLines, body_lines, factors_of_lines, yaw_factors
from rotorfit.flight.imu_tilt import ImuTilt, levelled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rotorfit.fit.reduction.reduce import Lines
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.signals import SignalLayout


@dataclass(frozen=True, kw_only=True)
class TimedDataset(Dataset):
    """A dataset with the timing of its motors, and its reduced flights.

    - `motor_timing`: where it was found.
    - `law_found`: whether the law from command to speed was found in these flights, with changes of
      thrust.
    - `lag_gain`: of the log-likelihood, by which these flights have shown that the lag acts on the
      motors' thrust and not their speed; zero where they have not.
    - `body`: lines of the signals that the rotors have no part in, of each flight of each
      configuration: made once (`reduced`), they serve every timing of the motors.
    """

    motor_timing: MotorTiming | None = None
    law_found: bool = False
    lag_gain: float = 0.0
    body: tuple[tuple[tuple[Lines, ...], ...], ...] | None = None

    @classmethod
    def of(cls, dataset: Dataset) -> TimedDataset:
        """Reduce a dataset whose motors are not timed yet."""
        kept = {one.name: getattr(dataset, one.name) for one in dataclasses.fields(Dataset)}
        return cls(**kept).reduced()

    @property
    def timing(self) -> MotorResponse | None:
        """Lag and delay that were found; None leaves the flights as they were prepared."""
        return None if self.motor_timing is None else self.motor_timing.response

    @property
    def timing_identifiable(self) -> bool:
        """Whether lag and delay are given, or identifiable from the flights."""
        return self.motor_timing is None or self.motor_timing.identifiable

    @property
    def reached(self) -> Mapping[str, float] | None:
        """Where the fit that found the timing ended; None if none did."""
        return None if self.motor_timing is None else self.motor_timing.reached

    @property
    def free_timing(self) -> FreeTiming | None:
        """The timing that a joint fit may move; None if it is given, or unidentifiable."""
        found = self.motor_timing
        if found is None or not found.free:
            return None
        bands = self._timed_already
        at = found.response if bands is None else bands.at
        return FreeTiming(at=at, names=found.free, lag_prior=self.lag_prior)

    @property
    def _timed_already(self) -> TimedBands | None:
        """The bands that the timing was found with, where they are of these flights."""
        bands = None if self.motor_timing is None else self.motor_timing.bands
        return bands if bands is not None and bands.matches(self._made_of) else None

    @property
    def _made_of(self) -> tuple[object, ...]:
        return self.vehicle, self.configurations, self.model.layout

    def at(self, response: MotorResponse, free: tuple[str, ...] = ()) -> TimedDataset:
        """Set the timing of the motors, and which of its times a fit may move."""
        timing = MotorTiming(response=response, total_std=0.0, free=free)
        return dataclasses.replace(self, motor_timing=timing)

    def keeping_bands(self, other: TimedDataset) -> TimedDataset:
        """Keep the reduced bands of a dataset with the same signals, of which more is known now."""
        timing = self.motor_timing
        if timing is None or not timing.free or not other._is_reduced:
            return self
        bands = dataclasses.replace(other.found_with(), inputs=self._made_of)
        return dataclasses.replace(self, motor_timing=dataclasses.replace(timing, bands=bands))

    @property
    def _is_reduced(self) -> bool:
        """Whether the bands at the timing that was found are made already."""
        return "timed_bands" in vars(self) or self._timed_already is not None

    def reduced(self) -> TimedDataset:
        """Reduce the body's lines once, for bands at many timings."""
        body = tuple(
            tuple(
                body_lines(data, plan=plan, added=self.model.layout.added)
                for data, plan in (banded_data(f.prepared, None) for f in c.flights)
            )
            for c in self.configurations
        )
        return dataclasses.replace(self, body=body)

    def bands(
        self,
        response: MotorResponse | None = None,
        *,
        free: FreeTiming | None = None,
        top: float = np.inf,
    ) -> tuple[Factors, ...]:
        """Return the band factors of each configuration, at another timing of the motors.

        With `free`, their slopes by the times that a fit may move; only of the bands that begin
        under `top` [Hz].
        """
        body = self.body or [None] * len(self.configurations)
        return tuple(
            flight_bands(
                [f.prepared for f in c.flights],
                self.vehicle,
                response,
                added=self.model.layout.added,
                free=free,
                body=own,
                top=top,
            )
            for c, own in zip(self.configurations, body, strict=True)
        )

    @cached_property
    def timed_bands(self) -> tuple[Factors, ...]:
        """The band factors at the estimated timing, with their slopes by the free times."""
        bands = self._timed_already
        if bands is not None:
            return bands.factors
        if self.free_timing is None:
            return self.bands(self.timing)
        return tuple(_factors_of_flights(own, self.model.layout) for own in self.timed_lines)

    @cached_property
    def timed_lines(self) -> tuple[tuple[list[BandLines], ...], ...]:
        """The lines of each flight of each configuration at that timing, with their slopes."""
        body = self.body or [[None] * len(c.flights) for c in self.configurations]
        return tuple(
            tuple(
                prepared_lines(
                    flight.prepared,
                    self.vehicle,
                    self.timing,
                    added=self.model.layout.added,
                    free=self.free_timing,
                    body=lines,
                )
                for flight, lines in zip(c.flights, own, strict=True)
            )
            for c, own in zip(self.configurations, body, strict=True)
        )

    def moved_along_lines(self, response: MotorResponse) -> TimedDataset:
        """Move the timing without reducing the samples again: by the lines of this dataset.

        Good to first order, and far beyond that for a delay and a lag (`line_moves.py`).
        """
        free, layout = self.free_timing, self.model.layout
        assert free is not None
        factors = tuple(
            _factors_of_flights([lines_at(one, layout, free, response) for one in own], layout)
            for own in self.timed_lines
        )
        bands = TimedBands(at=response, inputs=self._made_of, factors=factors)
        moved = self.at(response, free.names)
        assert moved.motor_timing is not None
        timing = dataclasses.replace(moved.motor_timing, bands=bands)
        return dataclasses.replace(moved, motor_timing=timing)

    def found_with(self) -> TimedBands:
        """Return the timed bands for other fits of the same flights."""
        free = self.free_timing
        assert free is not None
        return TimedBands(at=free.at, inputs=self._made_of, factors=self.timed_bands)

    def yaw_bands(self) -> tuple[Factors, ...]:
        """Return the band factors of yaw alone at that timing, every rotor for itself."""
        return tuple(
            stack_recordings(
                [
                    yaw_factors(data, len(self.vehicle.rotors), plan=plan)
                    for data, plan in (banded_data(f.prepared, self.timing) for f in c.flights)
                ]
            )
            for c in self.configurations
        )


def _factors_of_flights(flights: Sequence[Sequence[BandLines]], layout: SignalLayout) -> Factors:
    return stack_recordings([factors_of_lines(lines, layout) for lines in flights])


def tilt_corrected_flights(dataset: TimedDataset, tilt: ImuTilt) -> TimedDataset:
    """Rotate the IMU's readings of the flights into the rotors' axes."""
    turned = with_prepared(dataset, lambda prepared: levelled(prepared, tilt))
    return dataclasses.replace(turned, body=None)
