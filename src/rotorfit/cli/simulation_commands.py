"""Commands that need no log: plan a flight, fly in simulation, the demonstration."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from rotorfit.cli.help import Command
from rotorfit.cli.options import (
    Accuracy,
    After,
    AirframeFile,
    AsJson,
    Card,
    Force,
    Guess,
    Lengths,
    LogRate,
    PlannedMass,
    PlannedPayload,
    PlanOutput,
    Seed,
    Speed,
)
from rotorfit.cli.terminal import interruptible

commands = typer.Typer()


@commands.command(
    cls=Command, epilog="Example: rotorfit plan airframe.toml --mass 1.285 --card card.html"
)
@interruptible()
def plan(
    airframe: AirframeFile,
    mass: PlannedMass = None,
    accuracy: Accuracy = "5",
    seconds: Lengths = "20,40,75",
    speed: Speed = None,
    payload: PlannedPayload = None,
    guess: Guess = None,
    log_rate: LogRate = 200.0,
    after: After = None,
    card: Card = None,
    output: PlanOutput = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Plan a flight for a target accuracy.

    Recommends manoeuvres, how long to fly each, and whether to mount a payload.
    """
    from rotorfit.cli.plan import PlanOptions, run

    run(
        PlanOptions(
            airframe=airframe,
            mass=mass,
            accuracy=accuracy,
            seconds=seconds,
            speed=speed,
            payload=payload,
            guess=tuple(guess or ()),
            log_rate=log_rate,
            after=after,
            output=output,
            card=card,
            force=force,
            as_json=as_json,
        )
    )


@commands.command(cls=Command, epilog="Example: rotorfit simulate single -o flights --seconds 20")
@interruptible()
def simulate(
    scenario: Annotated[
        Literal["paper", "single", "hexa", "payload-pair"],
        typer.Argument(
            metavar="SCENARIO",
            help="paper: vehicles A and B of Six et al. 2020; single: a quadrotor; hexa: six "
            "rotors; payload-pair: bare and with a known payload.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for flights, experiment and truth."
        ),
    ],
    variant: Annotated[
        Literal["clean", "lag", "noisy", "real"],
        typer.Option(
            help="clean: perfect; lag: motors with a known lag; noisy: and sensor noise and bias; "
            "real: and gusts, drag, rotor inertia, unequal rotors, measured rotor speed."
        ),
    ] = "real",
    seed: Seed = 1,
    seconds: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Of each flight, between take-off and landing [s]."),
    ] = 75.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate flights with known truth, to try things on.

    Writes flight logs, an experiment file ready for identify, and the truth.
    """
    from rotorfit.cli.simulate import SimulateRequest, run

    run(
        SimulateRequest(
            scenario=scenario,
            output=output,
            variant=variant,
            seed=seed,
            seconds=seconds,
            force=force,
            as_json=as_json,
        )
    )


@commands.command(cls=Command, epilog="Example: rotorfit demo -o demo")
@interruptible()
def demo(
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Keep flights, experiment, truth, results and report here.",
        ),
    ] = None,
    seed: Seed = 1,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate the paper's experiment, identify it, compare.

    Six, Briot, Erskine and Chriette, ICRA 2020: two quadrotors that differ by a known payload,
    identified by the default method and by the paper's.
    """
    from rotorfit.cli.demo import run

    run(output, seed=seed, force=force, as_json=as_json)
