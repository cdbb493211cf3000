"""Keep one vehicle of a recording of several: their topics differ in one name alone.

A swarm records ``/uav1/imu`` and ``/uav2/imu``. The IMU of one and the motors of the other would
fit no vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from rotorfit.logs.rosbag.choose import Candidate

MOTORS: Final = ("rotor_speed", "command")
_SHOWN: Final = 8


def keep_one_vehicle(
    found: Mapping[str, list[Candidate]], asked: Collection[str]
) -> tuple[dict[str, list[Candidate]], list[str]]:
    """Return the candidates without those of other vehicles, and a doubt if there are any.

    `asked`: topics that the user names, which say the vehicle and always stay.
    """
    imus = found.get("gyro", [])
    depth = _shared_depth(one.topic for options in found.values() for one in options)
    vehicles = _twins((one.topic for one in imus), depth)
    if not vehicles:
        return dict(found), []
    moved = {_root(o.topic, depth) for name in MOTORS for o in found.get(name, [])} & vehicles
    named = {_root(topic, depth) for topic in asked} & vehicles
    able = named or moved or vehicles
    best = max((o for o in imus if _root(o.topic, depth) in able), key=lambda o: o.rate)
    kept = _root(best.topic, depth)
    others = vehicles - {kept}
    rest = {
        name: [o for o in options if o.topic in asked or _root(o.topic, depth) not in others]
        for name, options in found.items()
    }
    if named:
        return rest, []
    listed = ", ".join(sorted(vehicles)[:_SHOWN])
    return rest, [
        f"the recording has several vehicles ({listed}), of which {kept} is read; choose another "
        f'by one of its topics, as columns = {{ gyro = "{_other_imu(imus, others, depth)}" }}'
    ]


def _other_imu(imus: Iterable[Candidate], others: set[str], depth: int) -> str:
    return min(one.topic for one in imus if _root(one.topic, depth) in others)


def _shared_depth(topics: Iterable[str]) -> int:
    """Return how many leading names all topics share."""
    split = [topic.strip("/").split("/")[:-1] for topic in topics]
    depth = 0
    for names in zip(*split, strict=False):
        if len(set(names)) > 1:
            break
        depth += 1
    return depth


def _root(topic: str, depth: int) -> str:
    """Return the first name that topics do not share; empty of a topic that has no more."""
    names = topic.strip("/").split("/")
    return names[depth] if len(names) > depth + 1 else ""


def _twins(topics: Iterable[str], depth: int) -> set[str]:
    """Return the first names of topics that are alike but for that name."""
    roots: dict[str, set[str]] = {}
    for topic in topics:
        rest = "/".join(topic.strip("/").split("/")[depth + 1 :])
        if rest:
            roots.setdefault(rest, set()).add(_root(topic, depth))
    return {root for own in roots.values() if len(own) > 1 for root in own}
