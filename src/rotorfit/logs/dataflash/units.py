"""The units that a DataFlash log declares (FMTU, UNIT), held against those that are assumed."""

from typing import Final

import numpy as np

from rotorfit.logs.dataflash.columns import columns
from rotorfit.logs.dataflash.messages import Messages

EXPECTED: Final = {
    "GyrX": "rad/s",
    "AccX": "m/s/s",
    "RPM": "rpm",
    "Volt": "V",
    "VN": "m/s",
    "PX": "m",
}
"""Unit of one field of each kind, as the firmware writes it."""
CHECKED: Final = ("IMU", "GYR", "ACC", "ESC", "BAT", "XKF1", "VISP")


def declared_units(messages: Messages) -> dict[tuple[str, str], str]:
    """Return the unit of each field, by message and label, where the log declares them."""
    letters = columns(messages, "UNIT", ("Id", "Label"))
    uses = columns(messages, "FMTU", ("FmtType", "UnitIds"))
    if not letters or not uses or not _are_texts(letters["Label"], uses["UnitIds"]):
        return {}
    if letters["Id"].dtype.kind not in "iu" or uses["FmtType"].dtype.kind not in "iu":
        return {}
    names = {
        chr(int(i) & 0xFF): label.decode("latin-1")
        for i, label in zip(letters["Id"].tolist(), letters["Label"].tolist(), strict=True)
    }
    by_type = {f.type: f for f in messages.formats}
    found: dict[tuple[str, str], str] = {}
    for number, ids in zip(uses["FmtType"].tolist(), uses["UnitIds"].tolist(), strict=True):
        form = by_type.get(number)
        if form is None:
            continue
        for label, letter in zip(form.labels, ids.decode("latin-1"), strict=False):
            found[form.name, label] = names.get(letter, "")
    return found


def _are_texts(*values: np.ndarray) -> bool:
    return all(v.dtype.kind == "S" for v in values)


def unit_doubts(messages: Messages) -> list[str]:
    """Return a doubt for each field whose declared unit is not the one that it is read in."""
    units = declared_units(messages)
    return [
        f"{name}.{label} is declared in {units[name, label]!a}, and read as {unit}: check the scale"
        for name in CHECKED
        for label, unit in EXPECTED.items()
        if units.get((name, label), unit) not in (unit, "")
    ]
