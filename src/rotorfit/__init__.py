"""Physical parameters of a multirotor, with intervals, from ordinary flight logs.

The public names stand here. A name is imported when it is first used: `import rotorfit` costs
nothing, and neither does `rotorfit --help`.
"""

from typing import TYPE_CHECKING

from rotorfit.version import __version__ as __version__

if TYPE_CHECKING:
    from rotorfit.errors import EstimationError as EstimationError
    from rotorfit.errors import ExcitationError as ExcitationError
    from rotorfit.errors import ExperimentError as ExperimentError
    from rotorfit.errors import FlightError as FlightError
    from rotorfit.errors import FlightWarning as FlightWarning
    from rotorfit.errors import FrameError as FrameError
    from rotorfit.errors import LogError as LogError
    from rotorfit.errors import OutputError as OutputError
    from rotorfit.errors import RotorfitError as RotorfitError
    from rotorfit.errors import RotorfitWarning as RotorfitWarning
    from rotorfit.export.write import write_export as write_export
    from rotorfit.flight.data import FlightData as FlightData
    from rotorfit.flight.data import Segment as Segment
    from rotorfit.flight.log import Channel as Channel
    from rotorfit.flight.log import FlightLog as FlightLog
    from rotorfit.flight.prepare import MotorModel as MotorModel
    from rotorfit.flight.prepare import PreparedFlight as PreparedFlight
    from rotorfit.flight.prepare import prepare as prepare
    from rotorfit.identification.compare import Comparison as Comparison
    from rotorfit.identification.compare import compare_results as compare_results
    from rotorfit.identification.comparison import WrenchComparison as WrenchComparison
    from rotorfit.identification.experiment import Experiment as Experiment
    from rotorfit.identification.experiment import load_experiment as load_experiment
    from rotorfit.identification.experiment import motor_model_of as motor_model_of
    from rotorfit.identification.experiment import (
        single_flight_experiment as single_flight_experiment,
    )
    from rotorfit.identification.experiment import vehicle_of as vehicle_of
    from rotorfit.identification.identify import identify as identify
    from rotorfit.identification.physical import Projected as Projected
    from rotorfit.identification.physical import project_to_physical as project_to_physical
    from rotorfit.identification.plan import FlightPlan as FlightPlan
    from rotorfit.identification.plan import PlanRequest as PlanRequest
    from rotorfit.identification.plan import plan as plan
    from rotorfit.identification.plan_wanted import Wanted as Wanted
    from rotorfit.identification.plan_wanted import wanted_accuracy as wanted_accuracy
    from rotorfit.identification.result import Derived as Derived
    from rotorfit.identification.result import FlightRecord as FlightRecord
    from rotorfit.identification.result import IdentificationResult as IdentificationResult
    from rotorfit.identification.result import Parameter as Parameter
    from rotorfit.identification.validate import fitted_comparisons as fitted_comparisons
    from rotorfit.identification.validate import validate_file as validate_file
    from rotorfit.identification.validate import validation_comparisons as validation_comparisons
    from rotorfit.logs.columns import ColumnSpec as ColumnSpec
    from rotorfit.logs.read import ReadOptions as ReadOptions
    from rotorfit.logs.read import read_log as read_log
    from rotorfit.model.layouts import layout_rotors as layout_rotors
    from rotorfit.model.vehicle import Rotor as Rotor
    from rotorfit.model.vehicle import Vehicle as Vehicle
    from rotorfit.report.figures import figure_texts as figure_texts
    from rotorfit.report.html import write_report as write_report
    from rotorfit.report.plan_card import write_card as write_card
    from rotorfit.report.plan_text import plan_text as plan_text
    from rotorfit.report.text import result_text as result_text
    from rotorfit.simulation.folder import simulate as simulate
else:
    _PLACES = {
        "rotorfit.errors": (
            "EstimationError",
            "ExcitationError",
            "ExperimentError",
            "FlightError",
            "FlightWarning",
            "FrameError",
            "LogError",
            "OutputError",
            "RotorfitError",
            "RotorfitWarning",
        ),
        "rotorfit.export.write": ("write_export",),
        "rotorfit.flight.data": ("FlightData", "Segment"),
        "rotorfit.flight.log": ("Channel", "FlightLog"),
        "rotorfit.flight.prepare": ("MotorModel", "PreparedFlight", "prepare"),
        "rotorfit.identification.compare": ("Comparison", "compare_results"),
        "rotorfit.identification.comparison": ("WrenchComparison",),
        "rotorfit.identification.experiment": (
            "Experiment",
            "load_experiment",
            "motor_model_of",
            "single_flight_experiment",
            "vehicle_of",
        ),
        "rotorfit.identification.identify": ("identify",),
        "rotorfit.identification.physical": ("Projected", "project_to_physical"),
        "rotorfit.identification.plan": ("FlightPlan", "PlanRequest", "plan"),
        "rotorfit.identification.plan_wanted": ("Wanted", "wanted_accuracy"),
        "rotorfit.identification.result": (
            "Derived",
            "FlightRecord",
            "IdentificationResult",
            "Parameter",
        ),
        "rotorfit.identification.validate": (
            "fitted_comparisons",
            "validate_file",
            "validation_comparisons",
        ),
        "rotorfit.logs.columns": ("ColumnSpec",),
        "rotorfit.logs.read": ("ReadOptions", "read_log"),
        "rotorfit.model.layouts": ("layout_rotors",),
        "rotorfit.model.vehicle": ("Rotor", "Vehicle"),
        "rotorfit.report.figures": ("figure_texts",),
        "rotorfit.report.html": ("write_report",),
        "rotorfit.report.plan_card": ("write_card",),
        "rotorfit.report.plan_text": ("plan_text",),
        "rotorfit.report.text": ("result_text",),
        "rotorfit.simulation.folder": ("simulate",),
    }
    _MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}

    def __getattr__(name: str) -> object:
        """Return a public name, imported now and kept (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module
        from inspect import isfunction

        from rotorfit.arguments import checked

        value = getattr(import_module(_MODULE_OF[name]), name)
        if isfunction(value):
            value = checked(value, name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*_MODULE_OF, "__version__"})
