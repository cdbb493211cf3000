"""Run the command line as ``python -m rotorfit``."""

from __future__ import annotations

from rotorfit.cli.main import main

main()
