"""Safe YAML: one mapping of names to lists of names; nothing is constructed, no aliases, each key once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stewart_pin.errors import FileFormatError, FileMissingError, MissingExtraError

_DEEPEST = 3
"""A mapping, of lists, of pairs."""

Names = list[str]
"""A list of the file."""


def read_lists(path: Path) -> dict[str, list[str | Names]]:
    """Read a file of lists.

    Scalars stay the text of the file, so that a joint may be called ``on`` or ``1``.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    dict
        Per key its list; entries are text, or lists of text.

    Raises
    ------
    FileFormatError
        If the file is missing or broken, holds anything else, an alias, or a key twice.
    MissingExtraError
        If PyYAML is not installed.
    """
    try:
        import yaml  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("pyyaml", "yaml") from None
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise FileMissingError("no such file", path=str(path)) from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileFormatError(f"the file cannot be read as UTF-8 text: {error}", path=str(path)) from None
    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise FileFormatError("aliases (*name) are refused", path=str(path), culprit="*")
            # Refused at the first event: the parser's time goes with the square of the depth.
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise FileFormatError("lists are nested too deep", path=str(path), culprit="[")
        # Nodes, not objects: constructing would guess types; SafeLoader parses without running anything.
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise FileFormatError(f"not well-formed YAML: {reason}", path=str(path)) from None
    return _Reader(path).mapping(root)


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, text: str, node: Any) -> FileFormatError:
        return FileFormatError(
            f"{text} (line {node.start_mark.line + 1})", path=str(self.path), culprit="YAML"
        )

    def mapping(self, root: Any) -> dict[str, list[str | Names]]:
        if root is None:
            raise FileFormatError("the file is empty", path=str(self.path))
        if root.id != "mapping":
            raise self.error("the file must hold keys with lists", root)
        found: dict[str, list[str | Names]] = {}
        for key, value in root.value:
            name = self.scalar(key)
            if name in found:
                raise self.error(f"the key '{name}' stands there twice; keep one", key)
            if value.id != "sequence":
                raise self.error(f"'{name}' must hold a list", value)
            found[name] = [self.entry(each) for each in value.value]
        return found

    def entry(self, node: Any) -> str | Names:
        return [self.scalar(each) for each in node.value] if node.id == "sequence" else self.scalar(node)

    def scalar(self, node: Any) -> str:
        if node.id != "scalar" or not node.value:
            raise self.error("a name is missing", node)
        return node.value
