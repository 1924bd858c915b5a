"""Place an object file for 64-bit Arm in memory and fill in the addresses that it leaves open, as a linker would.

References
----------
.. [1] "ELF for the Arm 64-bit Architecture" (AAELF64), section 5.7: relocations. Mach-O's do the same by other names.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import pytest

lief = pytest.importorskip("lief", reason="needs LIEF: pip install 'stewart_pin[oracles]'")

PAGE = 0x1000
CODE, LIBRARY = 0x1_2345_0000, 0x1_2745_0000
"""Above 32 bits, so that an address cut short is no address; as near as a call reaches."""
_CALL = {"AARCH64_CALL26", "BRANCH26"}
_PAGE_OF = {"AARCH64_ADR_PREL_PG_HI21", "AARCH64_ADR_GOT_PAGE", "GOT_LOAD_PAGE21"}
_IN_PAGE = {"AARCH64_LDST64_ABS_LO12_NC", "AARCH64_LD64_GOT_LO12_NC", "GOT_LOAD_PAGEOFF12"}
_QUARTER = {f"AARCH64_MOVW_UABS_G{k}{end}": k for k, end in enumerate(("_NC", "_NC", "_NC", ""))}


@dataclass(frozen=True)
class Placed:
    """An object file in memory.

    `regions` gives for each address what lies there and whether it is code, `entry` is where ``run`` begins, `library`
    tells which functions of the C library are expected where.
    """

    regions: dict[int, tuple[bytes, bool]]
    entry: int
    library: dict[int, str]


def place_object(content: bytes) -> Placed:
    """Place each section on pages of its own."""
    binary: Any = lief.parse(content)
    sections = list(binary.sections)
    contents: dict[int, bytearray] = {}
    places: dict[int, int] = {}
    following = CODE
    for k, section in enumerate(sections):
        if section.size and _is_loaded(section):
            contents[k] = bytearray(section.content).ljust(-(-section.size // PAGE) * PAGE, b"\0")
            places[k] = following
            following += len(contents[k]) + PAGE
    symbols = _Symbols(places, following)
    for relocation in binary.relocations:
        k = next(i for i in places if sections[i].name == relocation.section.name)
        kind, offset = relocation.type.name, relocation.address
        if isinstance(binary, lief.MachO.Binary):
            offset -= sections[k].offset  # LIEF counts from the beginning of the file there
        value = symbols.address(relocation.symbol) + getattr(relocation, "addend", 0)
        if "GOT" in kind:
            value = symbols.slot(value)
        _fill_in(contents[k], offset, places[k] + offset, kind, value)
    entry = next(symbols.address(s) for s in binary.symbols if s.name.lstrip("_") == "run")
    regions = {places[k]: (bytes(text), _is_code(sections[k])) for k, text in contents.items()}
    regions[symbols.table] = struct.pack(f"<{len(symbols.slots)}Q", *symbols.slots), False
    return Placed(regions, entry, {at: name for name, at in symbols.library.items()})


class _Symbols:
    """Addresses of symbols, given to those of the C library as they come, and a table of addresses for far ones."""

    def __init__(self, places: dict[int, int], table: int) -> None:
        self.places = places
        self.table = table
        self.slots: list[int] = []
        self.library: dict[str, int] = {}

    def address(self, symbol: Any) -> int:
        macho = isinstance(symbol, lief.MachO.Symbol)
        section = symbol.numberof_sections - 1 if macho else symbol.shndx
        if section == (-1 if macho else 0):
            name = symbol.name.removeprefix("_") if macho else symbol.name
            return self.library.setdefault(name, LIBRARY + 4 * (len(self.library) + 1))
        return self.places[section] + symbol.value

    def slot(self, value: int) -> int:
        if value not in self.slots:
            self.slots.append(value)
        return self.table + 8 * self.slots.index(value)


def _is_loaded(section: Any) -> bool:
    if isinstance(section, lief.MachO.Section):
        return section.segment_name == "__TEXT"
    return section.has(lief.ELF.Section.FLAGS.ALLOC)


def _is_code(section: Any) -> bool:
    if isinstance(section, lief.MachO.Section):
        return section.has(lief.MachO.Section.FLAGS.SOME_INSTRUCTIONS)
    return section.has(lief.ELF.Section.FLAGS.EXECINSTR)


def _fill_in(content: bytearray, offset: int, place: int, kind: str, value: int) -> None:
    """Put an address into the instruction that is there, which must be one that takes such an address."""
    word = int.from_bytes(content[offset : offset + 4], "little")
    if kind in _CALL:
        distance = value - place
        assert word == 0x9400_0000, "bl"
        assert distance % 4 == 0
        assert -(2**27) <= distance < 2**27
        word |= distance // 4 % 2**26
    elif kind in _PAGE_OF:
        pages = value // PAGE - place // PAGE
        assert word & ~0x1F == 0x9000_0000, "adrp"
        assert -(2**20) <= pages < 2**20
        word |= pages % 4 << 29 | pages // 4 % 2**19 << 5
    elif kind in _IN_PAGE:
        assert word & ~0x3FF in {0xF940_0000, 0xFD40_0000}, "ldr of 8 bytes"
        assert value % 8 == 0
        word |= value % PAGE // 8 << 10
    else:
        k = _QUARTER[kind]
        assert word & ~0x1F in {0xD280_0000 | k << 21, 0xF280_0000 | k << 21}, "movz or movk"
        word |= (value >> 16 * k) % 2**16 << 5
    content[offset : offset + 4] = word.to_bytes(4, "little")
