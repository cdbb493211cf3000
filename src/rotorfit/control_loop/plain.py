"""The outcome of a loop as JSON."""

import json
from dataclasses import asdict
from typing import Any

from rotorfit.control_loop.loop import AxisLoop, LoopOutcome
from rotorfit.formatting.digits import finite_json


def loop_to_json(outcome: LoopOutcome) -> str:
    """Return the outcome as JSON text; null where there is no number."""
    plain = {
        "name": outcome.name,
        "configuration": outcome.configuration,
        "autopilot": outcome.autopilot,
        "firmware": outcome.firmware,
        "notes": list(outcome.notes),
        "axes": [_axis(loop) for loop in outcome.axes],
    }
    return json.dumps(finite_json(plain), indent=1, allow_nan=False) + "\n"


def _axis(loop: AxisLoop) -> dict[str, Any]:
    gain, late = loop.error.half_widths
    return {
        "axis": loop.axis,
        "controller": asdict(loop.controller),
        "replay": asdict(loop.replay),
        "mixer": None if loop.mixer is None else asdict(loop.mixer),
        "rate_loop": asdict(loop.rate_loop),
        "with_attitude": asdict(loop.with_attitude),
        "bands": [
            {
                "low": band.low,
                "high": band.high,
                "ratio": band.ratio,
                "degrees": band.degrees,
                "uncertainty": band.uncertainty,
                "proved": band.proved,
            }
            for band in loop.bands
        ],
        "effectiveness": {"value": loop.error.gain, "half_width": gain},
        "later": {"value": loop.error.delay, "half_width": late},
        "proved": None if loop.proved is None else list(loop.proved),
        "doubts": list(loop.doubts),
        "derivative_share": loop.derivative_share,
        "gains": [{"factor": factor, "sensitivity": peak} for factor, peak in loop.gains],
        "step": {name: values.tolist() for name, values in asdict(loop.step).items()},
    }
