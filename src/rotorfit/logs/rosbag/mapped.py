"""Numbers that a columns map names by topic and path, for messages that rotorfit does not know."""

from collections.abc import Mapping, Sequence

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.axes import Axes, attitude_from_euler, attitude_to_flu, vectors_to_flu
from rotorfit.logs.columns import EULER, ColumnSpec, Group, complete_groups, quantity_of, unit_of
from rotorfit.logs.flight_log import Channel
from rotorfit.logs.rosbag.clocks import Timing
from rotorfit.logs.rosbag.stream import Recorded
from rotorfit.logs.units import conversion

_VECTORS = ("gyro", "accel", "velocity", "reference", "position")


def mapped_paths(topic: str, columns: Mapping[str, ColumnSpec]) -> dict[str, tuple[str, ...]]:
    """Return the paths in a topic's messages that a map names, by canonical name.

    The name of a topic may have dots; a path follows it after one.
    """
    return {
        name: (spec.name.removeprefix(f"{topic}."),)
        for name, spec in columns.items()
        if spec.name.startswith(f"{topic}.")
    }


def mapped_channels(
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
    *,
    axes: Axes,
    motor_poles: int | None,
) -> dict[str, Channel]:
    """Return the channels of a map.

    Raises
    ------
    LogError
        If a name is not known, a path is not in the recording, or the columns of one channel come
        from several topics.
    """
    if not columns:
        return {}
    for name in columns:
        if quantity_of(name) is None or name == "time":
            raise LogError(
                f"the columns map names {name!r}; for a ROS recording it names channels (gyro, "
                "rotor_speed, ...) or columns of flight tables (gyro_x, rotor_1, ...)"
            )
    groups, _ = complete_groups(columns, columns)
    return {
        group.channel: _channel(group, topics, clocks, columns, axes, motor_poles)
        for group in groups
    }


def _channel(
    group: Group,
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
    axes: Axes,
    motor_poles: int | None,
) -> Channel:
    """Return one channel, its columns all from one topic."""
    recorded, timing = _home(group, topics, clocks, columns)
    parts: list[np.ndarray] = []
    for name in group.names:
        spec = columns[name]
        to_si = conversion(
            group.quantity,
            unit_of(name, spec),
            motor_poles=motor_poles,
            recorded_range=spec.range,
        )
        values = to_si(recorded.values[name][:, 0] * spec.scale + spec.offset)
        parts.append(np.where(np.isfinite(values), values, np.nan))
    values = np.stack(parts, axis=1)
    if group.channel == "attitude":
        values = attitude_to_flu(attitude_from_euler(values) if group == EULER else values, axes)
    elif group.channel in _VECTORS:
        values = vectors_to_flu(values, axes)
    order = np.argsort(timing.time, kind="stable")
    paths = ", ".join(columns[name].name for name in group.names)
    return Channel(time=timing.time[order], values=values[order], source=f"{paths} (columns map)")


def _home(
    group: Group,
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
) -> tuple[Recorded, Timing]:
    """Return the topic that has all columns of a channel."""
    for recorded, timing in zip(topics, clocks, strict=True):
        have = [name for name in group.names if recorded.values.get(name, _NONE).shape[1] == 1]
        if len(have) == len(group.names):
            return recorded, timing
    wanted = ", ".join(repr(columns[name].name) for name in group.names)
    raise LogError(
        f"no topic has all of {wanted}, which the columns map gives for {group.channel}: write "
        "TOPIC.path.to.number as `ros2 topic echo` shows it, all of one topic"
    )


_NONE = np.zeros((0, 0))
