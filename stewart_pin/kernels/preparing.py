"""All passes in the order that pays."""

from __future__ import annotations

from stewart_pin.kernels.fusing import fuse
from stewart_pin.kernels.passes import simplify
from stewart_pin.kernels.program import Program
from stewart_pin.kernels.reciprocals import share_reciprocals


def prepare(program: Program) -> Program:
    """Make a program short for the machine.

    Parameters
    ----------
    program
        Program as it was read.

    Returns
    -------
    Program
        With few divisions, free signs, shared operations and fused multiply-adds: the same values within round-off.

    Notes
    -----
    The order of the operations stays. Orders that keep fewer values alive at a time were tried and gave nothing: the
    compiler puts what does not fit the registers on the stack, which the processor hides.
    """
    return fuse(simplify(share_reciprocals(simplify(program))))
