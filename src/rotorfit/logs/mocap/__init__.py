"""Motion-capture recordings to a FlightLog of position and attitude; one module per format."""

from rotorfit.logs.mocap.motive import is_motive as is_motive
from rotorfit.logs.mocap.motive import read_motive as read_motive
from rotorfit.logs.mocap.qualisys import is_qualisys as is_qualisys
from rotorfit.logs.mocap.qualisys import read_qualisys as read_qualisys
from rotorfit.logs.mocap.trajectory import is_trajectory as is_trajectory
from rotorfit.logs.mocap.trajectory import read_trajectory as read_trajectory
from rotorfit.logs.mocap.vicon import is_vicon as is_vicon
from rotorfit.logs.mocap.vicon import read_vicon as read_vicon
