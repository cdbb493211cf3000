"""Flights with known truth, the independent reference; shares no line with the regressor."""

from rotorfit.simulation.controller import Gains as Gains
from rotorfit.simulation.experiment_files import exact_flight_data as exact_flight_data
from rotorfit.simulation.experiment_files import flight_table as flight_table
from rotorfit.simulation.experiment_files import sampled_flight_data as sampled_flight_data
from rotorfit.simulation.experiment_files import to_flight_log as to_flight_log
from rotorfit.simulation.experiment_files import write_flight_table as write_flight_table
from rotorfit.simulation.experiments import SimulatedVehicle as SimulatedVehicle
from rotorfit.simulation.experiments import layout_vehicle as layout_vehicle
from rotorfit.simulation.experiments import paper_vehicle as paper_vehicle
from rotorfit.simulation.experiments import variant as variant
from rotorfit.simulation.flight import Scenario as Scenario
from rotorfit.simulation.flight import simulate_flight as simulate_flight
from rotorfit.simulation.pilot import STILL as STILL
from rotorfit.simulation.pilot import Course as Course
from rotorfit.simulation.pilot import Stick as Stick
from rotorfit.simulation.pilot import Sticks as Sticks
from rotorfit.simulation.sensors import PERFECT as PERFECT
from rotorfit.simulation.sensors import TYPICAL as TYPICAL
from rotorfit.simulation.sensors import Sensors as Sensors
from rotorfit.simulation.sensors import SimulatedFlight as SimulatedFlight
from rotorfit.simulation.sensors import measure as measure
from rotorfit.simulation.truth import GRAVITY as GRAVITY
from rotorfit.simulation.truth import Truth as Truth
from rotorfit.simulation.truth import with_payload as with_payload
