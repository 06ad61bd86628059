"""Find words of the project's own making where the field has a word (`make lint`).

Usage: python tools/check_words.py [--all] [--lines]

The words, the field's words and the exceptions are in tools/words.toml. Documentation is checked by
default, line by line. ``--all`` checks the code as well (names, docstrings, comments, messages) and
prints how often each word is found in each file; with ``--lines`` every place. Exit status 1 where
anything is found.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
WORDS = ROOT / "tools" / "words.toml"

DOCUMENTS = ("*.md", "*.rst", "*.cff", "docs/**/*.md", "bags/**/*.md", "interfaces/**/*.md")
CODE = ("tccm_ros/**/*.py", "test/**/*.py", "bench/**/*.py", "tools/**/*.py", "launch/*.py")

CODE_IN_TEXT = re.compile(r"`[^`]*`|\]\([^)]*\)|<!--.*?-->|https?://\S+")
"""What is no sentence in a line of a document: names, targets of links, marks."""

PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
"""Words in an identifier."""


class Found(NamedTuple):
    """A private word in a line of a file."""

    path: str
    line: int
    private: str
    field: str


@dataclass(frozen=True)
class Word:
    """One entry of words.toml."""

    private: str
    field: str
    names: tuple[str, ...]
    modules: tuple[str, ...]
    text: re.Pattern[str] | None

    def is_in_name(self, name: str) -> bool:
        """Return whether an identifier contains the word."""
        parts = "_".join(["", *PARTS.findall(name), ""]).lower()
        return any(f"_{pattern}_" in parts for pattern in self.names)

    def is_in_text(self, text: str) -> bool:
        """Return whether a sentence contains the word."""
        return self.text is not None and self.text.search(text) is not None


class Checker:
    """The words and exceptions of a words.toml."""

    def __init__(self, path: Path = WORDS):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        self.words = [_word(entry) for entry in table["word"]]
        self.exceptions = table["exception"]

    def check(self, path: str, source: str) -> list[Found]:
        """Return what is found in a file, in the order of its lines.

        Parameters
        ----------
        path
            Relative to the repository: exceptions name it, ``.py`` is read as Python.
        source
            The content.
        """
        found = set(self._python(path, source) if path.endswith(".py") else self._text(source))
        lines = source.split("\n")
        return [
            Found(path, line, word.private, word.field)
            for line, word in sorted(found, key=lambda f: (f[0], f[1].private))
            if not self._is_exception(path, lines[line - 1])
        ]

    def _is_exception(self, path: str, line: str) -> bool:
        return any(
            fnmatch(path, entry["files"]) and re.search(entry.get("line", ""), line)
            for entry in self.exceptions
        )

    def _text(self, source: str) -> Iterator[tuple[int, Word]]:
        is_code = False
        for number, line in enumerate(source.split("\n"), 1):
            if line.lstrip().startswith("```"):
                is_code = not is_code
            elif not is_code:
                yield from self._sentence(number, CODE_IN_TEXT.sub(" ", line))

    def _sentence(self, number: int, text: str) -> Iterator[tuple[int, Word]]:
        yield from ((number, word) for word in self.words if word.is_in_text(text.lower()))

    def _python(self, path: str, source: str) -> Iterator[tuple[int, Word]]:
        stem = Path(path).stem
        for word in self.words:
            if stem in word.modules or word.is_in_name(stem):
                yield 1, word
        for number, name in _names(ast.parse(source)):
            yield from ((number, word) for word in self.words if word.is_in_name(name))
        for number, text in _texts(source):
            yield from self._sentence(number, CODE_IN_TEXT.sub(" ", text))


def _word(entry: dict[str, object]) -> Word:
    text = entry.get("text")
    names, modules = entry.get("names", ()), entry.get("modules", ())
    return Word(
        str(entry["private"]),
        str(entry["field"]),
        tuple(names) if isinstance(names, list) else (),
        tuple(modules) if isinstance(modules, list) else (),
        re.compile(str(text)) if text else None,
    )


def _names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the names that a module gives, where it gives them; not those that it only uses."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def _texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield comments, and strings of more than one word, line by line."""
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", -1)}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in kinds and " " in token.string.strip():
            for k, line in enumerate(token.string.split("\n")):
                yield token.start[0] + k, line


def files(patterns: Sequence[str]) -> list[Path]:
    """Return the files of the repository that match, sorted."""
    found = {path for pattern in patterns for path in ROOT.glob(pattern)}
    return sorted(path for path in found if path.is_file())


def main() -> int:
    """Check, print and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="check the code as well")
    parser.add_argument("--lines", action="store_true", help="print every place, also with --all")
    options = parser.parse_args()
    checker = Checker()
    found: list[Found] = []
    for path in files(DOCUMENTS + (CODE if options.all else ())):
        name = str(path.relative_to(ROOT))
        found += checker.check(name, path.read_text(encoding="utf-8"))
    if options.lines or not options.all:
        for place in found:
            print(f"{place.path}:{place.line}: {place.private}: write {place.field}")
    else:
        counts = Counter((place.path, place.private) for place in found)
        for (path, private), number in sorted(counts.items()):
            print(f"{number:5}  {private:<28}  {path}")
    if found:
        print(f"{len(found)} private words; exceptions and reasons go into tools/words.toml")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
