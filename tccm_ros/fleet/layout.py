"""The folder of a fleet: where results, failures, the catalogue and the page are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

RECORD = "fleet.json"
"""In the folder of each recording: what its results were made from (`fleet.record`)."""


@dataclass(frozen=True, slots=True)
class FleetFolder:
    """The folder of a fleet.

    Attributes
    ----------
    path
        The folder.
    """

    path: Path

    @property
    def recordings(self) -> Path:
        """Folder with a result folder for each recording that was replayed."""
        return self.path / "recordings"

    @property
    def failures(self) -> Path:
        """Folder with a file for each recording that was set aside."""
        return self.path / "failures"

    @property
    def catalogue(self) -> Path:
        """Folder of the catalogue: a folder for each table, in it a file for each recording."""
        return self.path / "catalogue"

    @property
    def page(self) -> Path:
        """The page of the fleet."""
        return self.path / "index.html"

    def results(self, name: str) -> Path:
        """Return the result folder of a recording."""
        return self.recordings / name

    def failure(self, name: str) -> Path:
        """Return the file that says why a recording was set aside."""
        return self.failures / f"{name}.json"
