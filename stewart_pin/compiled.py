"""Kernels: a chain, or a function of your own, as compiled programs for arrays of states."""

from stewart_pin.kernels.kernels import KernelReport as KernelReport
from stewart_pin.kernels.kernels import Kernels as Kernels
from stewart_pin.kernels.kernels import PlanBlock as PlanBlock
from stewart_pin.programs.array_kernel import ArrayKernel as ArrayKernel
from stewart_pin.programs.arrays import SingleState as SingleState
from stewart_pin.programs.repeating import Repeat as Repeat
from stewart_pin.programs.status import StateBound as StateBound
from stewart_pin.programs.status import StateStatus as StateStatus
