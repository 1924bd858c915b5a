"""Which file an ``<include>`` means: one in the folder of the file that was opened, and no other."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.formats.xml import ElementReader, read_xml

_MODELS = "model://"


class IncludedFiles:
    """The folder of a file, in which what it includes is looked up.

    ``model://arm`` is the folder ``arm`` there, as a simulator finds it whose model path is that folder; a relative
    path starts beside the file that includes.

    Parameters
    ----------
    folder
        Folder of the file that was opened.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, reader: ElementReader, uri: str, owner: str) -> Path:
        """Find an included file.

        Parameters
        ----------
        reader
            Reader of the file that includes it.
        uri
            What stands in ``<uri>``.
        owner
            Named in the message.

        Returns
        -------
        pathlib.Path
            The file, which need not exist.

        Raises
        ------
        FileFormatError
            If a folder's model.config names no file.
        UnsupportedError
            If it would lie elsewhere.
        """
        by_name = uri.startswith(_MODELS)
        plain = uri.removeprefix(_MODELS).removeprefix("file://")
        start = self.folder if by_name else Path(reader.path).parent
        if "://" in plain or self._leads_away(start, plain):
            raise UnsupportedError(
                f"{reader.path}: {owner}: '{uri}' may lie anywhere, and only files within {self.folder} are opened; "
                "give the path of the file relative to this one, or put its <model> here"
            )
        if by_name and not (start / plain).exists():
            raise UnsupportedError(
                f"{reader.path}: {owner}: '{uri}' would be looked up in a simulator's model path; give the path of the "
                f"file relative to this one, or put its <model> here, or its folder as '{plain}' into {self.folder}"
            )
        path = start / plain
        if not path.is_dir():
            return path
        # A folder says in model.config which file holds the model; the newest format comes last.
        files: Iterable[etree._Element] = read_xml(path / "model.config").findall("sdf")

        def age(element: etree._Element) -> list[int]:
            return [int(part) if part.isdecimal() else 0 for part in element.get("version", "").split(".")]

        newest = max(files, key=age, default=None)
        name = "" if newest is None else (newest.text or "").strip()
        if not name or self._leads_away(path, name):
            raise reader.error(f"{owner}: {path / 'model.config'} names no <sdf> file beside it", uri)
        return path / name

    def _leads_away(self, start: Path, plain: str) -> bool:
        """Tell a path that is absolute, climbs, or leaves the folder by a link."""
        steps = PurePosixPath(plain.replace("\\", "/"))
        if steps.is_absolute() or ".." in steps.parts or Path(plain).is_absolute():
            return True
        return not (start / plain).resolve().is_relative_to(self.folder.resolve())
