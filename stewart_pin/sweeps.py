"""Records of questions over many states."""

from stewart_pin.studies.answers import FailedPoint as FailedPoint
from stewart_pin.studies.answers import Sweep as Sweep
from stewart_pin.studies.comparison import Comparison as Comparison
