"""Print the table robots × laws: how many cases of each law hold for each robot and each kind of closure.

Run by hand; it runs the tests of ``tests/laws`` and sorts what they say::

    python -m tests.benchmarks.laws
"""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

LAWS = Path(__file__).parent.parent / "laws"


class Tally:
    """Counts outcomes by robot and module, as a pytest plugin."""

    def __init__(self) -> None:
        self.robots: dict[str, str] = {}
        self.counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
        self.laws: dict[str, str] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Remember which robot each test is about."""
        for item in items:
            parameters = getattr(getattr(item, "callspec", None), "params", {})
            robot = parameters.get("chain", parameters.get("name"))
            if robot is not None:
                self.robots[item.nodeid] = str(robot)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count the outcome of a test."""
        robot = self.robots.get(report.nodeid)
        if robot is not None and (report.when == "call" or report.outcome == "skipped"):
            law = Path(report.nodeid.split("::")[0]).stem.removeprefix("test_")
            self.counts[robot, law][report.outcome] += 1


def main() -> None:
    """Run the laws and print the table."""
    tally = Tally()
    pytest.main(["-q", "--no-header", "--tb=line", "-p", "no:cacheprovider", str(LAWS)], plugins=[tally])
    laws = sorted({law for _, law in tally.counts})
    table = Table(title="cases that hold (failed: in red; not applicable: after a plus)")
    table.add_column("robot")
    for law in laws:
        table.add_column(law.replace("_", " "), justify="right")
    for robot in dict.fromkeys(robot for robot, _ in tally.counts):
        cells = []
        for law in laws:
            count = tally.counts[robot, law]
            text = f"{count['passed']}" + (f"+{count['skipped']}" if count["skipped"] else "")
            cells.append(f"{text} [red]{count['failed']}[/red]" if count["failed"] else text)
        table.add_row(robot, *cells)
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
