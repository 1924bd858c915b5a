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


def independent_parts(chain: ClosedChain) -> list[Part]:
    """Split a chain into loops and couplings that share no joint.

    Parameters
    ----------
    chain
        Closed chain, loops perhaps open.

    Returns
    -------
    list of Part
        In the order of their first rows; joints in no loop and no coupling are in none.
    """
    groups = _groups(chain)
    everything = Part(chain, np.arange(chain.nq), tuple(chain.model.names)[1:])
    if len(groups) == 1 and groups[0][1].all():
        return [everything]
    # A loop between links that nothing moves closes or not, whatever the others do: it goes with the first of them.
    still = [rows for rows, entries in groups if not entries.any()]
    moving = [(rows, entries) for rows, entries in groups if entries.any()]
    if not moving:
        return [everything] if still else []
    moving[0] = (np.logical_or.reduce([moving[0][0], *still]), moving[0][1])
    return [_part(chain, rows, entries) for rows, entries in moving]


def _part(chain: ClosedChain, rows: BoolArray, entries: BoolArray) -> Part:
    """Leave out of a chain what has nothing to do with some rows: which rows move, none of the rest changes."""
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


def _groups(chain: ClosedChain) -> list[tuple[BoolArray, BoolArray]]:
    """Rows and tangent entries of each set of loops that share joints with no other set."""
    touched = chain.loop_table.row_difference != 0
    coupling = chain.loop_table.coupling
    for k, row in enumerate(coupling.index):
        touched[row, [entry for entry in (coupling.v1[k], coupling.v2[k]) if entry >= 0]] = True
        touched[row] |= coupling.ratios_v[k] != 0
    # Entries of one joint move together.
    for joint in chain.model.joints[1:]:
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        touched[:, own] = touched[:, own].any(axis=1, keepdims=True)
    left = np.ones(chain.nc, dtype=bool)
    groups: list[tuple[BoolArray, BoolArray]] = []
    while left.any():
        rows = np.zeros(chain.nc, dtype=bool)
        rows[np.argmax(left)] = True
        while True:
            entries = touched[rows].any(axis=0)
            more = touched[:, entries].any(axis=1) | rows
            if (more == rows).all():
                break
            rows = more
        groups.append((rows, entries))
        left &= ~rows
    return groups
