"""Catalogue of a fleet: tables of all surfaces, objects, walls and signs, queried in SQL.

When a map's task ends, it atomically writes one file per table. From time to time these files are
merged into one. A map's own file overrides its rows in the merged file, so that a reader finds each
map exactly once at any time.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from tccm_ros.atomic import output_file
from tccm_ros.errors import FleetError, OutputError, one_line
from tccm_ros.fleet.tables import TABLES, Table, read_source
from tccm_ros.report.tables import text_table

MAX_FILES = 20
"""Maximum number of unmerged files of a table. Chosen: each costs a query a millisecond of
processor time."""

MAX_WIDTH = 60
"""Maximum number of characters of a value in a terminal; ``--json`` prints all."""

TRIES = 5
"""Number of attempts at a query, which fails if files are merged meanwhile."""


@dataclass(frozen=True, slots=True)
class QueryResult:
    """Result of a query.

    Attributes
    ----------
    columns
        Column names.
    rows
        Rows, one tuple each.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"columns": self.columns, "rows": [[_plain(v) for v in row] for row in self.rows]}

    def text(self) -> str:
        """Return the result as a table for a terminal."""
        cells = [[_shown(v) for v in row] for row in self.rows]
        rules = ["-" * max(map(len, column)) for column in zip(self.columns, *cells)]
        return text_table([self.columns, rules, *cells])


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):  # a geometry
        with suppress(shapely.errors.GEOSException):
            return shapely.to_wkt(shapely.from_wkb(value))
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _shown(value: Any) -> str:
    if value is None:
        return ""
    text = f"{value:.3f}" if isinstance(value, float) else str(_plain(value))
    return text if len(text) <= MAX_WIDTH else text[: MAX_WIDTH - 3] + "..."


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The catalogue in a folder.

    Attributes
    ----------
    path
        Its folder. Each table is a subfolder with a file per map, and a file next to it with the
        merged rows.
    """

    path: Path

    def add(self, name: str, folder: Path, final: Path | None = None) -> None:
        """Write the rows of a map, replacing its older ones.

        Parameters
        ----------
        name
            Name of the map.
        folder
            Its result folder.
        final
            Final path of that folder, if it will be moved.

        Raises
        ------
        MapError
            If its files are missing or damaged.
        OutputError
            If the catalogue cannot be written.
        """
        source = replace(read_source(name, folder), folder=final or folder)
        for table in TABLES:
            with output_file(self._file(table, name)) as made:
                pq.write_table(table.of(source), made)

    def gather(self, *, max_files: int = MAX_FILES) -> None:
        """Merge the files of each table that has more than `max_files`.

        Raises
        ------
        OutputError
            If the catalogue cannot be written.
        """
        if not self.path.is_dir():
            return
        with self._lock():
            for table in TABLES:
                files = self._files(table)
                if len(files) > max_files:
                    self._gather(table, files)

    def _gather(self, table: Table, files: list[Path]) -> None:
        try:
            states = {file: file.stat() for file in files}
            parts = [pq.read_table(file) for file in files]
            gathered = self._gathered(table)
            if gathered.exists():
                older = pq.read_table(gathered)
                replaced = pa.array([file.stem for file in files])
                parts.insert(0, older.filter(pc.invert(pc.is_in(older["map"], replaced))))
            rows = pa.concat_tables(parts, promote_options="default")
            with output_file(gathered) as made:
                pq.write_table(rows.replace_schema_metadata(table.schema.metadata), made)
            for file, state in states.items():
                with suppress(FileNotFoundError):
                    if file.stat().st_ino == state.st_ino:  # not replaced meanwhile
                        file.unlink()
        except (OSError, pa.ArrowInvalid) as error:
            raise OutputError(f"{self.path}: cannot be gathered ({one_line(error)})") from None

    def ask(self, query: str) -> QueryResult:
        """Run a query on the tables ``surfaces``, ``objects``, ``walls`` and ``signs``.

        Parameters
        ----------
        query
            SQL in DuckDB's dialect.

        Raises
        ------
        FleetError
            If there is no catalogue, or the query fails.
        """
        if not self.path.is_dir():
            raise FleetError(f"{self.path}: no catalogue; 'tccm fleet --out DIR' writes one")
        for last in range(TRIES - 1, -1, -1):
            try:
                return self._ask(query)
            except duckdb.IOException as error:
                if not last:
                    raise FleetError(f"{self.path}: {one_line(error)}") from None
            except duckdb.Error as error:
                raise FleetError(f"query: {one_line(error)}") from None
        raise AssertionError

    def _ask(self, query: str) -> QueryResult:
        with duckdb.connect() as database:
            for table in TABLES:
                if table.name in query.lower():  # opening the files of a table takes time
                    self._open(database, table)
            found = database.execute(query)
            columns = tuple(column[0] for column in found.description or ())
            return QueryResult(columns, tuple(found.fetchall()))

    def _open(self, database: duckdb.DuckDBPyConnection, table: Table) -> None:
        """Define a table as the maps' own files and the merged rows of all other maps."""
        database.register(f"_{table.name}", table.schema.empty_table())
        parts = [f"SELECT * FROM _{table.name}"]
        files = self._files(table)  # list these first: otherwise a concurrent merge loses rows
        if files:
            database.register("_own", pa.table({"map": [file.stem for file in files]}))
            database.execute(f"CREATE TABLE _own_{table.name} AS SELECT map FROM _own")
            names = ", ".join(_quoted(str(file)) for file in files)
            parts.append(f"SELECT * FROM read_parquet([{names}], union_by_name = true)")
        gathered = self._gathered(table)
        if gathered.exists():
            only = f" WHERE map NOT IN (SELECT map FROM _own_{table.name})" if files else ""
            parts.append(f"SELECT * FROM read_parquet({_quoted(str(gathered))}){only}")
        database.execute(f"CREATE VIEW {table.name} AS " + " UNION ALL BY NAME ".join(parts))

    def _file(self, table: Table, name: str) -> Path:
        return self.path / table.name / f"{name}.parquet"

    def _gathered(self, table: Table) -> Path:
        return self.path / f"{table.name}.parquet"

    def _files(self, table: Table) -> list[Path]:
        return sorted((self.path / table.name).glob("[!.]*.parquet"))

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """Allow one process at a time to merge."""
        with (self.path / ".lock").open("a") as file:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
            yield


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
