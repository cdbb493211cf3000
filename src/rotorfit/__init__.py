"""Physical parameters of a multirotor, with intervals, from ordinary flight logs.

The public names stand here. A name is imported when it is first used: `import rotorfit` costs
nothing, and neither does `rotorfit --help`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rotorfit.version import __version__ as __version__

if TYPE_CHECKING:
    from rotorfit import plot as plot
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
    from rotorfit.fit.experiment.declared_vehicle import motor_model_of as motor_model_of
    from rotorfit.fit.experiment.declared_vehicle import vehicle_of as vehicle_of
    from rotorfit.fit.experiment.experiment import Experiment as Experiment
    from rotorfit.fit.experiment.experiment import load_experiment as load_experiment
    from rotorfit.fit.experiment.experiment import (
        single_flight_experiment as single_flight_experiment,
    )
    from rotorfit.flight.flight_data import FlightData as FlightData
    from rotorfit.flight.flight_data import Segment as Segment
    from rotorfit.flight.motors.motor_model import MotorModel as MotorModel
    from rotorfit.flight.prepare import PreparedFlight as PreparedFlight
    from rotorfit.flight.prepare import prepare as prepare
    from rotorfit.identification import identify as identify
    from rotorfit.logs.columns import ColumnSpec as ColumnSpec
    from rotorfit.logs.flight_log import Channel as Channel
    from rotorfit.logs.flight_log import FlightLog as FlightLog
    from rotorfit.logs.formats import ReadOptions as ReadOptions
    from rotorfit.logs.read import read_log as read_log
    from rotorfit.model.vehicle import Rotor as Rotor
    from rotorfit.model.vehicle import Vehicle as Vehicle
    from rotorfit.model.vehicle import layout_rotors as layout_rotors
    from rotorfit.report.parameters import latex_table as latex_table
    from rotorfit.report.plan_card import write_card as write_card
    from rotorfit.report.plan_text import plan_text as plan_text
    from rotorfit.report.result_page import figure_texts as figure_texts
    from rotorfit.report.result_page import write_report as write_report
    from rotorfit.report.text import result_text as result_text
    from rotorfit.results.command_law import CommandLaw as CommandLaw
    from rotorfit.results.command_law import LawNumber as LawNumber
    from rotorfit.results.command_law import LawPoint as LawPoint
    from rotorfit.results.compare import Comparison as Comparison
    from rotorfit.results.compare import compare_results as compare_results
    from rotorfit.results.physical_inertia import Projected as Projected
    from rotorfit.results.physical_inertia import project_to_physical as project_to_physical
    from rotorfit.results.result import Derived as Derived
    from rotorfit.results.result import FlightRecord as FlightRecord
    from rotorfit.results.result import IdentificationResult as IdentificationResult
    from rotorfit.results.result import Parameter as Parameter
    from rotorfit.results.samples import Samples as Samples
    from rotorfit.results.validation.validate import fitted_comparisons as fitted_comparisons
    from rotorfit.results.validation.validate import validate_file as validate_file
    from rotorfit.results.validation.validate import (
        validation_comparisons as validation_comparisons,
    )
    from rotorfit.results.validation.wrench_comparison import WrenchComparison as WrenchComparison
    from rotorfit.simulation.experiment_files import simulate as simulate
    from rotorfit.tools.control_loop.loop import AxisLoop as AxisLoop
    from rotorfit.tools.control_loop.loop import LoopOutcome as LoopOutcome
    from rotorfit.tools.control_loop.loop import loop_margins as loop_margins
    from rotorfit.tools.control_loop.measures import LoopMeasures as LoopMeasures
    from rotorfit.tools.control_loop.measures import Measure as Measure
    from rotorfit.tools.planning.plan import FlightPlan as FlightPlan
    from rotorfit.tools.planning.plan import PlanRequest as PlanRequest
    from rotorfit.tools.planning.plan import plan as plan
    from rotorfit.tools.planning.wanted import Wanted as Wanted
    from rotorfit.tools.planning.wanted import wanted_accuracy as wanted_accuracy
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
        "rotorfit.tools.control_loop.loop": ("AxisLoop", "LoopOutcome", "loop_margins"),
        "rotorfit.tools.control_loop.measures": ("LoopMeasures", "Measure"),
        "rotorfit.export.write": ("write_export",),
        "rotorfit.flight.flight_data": ("FlightData", "Segment"),
        "rotorfit.logs.flight_log": ("Channel", "FlightLog"),
        "rotorfit.flight.motors.motor_model": ("MotorModel",),
        "rotorfit.flight.prepare": ("PreparedFlight", "prepare"),
        "rotorfit.results.command_law": ("CommandLaw", "LawNumber", "LawPoint"),
        "rotorfit.results.compare": ("Comparison", "compare_results"),
        "rotorfit.results.validation.wrench_comparison": ("WrenchComparison",),
        "rotorfit.fit.experiment.declared_vehicle": ("motor_model_of", "vehicle_of"),
        "rotorfit.fit.experiment.experiment": (
            "Experiment",
            "load_experiment",
            "single_flight_experiment",
        ),
        "rotorfit.identification": ("identify",),
        "rotorfit.results.physical_inertia": ("Projected", "project_to_physical"),
        "rotorfit.tools.planning.plan": ("FlightPlan", "PlanRequest", "plan"),
        "rotorfit.tools.planning.wanted": ("Wanted", "wanted_accuracy"),
        "rotorfit.results.result": (
            "Derived",
            "FlightRecord",
            "IdentificationResult",
            "Parameter",
        ),
        "rotorfit.results.validation.validate": (
            "fitted_comparisons",
            "validate_file",
            "validation_comparisons",
        ),
        "rotorfit.logs.columns": ("ColumnSpec",),
        "rotorfit.logs.formats": ("ReadOptions",),
        "rotorfit.logs.read": ("read_log",),
        "rotorfit.model.vehicle": ("Rotor", "Vehicle", "layout_rotors"),
        "rotorfit.report.result_page": ("figure_texts", "write_report"),
        "rotorfit.report.parameters": ("latex_table",),
        "rotorfit.report.plan_card": ("write_card",),
        "rotorfit.report.plan_text": ("plan_text",),
        "rotorfit.report.text": ("result_text",),
        "rotorfit.results.samples": ("Samples",),
        "rotorfit.simulation.experiment_files": ("simulate",),
    }
    _MODULES = ("plot",)
    _MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}

    def __getattr__(name: str) -> object:
        """Return a public name, imported now and kept (PEP 562)."""
        if name in _MODULES:
            from importlib import import_module

            return import_module(f"rotorfit.{name}")
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
        return sorted({*_MODULE_OF, *_MODULES, "__version__"})
