"""Run the command line as ``python -m rotorfit``."""

from rotorfit.cli.main import main

main()
