"""Motions of platforms: profiles, earthquakes, recorded accelerations, what motors need for them."""

from stewart_pin.motion.earthquakes import Accelerogram as Accelerogram
from stewart_pin.motion.earthquakes import accelerogram as accelerogram
from stewart_pin.motion.earthquakes import correct_baseline as correct_baseline
from stewart_pin.motion.earthquakes import earthquake_motion as earthquake_motion
from stewart_pin.motion.earthquakes import read_at2 as read_at2
from stewart_pin.motion.earthquakes import read_columns as read_columns
from stewart_pin.motion.earthquakes import response_spectrum as response_spectrum
from stewart_pin.motion.earthquakes import synthetic_accelerogram as synthetic_accelerogram
from stewart_pin.motion.motor_demand import MotorDemand as MotorDemand
from stewart_pin.motion.shake_table import FitReport as FitReport
from stewart_pin.motion.trajectories import PlatformSamples as PlatformSamples
from stewart_pin.motion.trajectories import chirp_motion as chirp_motion
from stewart_pin.motion.trajectories import minimum_jerk_motion as minimum_jerk_motion
from stewart_pin.motion.trajectories import sample_times as sample_times
from stewart_pin.motion.trajectories import sinusoidal_motion as sinusoidal_motion
from stewart_pin.motion.trajectories import spline_motion as spline_motion
