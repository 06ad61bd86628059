"""Folder structure of a fleet: results, failures, catalogue and page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

RECORD = "fleet.json"
"""File in the folder of each recording with the inputs of its results (`fleet.record`)."""


@dataclass(frozen=True, slots=True)
class FleetFolder:
    """Folder of a fleet.

    Attributes
    ----------
    path
        The folder.
    """

    path: Path

    @property
    def recordings(self) -> Path:
        """Folder with a result folder for each replayed recording."""
        return self.path / "recordings"

    @property
    def failures(self) -> Path:
        """Folder with a file for each failed recording."""
        return self.path / "failures"

    @property
    def catalogue(self) -> Path:
        """Folder of the catalogue, with a subfolder per table and a file per recording in it."""
        return self.path / "catalogue"

    @property
    def page(self) -> Path:
        """HTML page of the fleet."""
        return self.path / "index.html"

    def results(self, name: str) -> Path:
        """Return the result folder of a recording."""
        return self.recordings / name

    def failure(self, name: str) -> Path:
        """Return the file with the reason for a recording's failure."""
        return self.failures / f"{name}.json"
