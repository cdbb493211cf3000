"""Which outputs drive motors: those that the motion of the vehicle follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.logs.flight_log import Channel

MOTOR_COUNTS: Final = (3, 4, 6, 8, 12)
"""Numbers of motors that a multirotor has."""
_DELAYS: Final = (0.0, 0.03, 0.06, 0.12)
"""Delays between an output and the motion that it makes [s]: of the autopilot and the motors."""
_SLOWEST: Final = 1.0
"""Time over which steady parts and slow changes are taken off [s]: trims and drifts."""
_FEWEST: Final = 200
"""Samples that show which outputs drive motors."""
_CLEAR: Final = 0.05
"""Share of a motion that the outputs of a motor explain beyond chance."""
_BY_CHANCE: Final = 0.25
"""Part of the least motor's share up to which an output explains motion by chance alone."""

_CLEARLY_LESS: Final = 0.5
"""Part of what motors explain that outputs of another kind stay under: a gimbal or a servo."""


def motor_outputs(command: Channel, gyro: Channel, accel: Channel) -> Bool[np.ndarray, " k"] | None:
    """Select the outputs that drive motors; None if the flight does not show it."""
    if command.values.shape[1] <= min(MOTOR_COUNTS):
        return None
    share = _explained_shares(command, gyro, accel)
    if share is None:
        return None
    order = np.argsort(-share)
    for count in reversed(MOTOR_COUNTS):
        # A whole frame with one motor that does little is no frame of one motor less.
        if count == len(share) - 1 and len(share) in MOTOR_COUNTS:
            continue
        kept, others = share[order[:count]], share[order[count:]]
        # Thrust and angular accelerations follow each motor by itself, through the loop that flies
        # the vehicle; a servo, a gimbal or a pilot's channel moves by itself. An output is left out
        # where it explains a quarter of what each other one does, and those are as many as a
        # multirotor has.
        if len(others) and kept.min() > _CLEAR and others.max() < _BY_CHANCE * kept.min():
            return np.isin(np.arange(len(share)), order[:count])
    return None


def followed_group(groups: Sequence[Channel], gyro: Channel, accel: Channel) -> int | None:
    """Find which of some groups of outputs the motion follows; None if it is not clear."""
    shares = [_explained_shares(group, gyro, accel) for group in groups]
    means = np.array([0.0 if share is None else float(share.mean()) for share in shares])
    best = int(np.argmax(means))
    others = np.delete(means, best)
    is_clear = means[best] > _CLEAR and bool((others < _CLEARLY_LESS * means[best]).all())
    return best if is_clear else None


def _explained_shares(
    command: Channel, gyro: Channel, accel: Channel
) -> Float[np.ndarray, " k"] | None:
    """Return the share of a motion that each output explains; None if the flight is too short."""
    if len(command.time) < _FEWEST:
        return None
    step = float(np.median(np.diff(command.time)))
    if step <= 0.0:
        return None
    start = max(one.time[0] for one in (command, gyro, accel)) + max(_DELAYS)
    even = np.arange(start, min(one.time[-1] for one in (command, gyro, accel)), step)
    if len(even) < _FEWEST:
        return None
    width = 2 * max(round(0.5 * _SLOWEST / step), 1) + 1
    turns = np.gradient(_sample_evenly(gyro, even), step, axis=0)
    motion = _remove_moving_mean(np.column_stack([turns, _sample_evenly(accel, even)[:, 2]]), width)
    return np.array(
        [
            _explained_share(
                motion, _remove_moving_mean(_delayed_commands(command, even, i), width)
            )
            for i in range(command.values.shape[1])
        ]
    )


def _sample_evenly(channel: Channel, even: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n k"]:
    values = np.nan_to_num(channel.values)
    columns = [np.interp(even, channel.time, values[:, i]) for i in range(values.shape[1])]
    return np.stack(columns, axis=1)


def _delayed_commands(
    command: Channel, even: Float[np.ndarray, " n"], i: int
) -> Float[np.ndarray, "n d"]:
    values = np.nan_to_num(command.values[:, i])
    return np.stack([np.interp(even - delay, command.time, values) for delay in _DELAYS], axis=1)


def _remove_moving_mean(values: Float[np.ndarray, "n k"], width: int) -> Float[np.ndarray, "m k"]:
    """Take the moving mean off."""
    box = np.full(width, 1.0 / width)
    means = np.stack([np.convolve(column, box, mode="valid") for column in values.T], axis=1)
    half = width // 2
    return values[half : half + len(means)] - means


def _explained_share(motion: Float[np.ndarray, "n 4"], drives: Float[np.ndarray, "n d"]) -> float:
    """Return the largest share of one motion that an output explains at some delays."""
    response = np.linalg.lstsq(drives, motion, rcond=None)[0]
    left = ((motion - drives @ response) ** 2).sum(axis=0)
    total = np.maximum((motion**2).sum(axis=0), np.finfo(float).tiny)
    return float((1.0 - left / total).max())
