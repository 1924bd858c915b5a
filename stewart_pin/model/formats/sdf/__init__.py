"""SDFormat 1.3 to 1.12, as Gazebo Classic, Gazebo and Drake write it."""

from stewart_pin.model.formats.sdf.mechanism import read_sdf as read_sdf
