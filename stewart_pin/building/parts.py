"""Parts of a chain that share no loop: each can be closed, moved and judged as a chain of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stewart_pin.model.description import JointKind
from stewart_pin.model.tree import build_tree
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import BoolArray


@dataclass(frozen=True, eq=False)
class Part:
    """Loops and couplings that share no joint with others, as a chain of their own.

    Attributes
    ----------
    chain
        The links that carry them; joints between these that move none of the loops are fixed.
    at
        (k,) where its configuration stands in that of the whole [index].
    joints
        Names of its joints that move.
    """

    chain: ClosedChain
    at: np.ndarray
    joints: tuple[str, ...]


def part_of(chain: ClosedChain, rows: BoolArray, entries: BoolArray) -> Part:
    """Leave out of a chain what has nothing to do with some of its loops.

    Parameters
    ----------
    chain
        Closed chain, loops perhaps open.
    rows
        (nc,) rows of these loops and couplings.
    entries
        (nv,) tangent entries that move them.

    Returns
    -------
    Part
        A chain whose loops are open by the same gaps.
    """
    old, table = chain.mechanism, chain.loop_table
    names = tuple(
        name
        for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
        if entries[joint.idx_v]
    )
    loops = tuple(loop for loop, own in zip(old.loops, table.slices, strict=True) if rows[own].any())
    couplings = tuple(
        coupling for coupling, row in zip(old.couplings, table.coupling.index, strict=True) if rows[row]
    )
    above = {joint.child: joint for joint in old.joints}
    wanted = {old.root}
    ends = [link for loop in loops for link in (loop.link1, loop.link2)]
    for link in [*ends, *(joint.child for joint in old.joints if joint.name in names)]:
        while link not in wanted:
            wanted.add(link)
            link = above[link].parent
    mechanism = replace(
        old,
        links=tuple(link for link in old.links if link.name in wanted),
        joints=tuple(
            joint if joint.name in names else replace(joint, kind=JointKind.FIXED)
            for joint in old.joints
            if joint.child in wanted
        ),
        loops=loops,
        couplings=couplings,
        platform=None,
        home={name: values for name, values in old.home.items() if name in names},
        notes=(),
    )
    model = build_tree(mechanism, chain.gravity)
    part = ClosedChain(mechanism, model, (), None, np.zeros(model.nq))
    part.__dict__["length_scale"] = chain.length_scale
    whole = [chain.model.joints[chain.model.getJointId(name)] for name in model.names[1:]]
    at = np.concatenate([np.arange(joint.idx_q, joint.idx_q + joint.nq) for joint in whole])
    return Part(part, at, names)
