"""ROS recordings to a FlightLog: ROS 1 bags, ROS 2 SQLite bags and MCAP."""

from rotorfit.logs.rosbag.container import is_rosbag as is_rosbag
from rotorfit.logs.rosbag.container import is_rosbag_folder as is_rosbag_folder
from rotorfit.logs.rosbag.read import read_rosbag as read_rosbag
