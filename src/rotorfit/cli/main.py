"""The command line: one command a question. Heavy imports happen inside the commands."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

import rotorfit
from rotorfit.errors import RotorfitError

app = typer.Typer(
    name="rotorfit",
    help="Physical parameters of a multirotor, with intervals, from the flight logs you have.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]


def main() -> None:
    """Run the command line; a refusal is one line on stderr and exit code 1."""
    try:
        app()
    except RotorfitError as error:
        typer.echo(f"rotorfit: {' '.join(str(error).split())}", err=True)
        sys.exit(1)
    except BrokenPipeError:
        # The reader of our output (such as head) has gone: nothing is wrong.
        sys.stderr.close()
        sys.exit(0)
    except KeyboardInterrupt:
        typer.echo("rotorfit: stopped; nothing was written", err=True)
        sys.exit(1)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rotorfit {rotorfit.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    del version


@app.command()
def identify(
    source: Annotated[Path, typer.Argument(help="An experiment file (.toml), or one flight log.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write the result as JSON here.")
    ] = None,
    mass: Annotated[
        str | None, typer.Option(help='With a log: weighed mass in kg, or "unknown".')
    ] = None,
    airframe: Annotated[
        Path | None, typer.Option(help="With a log: file with [airframe] and [motors].")
    ] = None,
    log: Annotated[
        int | None, typer.Option(min=1, help="With a log file of several logs: which, from 1.")
    ] = None,
    method: Annotated[
        Literal["ols", "tls"] | None,
        typer.Option(help="ols: row by row (default); tls: total least squares of all rows."),
    ] = None,
    preset: Annotated[
        Literal["paper"] | None,
        typer.Option(help="paper: exactly as Six et al. 2020, their standard deviations included."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify a vehicle's parameters from its flights.

    Either an experiment file, which names airframe, masses and flights, or straight from one log:
    rotorfit identify LOG --mass 0.428 --airframe airframe.toml
    """
    from rotorfit.cli.identify import IdentifyRequest, run

    run(
        IdentifyRequest(
            source=source,
            output=output,
            mass=mass,
            airframe=airframe,
            log=log,
            method=method,
            preset=preset,
            force=force,
            as_json=as_json,
        )
    )


@app.command()
def inspect(
    logs: Annotated[list[Path], typer.Argument(help="Flight logs of any format.")],
    log: Annotated[
        int | None, typer.Option(min=1, help="In a file of several logs: which, from 1.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what is in a log: channels, rates, gaps, units, airborne time, what is missing."""
    from rotorfit.cli.inspect import run

    run(logs, log_number=log, as_json=as_json)


@app.command()
def demo(
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Keep flight, experiment, truth and result here."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another flight.")] = 1,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Fly a simulated quadrotor, identify it, and print the estimate beside the truth."""
    from rotorfit.cli.demo import run

    run(output, seed=seed, force=force, as_json=as_json)
