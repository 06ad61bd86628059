"""Parse each interface file once for all generators of a build, which are processes.

`generate_interfaces.py` puts this folder on PYTHONPATH and names the folder of parsed files. The
parser takes most of a generator's time, and each of six generators parses every file.
"""

import hashlib
import os
import pickle
from contextlib import suppress
from pathlib import Path

with suppress(ImportError):
    from rosidl_parser import parser

    folder, parse = Path(os.environ["PARSED_INTERFACES"]), parser.get_ast_from_idl_string

    def parse_once(text):
        """Return the syntax tree of a file, from disk if a generator has parsed it."""
        path = folder / hashlib.sha256(text.encode()).hexdigest()
        with suppress(OSError):
            return pickle.loads(path.read_bytes())
        tree = parse(text)
        unfinished = path.with_suffix(f".{os.getpid()}")
        unfinished.write_bytes(pickle.dumps(tree))
        unfinished.replace(path)
        return tree

    parser.get_ast_from_idl_string = parse_once
