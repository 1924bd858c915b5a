"""Records of questions over many states."""

from stewart_pin.studies.comparison import Comparison as Comparison
from stewart_pin.studies.record import FailedPoint as FailedPoint
from stewart_pin.studies.record import Sweep as Sweep
