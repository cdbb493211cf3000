"""The option --mass: kilograms, or with the unit behind it."""

from __future__ import annotations

import typer

from rotorfit.written_mass import EXAMPLES, Mass, read_mass


def parse_mass(text: str) -> Mass:
    """Parse ``--mass`` in kilograms, or with the unit behind it: 428g, 0.428kg."""
    try:
        return read_mass(text, "--mass")
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not a mass; give {EXAMPLES}", param_hint="--mass"
        ) from None
